"""The emulated launcher and camera of a campaign: strokes in MuJoCo with hidden constants, at 180 frames/s.

In: hidden constants, execution errors and a seed. Out: a `CueShot` for every commanded stroke. The constants (cue, end
mass, leather, cloth, zeros of stage and aim) are drawn from known ranges. Each stroke has its own errors:
cue speed within some 1 %, ball and stage put back within 0.1 to 0.3 mm (normal plus backlash), aim within half a
milliradian. The tip strikes in a world that `mj_step` moves (models/mujoco/launcher.py). After the hit the ball moves
in closed form (models/analytic/cloth.py), observed with 0.5 mm of noise per axis, and is measured as at a table
(robot/cueing/first_track.py). Left out: the hop of the ball after the hit, and tracking errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.analytic.cloth import state_at
from models.mjcf.launcher import CueProperties
from models.model_file import full_model
from models.mujoco.launcher import Launcher, SimulatedStroke
from models.mujoco.world import World
from models.shot import Array
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.launcher.stroke import LauncherModel
from robot.cueing.campaign import CueShot
from robot.cueing.first_track import ROLLING_FRICTION, TRACK_LENGTH_S, read_track
from robot.cueing.hidden import draw_values

CAMERA_FPS = 180.0  # [1/s] (Robotic Billiards 2015)
REST_FRAMES = 8  # frames of the resting ball before the hit
BALL_NAME, BALL_SPOT = "white", np.array([-1.23, 0.0])  # name and position of the ball to be struck [m]


@dataclass(frozen=True)
class Hidden:
    """True constants of the emulated launcher."""

    tip_restitution: float = 0.75  # [1]
    cue_mass: float = 0.50  # [kg]
    end_mass: float = 0.00703  # [kg]
    friction: float = 0.21  # of the cloth, in the hit and after [1]
    tip_friction: float = 0.6  # [1]
    side_zero: float = 0.0  # true minus commanded [m]
    height_zero: float = 0.0  # likewise, upwards [m]
    aim_zero: float = 0.0  # likewise, to the left [rad]


@dataclass(frozen=True)
class Sloppiness:
    """Execution errors of a stroke, and errors of the camera; standard deviations."""

    speed: float = 0.01  # of the cue, as a fraction: ripple of the drive
    azimuth: float = 0.0005  # [rad]
    place: float = 1e-4  # positions of ball and stage, each axis [m]
    play: float = 1.5e-4  # backlash of the stage, uniform within +- this [m]
    pixel: float = 5e-4  # of the camera, each axis [m]


def draw_hidden(rng: np.random.Generator) -> Hidden:
    """Hidden constants of an emulated launcher."""
    values = draw_values(rng)
    return Hidden(friction=values.pop("slate_friction"), **values)


def hidden_launcher(hidden: Hidden) -> Launcher:
    """The launcher at the table with these constants, aimed along x at the ball on its spot."""
    cloth = {"decoupled_cloth.slide": hidden.friction}
    world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL).with_values(cloth), (BALL_NAME,))
    device = CueProperties(hidden.cue_mass, hidden.end_mass, hidden.tip_restitution, hidden.tip_friction)
    launcher = Launcher(world, device)
    launcher.aim(world.place({BALL_NAME: BALL_SPOT}), 0.0)
    return launcher


def strike(launcher: Launcher, cue_speed: float, side: float, height: float) -> SimulatedStroke:
    """Strike the ball on its spot once, like `Launcher.strike`."""
    return launcher.strike(launcher.world.place({BALL_NAME: BALL_SPOT}), cue_speed, side, height, run_up=False)


class EmulatedStriker:
    """An emulated launcher with camera, a striker for `run_campaign`.

    Every stroke draws its errors from the seed and its own number, so a campaign that is continued after `played`
    strokes gives the same strokes as an uninterrupted one.
    """

    def __init__(self, hidden: Hidden, sloppiness: Sloppiness, seed: int, played: int = 0) -> None:
        """Set up table, launcher and camera without a stroke."""
        self.hidden, self.sloppiness, self.seed, self.played = hidden, sloppiness, seed, played
        self.launcher = hidden_launcher(hidden)
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
        stroke = strike(self.launcher, cue_speed, float(side), float(height))
        c, s = np.cos(aim), np.sin(aim)
        about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        frames, seen = film(about @ stroke.velocity, about @ stroke.spin, hidden.friction, slop.pixel, rng)
        noise = max(slop.pixel, 1e-6)
        read = read_track(frames, seen, hidden.friction, noise, x0_mm, y0_mm)
        return CueShot(string, commanded, x0_mm, y0_mm, *read, miscue=stroke.miscue)


def film(velocity: Array, spin: Array, friction: float, noise: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Observed times (n,) [s] and positions (n, 2) [m]; the hit is at a random moment between two frames."""
    times = np.arange(-REST_FRAMES, round(CAMERA_FPS * TRACK_LENGTH_S)) / CAMERA_FPS
    after = np.maximum(times - rng.uniform(0.0, 1.0) / CAMERA_FPS, 0.0)
    flat = np.append(velocity[:2], 0.0)[:2]
    xy, _, _ = state_at(after, np.zeros(2), flat, spin, SNOOKER_BALL.radius, friction, ROLLING_FRICTION, 22.0)
    return times, xy + rng.normal(0.0, noise, xy.shape)
