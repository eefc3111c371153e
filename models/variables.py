"""Variables of formulas and of free forms, on which a force or an impact may depend, each with its code."""

from __future__ import annotations

import math
from typing import Any, Final

from models.compiled import compiled
from models.effect import BallState, ImageState, ImpactState

SESSION_VARIABLES: Final = ("order", "hour", "warmth", "cloth_age", "table", "player")
VARIABLES: Final = (
    "none", "x", "y", "heading", "speed", "slip", "wz", "time", "number", "rail", "along", "grazing", "approach",
    *SESSION_VARIABLES,
)  # fmt: skip
(
    NONE, X, Y, HEADING, SPEED, SLIP, WZ, TIME, NUMBER, RAIL, ALONG, GRAZING, APPROACH,
    ORDER, HOUR, WARMTH, CLOTH_AGE, TABLE, PLAYER,
) = range(len(VARIABLES))  # fmt: skip


@compiled
def grazing_sine(vx: float, vy: float, approach: float) -> float:
    """Sine of the angle between a ball's way and the normal of its impact; 0 for a ball at rest."""
    square = vx * vx + vy * vy
    return math.sqrt(max(1.0 - approach * approach / square, 0.0)) if square > 0.0 else 0.0


@compiled
def of_motion(variable: float, state: Any) -> float:
    """A variable of place, way, time or session, which every state has; 0 for another one."""
    if variable == X:
        return state.x
    if variable == Y:
        return state.y
    if variable == HEADING:
        return math.atan2(state.vy, state.vx)
    if variable == SPEED:
        return math.sqrt(state.vx * state.vx + state.vy * state.vy)
    if variable == TIME:
        return state.time
    if variable == ORDER:
        return state.order
    if variable == HOUR:
        return state.hour
    if variable == WARMTH:
        return state.warmth
    if variable == CLOTH_AGE:
        return state.cloth_age
    if variable == TABLE:
        return state.table
    return state.player if variable == PLAYER else 0.0


@compiled
def of_ball(variable: float, ball: BallState) -> float:
    """A variable for a ball on the cloth; 0 for one that it does not have."""
    if variable == SLIP:
        return math.sqrt(ball.slip_x * ball.slip_x + ball.slip_y * ball.slip_y)
    if variable == WZ:
        return ball.wz
    if variable == NUMBER:
        return ball.number
    return of_motion(variable, ball)


@compiled
def of_impact(variable: float, hit: ImpactState) -> float:
    """A variable for a contact."""
    if variable == SLIP:
        return hit.slip
    if variable == WZ:
        return hit.wz
    if variable == NUMBER:
        return hit.first
    if variable == RAIL:
        return hit.second
    if variable == ALONG:
        return hit.y if hit.second < 2.0 else hit.x
    if variable == GRAZING:
        return grazing_sine(hit.vx, hit.vy, hit.approach)
    if variable == APPROACH:
        return hit.approach
    return of_motion(variable, hit)


@compiled
def of_image(variable: float, image: ImageState) -> float:
    """A variable for a ball in a picture."""
    return image.number if variable == NUMBER else of_motion(variable, image)
