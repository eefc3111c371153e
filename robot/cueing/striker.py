"""The emulated launcher and camera of a campaign: strokes in MuJoCo with hidden constants, filmed at 180 frames/s.

In: hidden constants, execution errors and a seed. Out: a `CueShot` for every commanded stroke. The constants (cue, end
mass, leather, cloth, zeros of stage and aim) are drawn within what is known of them. Each stroke has its own errors:
cue speed within some 1 %, ball and stage put back within 0.1 to 0.3 mm (normal plus backlash), aim within half a
milliradian. The leather's damping makes its restitution (mjcf/native.py); the bed has plain Coulomb friction, because
MuJoCo's single cone for sliding, rolling and turning would give a spinning ball too little of it. After the hit the
ball runs in closed form (models/analytic/cloth.py), seen with 0.5 mm of noise per axis.

The measurement: start, velocity, slip and time of the hit are fitted to the frames of the first 0.35 s, sliding and
rolling, with the cloth's friction known from the table's fit. A short slide holds little information on the slip, which
therefore has a normal prior about the value of the default constants; the error that this may cause is reported.
Leaves out the hop of the ball after the hit and faults of the tracking.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from models.analytic.cloth import slip, state_at
from models.analytic.cue_impulse import Constants, Geometry, launch
from models.errors import BadInput
from models.mjcf.launcher import NAME_PREFIX, LauncherScene, build_scene, strike
from models.mjcf.native import solref
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
from models.shot import GRAVITY, Array
from planner.launcher.stroke import LauncherModel
from robot.cueing.campaign import CueShot
from robot.cueing.hidden import draw_values

CAMERA_FPS = 180.0  # [1/s] (Robotic Billiards 2015)
TRACK_LENGTH_S = 0.35  # after the hit, to which velocity and slip are fitted
REST_FRAMES = 8  # of the resting ball before the hit
ROLLING_FRICTION = 0.0148  # [1], as models/mjcf/native.py
SLIP_SD = 0.05  # prior sd of the slip, over the ball's speed [1]
BALL_SPOT = np.array([-1.23, 0.0])  # where the ball lies to be struck [m]


@dataclass(frozen=True)
class Hidden:
    """True constants of the emulated launcher."""

    tip_restitution: float = 0.75  # [1]
    cue_mass: float = 0.50  # [kg]
    end_mass: float = 0.00703  # [kg]
    friction: float = 0.21  # of the cloth, in the hit and after [1]
    tip_friction: float = 0.6  # [1]
    side_zero: float = 0.0  # true less commanded [m]
    height_zero: float = 0.0  # the same [m]
    aim_zero: float = 0.0  # the same, to the left [rad]


@dataclass(frozen=True)
class Sloppiness:
    """Execution errors of a stroke, and errors of the camera; standard deviations."""

    speed: float = 0.01  # of the cue, fraction; ripple of the drive
    azimuth: float = 0.0005  # [rad]
    place: float = 1e-4  # of the ball and stage, each axis [m]
    play: float = 1.5e-4  # of the stage, evenly within +- this [m]
    pixel: float = 5e-4  # of the camera, each axis [m]


def draw_hidden(rng: np.random.Generator) -> Hidden:
    """Hidden constants of an emulated launcher."""
    values = draw_values(rng)
    return Hidden(friction=values.pop("slate_friction"), **values)


def hidden_scene(hidden: Hidden) -> LauncherScene:
    """The launcher at the table with these constants in it."""
    scene = build_scene(
        SNOOKER_TABLE,
        SNOOKER_BALL,
        ("white",),
        BALL_SPOT,
        0.0,
        end_mass=hidden.end_mass,
        tip_friction=hidden.tip_friction,
    )
    spec = scene.spec
    spec.body(f"{NAME_PREFIX}cue").mass = hidden.cue_mass - hidden.end_mass
    reduced = 1.0 / (1.0 / SNOOKER_BALL.mass + 1.0 / hidden.cue_mass)
    stiffness, damping = (-value for value in solref(hidden.tip_restitution))
    # solref is for a contact of the world's CONTACT_TIME; the leather's own takes half of that, 1 ms.
    for axis in "xyz":
        joint = spec.joint(f"{NAME_PREFIX}leather {axis}")
        joint.stiffness, joint.damping = [4.0 * stiffness * reduced, 0, 0], [2.0 * damping * reduced, 0, 0]
    bed = next(p for p in spec.pairs if {p.geomname1, p.geomname2} == {"ball white", "bed"})
    bed.condim, bed.friction = 3, [hidden.friction, hidden.friction, 0, 0, 0]
    return dataclasses.replace(scene, model=spec.compile())


class EmulatedStriker:
    """A launcher with camera, as `run_campaign` strikes with it.

    Every stroke draws its errors from the seed and its own number, so a campaign that is continued after an
    interruption (`played` strokes into it) gives the same strokes as one without.
    """

    def __init__(self, hidden: Hidden, sloppiness: Sloppiness, seed: int, played: int = 0) -> None:
        """Set it up; nothing is struck."""
        self.hidden, self.sloppiness, self.seed, self.played = hidden, sloppiness, seed, played
        self.scene = hidden_scene(hidden)
        self.strings = LauncherModel()

    def __call__(self, string: int, x0_mm: float, y0_mm: float) -> CueShot:
        """Strike once and measure."""
        rng = np.random.default_rng((self.seed, self.played))
        self.played += 1
        slop, hidden, commanded = self.sloppiness, self.hidden, self.strings.cue_speed(string)
        off = rng.normal(0.0, slop.place, 2) + rng.uniform(-slop.play, slop.play, 2)
        cue_speed = commanded * (1.0 + slop.speed * rng.standard_normal())
        aim = hidden.aim_zero + slop.azimuth * rng.standard_normal()
        side, height = 1e-3 * x0_mm + hidden.side_zero + off[0], 1e-3 * y0_mm + hidden.height_zero + off[1]
        stroke = strike(self.scene, cue_speed, float(side), float(height))
        c, s = np.cos(aim), np.sin(aim)
        about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        frames, seen = film(about @ stroke.velocity, about @ stroke.spin, hidden.friction, slop.pixel, rng)
        noise = max(slop.pixel, 1e-6)
        read = read_track(frames, seen, hidden.friction, noise, x0_mm, y0_mm)
        return CueShot(string, commanded, x0_mm, y0_mm, *read, miscue=stroke.miscue)


def film(velocity: Array, spin: Array, friction: float, noise: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Times (n,) [s] and places (n, 2) [m] as the camera has them; the hit falls anywhere between two frames."""
    times = np.arange(-REST_FRAMES, round(CAMERA_FPS * TRACK_LENGTH_S)) / CAMERA_FPS
    after = np.maximum(times - rng.uniform(0.0, 1.0) / CAMERA_FPS, 0.0)
    flat = np.append(velocity[:2], 0.0)[:2]
    xy, _, _ = state_at(after, np.zeros(2), flat, spin, SNOOKER_BALL.radius, friction, ROLLING_FRICTION, 22.0)
    return times, xy + rng.normal(0.0, noise, xy.shape)


def read_track(
    times: Array, xy: Array, friction: float, noise: float, x0_mm: float, y0_mm: float
) -> tuple[float, float, float, float, float, float]:
    """Ball speed [m/s] and squirt [rad] as the ball leaves the tip, each with two standard deviations.

    The first is what the camera's noise makes of it, by which repeats scatter; the second is what the slip expected
    may be wrong by, which is the same in every repeat.

    Args:
        times: of the frames (n,) [s]; the hit is between the first after 0 and the one before it.
        xy: places (n, 2) [m], x along the aim.
        friction: of the sliding ball [1].
        noise: of the camera, per axis [m].
        x0_mm: commanded offset of the cue's axis, to the right, from which the slip is predicted.
        y0_mm: the same, up.

    Raises:
        BadInput: the track holds no speed.
    """
    quick = times > 0.02
    if np.count_nonzero(quick) < 4 or np.count_nonzero(times <= 0) < 1:
        raise BadInput(f"a track of {len(times)} frames is too short; film the resting ball and 0.02 s or more after")
    slope = np.polyfit(times[quick], xy[quick], 1)[0]
    pace = float(max(np.hypot(*slope), 1e-3))
    expected = expected_slip(x0_mm, y0_mm)

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


def expected_slip(x0_mm: float, y0_mm: float) -> Array:
    """Of the ball's lowest point as it leaves the tip, over its speed: (2,), by the usual constants."""
    side, height = np.array([1e-3 * x0_mm]), np.array([1e-3 * y0_mm])
    velocity, spin = launch(Constants(), Geometry(SNOOKER_BALL), np.ones(1), side, height)
    return np.asarray(slip(velocity, spin, SNOOKER_BALL.radius)[0] / np.hypot(*velocity[0, :2]))


def _run(place: Array, velocity: Array, slipping: Array, friction: float, after: Array) -> Array:
    """Where a ball is that slides until its slip is gone, then rolls: (n, 2) [m]; after (n,) [s]."""
    size = max(float(np.hypot(*slipping)), 1e-9)
    lasts = size / (3.5 * friction * GRAVITY)
    s, t = np.minimum(after, lasts)[:, None], np.maximum(after - lasts, 0.0)[:, None]
    rolling = velocity - 2.0 / 7.0 * slipping
    direction = rolling / max(float(np.hypot(*rolling)), 1e-9)
    slid = velocity * s - 0.5 * friction * GRAVITY * slipping / size * s**2
    return np.asarray(place + slid + rolling * t - 0.5 * ROLLING_FRICTION * GRAVITY * direction * t**2)


def exact_strokes(
    hidden: Hidden, strokes: Sequence[tuple[int, float, float]]
) -> dict[tuple[int, float, float], tuple[float, float]]:
    """Ball speed [m/s] and squirt [rad] of strokes (string, x0_mm, y0_mm) that go without any error."""
    scene, strings, out = hidden_scene(hidden), LauncherModel(), {}
    for string, x0_mm, y0_mm in strokes:
        side, height = 1e-3 * x0_mm + hidden.side_zero, 1e-3 * y0_mm + hidden.height_zero
        stroke = strike(scene, strings.cue_speed(string), side, height)
        out[string, x0_mm, y0_mm] = float(np.hypot(*stroke.velocity[:2])), stroke.squirt + hidden.aim_zero
    return out
