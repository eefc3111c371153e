"""Fit of table and launcher to a series of filmed strokes.

In: the clip set of the films with their played records (robot/play.py), the start model and start map. Out: `Learnt`.

The launcher: the ball's velocity before its first impact in every film, with the commanded string, stage and yaw, forms
a campaign to which the cueing map is fitted; if the strokes contain little information the start map is kept. The
table: sysid/selection/discover.py on the films, each cut at the first contact with a pocket's jaws, with the stroke
predicted by this map as the command, so that an unknown launcher does not look like an effect of the table. A squirt
that is found nevertheless belongs to the launcher: it is dropped and the map is fitted again.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.analytic.cue_impulse import CONSTANT_NAMES
from models.model_file import Model
from models.shot import Array
from planner.launcher.cueing_map import CueingMap
from robot.cueing.campaign import CueShot
from robot.cueing.map_fit import fit_map
from robot.device.protocol import string_number
from sysid.clips import ClipSet, CueCommand
from sysid.clips.jaws import before_jaws
from sysid.clips.tracker.noise import position_noise
from sysid.clips.tracker.outliers import remove_outliers
from sysid.estimation.problem import turn
from sysid.estimation.shot_problem import GROWING_RATE, shot_problem
from sysid.estimation.states.initial_states import fit_states
from sysid.estimation.states.state_search import Optima, up_to_event
from sysid.report.result_json import result_of
from sysid.selection.discover import discover

MIN_STROKES = 8  # fewest strokes for a new map; the start map is its prior
MAX_START_S = 0.4  # beginning of a film to which the ball's first velocity is fitted
SQUIRT_NAME = "squirt"  # name of the effect, or of its slot
log = logging.getLogger("sysid.relearn")


@dataclass(frozen=True)
class Learnt:
    """Table and launcher fitted to a series of strokes."""

    model: Model
    cueing_map: CueingMap
    result: dict[str, Any]  # of the discovery, billiard-discovery/1

    def launcher(self) -> dict[str, dict[str, float]]:
        """Constants of the map with their standard deviations."""
        sds = np.sqrt(np.diag(self.cueing_map.covariance))
        made = self.cueing_map.constants
        return {n: {"value": getattr(made, n), "sd": float(s)} for n, s in zip(CONSTANT_NAMES, sds, strict=True)}


def relearn(
    clip_set: ClipSet, played: Sequence[Mapping[str, Any]], start: Model, start_map: CueingMap, known: Model,
) -> Learnt:  # fmt: skip
    """Fit table and launcher to all strokes so far.

    Args:
        clip_set: films of the strokes.
        played: their records (billiard-played/1), in the same order.
        start: start model of the discovery.
        start_map: prior of the cueing map.
        known: best model so far.
    """
    short = before_jaws(clip_set)
    log.info("first velocities of all films")
    rough = learn_launcher(short, played, known, start_map)
    found = discover(with_commands(short, played, rough), start)
    model = found.model_of(found.last, "robot learn")
    model = dataclasses.replace(model, effects=tuple(e for e in model.effects if SQUIRT_NAME not in (e.slot, e.name())))
    return Learnt(model, learn_launcher(short, played, model, start_map), result_of(found, math.nan))


def learn_launcher(
    clip_set: ClipSet, played: Sequence[Mapping[str, Any]], model: Model, start: CueingMap
) -> CueingMap:  # fmt: skip
    """The cueing map fitted to films and commands, with a model of the table."""
    strokes = strokes_of(clip_set, played, first_velocities(clip_set, model))
    places = [{s.x0_mm for s in strokes}, {s.y0_mm for s in strokes}]
    if len(strokes) < MIN_STROKES or min(map(len, places)) < 3:
        return start
    return fit_map(strokes, start.geometry, start=start.constants, execution=start.execution, fewest=MIN_STROKES)


def with_commands(clip_set: ClipSet, played: Sequence[Mapping[str, Any]], cueing_map: CueingMap) -> ClipSet:
    """The clips with commands predicted by a map: speed, azimuth and spin of the ball from string, stage and yaw."""
    records = {record["clip"]["file"]: record for record in played}
    clips = []
    for clip in clip_set.clips:
        done, theta = records[clip.file]["done"], math.radians(records[clip.file]["asked"]["theta_deg"])
        stroke = (done["asked_speed"], 1e-3 * done["x0_mm"], 1e-3 * done["y0_mm"])
        speed, turned, side, height = (float(v[0]) for v in cueing_map.forward(*(np.array([v]) for v in stroke)))
        azimuth = math.remainder(theta + turned, 2 * math.pi)
        cue = CueCommand(speed, azimuth, side, height, cueing_map.geometry.elevation)
        clips.append(dataclasses.replace(clip, cue=cue))
    return dataclasses.replace(clip_set, clips=tuple(clips))


def first_velocities(clip_set: ClipSet, model: Model) -> dict[str, tuple[Array, float, float]]:
    """First velocity of the struck ball of every clip, by file: (2,), with its sd along and across the path [m/s].

    It is fitted to the path up to the first impact, at most MAX_START_S, where an error of the model matters little.
    The sd is marginal over all parameters of the initial state: a ball struck near natural roll slides for a few frames
    only, and spin across its path is then confounded with its direction, whose sd is 25 mrad instead of 1.
    """
    sigma = position_noise(clip_set)
    clip_set, _ = remove_outliers(clip_set, sigma)
    problem = shot_problem(model, (), clip_set, sigma)
    none = np.zeros(0)
    start = problem.until(np.clip(problem.horizon_at(0), 2 / clip_set.fps, MAX_START_S))
    tolerant = problem.with_discrepancy(GROWING_RATE)
    x = fit_states(start, up_to_event(tolerant, Optima.at(problem.start), none, 0).best, none, 10)
    every, constants = np.arange(len(x)), np.zeros((len(x), 0))
    steps = np.diag(problem.steps)
    slopes = [(start.evaluate(x + s, constants, every) - start.evaluate(x - s, constants, every)) for s in steps]
    jacobian = np.nan_to_num(np.stack(slopes, axis=-1) / (2 * problem.steps))
    information = np.swapaxes(jacobian, 1, 2) @ jacobian + problem.prior.sd[:, :, None] ** -2.0 * np.eye(x.shape[1])
    out = {}
    for clip, azimuth, row, cov in zip(clip_set.clips, problem.azimuth, x, np.linalg.inv(information), strict=True):
        along = row[2:4] / np.hypot(*row[2:4])
        across = np.array([-along[1], along[0]])
        sds = (float(np.sqrt(axis @ cov[2:4, 2:4] @ axis)) for axis in (along, across))
        out[clip.file] = (turn(float(azimuth)) @ row[2:4], *sds)
    return out


def strokes_of(
    clip_set: ClipSet, played: Sequence[Mapping[str, Any]], velocities: Mapping[str, tuple[Array, float, float]]
) -> list[CueShot]:
    """The strokes as a campaign: commands, and the ball's first velocities."""
    records = {record["clip"]["file"]: record for record in played}
    out = []
    for k, clip in enumerate(clip_set.clips):
        (velocity, sd, sd_across), record = velocities[clip.file], records[clip.file]
        speed, done = float(np.hypot(*velocity)), record["done"]
        deflection = math.atan2(velocity[1], velocity[0]) - math.radians(record["asked"]["theta_deg"])
        out.append(
            CueShot(
                string_number(record["asked"]["string"]), done["asked_speed"], done["x0_mm"], done["y0_mm"], speed, sd,
                0.0, math.remainder(deflection, 2 * math.pi), sd_across / speed, 0.0, False, k,
            )
        )  # fmt: skip
    return out
