"""Pockets as they are: where straight cushions end, the jaws' arcs, and where the slate ends.

In the space of ball centres, which meet a nose line at R cos(theta). Before a pocket the nose bends away in an arc of
radius r that is tangent to its line, until it runs along the pocket's axis: 45 degrees at a corner, 90 at a middle. A
centre meets the arc at rho = r + R cos(theta) from its centre. There the balls' widest level sees the mouth m, so a
centre has w = m/2 - R clean room on either side of the axis (Robotic Billiards 2015: "around 19 mm"), and the arc's
centre stands w + rho from the axis, r behind the nose line. So a straight cushion ends at

    sqrt(2) (w + R cos(theta)) + (sqrt(2) - 1) r   from a corner,      w + R cos(theta) + r   from a middle.

The slate ends in a circle about a point of the axis; a ball whose centre comes over its edge falls. The circle closes
the way between the jaws, so nothing is met behind it, and an arc counts as a whole circle.

Radii: the edge's is half a mouth at every pocket; about the corner itself, and so that it touches the nose line at a
middle (Broadfoot, Billiards, 1896: about the line of the cushion). The jaws' are chosen so that a ball that rolls in
along the axis at 0.3 m/s falls up to the offsets that Robotic Billiards 2015 has jaws let in, 45 mm at a corner and
55 mm at a middle; harder balls fall up to less. Templates of snooker tables as others have them, 89 and 67 mm, would
let in 39.5 and 47.5 mm. Leaves out that rubber gives way and is undercut at the jaws, balls that hop, and that a ball
takes a time to tip over the edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.analytic.events import CLOSED_GAP_M, in_mouth, line
from models.compiled import compiled_in_place
from models.errors import BadInput
from models.shot import NOSE_COSINE, POCKET_MOUTH, RAIL_NAMES, Ball, Table

Array = NDArray[np.float64]
CORNER_JAW, MIDDLE_JAW = 0.122, 0.085  # radius of the nose line's bend [m], bounds 0.02 to 0.15; see above
CORNER_FALL = (0.0, 0.045)  # the slate's edge: its centre beyond the corner along the axis, its radius [m]
MIDDLE_FALL = (0.045, 0.045)  # the same from the middle of a long nose line
ARC_SETBACK_M = (
    1e-10  # by which arcs stand back, so that what rolls along a cushion does not graze them by rounding [m]
)
JAW_RAILS = (0, 0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3)  # the rail that each jaw ends


@dataclass(frozen=True)
class Pockets:
    """Where balls of one size meet a table's pockets; arrays of no rows without them."""

    ends: Array  # (3,) [m], of the straight cushions, from a corner and from a middle; the last is not used
    jaws: Array  # (12, 3) [m], x, y of an arc's centre, and how far from it a ball's centre meets it; see JAW_RAILS
    falls: Array  # (6, 3) [m], x, y and radius of the slate's edge; pockets by row: -y first, -x first


NO_ARCS = np.zeros((0, 3))


def rail_of(number: int) -> str:
    """The rail of a logged impact: of a cushion by its number, of a jaw by 4 + its number."""
    return RAIL_NAMES[number if number < 4 else JAW_RAILS[number - 4]]


def pockets_of(table: Table, ball: Ball) -> Pockets:
    """Jaws and edges of a table for a ball.

    Raises:
        BadInput: for a ball that the mouths do not let in or the edges do not take, and a table with no room for them.
    """
    if not table.pockets:
        return Pockets(np.zeros(3), NO_ARCS, NO_ARCS)
    room, near = POCKET_MOUTH / 2 - ball.radius, ball.radius * NOSE_COSINE
    lx, ly = table.length / 2, table.width / 2
    corner = math.sqrt(2) * (room + near) + (math.sqrt(2) - 1) * CORNER_JAW
    middle = room + near + MIDDLE_JAW
    # Where along the axis the arcs have their centres, and are nearest to each other.
    depths = (math.sqrt(2) - 1) * CORNER_JAW - room - near, MIDDLE_JAW
    for (beyond, edge), jaw, depth in zip((CORNER_FALL, MIDDLE_FALL), (CORNER_JAW, MIDDLE_JAW), depths, strict=True):
        if room <= 0 or math.hypot(room + jaw + near, depth - beyond) > jaw + near + edge:
            raise BadInput(f"a ball of {2e3 * ball.radius:.1f} mm is none for these pockets; play it without jaws")
    if corner + middle >= lx or corner >= ly:
        raise BadInput(f"a table of {table.length} x {table.width} m has no room for its jaws; play it without them")
    sides, rho = (1.0, -1.0), (CORNER_JAW + near - ARC_SETBACK_M, MIDDLE_JAW + near - ARC_SETBACK_M)
    jaws = [(sx * (lx + CORNER_JAW), sy * (ly - corner), rho[0]) for sx in sides for sy in sides]
    for sy in sides:
        jaws += [(sx * (lx - corner), sy * (ly + CORNER_JAW), rho[0]) for sx in sides]
        jaws += [(sx * middle, sy * (ly + MIDDLE_JAW), rho[1]) for sx in sides]
    slant = CORNER_FALL[0] / math.sqrt(2)
    falls = [
        (sx * (lx + slant), sy * (ly + slant), CORNER_FALL[1])
        if sx
        else (0.0, sy * (ly + MIDDLE_FALL[0]), MIDDLE_FALL[1])
        for sy in (-1.0, 1.0)
        for sx in (-1.0, 0.0, 1.0)
    ]
    return Pockets(np.array([corner, middle, 0.0]), np.array(jaws), np.array(falls))


@compiled_in_place
def outward(number, x, y, jaws):  # type: ignore[no-untyped-def]
    """Unit vector from a centre at (x, y) into rail `number` (+x, -x, +y, -y), or into jaw `number` - 4."""
    if number < 4:
        sign = 1.0 - 2.0 * (number % 2)
        return (sign, 0.0) if number < 2 else (0.0, sign)
    nx, ny = jaws[number - 4, 0] - x, jaws[number - 4, 1] - y
    d = math.sqrt(nx * nx + ny * ny)
    return nx / d, ny / d


@compiled_in_place
def straight(rail, limits, p, v, a, half, ends, h):  # type: ignore[no-untyped-def]
    """The same as `line` for a rail that ends before the jaws: p, v, a (2,) or (3,) of a centre, time limit h."""
    k, o, sign = rail // 2, 1 - rail // 2, 1.0 - 2.0 * (rail % 2)
    gap, speed, faster = limits[k] - sign * p[k], sign * v[k], sign * a[k]
    if gap < -CLOSED_GAP_M and in_mouth(p[o], rail, half, ends):
        # Between the jaws, beyond the line: it may come out, and back to the line elsewhere.
        disc = speed * speed + 2.0 * faster * gap
        if speed >= 0.0 or faster <= 0.0 or disc <= 0.0:
            return np.inf
        t = (math.sqrt(disc) - speed) / faster
        if t > h:
            return np.inf
    else:
        t = line(gap, speed, faster, h)
        if t == np.inf:
            return t
    s = max(t, 0.0)
    return np.inf if in_mouth(p[o] + v[o] * s + 0.5 * a[o] * s * s, rail, half, ends) else t
