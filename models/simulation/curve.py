"""A step along which forces vary: the acceleration is a quadratic in time, through three looks at the forces.

The looks are at the begin, the middle and three quarters of a trial step (Ralston's third-order method), never at its
end, where a slide or a roll may be over. The quadratic is the motion: a touch within the step is found on it, and the
step cut there. Its last term says how far an accurate step may go (`room`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.effect import STILL
from models.engine.curve import MIN_DECELERATION
from models.hooks import Hooks
from models.shot import Array
from models.simulation.act import Balls

TINY_STEP_S = 1e-5  # step along which nothing varies: parts of the last bit of speed would count as rest [s]
STEP_TOLERANCE_M = 2e-6  # of a step, by its last term: some ten times its error of position or more [m]
SPIN_ERROR_S = 0.02  # how long an error of sidespin counts [s]
MAX_TRIAL_RATIO = 1.3  # than there is room for a trial may be
MAX_TRIALS = 8
TRIAL_MARGIN = 1.02  # of a trial beyond the touch that present forces would make
NO_CHANGE_S = 1e-15  # change of the time of a touch that is none [s]

Touch = Callable[[NDArray[np.int64], Array, Array], tuple[Array, NDArray[np.int64]]]


@dataclass
class Curve:
    """Accelerations a0 + a1 t + a2 t^2, from t = 0 to `span`."""

    span: Array  # (nsim,) [s]
    push: Array  # (3, nsim, nball, 3) [m/s^2, m/s^3, m/s^4]
    turn: Array  # (3, nsim, nball, 3) [rad/s^2, rad/s^3, rad/s^4]

    @staticmethod
    def mean(terms: Array, t: Array) -> Array:
        """Mean of an acceleration up to t (nsim,): what the velocity changes by, over t."""
        t = t[:, None, None]
        out: Array = terms[0] + t * (terms[1] / 2 + t * terms[2] / 3)
        return out

    @staticmethod
    def chord(terms: Array, t: Array) -> Array:
        """The constant acceleration that would lead to the same place at t (nsim,)."""
        t = t[:, None, None]
        out: Array = terms[0] + t * (terms[1] / 3 + t * terms[2] / 6)
        return out

    def shift(self, start: Array, terms: Array, t: Array) -> Array:
        """What a velocity (nsim, nball, 3) and its acceleration sum up to at t (nsim,)."""
        out: Array = t[:, None, None] * (start + 0.5 * t[:, None, None] * self.chord(terms, t))
        return out

    def way(self, velocity: Array, t: Array) -> Array:
        """Mean speed up to t (nsim,), by Simpson: (nsim, nball) [m/s]."""
        at = [velocity + part * t[:, None, None] * self.mean(self.push, part * t) for part in (0.0, 0.5, 1.0)]
        speed = [np.hypot(v[..., 0], v[..., 1]) for v in at]
        out: Array = (speed[0] + 4.0 * speed[1] + speed[2]) / 6.0
        return out


def take(balls: Balls, index: NDArray[np.int64]) -> Balls:
    """The balls of some simulations."""
    values = {f.name: getattr(balls, f.name) for f in dataclasses.fields(balls)}
    some: dict[str, Any] = {k: v[index] for k, v in values.items() if isinstance(v, np.ndarray)}
    return dataclasses.replace(balls, **some)


def ahead(balls: Balls, push: Array, turn: Array, t: Array) -> Balls:
    """The state at t (nsim,) under constant accelerations."""
    part = t[:, None, None]
    velocity = balls.velocity + part * push
    velocity[..., 2] = balls.velocity[..., 2]
    speeds = [np.hypot(v[..., 0], v[..., 1]) for v in (balls.velocity, velocity)]
    return dataclasses.replace(
        balls,
        position=balls.position + 0.5 * part * (balls.velocity + velocity),
        velocity=velocity,
        spin=balls.spin + part * turn,
        rolled=balls.rolled + 0.5 * t[:, None] * (speeds[0] + speeds[1]) / balls.ball.radius * balls.rolling,
        time=balls.time + t,
    )


def look(hooks: Hooks, cloth: Array, balls: Balls, span: Array) -> Curve:
    """Follow what acts from the present, which `balls` hold, over a trial step."""
    bend = np.where(span > TINY_STEP_S, span, 0.0)
    push, turn = [balls.acceleration], [balls.turning]
    for part in (1 / 2, 3 / 4):
        then = ahead(balls, push[-1], turn[-1], part * bend)
        then.act(hooks, cloth)
        push.append(then.acceleration)
        turn.append(then.turning)
    over = np.divide(1.0, bend, out=np.zeros_like(bend), where=bend > 0)[:, None, None]
    out = []
    for k in (push, turn):
        one, two = k[1] - k[0], k[2] - k[0]
        out.append(np.stack([k[0], over * (6.0 * one - 8 / 3 * two), over**2 * (16 / 3 * two - 8.0 * one)]))
    return Curve(span, out[0], out[1])


def room(balls: Balls, curve: Curve, left: Array) -> Array:
    """How long an accurate step may be (nsim,) [s], where `left` (nsim,) [s] is to go.

    What counts is the velocity that a ball will roll with: of an error of slip, only that the slide ends too soon.
    """
    r, turn = balls.ball.radius, curve.turn[2]
    now, slip = (
        push[..., :2] + r * np.stack([-turn[..., 1], turn[..., 0]], axis=-1)
        for push, turn in ((curve.push[k], curve.turn[k]) for k in (0, 2))
    )
    roll = curve.push[2][..., :2] - 2 / 7 * slip
    lasts = np.minimum(left[:, None], np.hypot(balls.velocity[..., 0], balls.velocity[..., 1]) / MIN_DECELERATION)
    size = np.hypot(roll[..., 0], roll[..., 1]) * lasts
    early = MIN_DECELERATION * lasts / np.maximum(np.hypot(now[..., 0], now[..., 1]), MIN_DECELERATION)
    size += early * np.hypot(slip[..., 0], slip[..., 1]) + SPIN_ERROR_S * r * np.abs(turn[..., 2])
    worst = np.where(balls.alive, size, 0.0).max(axis=1)
    return np.asarray(np.cbrt(np.divide(STEP_TOLERANCE_M, worst, out=np.full_like(worst, np.inf), where=worst > 0)))


@compiled
def _ends(start: Array, terms: Array, span: float) -> float:
    """When a velocity (k,) that changes by terms (3, k) no longer has a part along what it was; inf if after span."""
    one = np.dot(start, start)
    c = np.array([np.dot(start, terms[0]) / one, np.dot(start, terms[1]) / one / 2, np.dot(start, terms[2]) / one / 3])
    low, high = 0.0, span
    if 1.0 + span * (c[0] + span * (c[1] + span * c[2])) >= 0.0:
        return np.inf
    for _ in range(60):
        t = 0.5 * (low + high)
        if 1.0 + t * (c[0] + t * (c[1] + t * c[2])) > 0.0:
            low = t
        else:
            high = t
    return high


@compiled
def _switches(v: Array, w: Array, push: Array, turn: Array, span: Array, r: float) -> Array:
    out = span.copy()
    for s in range(v.shape[0]):
        for i in range(v.shape[1]):
            slip = np.array([v[s, i, 0] - r * w[s, i, 1], v[s, i, 1] + r * w[s, i, 0]])
            terms = np.empty((3, 2))
            for k in range(3):
                terms[k, 0] = push[k, s, i, 0] - r * turn[k, s, i, 1]
                terms[k, 1] = push[k, s, i, 1] + r * turn[k, s, i, 0]
            if np.hypot(slip[0], slip[1]) > STILL:
                out[s] = min(out[s], _ends(slip, terms, out[s]))
            if abs(w[s, i, 2]) > STILL:
                out[s] = min(out[s], _ends(w[s, i, 2:], np.ascontiguousarray(turn[:, s, i, 2:]), out[s]))
    return out


def follow(hooks: Hooks, cloth: Array, balls: Balls, span: Array, left: Array) -> tuple[Curve, Array]:
    """The curve over a trial step, or over as much of it as can be followed; and the room there was: (nsim,) [s]."""
    curve = look(hooks, cloth, balls, span)
    free = room(balls, curve, left)
    for _ in range(MAX_TRIALS):
        again = np.flatnonzero(curve.span > MAX_TRIAL_RATIO * free)
        if again.size == 0:
            break
        some = take(balls, again)
        part = look(hooks, cloth, some, free[again])
        curve.span[again], curve.push[:, again], curve.turn[:, again] = part.span, part.push, part.turn
        free[again] = room(some, part, left[again])
    # A slide that ends within the step on the curve ends the step.
    curve.span = _switches(balls.velocity, balls.spin, curve.push, curve.turn, curve.span, balls.ball.radius)
    return curve, free


def land(touch: Touch, curve: Curve, span: Array) -> tuple[Array, NDArray[np.int64]]:
    """The step up to the next touch on the curve, at most `span`, and what it is: (nsim,), (nsim, 3)."""
    rows = np.arange(span.size)
    step, hit = touch(rows, curve.chord(curve.push, span), span)
    for _ in range(MAX_TRIALS):
        rows = rows[(hit[rows, 0] > 0) & (step[rows] > 0)]
        if rows.size == 0:
            break
        at = step[rows]
        step[rows], hit[rows] = touch(rows, curve.chord(curve.push[:, rows], at), span[rows])
        rows = rows[np.abs(step[rows] - at) > NO_CHANGE_S]
    return step, hit
