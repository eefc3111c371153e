"""Test footage drawn by MuJoCo from the MJCF of table, balls and cue, through the lens of a calibrated camera.

MuJoCo draws a pinhole's picture, wide and fine enough, which is then bent as the lens bends it. Rows that are read one
after another: every ball is drawn where it is when its middle row is read, so it is moved but not sheared.
"""

from __future__ import annotations

from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from models.mjcf.gl import choose_backend, require_rendering

choose_backend()  # before MuJoCo is imported

import mujoco  # noqa: E402

from models.mjcf.world import build_spec  # noqa: E402
from models.shot import Ball  # noqa: E402
from sysid.vision.camera.projection import Array, Camera  # noqa: E402
from tests.footage.film import CUE_WOOD, LEATHER, Look, brightness, when_read  # noqa: E402
from tests.footage.motion import Cue, Motion  # noqa: E402

SIDES = 24  # of the cue's round
FINER = 1.3  # pinhole pixels a pixel of the lens
MARGIN = 1.02  # of the pinhole's picture around what the lens shows
PROUD = 2e-4  # of a spot over its ball, part of the radius
AWAY = 10.0  # where what is not seen is put [m]


class Drawn:
    """A table with balls and cue that MuJoCo draws; to be used as a context, which ends the OpenGL window."""

    def __init__(self, camera: Camera, motion: Motion, look: Look) -> None:
        """Compile the scene; BadInput names the packages where nothing can be drawn."""
        require_rendering()
        self.camera, self.motion, self.look = camera, motion, look
        x, y = self._sides()
        width, height = (
            int(np.ceil(2 * s * f * FINER)) for s, f in ((x, camera.matrix[0, 0]), (y, camera.matrix[1, 1]))
        )
        self.model = self._spec(2 * float(np.arctan(y)), width, height).compile()
        self.data = mujoco.MjData(self.model)
        self.renderer = mujoco.Renderer(self.model, height, width)
        grid = np.stack(np.meshgrid(*(np.arange(n) for n in camera.size)), axis=-1).reshape(-1, 2).astype(float)
        flat = self._flat(grid)
        place = (flat / [x, y] + 1) / 2 * [width, height] - 0.5
        self.bend = place.reshape(camera.size[1], camera.size[0], 2).astype(np.float32)
        self.light = brightness(camera, look, grid).reshape(camera.size[1], camera.size[0], 1).astype(np.float32)

    def __enter__(self) -> Drawn:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give OpenGL back what it lent."""
        self.renderer.close()

    def _flat(self, pixels: Array) -> Array:
        """Where pixels (n, 2) lie in a pinhole's picture of focal length 1: (n, 2)."""
        seen = self.camera.rays(pixels) @ self.camera.axes.T
        return np.asarray(seen[:, :2] / seen[:, 2:])

    def _sides(self) -> tuple[float, float]:
        w, h = self.camera.size
        along = np.linspace(-0.5, 1, 64)
        rim = [(w * t, v) for t in along for v in (-0.5, h - 0.5)] + [
            (u, h * t) for t in along for u in (-0.5, w - 0.5)
        ]
        far = np.abs(self._flat(np.array(rim))).max(axis=0) * MARGIN
        return float(far[0]), float(far[1])

    def _spec(self, fovy: float, width: int, height: int) -> mujoco.MjSpec:
        camera, look = self.camera, self.look
        spec = build_spec(camera.table, Ball(camera.diameter, 0.14), self.motion.names, furnished=True)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
        eye = spec.worldbody.add_camera(name="film", pos=camera.eye, fovy=np.degrees(fovy))
        eye.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
        eye.alt.xyaxes = np.concatenate([camera.axes[0], -camera.axes[1]])
        for name in self.motion.names:
            body = spec.body(name)
            if name in look.colours:
                spec.geom(f"ball {name}").rgba = [*look.colours[name], 1]
            for k, spot in enumerate(look.spots.get(name, ())):
                n = np.asarray(spot.place, float) / np.linalg.norm(spot.place)
                r, wide = camera.radius, np.sin(spot.angle)
                turn, _ = Rotation.align_vectors([n], [[0, 0, 1.0]])
                x, y, z, w = turn.as_quat()
                body.add_geom(
                    name=f"spot {name} {k}", type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, pos=r * np.cos(spot.angle) * n,
                    size=r * np.array([wide, wide, 1 - np.cos(spot.angle) + PROUD]), quat=[w, x, y, z],
                    rgba=[*spot.colour, 1], contype=0, conaffinity=0, mass=0,
                )  # fmt: skip
        if self.motion.cue is not None:
            _add_cue(spec, self.motion.cue)
        return spec

    def picture(self, moment: float) -> NDArray[np.float32]:
        """The light at a moment: (height, width, 3), red, green, blue, 0 to 1."""
        for k, name in enumerate(self.motion.names):
            place, _, axes, _ = when_read(self.camera, self.motion, k, moment, self.look)
            joint = self.data.joint(name)
            there = np.isfinite(place).all()
            joint.qpos[:3] = [*place, self.camera.radius] if there else [AWAY + k, 0, -AWAY]
            x, y, z, w = Rotation.from_matrix(axes).as_quat()
            joint.qpos[3:] = [w, x, y, z]
        if self.motion.cue is not None:
            self.data.mocap_pos[0] = self.motion.cue.tip_at(moment)
        mujoco.mj_forward(self.model, self.data)
        self.renderer.update_scene(self.data, "film")
        flat = self.renderer.render().astype(np.float32) / 255
        return np.asarray(cv2.remap(flat, self.bend, None, cv2.INTER_LINEAR) * self.light, np.float32)


def _add_cue(spec: mujoco.MjSpec, cue: Cue) -> None:
    """A tapered stick with a leather tip, its tip at the body's place."""
    body = spec.worldbody.add_body(name="cue", mocap=True)
    back = -cue.direction
    side = np.cross([0, 0, 1.0], back)
    side /= np.linalg.norm(side)
    up = np.cross(back, side)
    angle = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    for name, begin, end, colour in (("tip", 0.0, 0.012, LEATHER), ("shaft", 0.012, cue.length, CUE_WOOD)):
        points = []
        for way in (begin, end):
            wide = 0.5 * (cue.tip + (cue.butt - cue.tip) * way / cue.length)
            points.append(way * back + wide * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up))
        mesh = spec.add_mesh(name=f"cue {name}", uservert=np.concatenate(points).ravel())
        body.add_geom(
            name=f"cue {name}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name, rgba=[*colour, 1], contype=0,
            conaffinity=0,
        )  # fmt: skip
