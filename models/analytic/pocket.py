"""Pockets in the space of ball centres: ends of straight cushions, noses, facings, and the slate's edge.

Ball centres meet a nose line at R cos(theta). A table's `PocketShapes` (models/table/pocket_shape.py) give mouth m,
nose radius r, cut angle, shelf and edge. Before a pocket the nose bends away in an arc of radius r that is tangent
to its line and to the facing, turned by t = 180 degrees - cut. A centre meets the arc at rho = r + R
cos(theta) from its centre, and the facing at R cos(theta) from its line. There the balls' widest level sees the mouth,
so a centre has w = m/2 - R clean room on either side of the axis (Robotic Billiards 2015: "around 19 mm"), and lines of
nose and facing meet w + R cos(theta) from the axis. So a straight cushion ends at

    sqrt(2) (w + R cos(theta)) + tan(t/2) r   from a corner,      w + R cos(theta) + tan(t/2) r   from a middle.

The slate ends in a circle about a point of the axis; a ball whose centre comes over its edge falls. The circle closes
the way between the facings, so nothing is met behind it, and an arc counts as a whole circle. A facing that begins
behind the edge is met by nobody and left out: so are those of snooker, which run along the axis.

Snooker: nose radii are chosen so that a ball that rolls in along the axis at 0.3 m/s falls up to the offsets that
Robotic Billiards 2015 has jaws let in, 45 mm at a corner and 55 mm at a middle; harder balls fall up to less. Templates
of snooker tables as others have them, radii of 89 and 67 mm, would let in 39.5 and 47.5 mm. Leaves out that rubber
gives way and is undercut at the jaws, balls that hop, and that a ball takes a time to tip over the edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.analytic.events import CLOSED_GAP_M, in_mouth, line, meeting
from models.analytic.geometry import Parabola
from models.compiled import compiled_in_place
from models.errors import BadInput
from models.shot import NOSE_COSINE, RAIL_NAMES, Ball, Table
from models.table.pocket_shape import CORNER_PARALLEL_RAD, MIDDLE_PARALLEL_RAD, PocketShape

Array = NDArray[np.float64]
OWN_POCKETS = "give [table] the pockets of its game"  # the remedy for pockets that fit no ball or table
ARC_SETBACK_M = (
    1e-10  # by which arcs stand back, so that what rolls along a cushion does not graze them by rounding [m]
)
ARC_RAILS = (0, 0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3)  # the rail at the end of which each arc is
JAW_RAILS = ARC_RAILS * 2  # the rails of the arcs, then of the facings behind them
MIDDLE_ARCS = (6, 7, 10, 11)
FACING_OVERLAP_M = 1e-3  # length of a facing beyond the slate's edge [m]
BEHIND_M = 1e-5  # depth behind a facing's line, past its end, from which a ball does not touch it [m]
DRIVEN_M = 5e-3  # depth to which other balls may drive a ball into a facing [m]
NO_FACING_M = -1.0  # half length that stands for a facing without contact [m]


class Pockets(NamedTuple):
    """Where balls of one size meet a table's pockets; arrays of no rows without them.

    A row of `jaws` is an arc or a facing. Arc: x, y of its centre, how far from it a ball's centre meets it, 0, 0.
    Facing: x, y of the middle of the line that centres meet, half its length, and the unit normal into the rubber.
    """

    ends: Array  # (3,) [m], of the straight cushions, from a corner and from a middle; the last is not used
    jaws: Array  # (12 or 24, 5) [m], arcs and, if any is met, facings in the same order; see JAW_RAILS
    falls: Array  # (6, 3) [m], x, y and radius of the slate's edge; pockets by row: -y first, -x first


NO_ARCS = np.zeros((0, 3))


def rail_of(number: int) -> str:
    """The rail of a logged impact: of a cushion by its number, of a jaw by 4 + its number."""
    return RAIL_NAMES[number if number < 4 else JAW_RAILS[number - 4]]


@dataclass(frozen=True)
class _Mouth:
    """One pocket in the space of ball centres: depth along its axis beyond its place, and distance from the axis."""

    end: float  # of the straight cushion, along the nose line from the pocket's place [m]
    turn: float  # from the nose line into the facing [rad]
    beyond: float  # depth of the middle of the slate's edge [m]
    facing: float  # length of the facing that is met before the edge, 0 for none [m]


def _mouth(shape: PocketShape, ball: Ball, *, middle: bool) -> _Mouth | None:
    """None where a ball does not pass, or passes the edge."""
    near, r, clean = ball.radius * NOSE_COSINE, shape.nose_radius, shape.mouth / 2 - ball.radius
    closing = shape.cut_angle - (MIDDLE_PARALLEL_RAD if middle else CORNER_PARALLEL_RAD)
    # tan(t/2) of the turn t by that of the turn to the axis, which has no rounding where the facing runs along it.
    whole, less = (1.0 if middle else math.sqrt(2) - 1), math.tan(closing / 2)
    bend = (whole - less) / (1 + whole * less) * r
    if middle:
        end = clean + near + bend
        depth, across = r, end
    else:
        end = math.sqrt(2) * (clean + near) + bend
        depth, across = (r - end) / math.sqrt(2), (r + end) / math.sqrt(2)
    beyond = shape.edge_depth(corner=not middle)
    # The facing begins where the arc ends; s is the way along it to the edge, a circle about (beyond, 0).
    touching = math.hypot(depth - beyond, across) <= r + near + shape.edge_radius
    depth -= (r + near) * math.sin(closing) + beyond
    across -= (r + near) * math.cos(closing)
    towards = depth * math.cos(closing) - across * math.sin(closing)
    room = towards**2 - (depth**2 + across**2 - shape.edge_radius**2)
    before = math.hypot(depth, across) <= shape.edge_radius or (towards >= 0 and touching)  # the arc comes to the edge
    s = -towards - math.sqrt(room) if room >= 0 and towards < 0 else math.inf
    closed = before or (s < math.inf and s * math.sin(closing) < across)  # nothing leaves beside the edge
    if clean <= 0 or bend < 0 or across <= 0 or not closed:
        return None
    return _Mouth(end, math.pi - shape.cut_angle, beyond, 0.0 if before else s + FACING_OVERLAP_M)


def pockets_of(table: Table, ball: Ball) -> Pockets:
    """Jaws and edges of a table for a ball.

    Raises:
        BadInput: for a ball that the mouths do not let in or the edges do not take, and a table with no room for them.
    """
    if not table.pockets:
        return Pockets(np.zeros(3), NO_ARCS, NO_ARCS)
    shapes, near = table.shapes, ball.radius * NOSE_COSINE
    corner, middle = _mouth(shapes.corner, ball, middle=False), _mouth(shapes.middle, ball, middle=True)
    if corner is None or middle is None:
        raise BadInput(
            f"a ball of {2e3 * ball.radius:.1f} mm is none for the pockets: correct diameter, or {OWN_POCKETS}"
        )
    lx, ly, r, q = table.length / 2, table.width / 2, shapes.corner.nose_radius, shapes.middle.nose_radius
    if corner.end + middle.end >= lx or corner.end >= ly:
        size = f"a table of {table.length} x {table.width} m"
        raise BadInput(f"{size} has no room for its pockets: correct length and width, or {OWN_POCKETS}")
    sides, rho = (1.0, -1.0), (r + near - ARC_SETBACK_M, q + near - ARC_SETBACK_M)
    arcs = [(sx * (lx + r), sy * (ly - corner.end), rho[0]) for sx in sides for sy in sides]
    along = [(0.0, sy) for _ in sides for sy in sides]  # towards the pocket
    for sy in sides:
        arcs += [(sx * (lx - corner.end), sy * (ly + r), rho[0]) for sx in sides]
        arcs += [(sx * middle.end, sy * (ly + q), rho[1]) for sx in sides]
        along += [(1.0, 0.0), (-1.0, 0.0), (-1.0, 0.0), (1.0, 0.0)]
    jaws = [(*arc, 0.0, 0.0) for arc in arcs]
    if corner.facing or middle.facing:
        for k, (x, y, arc_radius) in enumerate(arcs):
            mouth = middle if k in MIDDLE_ARCS else corner
            jaws.append(_facing((x, y), along[k], ARC_RAILS[k], arc_radius + ARC_SETBACK_M, mouth))
    slant = corner.beyond / math.sqrt(2)
    falls = [
        (sx * (lx + slant), sy * (ly + slant), shapes.corner.edge_radius)
        if sx
        else (0.0, sy * (ly + middle.beyond), shapes.middle.edge_radius)
        for sy in (-1.0, 1.0)
        for sx in (-1.0, 0.0, 1.0)
    ]
    return Pockets(np.array([corner.end, middle.end, 0.0]), np.array(jaws), np.array(falls))


def _facing(
    centre: tuple[float, float], along: tuple[float, float], rail: int, arc_radius: float, mouth: _Mouth
) -> tuple[float, float, float, float, float]:
    """The row of the facing behind an arc about `centre`, of a rail that runs `along` (2,) towards the pocket."""
    sign = 1.0 - 2.0 * (rail % 2)
    out = (sign, 0.0) if rail < 2 else (0.0, sign)
    c, s = math.cos(mouth.turn), math.sin(mouth.turn)
    nx, ny = out[0] * c - along[0] * s, out[1] * c - along[1] * s
    half = mouth.facing / 2 if mouth.facing else 0.0
    x = centre[0] - arc_radius * nx + half * (along[0] * c + out[0] * s)
    y = centre[1] - arc_radius * ny + half * (along[1] * c + out[1] * s)
    return x, y, half if mouth.facing else NO_FACING_M, nx, ny


def jaw_gaps(xy: Array, jaws: Array) -> Array:
    """Distances of centres (n, 2) from contact with each jaw, negative within an arc: (n, jaws) [m]."""
    arcs, facings = jaws[:12], jaws[12:]
    gaps = np.hypot(*(xy[:, None] - arcs[None, :, :2]).transpose(2, 0, 1)) - arcs[:, 2]
    off = xy[:, None] - facings[None, :, :2]
    out = np.sum(off * facings[:, 3:], axis=-1)
    beside = np.abs(off[..., 0] * facings[:, 4] - off[..., 1] * facings[:, 3]) - facings[:, 2]
    found = np.where(facings[:, 2] < 0, np.inf, np.hypot(out, np.maximum(beside, 0.0)))
    return np.concatenate([gaps, found], axis=1)


@compiled_in_place
def is_facing(jaw):  # type: ignore[no-untyped-def]
    """Whether a row of `jaws` is a facing."""
    return jaw[3] != 0.0 or jaw[4] != 0.0


@compiled_in_place
def jaw_gap(jaw, x, y):  # type: ignore[no-untyped-def]
    """Distance of a centre from contact with an arc or a facing, negative within; inf past the end of a facing."""
    x, y = x - jaw[0], y - jaw[1]
    if not is_facing(jaw):
        return math.sqrt(x * x + y * y) - jaw[2]
    gap = -(jaw[3] * x + jaw[4] * y)
    return gap if gap >= -DRIVEN_M and abs(jaw[3] * y - jaw[4] * x) <= jaw[2] else np.inf


@compiled_in_place
def is_behind(facing, x, y):  # type: ignore[no-untyped-def]
    """Whether a centre at (x, y) is behind the line of a facing, but not in the facing: elsewhere."""
    x, y = x - facing[0], y - facing[1]
    beside = abs(facing[3] * y - facing[4] * x) > facing[2]
    return facing[3] * x + facing[4] * y > (BEHIND_M if beside else DRIVEN_M)


@compiled_in_place
def _out_and_back(gap, speed, acceleration, h):  # type: ignore[no-untyped-def]
    """Time in [0, h] at which a centre behind a line, by -`gap`, comes back to it from in front; inf for none."""
    disc = speed * speed + 2.0 * acceleration * gap
    if speed >= 0.0 or acceleration <= 0.0 or disc <= 0.0:
        return np.inf
    t = (math.sqrt(disc) - speed) / acceleration
    return t if t <= h else np.inf


@compiled_in_place
def meet_jaw(jaw, path, h):  # type: ignore[no-untyped-def]
    """First time in [0, h] at which a centre meets an arc or a facing; inf for none, -1 where pressed."""
    x, y, vx, vy, ax, ay = path
    if not is_facing(jaw):
        return meeting(Parabola(x - jaw[0], y - jaw[1], vx, vy, ax, ay), jaw[2], h)
    behind = is_behind(jaw, x, y)
    x, y = x - jaw[0], y - jaw[1]
    nx, ny = jaw[3], jaw[4]
    gap, speed, faster = -(nx * x + ny * y), nx * vx + ny * vy, nx * ax + ny * ay
    if behind:  # it may come out, and back here
        t = _out_and_back(gap, speed, faster, h)
    else:
        t = line(gap, speed, faster, h)
    if t == np.inf:
        return t
    s = max(t, 0.0)
    x, y = x + vx * s + 0.5 * ax * s * s, y + vy * s + 0.5 * ay * s * s
    return t if abs(nx * y - ny * x) <= jaw[2] else np.inf


@compiled_in_place
def outward(number, x, y, jaws):  # type: ignore[no-untyped-def]
    """Unit vector from a centre at (x, y) into rail `number` (+x, -x, +y, -y), or into jaw `number` - 4."""
    if number < 4:
        sign = 1.0 - 2.0 * (number % 2)
        return (sign, 0.0) if number < 2 else (0.0, sign)
    if is_facing(jaws[number - 4]):
        return jaws[number - 4, 3], jaws[number - 4, 4]
    nx, ny = jaws[number - 4, 0] - x, jaws[number - 4, 1] - y
    d = math.sqrt(nx * nx + ny * ny)
    return nx / d, ny / d


@compiled_in_place
def straight(rail, geometry, p, v, a, h):  # type: ignore[no-untyped-def]
    """The same as `line` for a rail that ends before the jaws: p, v, a (2,) or (3,) of a centre, time limit h."""
    limits, half, ends = geometry.limits, geometry.half, geometry.mouths
    k, o, sign = rail // 2, 1 - rail // 2, 1.0 - 2.0 * (rail % 2)
    gap, speed, faster = limits[k] - sign * p[k], sign * v[k], sign * a[k]
    if gap < -CLOSED_GAP_M and in_mouth(p[o], rail, half, ends):
        # Between the jaws, beyond the line: it may come out, and back to the line elsewhere.
        t = _out_and_back(gap, speed, faster, h)
    else:
        t = line(gap, speed, faster, h)
    if t == np.inf:
        return t
    s = max(t, 0.0)
    return np.inf if in_mouth(p[o] + v[o] * s + 0.5 * a[o] * s * s, rail, half, ends) else t
