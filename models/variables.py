"""What a force or an impact may depend on, each by its code: variables of formulas and of free forms."""

from __future__ import annotations

import math
from typing import Final

from models.compiled import compiled
from models.effect import BallState, ImageState, ImpactState

VARIABLES: Final = (
    "none", "x", "y", "heading", "speed", "slip", "wz", "time", "order", "number", "rail", "along", "grazing",
    "approach",
)  # fmt: skip
NONE, X, Y, HEADING, SPEED, SLIP, WZ, TIME, ORDER, NUMBER, RAIL, ALONG, GRAZING, APPROACH = range(len(VARIABLES))


@compiled
def grazing_sine(vx: float, vy: float, approach: float) -> float:
    """Sine of the angle between a ball's way and the normal of its impact; 0 for a ball at rest."""
    square = vx * vx + vy * vy
    return math.sqrt(max(1.0 - approach * approach / square, 0.0)) if square > 0.0 else 0.0


@compiled
def variable_value(
    variable: float, x: float, y: float, vx: float, vy: float, wz: float, order: float, time: float, first: float,
    second: float, slip: float, approach: float,
) -> float:  # fmt: skip
    """A variable for a ball, or an impact of ball `first` with ball or rail `second`; 0 for what is not known there."""
    if variable == X:
        return x
    if variable == Y:
        return y
    if variable == HEADING:
        return math.atan2(vy, vx)
    if variable == SPEED:
        return math.sqrt(vx * vx + vy * vy)
    if variable == SLIP:
        return slip
    if variable == WZ:
        return wz
    if variable == TIME:
        return time
    if variable == ORDER:
        return order
    if variable == NUMBER:
        return first
    if variable == RAIL:
        return second
    if variable == ALONG:
        return y if second < 2.0 else x
    if variable == GRAZING:
        return grazing_sine(vx, vy, approach)
    return approach if variable == APPROACH else 0.0


@compiled
def of_ball(variable: float, ball: BallState) -> float:
    """A variable for a ball on the cloth."""
    slip = math.sqrt(ball.slip_x * ball.slip_x + ball.slip_y * ball.slip_y)
    return variable_value(
        variable, ball.x, ball.y, ball.vx, ball.vy, ball.wz, ball.order, ball.time, ball.number, -1.0, slip, 0.0
    )


@compiled
def of_impact(variable: float, hit: ImpactState) -> float:
    """A variable for a contact."""
    return variable_value(
        variable, hit.x, hit.y, hit.vx, hit.vy, hit.wz, hit.order, hit.time, hit.first, hit.second, hit.slip,
        hit.approach,
    )  # fmt: skip


@compiled
def of_image(variable: float, image: ImageState) -> float:
    """A variable for a ball in a picture."""
    return variable_value(
        variable, image.x, image.y, image.vx, image.vy, 0.0, image.order, image.time, image.number, -1.0, 0.0, 0.0
    )
