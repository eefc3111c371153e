"""What a series of filmed strokes says of the table and of the launcher.

The launcher: what every film begins with, up to its first impact, beside the string, the stage and the yaw that were
told, makes a campaign of its own, to which the cueing map is fitted; what so few strokes do not tell stays with the
start map. The table: sysid/selection/discover.py on the films, each up to where a pocket's jaws enter, with the
commands that this map makes of what was told: a launcher that is not yet known must not look like an effect of the
table. A squirt that is found all the same is the launcher's, and left to its map, which is fitted again in the end.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.analytic.cue_impulse import NAMES
from models.model_file import Model
from models.shot import Array
from planner.launcher.cueing_map import CueingMap
from robot.cueing.campaign import CueShot
from robot.cueing.map_fit import fit_map
from robot.device.protocol import string_number
from sysid.clips import ClipSet, Cue
from sysid.clips.jaws import before_jaws
from sysid.clips.noise import position_noise
from sysid.clips.outliers import set_aside
from sysid.estimation.initial_states import fit_states, grown_by_stage
from sysid.estimation.problem import turn
from sysid.estimation.shot_problem import shot_problem
from sysid.report.outcome import model_of
from sysid.report.result_json import result_of
from sysid.selection.discover import discover

FEWEST = 8  # strokes from which the map is fitted anew; the start map holds what they do not tell
LONGEST = 0.4  # of a film's beginning [s]
SQUIRT = "squirt"  # name or slot
log = logging.getLogger("sysid.relearn")


@dataclass(frozen=True)
class Learnt:
    """Table and launcher, as a series of strokes tells them."""

    model: Model
    cueing_map: CueingMap
    result: dict[str, Any]  # of the discovery, billiard-discovery/1

    def launcher(self) -> dict[str, dict[str, float]]:
        """Constants of the map, with their standard deviations."""
        sds = np.sqrt(np.diag(self.cueing_map.covariance))
        made = self.cueing_map.constants
        return {n: {"value": getattr(made, n), "sd": float(s)} for n, s in zip(NAMES, sds, strict=True)}


def relearn(
    clip_set: ClipSet, played: Sequence[Mapping[str, Any]], start: Model, start_map: CueingMap, known: Model,
) -> Learnt:  # fmt: skip
    """Learn both from all strokes so far.

    Args:
        clip_set: films of the strokes.
        played: the record of each (billiard-played/1), in the same order.
        start: the model that the discovery begins with.
        start_map: the map that is held for known before.
        known: the best model so far.
    """
    short = before_jaws(clip_set)
    log.info("what every film begins with")
    rough = learn_launcher(short, played, known, start_map)
    found = discover(with_commands(short, played, rough), start)
    model = model_of(found, found.last, "robot learn")
    model = dataclasses.replace(model, effects=tuple(e for e in model.effects if SQUIRT not in (e.slot, e.name())))
    return Learnt(model, learn_launcher(short, played, model, start_map), result_of(found, math.nan))


def learn_launcher(
    clip_set: ClipSet, played: Sequence[Mapping[str, Any]], model: Model, start: CueingMap
) -> CueingMap:  # fmt: skip
    """The cueing map that films and what was told ask for, seen with a model of the table."""
    strokes = strokes_of(clip_set, played, first_velocities(clip_set, model))
    places = [{s.x0_mm for s in strokes}, {s.y0_mm for s in strokes}]
    if len(strokes) < FEWEST or min(map(len, places)) < 3:
        return start
    return fit_map(strokes, start.geometry, start=start.constants, execution=start.execution, fewest=FEWEST)


def with_commands(clip_set: ClipSet, played: Sequence[Mapping[str, Any]], cueing_map: CueingMap) -> ClipSet:
    """The clips, their commands what a map makes of what was told: the ball's speed, way and spin."""
    told = {record["clip"]["file"]: record for record in played}
    clips = []
    for clip in clip_set.clips:
        done, theta = told[clip.file]["done"], math.radians(told[clip.file]["asked"]["theta_deg"])
        stroke = (done["asked_speed"], 1e-3 * done["x0_mm"], 1e-3 * done["y0_mm"])
        speed, turned, side, height = (float(v[0]) for v in cueing_map.give(*(np.array([v]) for v in stroke)))
        azimuth = math.remainder(theta + turned, 2 * math.pi)
        cue = Cue(speed, azimuth, side, height, cueing_map.geometry.elevation)
        clips.append(dataclasses.replace(clip, cue=cue))
    return dataclasses.replace(clip_set, clips=tuple(clips))


def first_velocities(clip_set: ClipSet, model: Model) -> dict[str, tuple[Array, float, float]]:
    """What the struck ball of every clip begins with, by its file: velocity (2,), its sd along and across [m/s].

    From its way to the first impact, or so much of it as `LONGEST`: a model that is still wrong errs little there. How
    well a film tells it is that of all its unknowns together: a ball that is struck near natural roll slides for a few
    frames only, and spin across its way then looks like another direction, 25 mrad of it in place of 1.
    """
    sigma = position_noise(clip_set)
    clip_set, _ = set_aside(clip_set, sigma)
    problem = shot_problem(model, (), clip_set, sigma)
    none = np.zeros(0)
    begun = problem.until(np.clip(problem.horizon_at(0), 2 / clip_set.fps, LONGEST))
    x = fit_states(begun, grown_by_stage(problem, problem.start, none, 0), none, 10)
    every, constants = np.arange(len(x)), np.zeros((len(x), 0))
    steps = np.diag(problem.steps)
    slopes = [(begun.evaluate(x + s, constants, every) - begun.evaluate(x - s, constants, every)) for s in steps]
    jacobian = np.nan_to_num(np.stack(slopes, axis=-1) / (2 * problem.steps))
    known = np.swapaxes(jacobian, 1, 2) @ jacobian + problem.prior.sd[:, :, None] ** -2.0 * np.eye(x.shape[1])
    out = {}
    for clip, azimuth, row, cov in zip(clip_set.clips, problem.azimuth, x, np.linalg.inv(known), strict=True):
        along = row[2:4] / np.hypot(*row[2:4])
        across = np.array([-along[1], along[0]])
        sds = (float(np.sqrt(way @ cov[2:4, 2:4] @ way)) for way in (along, across))
        out[clip.file] = (turn(float(azimuth)) @ row[2:4], *sds)
    return out


def strokes_of(
    clip_set: ClipSet, played: Sequence[Mapping[str, Any]], velocities: Mapping[str, tuple[Array, float, float]]
) -> list[CueShot]:
    """Strokes as a campaign has them: what was told, and what the ball began with."""
    told = {record["clip"]["file"]: record for record in played}
    out = []
    for k, clip in enumerate(clip_set.clips):
        (velocity, sd, sd_across), record = velocities[clip.file], told[clip.file]
        speed, done = float(np.hypot(*velocity)), record["done"]
        aside = math.atan2(velocity[1], velocity[0]) - math.radians(record["asked"]["theta_deg"])
        out.append(
            CueShot(
                string_number(record["asked"]["string"]), done["asked_speed"], done["x0_mm"], done["y0_mm"], speed, sd,
                0.0, math.remainder(aside, 2 * math.pi), sd_across / speed, 0.0, False, k,
            )
        )  # fmt: skip
    return out
