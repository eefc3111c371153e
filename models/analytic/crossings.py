"""When a ball next crosses a line, the edge of a cell, or a bend of a curve, at what pushes it now: for `horizon`."""

from __future__ import annotations

import math
from typing import NamedTuple

from models.compiled import compiled
from models.effect import EDGE_OVERSHOOT_M, BallState
from models.variables import SLIP, SPEED, TIME, WZ, X, Y


@compiled
def _until(gap: float, speed: float, acceleration: float) -> float:
    """When a way of `gap`, and a bit more, has been gone at a constant acceleration [s]; inf if never."""
    way = gap + EDGE_OVERSHOOT_M if gap >= 0.0 else gap - EDGE_OVERSHOOT_M
    under = speed * speed + 2.0 * acceleration * way
    if under < 0.0:
        return math.inf
    both = speed + math.copysign(math.sqrt(under), speed)
    first = 2.0 * way / both if both != 0.0 else math.inf
    second = -both / acceleration if acceleration != 0.0 else math.inf
    return min(first if first > 0.0 else math.inf, second if second > 0.0 else math.inf)


class NearestLines(NamedTuple):
    """How far the nearest lines across an axis lie from a ball [m]."""

    ahead: float = math.inf  # towards the axis's positive side, or on it
    behind: float = -math.inf


@compiled
def nearer(lines: NearestLines, gap: float) -> NearestLines:
    """The nearest lines, with one more."""
    if gap >= 0.0:
        return NearestLines(min(lines.ahead, gap), lines.behind)
    return NearestLines(lines.ahead, max(lines.behind, gap))


@compiled
def until_nearest(lines: NearestLines, speed: float, acceleration: float) -> float:
    """When a ball first crosses one of them: of those on one side that is the nearest [s]; inf if never."""
    left = math.inf
    if lines.ahead < math.inf:
        left = _until(lines.ahead, speed, acceleration)
    if lines.behind > -math.inf:
        left = min(left, _until(lines.behind, speed, acceleration))
    return left


@compiled
def until_line(ball: BallState, variable: float, at: float) -> float:
    """When a ball crosses the line x = at or y = at, at what pushes it now [s]; inf for another variable."""
    if variable == X and ball.vx != 0.0:
        return _until(at - ball.x, ball.vx, ball.ax)
    if variable == Y and ball.vy != 0.0:
        return _until(at - ball.y, ball.vy, ball.ay)
    return math.inf


@compiled
def until_bend(ball: BallState, variable: float, at: float, half: float) -> float:
    """When a hat at a value of a variable bends, or for what is not known ahead how long half of it takes [s]."""
    ends = (at - half, at, at + half)
    left = math.inf
    if variable in (X, Y):
        for end in ends:
            left = min(left, until_line(ball, variable, end))
    elif variable == TIME:
        for end in ends:
            left = min(left, end - ball.time if end > ball.time else math.inf)
    elif variable in (SPEED, SLIP, WZ):
        rate = abs(ball.bz) if variable == WZ else math.sqrt(ball.ax * ball.ax + ball.ay * ball.ay)
        if variable == SLIP:
            rate *= 3.5  # of a sliding ball: a - R alpha, 5/2 of the force turning it
        left = half / rate if rate > 0.0 else math.inf
    return left


@compiled
def until_edge(ball: BallState, x: float, half_x: float, y: float, half_y: float) -> float:
    """When a ball crosses a line of the cell |x' - x| <= half_x, |y' - y| <= half_y, at what pushes it now [s]."""
    left = math.inf
    if ball.vx * ball.vx + ball.vy * ball.vy > 0.0:
        for side in (-1.0, 1.0):
            left = min(left, _until(x + side * half_x - ball.x, ball.vx, ball.ax))
            left = min(left, _until(y + side * half_y - ball.y, ball.vy, ball.ay))
    return left
