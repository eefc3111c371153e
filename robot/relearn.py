"""What a series of filmed strokes says of the table and of the launcher.

The table: sysid/discover.py on the films, each up to where a pocket's jaws enter. The launcher: the first velocity of
every film, the fitted model run back to the hit, beside the string, the stage and the yaw that were told, makes a
campaign of its own, to which the cueing map is fitted; what so few strokes do not tell stays with the start map.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from models.analytic.cue_impulse import NAMES
from models.model_file import Model
from models.shot import Array
from planner.cueing_map import CueingMap
from robot.campaign import CueShot
from robot.map_fit import fit_map
from robot.protocol import string_number
from sysid.clips import ClipSet
from sysid.discover import discover
from sysid.findings import model_of, result_of
from sysid.jaws import before_jaws
from sysid.noise import position_noise
from sysid.own import fit_own, polish
from sysid.problem import shot_problem, turn
from sysid.spikes import set_aside

FEWEST = 8  # strokes from which the map is fitted anew; the start map holds what they do not tell
SPEED_SD, SQUIRT_SD = 2e-3, 5e-4  # of a first velocity from a film: fraction of the speed, [rad]; tests/test_learn.py
Report = Callable[[str], None]


def learn_table(clip_set: ClipSet, start: Model, report: Report) -> tuple[Model, dict[str, Any]]:
    """The model that films ask for, beginning at `start`, and the discovery's result (billiard-discovery/1)."""
    found = discover(before_jaws(clip_set), start, report)
    return model_of(found, found.last, "robot learn"), result_of(found, math.nan)


def learn_launcher(
    clip_set: ClipSet, played: Sequence[Mapping[str, Any]], model: Model, start: CueingMap, report: Report
) -> tuple[CueingMap, dict[str, dict[str, float]]]:
    """The cueing map that films and what was told ask for, and its constants with their standard deviations.

    Args:
        clip_set: films of the strokes.
        played: the record of each (billiard-played/1), in the same order.
        model: of the table, fitted.
        start: the map that is held for known before.
        report: told what is being done.
    """
    report("first velocities")
    strokes = strokes_of(clip_set, played, first_velocities(clip_set, model))
    places = [{s.x0_mm for s in strokes}, {s.y0_mm for s in strokes}]
    if len(strokes) < FEWEST or min(map(len, places)) < 3:
        made = start
    else:
        made = fit_map(strokes, start.geometry, start=start.constants, execution=start.execution, fewest=FEWEST)
    sds = np.sqrt(np.diag(made.covariance))
    return made, {n: {"value": getattr(made.constants, n), "sd": float(s)} for n, s in zip(NAMES, sds, strict=True)}


def first_velocities(clip_set: ClipSet, model: Model) -> dict[str, Array]:
    """What the struck ball of every clip begins with, by its file: (2,) [m/s], table frame."""
    clip_set = before_jaws(clip_set)
    sigma = position_noise(clip_set)
    clip_set, _ = set_aside(clip_set, sigma)
    problem = shot_problem(model, (), clip_set, sigma)
    none = np.zeros(0)
    x = polish(problem, fit_own(problem, clip_set, none, sigma), none)
    return {
        clip.file: turn(float(azimuth)) @ row[2:4]
        for clip, azimuth, row in zip(clip_set.clips, problem.azimuth, x, strict=True)
    }


def strokes_of(
    clip_set: ClipSet, played: Sequence[Mapping[str, Any]], velocities: Mapping[str, Array]
) -> list[CueShot]:
    """Strokes as a campaign has them: what was told, and what the ball began with."""
    out = []
    for k, (clip, record) in enumerate(zip(clip_set.clips, played, strict=True)):
        if clip.file not in velocities:
            continue
        velocity, done = velocities[clip.file], record["done"]
        speed = float(np.hypot(*velocity))
        aside = math.atan2(velocity[1], velocity[0]) - math.radians(record["asked"]["theta_deg"])
        out.append(
            CueShot(
                string_number(record["asked"]["string"]), done["asked_speed"], done["x0_mm"], done["y0_mm"], speed,
                SPEED_SD * speed, 0.0, math.remainder(aside, 2 * math.pi), SQUIRT_SD, 0.0, False, k,
            )
        )  # fmt: skip
    return out
