"""The emulated launcher's strokes of one string, and where they end on an emulated table or on a cloth without end.

In: the launcher's settings, strings, a seed. Out: path length and scatter of the ball for each string
(robot/cueing/repeated.py). The same strokes on an endless cloth (`OPEN_CLOTH`) run up to 30 m and scatter six times as
far; they separate the launcher from the cushions. The emulated launcher repeats its speed within 1.25 %
(robot/emulator/firmware.py), which makes 47 mm over 1800 strokes; 300, as `robot repeat` plays them without options,
give that within 3 mm.

The ball lies on the brown spot and is struck straight up the table, tip at its centre, the stand turned once; it is put
back by hand, within BALL_PLACING_SD_M. Places are those that the emulated camera sees, path lengths are true. Leaves
out a stand that shakes and a stage that moves between strokes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE, spots
from models.model_file import full_model
from models.shot import Array, Table
from robot.cueing.repeated import DEFAULT_REPEATS, Repeated, summarised
from robot.device.settings import Settings
from robot.emulator.table import PLACE_SIGMA_M, EmulatedOptions, EmulatedTable, emulated_launcher

BALL_PLACING_SD_M = 1e-4  # of the place a ball is put back to, each axis [m]; as robot/cueing/striker.py has it
OPEN_CLOTH = Table(250.0, 250.0, pockets=False)  # a cloth on which no ball of 7 m/s comes to a cushion [m]
BALL_NAME = "white"


@dataclass(frozen=True)
class Conditions:
    """Where the ball runs, and how well it is put back and seen."""

    cloth: Table = SNOOKER_TABLE  # or OPEN_CLOTH
    ball_sd: float = BALL_PLACING_SD_M  # of the place that the ball is put back to, each axis [m]
    sigma: float = PLACE_SIGMA_M  # of the camera, each axis [m]


def measure(
    settings: Settings,
    strings: Sequence[int],
    repeats: int = DEFAULT_REPEATS,
    seed: int = 0,
    conditions: Conditions | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[Repeated, ...]:
    """Strike each string again and again on an emulated launcher and table; the same seed gives the same strokes.

    Args:
        settings: of the launcher; its strings run as its calibration says, but for what does not repeat.
        strings: to be measured.
        repeats: of each, 2 or more.
        seed: of the launcher, of the ball's places, and of the camera; the same for every cloth.
        conditions: cloth and errors of hand and camera, where they differ from the defaults.
        progress: called with what is being done.

    Raises:
        BadInput: a string outside calibration or limits, or too few repeats, before anything is struck.
    """
    if not strings:
        raise BadInput("strings is empty; give 1 to 200, as far as the launcher is calibrated")
    if repeats < 2:
        raise BadInput(f"repeats is {repeats}; give 2 or more")
    asked = [settings.check_speed(n) for n in strings]
    conditions = conditions or Conditions()
    cloth, options = conditions.cloth, EmulatedOptions(sigma=conditions.sigma, yaw_sd=0.0)
    model = full_model(cloth, SNOOKER_BALL)
    spot = spots(cloth)["brown"] if cloth.pockets else np.array([-0.45 * cloth.length, 0.0])
    of_launcher, of_hand, of_camera = np.random.default_rng(seed).spawn(3)
    hits: list[tuple[float, float, float]] = []
    launcher, _ = emulated_launcher(settings, lambda *hit: hits.append(hit), of_launcher)
    found = []
    with launcher:
        launcher.home()
        launcher.move_tip(0.0, 0.0)
        for n, speed in zip(strings, asked, strict=True):
            speeds, ends, lengths = np.empty(repeats), np.empty((repeats, 2)), np.empty(repeats)
            for k in range(repeats):
                speeds[k] = launcher.strike(n).cue_speed
                launcher.retract()
                off = conditions.ball_sd * of_hand.standard_normal(2)
                camera_seed = int(of_camera.integers(2**32))
                ground = EmulatedTable(model, {BALL_NAME: tuple(spot + off)}, 0.0, camera_seed, options)
                cue_speed, side, height = hits.pop()
                ground.hit(cue_speed, side + off[1], height)  # a ball to the left is struck on its right
                ends[k] = ground.look().get(BALL_NAME, np.full(2, np.nan))
                lengths[k] = _path_length(ground.track.position[:, 0]) if ground.track is not None else math.nan
            found.append(summarised(n, speed, speeds, ends, lengths))
            if progress:
                progress(f"string {n:03d}p: {repeats} strokes scatter by {1e3 * found[-1].scatter:.0f} mm")
    return tuple(found)


def _path_length(xy: Array) -> float:
    """Length of a path (n, 2) [m]."""
    return float(np.hypot(*np.diff(xy, axis=0).T).sum())
