"""The purely visual parts of a table: rubber, wood, pockets, lines, spots, legs.

Everything here is in the default class `fixture`, without contacts. Shapes are swept or sliced into meshes: a cushion
is a profile swept along its nose, rounded at the jaws; the frame is mitred and cut out around the pockets. Sizes are
those of no make in particular; lines and spots follow the rules of snooker, scaled by the table's length.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from models.shot import NOSE_HEIGHT, Array, Table
from models.table.pocket_shape import SNOOKER_POCKETS
from models.table.snooker import D_RADIUS_M, FULL_LENGTH, is_snooker, spots

RUBBER_END_M, FRAME_END_M = 0.05, 0.13  # where the rubber ends and the frame ends, from the nose line [m]
RUBBER_BACK_M = RUBBER_END_M + 0.004  # where the rubber ends under the frame [m]
BEVEL_M = 0.008  # bevel of the frame
LIP_HEIGHT_M = 0.006  # height of the frame above the nose
FRAME_DEPTH_M = 0.16  # depth of the frame [m]
TABLE_HEIGHT_M = 0.86  # height of the playing surface above the floor
CORNER_POCKET, MIDDLE_POCKET = (0.012, 0.052), (0.040, 0.048)  # of snooker: centre beyond the nose line, radius [m]
LEATHER_THICKNESS_M = 0.007  # thickness [m]
CORNER_ROUNDING, MIDDLE_ROUNDING = (0.055, 0.95), (0.022, 1.3)  # of snooker's jaws: radius [m], angle [rad]
MIN_ROUNDING_M = 0.002  # radius of a sharp nose as drawn
ARC_PIECES = 24  # pieces of a rounding


def _mesh(spec: mujoco.MjSpec, name: str, material: str, vertices: Array, faces: Array) -> None:
    """A closed surface, its faces turned outward."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    faces, a, normal, size = faces[size > 1e-9], a[size > 1e-9], normal[size > 1e-9], size[size > 1e-9]
    if np.sum(a * normal) < 0:
        faces, normal = faces[:, ::-1], -normal
    flat = np.repeat(np.arange(len(faces)), 3)  # normals averaged over thin faces would catch light
    mesh = spec.add_mesh(
        name=name,
        uservert=np.ravel(vertices),
        userface=np.ravel(faces),
        usernormal=np.ravel(normal / size[:, None]),
        userfacenormal=flat,
    )
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(
        spec.find_default("fixture"), name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=material
    )


def _grid(spec: mujoco.MjSpec, name: str, material: str, grid: Array) -> None:
    """A solid of n sections of m points each (n, m, 3), every section a closed polygon, both ends capped."""
    n, m = grid.shape[:2]
    faces = []
    for i in range(n - 1):
        for j in range(m):
            a, b = i * m + j, i * m + (j + 1) % m
            faces += [(a, b, b + m), (a, b + m, a + m)]
    for j in range(1, m - 1):
        faces += [(0, j + 1, j), ((n - 1) * m, (n - 1) * m + j, (n - 1) * m + j + 1)]
    _mesh(spec, name, material, grid.reshape(-1, 3), np.array(faces))


def _sweep(
    spec: mujoco.MjSpec, name: str, material: str, path: Array, normal: Array, profile: Sequence[Sequence[float]]
) -> None:
    """A profile of (offset along the normal, height) swept along a path (n, 2) with its normals (n, 2)."""
    shape = np.array(profile, float)
    flat = path[:, None, :] + shape[None, :, :1] * normal[:, None, :]
    grid = np.concatenate([flat, np.broadcast_to(shape[:, 1:], (*flat.shape[:2], 1))], axis=2)
    _grid(spec, name, material, grid)


def _turn(angles: Array) -> Array:
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _box(spec: mujoco.MjSpec, name: str, material: str, low: Sequence[float], high: Sequence[float]) -> None:
    a, b = np.array(low, float), np.array(high, float)
    spec.worldbody.add_geom(
        spec.find_default("fixture"), name=name, material=material, size=(b - a) / 2, pos=(a + b) / 2
    )


def _disc(spec: mujoco.MjSpec, name: str, material: str, xy: Array, radius: float, low: float, high: float) -> None:
    spec.worldbody.add_geom(
        spec.find_default("fixture"),
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        material=material,
        size=[radius, (high - low) / 2, 0],
        pos=[*xy, (low + high) / 2],
    )


def _rounding(table: Table, point: Array) -> tuple[float, float]:
    """Radius [m] and angle [rad] by which a cushion's end is rounded, in proportion to those of snooker."""
    if not table.pockets:
        return 0.0, 0.0
    middle = abs(point[0]) < table.length / 4
    (radius, angle), own = (MIDDLE_ROUNDING, table.shapes.middle) if middle else (CORNER_ROUNDING, table.shapes.corner)
    usual = SNOOKER_POCKETS.middle if middle else SNOOKER_POCKETS.corner
    turn = (np.pi - own.cut_angle) / (np.pi - usual.cut_angle)
    return max(radius * (own.nose_radius / usual.nose_radius), MIN_ROUNDING_M), angle * turn


def _cushion(spec: mujoco.MjSpec, number: int, table: Table, ends: Array, outward: Array, nose: float) -> None:
    """Rubber along a nose, its ends rounded off into the pockets or mitred into the corner."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    path, normals = [], []
    for point, forward in ((ends[0], -along), (ends[1], along)):
        radius, angle = _rounding(table, point)
        turn = np.linspace(0.0, angle, ARC_PIECES if radius else 1)[:, None]
        centre = point - forward * radius * np.sin(angle) + radius * outward
        normal = outward * np.cos(turn) - forward * np.sin(turn) if radius else (outward + forward)[None]
        arc = centre - radius * normal
        path.append(arc[::-1] if forward is not along else arc)
        normals.append(normal[::-1] if forward is not along else normal)
    line, facing = np.concatenate(path), np.concatenate(normals)
    top, level = nose + LIP_HEIGHT_M - 0.001, float(ends[0] @ outward)
    back = line + (level + RUBBER_BACK_M - line @ outward)[:, None] * facing / (facing @ outward)[:, None]
    if table.pockets:  # straight behind the jaws
        back = line + (level + RUBBER_BACK_M - line @ outward)[:, None] * outward
    front = ((0.010, 0.0), (0.0, nose - 0.004), (0.0015, nose + 0.002), (0.012, nose + 0.004))
    points = [(line + d * facing, z) for d, z in front] + [(back, top), (back, 0.0)]
    grid = np.stack([np.column_stack([xy, np.full(len(xy), z)]) for xy, z in points], axis=1)
    _grid(spec, f"rubber {number}", "rubber", grid)


def _hole(table: Table, x: float, y: float) -> tuple[Array, float]:
    """Centre (2,) and radius of the opening of the pocket at (x, y) [m]."""
    beyond, radius = CORNER_POCKET if x else MIDDLE_POCKET
    shape = table.shapes.corner if x else table.shapes.middle
    scale = shape.mouth / (SNOOKER_POCKETS.corner if x else SNOOKER_POCKETS.middle).mouth
    return np.array([x, y]) + scale * beyond * np.sign([x, y]), scale * radius


def _frame(spec: mujoco.MjSpec, table: Table, pockets: Array, top: float) -> None:
    """Four mitred boards, cut out around the pockets."""
    size = np.array([table.length, table.width]) / 2
    for side in range(4):
        k, sign = side // 2, 1.0 if side % 2 == 0 else -1.0
        half, across = size[1 - k], size[k]  # the board runs along axis 1 - k
        cuts = []  # places along and across of the openings that this board meets
        for x, y in pockets:
            (cx, cy), radius = _hole(table, x, y)
            at, off = (cy, cx * sign) if k == 0 else (cx, cy * sign)
            if off > across - 0.01 and not (k == 0 and x == 0):
                cuts.append((at, off - across, radius + LEATHER_THICKNESS_M))
        u = [np.array([-half - FRAME_END_M, half + FRAME_END_M])]
        u += [at + radius * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 2 * ARC_PIECES + 1)) for at, _, radius in cuts]
        u += [np.array([-half - RUBBER_END_M, half + RUBBER_END_M])]
        places = np.unique(
            np.concatenate(u).round(3).clip(-half - FRAME_END_M, half + FRAME_END_M)
        )  # no slivers: they catch light
        inner = np.maximum(RUBBER_END_M, np.abs(places) - half)
        for at, off, radius in cuts:
            half_opening = np.sqrt(np.maximum(radius**2 - (places - at) ** 2, 0.0))
            inner = np.where(half_opening > 0, np.maximum(inner, off + half_opening), inner)
        near, bevel = np.minimum(inner, FRAME_END_M - BEVEL_M), FRAME_END_M - BEVEL_M
        rows = []
        for place, d in zip(places, near, strict=True):
            edge = (
                (d, -FRAME_DEPTH_M),
                (d, top),
                (bevel, top),
                (FRAME_END_M, top - BEVEL_M),
                (FRAME_END_M, -FRAME_DEPTH_M),
            )
            at = [(across + off, np.clip(place, -half - off, half + off), z) for off, z in edge]
            rows.append([(sign * x, y, z) if k == 0 else (y, sign * x, z) for x, y, z in at])
        _grid(spec, f"wood {side}", "wood", np.array(rows))


def _pocket(spec: mujoco.MjSpec, number: int, table: Table, x: float, y: float, top: float) -> None:
    """A black hole in the cloth with leather around its back."""
    centre, radius = _hole(table, x, y)
    _disc(spec, f"pocket {number}", "hole", centre, radius, -FRAME_DEPTH_M, 0.0006)
    facing = np.arctan2(np.sign(y), np.sign(x))
    spread = 1.95 if x else 1.5
    angles = np.linspace(facing - spread, facing + spread, 2 * ARC_PIECES)
    out = _turn(angles)
    profile = (
        (0.0, -0.1),
        (0.0, top + 0.001),
        (0.002, top + 0.003),
        (LEATHER_THICKNESS_M + 0.004, top + 0.003),
        (LEATHER_THICKNESS_M + 0.006, top),
        (LEATHER_THICKNESS_M, -0.1),
    )
    _sweep(spec, f"leather {number}", "leather", centre + radius * out, out, profile)


def _markings(spec: mujoco.MjSpec, table: Table) -> None:
    """Baulk line, D and spots."""
    k = table.length / FULL_LENGTH
    places = spots(table)
    line, thick, up = places["brown"][0], 0.0015, 0.0004
    _box(spec, "baulk line", "line", (line - thick, -table.width / 2, 0), (line + thick, table.width / 2, up))
    out = _turn(np.linspace(np.pi / 2, 1.5 * np.pi, 4 * ARC_PIECES))
    profile = ((-thick, 0.0), (-thick, up), (thick, up), (thick, 0.0))
    _sweep(spec, "D", "line", places["brown"] + D_RADIUS_M * k * out, out, profile)
    for name, xy in places.items():
        _disc(spec, f"spot {name}", "line", xy, 0.004, 0.0, 0.0006)


def _stand(spec: mujoco.MjSpec, table: Table) -> None:
    """Legs and floor."""
    lx, ly = table.length / 2, table.width / 2
    for i, x in enumerate(np.array([-0.92, -0.32, 0.32, 0.92]) * lx):
        for j, y in enumerate((-ly + 0.05, ly - 0.05)):
            _disc(spec, f"leg {i}{j}", "wood", np.array([x, y]), 0.07, -TABLE_HEIGHT_M, -0.05)
            _disc(spec, f"foot {i}{j}", "wood", np.array([x, y]), 0.09, -TABLE_HEIGHT_M, -TABLE_HEIGHT_M + 0.06)
    spec.worldbody.add_geom(
        spec.find_default("fixture"),
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        material="carpet",
        size=[8, 8, 1],
        pos=[0, 0, -TABLE_HEIGHT_M],
    )


def furnish(
    spec: mujoco.MjSpec, table: Table, radius: float, noses: Sequence[tuple[Array, Array]], pockets: Array
) -> None:
    """Add all purely visual parts; `noses`: ends (2, 2) and outward (2,) of every cushion, [m]."""
    nose = NOSE_HEIGHT * radius
    lx, ly = table.length / 2, table.width / 2
    _box(
        spec,
        "slate",
        "cloth",
        (-lx - RUBBER_END_M, -ly - RUBBER_END_M, -0.04),
        (lx + RUBBER_END_M, ly + RUBBER_END_M, -0.0004),
    )
    for number, (ends, outward) in enumerate(noses):
        _cushion(spec, number, table, ends, outward, nose)
    _frame(spec, table, pockets, nose + LIP_HEIGHT_M)
    for number, (x, y) in enumerate(pockets):
        _pocket(spec, number, table, x, y, nose + LIP_HEIGHT_M)
    if is_snooker(table, radius):
        _markings(spec, table)
    _stand(spec, table)
