"""What acts on the balls of many simulations at a moment: effects and cloth, for the MuJoCo world and its steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from models import record as rec
from models.analytic.cloth import (
    LAST_SLIP_MARGIN,
    LAST_SLIP_S,
    RESTING,
    ROLLING,
    SLIDING,
    STILL_SPEED,
    STILL_SPIN,
    add_cloth,
)
from models.compiled import compiled
from models.effect import STILL as NO_ROLL
from models.engine.curve import push
from models.hooks import Hooks, call_horizon
from models.shot import GRAVITY, SESSION_FIELDS, Array, Ball

MIN_STOP_STEP_S = 1e-3  # shortest step towards a stop under a push from the side [s]


@dataclass
class Balls:
    """The balls of some simulations, and after `act` what acts on them."""

    ball: Ball
    position: Array  # (n, nball, 3) [m]
    velocity: Array  # (n, nball, 3) [m/s]
    spin: Array  # (n, nball, 3) [rad/s], table frame
    alive: NDArray[np.bool_]  # (n, nball), which are not potted
    rolled: Array  # (n, nball) [rad], turned about the horizontal while rolling, since t = 0
    time: Array  # (n,) [s], since t = 0
    launch: Array  # (n,) [m/s], speed of the struck ball, which is number 0, at t = 0; 0 if it was not struck then
    session: Array  # (n, SESSION_FIELDS)
    rows: NDArray[np.int64]  # (n,) of the simulations among all, to find their parameters
    acceleration: Array = field(default_factory=lambda: np.zeros(0))  # (n, nball, 3) [m/s^2]
    turning: Array = field(default_factory=lambda: np.zeros(0))  # (n, nball, 3) [rad/s^2]
    rolling: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))  # (n, nball)

    def act(self, hooks: Hooks, cloth: Array) -> Array:
        """Let effects and cloth act; returns how long until something switches: (n,) [s].

        `cloth` (nsim, 3): friction of sliding and rolling, deceleration of sidespin; (nsim, 0) where it is MuJoCo's.
        """
        self.acceleration, self.turning = np.zeros_like(self.position), np.zeros_like(self.position)
        self.rolling, span = np.zeros(self.alive.shape, bool), np.full(len(self.rows), np.inf)
        act_rows(
            self.position, self.velocity, self.spin, self.alive, self.rolled, self.time, self.launch, self.session,
            self.ball.radius, self.ball.mass, hooks.own, self.rows, hooks.forces, hooks.support, hooks.horizon, cloth,
            self.acceleration, self.turning, self.rolling, span,
        )  # fmt: skip
        return span


@compiled
def act_rows(  # type: ignore[no-untyped-def]
    p, v, w, alive, rolled, time, launch, session, radius, mass, own, rows, forces, support, horizon, cloth,
    acceleration, turning, rolling, span,
):  # fmt: skip
    """See `Balls.act`."""
    r = np.zeros(rec.BALL_FIELDS)
    at = r.ctypes.data
    for s in range(p.shape[0]):
        parameters = own[rows[s]].ctypes.data
        for i in range(p.shape[1]):
            if not alive[s, i]:
                continue
            r[rec.X], r[rec.Y], r[rec.VX], r[rec.VY] = p[s, i, 0], p[s, i, 1], v[s, i, 0], v[s, i, 1]
            r[rec.WX], r[rec.WY], r[rec.WZ] = w[s, i, 0], w[s, i, 1], w[s, i, 2]
            ux, uy = r[rec.VX] - radius * r[rec.WY], r[rec.VY] + radius * r[rec.WX]
            u, speed = math.sqrt(ux * ux + uy * uy), math.sqrt(r[rec.VX] * r[rec.VX] + r[rec.VY] * r[rec.VY])
            r[rec.SLIP_X], r[rec.SLIP_Y], r[rec.TIME], r[rec.LAUNCH] = ux, uy, time[s], launch[s]
            r[rec.SESSION : rec.SESSION + SESSION_FIELDS] = session[s]
            r[rec.ROLLED], r[rec.NUMBER], r[rec.RADIUS], r[rec.MASS] = rolled[s, i], i, radius, mass
            r[rec.ROLLING] = 1.0 if u < NO_ROLL and speed > NO_ROLL else 0.0
            push(r, at, parameters, forces, support)
            rolling[s, i] = r[rec.ROLLING] > 0.0
            if cloth.shape[1] > 0:
                slide, roll, spin = cloth[rows[s], 0], cloth[rows[s], 1], cloth[rows[s], 2]
                mode = SLIDING if u > STILL_SPEED else (ROLLING if speed > STILL_SPEED else RESTING)
                over, per = 1.0 / u if u > 0.0 else 0.0, 1.0 / speed if speed > 0.0 else 0.0
                add_cloth(
                    r, mode, u, ux * over, uy * over, r[rec.VX] * per, r[rec.VY] * per, r[rec.WZ], slide, roll, spin
                )
                span[s] = min(span[s], _until_switch(r, u, speed, slide))
            for k in range(horizon.shape[0]):
                left = call_horizon(horizon[k, 0], parameters + 8 * horizon[k, 1], at)
                if left == left:
                    span[s] = min(span[s], left)
            acceleration[s, i, 0], acceleration[s, i, 1] = r[rec.AX], r[rec.AY]
            turning[s, i, 0], turning[s, i, 1], turning[s, i, 2] = r[rec.BX], r[rec.BY], r[rec.BZ]


@compiled
def _until_switch(r, slip, speed, slide):  # type: ignore[no-untyped-def]
    """How long until a slide, a roll or a sidespin ends, at what acts now [s]."""
    span, ax, ay = np.inf, r[rec.AX], r[rec.AY]
    sliding = slip > STILL_SPEED
    if sliding:
        x, y = r[rec.SLIP_X], r[rec.SLIP_Y]
        ax, ay = ax - r[rec.RADIUS] * r[rec.BY], ay + r[rec.RADIUS] * r[rec.BX]
    else:
        x, y = r[rec.VX], r[rec.VY]
    closing, size = -(x * ax + y * ay), x * x + y * y
    if size > STILL_SPEED * STILL_SPEED and closing > 0.0:
        span = size / closing
        if sliding and r[rec.SLIDE_FACTOR] != 1.0:
            over = slip - 3.5 * slide * r[rec.WEIGHT] * GRAVITY * LAST_SLIP_S
            if over > LAST_SLIP_MARGIN * slip:
                span = over * slip / closing
        # A rolling ball pushed across its way never comes to an exact stop: steps do not shrink without end.
        if not sliding and abs(x * ay - y * ax) > 1e-6 * closing:
            span = max(span, MIN_STOP_STEP_S)
    if abs(r[rec.WZ]) > STILL_SPIN and r[rec.WZ] * r[rec.BZ] < 0.0:
        span = min(span, -r[rec.WZ] / r[rec.BZ])
    return span
