"""Balls that stay in a rail (effect cushion_contact_time): how deep they are laid into it, and what stops there.

A ball is laid in with the velocity that it leaves with, so deep that it comes out in the time of contact. What stops it
before (another ball, cloth that resists more there) leaves it in rubber that is still pressed: the rubber pushes it out
slowly, with what lies against it, and the cloth takes that work up at once.
"""

from __future__ import annotations

from models.analytic.events import INSIDE_M
from models.compiled import compiled_in_place
from models.engine.gaps import rail_gap
from models.engine.motion import REST
from models.engine.rigid import part_all
from models.shot import GRAVITY

MAX_RAIL_DEPTH = (
    0.75  # of a ball's centre in a rail, over the radius: a centre that passes the nose line is in a pocket
)
MAX_SLOWED = 0.4  # largest part of its speed out of a rail that sliding friction may take from a ball still in it


@compiled_in_place
def delay_rebound(p, v, rail, time, slide, geometry):  # type: ignore[no-untyped-def]
    """Put a ball, place p and velocity v after its impact, as deep into a rail as it comes out within a `time` [s].

    On its way out sliding friction `slide` slows it; it comes out in any case. Within a diameter of a mouth, where the
    rubber ends, it is less deep, down to nothing at the mouth. There is none at a jaw (rail > 3), nor where balls met
    (rail < 0).
    """
    if not 0 <= rail < 4 or time <= 0.0:
        return
    radius, half, mouths = geometry.radius, geometry.half, geometry.mouths
    k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    slowing, speed = slide * GRAVITY, max(-sign * v[k], 0.0)
    time = min(time, MAX_SLOWED * speed / slowing) if slowing > 0.0 else time
    depth = min((speed - 0.5 * slowing * time) * time, MAX_RAIL_DEPTH * radius)
    if mouths[0] > 0.0:
        along = abs(p[1 - k])
        room = half[1 - k] - mouths[0] - along
        if k == 1:
            room = min(room, along - mouths[1])
        depth *= min(max(0.5 * room / radius, 0.0), 1.0)
    p[k] += sign * depth


@compiled_in_place
def stopped_in_rail(balls, moved, geometry):  # type: ignore[no-untyped-def]
    """The first ball of those that have `moved` (n,) that has come to rest in a rail, or -1."""
    for i in range(balls.kind.size):
        if moved[i] and balls.kind[i] == REST:
            for rail in range(4):
                if rail_gap(balls.rows[i], rail, geometry) < -INSIDE_M:
                    return i
    return -1


@compiled_in_place
def push_out(balls, i, touched, geometry):  # type: ignore[no-untyped-def]
    """Move a ball out of the rails, and balls in its way likewise; fills `touched` (n,), the balls that moved."""
    for q in range(touched.size):
        touched[q] = q == i
    part_all(balls, touched, geometry)
