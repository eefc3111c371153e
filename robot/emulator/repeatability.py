"""Repeatability of the emulated launcher: end points of strokes with one string, on a table or on unlimited cloth.

In: the launcher's settings, strings, a seed. Out: path length and scatter of the ball for each string
(robot/cueing/repeated.py). On an unlimited cloth (`OPEN_CLOTH`) the same strokes run up to 30 m and scatter six times
as much; this separates the launcher from the cushions. The emulated launcher repeats its speed within 1.25 %
(robot/emulator/mechanism.py), which gives 47 mm over 1800 strokes, and within 3 mm of it over 300, the default of
`robot repeat`.

The ball lies on the brown spot and is struck straight up the table, tip at its centre, with the stand turned once; it
is put back by hand, within BALL_PLACING_SD_M. Positions are those of the emulated camera, path lengths are true. Left
out: a shaking stand, and a stage that moves between strokes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from models.model_file import full_model
from models.shot import Array, Table
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE, spots
from robot.cueing.repeated import DEFAULT_REPEATS, Repeated, summarised
from robot.device.settings import Settings
from robot.emulator.table import PLACE_SIGMA_M, EmulatedOptions, EmulatedTable, emulated_launcher

BALL_PLACING_SD_M = 1e-4  # error of the place to which a ball is put back, each axis; as in robot/cueing/striker.py
OPEN_CLOTH = Table(250.0, 250.0, pockets=False)  # so large that no ball of 7 m/s meets a cushion
BALL_NAME = "white"


@dataclass(frozen=True)
class Conditions:
    """The cloth, and the errors of placing and of the camera."""

    cloth: Table = SNOOKER_TABLE  # or OPEN_CLOTH
    ball_sd: float = BALL_PLACING_SD_M  # error of the place to which the ball is put back, each axis [m]
    sigma: float = PLACE_SIGMA_M  # of the camera, each axis [m]


def measure(
    settings: Settings,
    strings: Sequence[int],
    repeats: int = DEFAULT_REPEATS,
    seed: int = 0,
    conditions: Conditions | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[Repeated, ...]:
    """Strike each string repeatedly on an emulated launcher and table; the same seed gives the same strokes.

    Args:
        settings: of the launcher, whose strings follow its calibration apart from random errors.
        strings: strings to measure.
        repeats: strokes of each, 2 or more.
        seed: of launcher, ball placing and camera; the same for every cloth.
        conditions: cloth and errors of placing and camera that differ from the defaults.
        progress: called with a description of the current step.

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
                ground.hit(cue_speed, side + off[1], height)  # a ball displaced to the left is struck on its right
                ends[k] = ground.look().get(BALL_NAME, np.full(2, np.nan))
                lengths[k] = _path_length(ground.track.position[:, 0]) if ground.track is not None else math.nan
            found.append(summarised(n, speed, speeds, ends, lengths))
            if progress:
                progress(f"string {n:03d}p: {repeats} strokes scatter by {1e3 * found[-1].scatter:.0f} mm")
    return tuple(found)


def _path_length(xy: Array) -> float:
    """Length of a path (n, 2) [m]."""
    return float(np.hypot(*np.diff(xy, axis=0).T).sum())
