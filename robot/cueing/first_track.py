"""Ball speed and squirt of a stroke, measured from the beginning of the ball's filmed path.

In: times and positions of the cue ball, resting and after the hit. Out: speed and direction as it leaves the tip, with
standard deviations. Start, velocity, slip and time of the hit are fitted to the frames of the first 0.35 s, sliding and
rolling, with the cloth's friction known from the table's fit. A short slide contains little information on the slip,
which therefore has a normal prior about the value of the default constants; the possible error is reported. Left out:
the hop of the ball after the hit.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from models.analytic.cloth import slip
from models.analytic.cue_impulse import Constants, Geometry, launch
from models.errors import BadInput
from models.shot import GRAVITY, Array, Ball
from models.table.snooker import SNOOKER_BALL

TRACK_LENGTH_S = 0.35  # duration after the hit to which velocity and slip are fitted
MIN_TRACK_S, MIN_TRACK_FRAMES = 0.02, 4  # shortest path after the hit; fewest frames later than that
ROLLING_FRICTION = 0.0148  # [1], as in models/mjcf/native.py
SLIP_SD = 0.05  # prior sd of the slip, over the ball's speed [1]


def read_track(
    times: Array, xy: Array, friction: float, noise: float, x0_mm: float, y0_mm: float, ball: Ball = SNOOKER_BALL
) -> tuple[float, float, float, float, float, float]:
    """Ball speed [m/s] and squirt [rad] as the ball leaves the tip, each with two standard deviations.

    The first is the effect of the camera's noise, which differs between repeats; the second is the effect of an error
    in the expected slip, which repeats share.

    Args:
        times: of the frames (n,) [s]; the hit is between the first one after 0 and the one before that.
        xy: positions (n, 2) [m], x along the aim.
        friction: of the sliding ball [1].
        noise: of the camera, per axis [m].
        x0_mm: commanded offset of the cue's axis to the right, which predicts the slip.
        y0_mm: likewise, upwards.
        ball: that was struck.

    Raises:
        BadInput: the track does not determine a speed.
    """
    quick = times > MIN_TRACK_S
    if np.count_nonzero(quick) < MIN_TRACK_FRAMES or np.count_nonzero(times <= 0) < 1:
        raise BadInput(f"{len(times)} frames are too short; film the resting ball and 0.02 s or more after the hit")
    slope = np.polyfit(times[quick], xy[quick], 1)[0]
    pace = float(max(np.hypot(*slope), 1e-3))
    expected = expected_slip(x0_mm, y0_mm, ball)

    def residual(p: Array) -> Array:
        after = np.maximum(times - p[6], 0.0)
        miss = (_run(p[0:2], p[2:4], p[4:6], friction, after) - xy) / noise
        held = (p[4:6] / max(np.hypot(p[2], p[3]), 1e-3) - expected) / SLIP_SD
        return np.concatenate([miss.ravel(), held])

    start = np.concatenate(
        [xy[times <= 0].mean(axis=0), slope + 2.0 / 7.0 * expected * pace * 0.5, expected * pace, [0.0]]
    )
    scale = np.array([1e-3, 1e-3, 0.1 * pace, 0.1 * pace, 0.3 * pace, 0.3 * pace, 3e-3])
    found = least_squares(residual, start, x_scale=scale, max_nfev=60)
    v = found.x[2:4]
    if not found.success or not np.all(np.isfinite(v)):
        raise BadInput(f"no speed can be measured from a track of {len(times)} frames; film that stroke again")
    whole = np.linalg.pinv(found.jac.T @ found.jac)[2:4]
    speed = float(np.hypot(*v))
    axes = np.array([v, [-v[1], v[0]]]) / speed
    (fast, wide), (fast_unsure, wide_unsure) = (
        np.linalg.norm(axes @ whole @ rows.T, axis=-1) for rows in (found.jac[:-2], found.jac[-2:])
    )
    turn = float(np.arctan2(v[1], v[0]))
    return speed, float(fast), float(fast_unsure), turn, float(wide / speed), float(wide_unsure / speed)


def expected_slip(x0_mm: float, y0_mm: float, ball: Ball = SNOOKER_BALL) -> Array:
    """Slip of the ball as it leaves the tip, over its speed, by the usual constants: (2,)."""
    side, height = np.array([1e-3 * x0_mm]), np.array([1e-3 * y0_mm])
    velocity, spin = launch(Constants(), Geometry(ball), np.ones(1), side, height)
    return np.asarray(slip(velocity, spin, ball.radius)[0] / np.hypot(*velocity[0, :2]))


def _run(place: Array, velocity: Array, slipping: Array, friction: float, after: Array) -> Array:
    """Positions of a ball that slides, then rolls: (n, 2) [m], after (n,) [s]."""
    size = max(float(np.hypot(*slipping)), 1e-9)
    lasts = size / (3.5 * friction * GRAVITY)
    s, t = np.minimum(after, lasts)[:, None], np.maximum(after - lasts, 0.0)[:, None]
    rolling = velocity - 2.0 / 7.0 * slipping
    direction = rolling / max(float(np.hypot(*rolling)), 1e-9)
    slid = velocity * s - 0.5 * friction * GRAVITY * slipping / size * s**2
    return np.asarray(place + slid + rolling * t - 0.5 * ROLLING_FRICTION * GRAVITY * direction * t**2)
