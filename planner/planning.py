"""From a scene and a fitted model to a plan, billiard-plan/1.

In: scene, model with its uncertainty, the launcher's repeatability, weights of the utility. Out: the stroke of greatest
expected utility, physically and as a launcher command; probabilities with intervals over execution errors and model
uncertainty; the distribution of the cue ball's final position; the tolerance of the yaw, which is set by hand, within
which less than a tenth of the pots is lost; predicted tracks, with all effects; the best strokes of other
kinds; and the reasons in words.
"""

from __future__ import annotations

import logging
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.files import read_json
from models.model_file import Model
from models.shot import Track
from planner.evaluation.outcome import FOULS
from planner.evaluation.play import Player
from planner.evaluation.published import unfitted_spread, with_published_spread
from planner.evaluation.risk import ErrorSamples, Evaluation, draw_errors
from planner.evaluation.value import UtilityWeights
from planner.launcher.execution import Execution
from planner.launcher.mapped import usual_launcher
from planner.launcher.stroke import AZIMUTH, LauncherModel, stroke_terms
from planner.reasons import comparison_in_words, kind_in_words, reasons
from planner.scene import POCKETS, Scene, pocket_name, scene_dict
from planner.search import baseline
from planner.search.search import (
    Effort,
    RankedStroke,
    in_both_engines,
    playable,
    search,
)

Array = NDArray[np.float64]
PLAN_FORMAT = "billiard-plan/1"
METHODS, GIVEN = ("risk", "ga"), "given"  # methods of the search; the mark of a given stroke
FAN_PLAYS = 40  # tracks kept, from the first plays of the evaluation
MAX_PLACES = 500  # most final positions of the cue ball that are kept
TRACK_PERIOD_S, FAN_PERIOD_S = 0.02, 0.08  # time between points of the planned tracks, and of the fan's
MAX_POT_LOSS = 0.1  # share of the pots lost at the tolerance of the yaw
TURNS_DEG = np.concatenate([np.arange(0.0, 0.2, 0.01), np.arange(0.2, 1.0, 0.02), np.arange(1.0, 4.01, 0.1)])
YAW_SAMPLES = 256  # plays at each turn of the yaw
COARSE_STRIDE = 7  # stride of the first turns tried, before the interval with the limit is refined
MAX_ALTERNATIVES = 4
log = logging.getLogger(__name__)


def make_plan(
    scene: Scene, model: Model, execution: Execution | None = None, weights: UtilityWeights | None = None, *,
    method: str = "risk", seed: int = 0, launcher: LauncherModel | None = None, effort: Effort | None = None,
    threads: int = 0,
) -> dict[str, Any]:  # fmt: skip
    """Plan a shot.

    Args:
        scene: balls and goal.
        model: fitted to the same table and ball; constants without a standard deviation vary as published ones do
            (planner/evaluation/published.py).
        execution: the launcher's repeatability; by default the usual one.
        weights: of the utility; by default the usual ones.
        method: "risk", the search under errors, or "ga", the paper's on the nominal model.
        seed: of all random numbers; the same seed gives the same plan at any number of threads.
        launcher: by default one with constants from the literature.
        effort: amount of computation.
        threads: at most; 0 for all.

    Returns:
        The plan as plain values; "stroke" is None if no shot is reasonable.

    Raises:
        BadInput: for a model that does not fit the scene, and an unknown method.
    """
    if method not in METHODS:
        raise BadInput(f"method is {method!r}; choose from {', '.join(METHODS)}")
    execution, weights, effort = execution or Execution(), weights or UtilityWeights(), effort or Effort()
    player = Player(with_published_spread(model), scene, launcher or usual_launcher(model), threads)
    head = _head(player, model, execution, weights, method, seed)
    if method == "ga":
        strokes, why = _baseline_stroke(player, execution, weights, seed, effort)
    else:
        strokes = search(player, execution, weights, seed=seed, effort=effort)
        why = reasons(player, strokes, weights)
    if not strokes:
        return head | {"stroke": None, "launcher": None, "alternatives": [], "why": why}
    log.info("tracks, and the tolerance of the yaw")
    best = strokes[0].evaluation
    plan = _stroke_entries(player, strokes[0]) | {"why": why}
    plan["launcher"]["theta_tolerance_deg"] = yaw_tolerance(player, best.q, execution, seed + 2)
    plan |= _plays(player, best, draw_errors(player.model, execution, effort.fresh, seed + 1))
    others = [_stroke_entries(player, one) for one in strokes[1 : 1 + MAX_ALTERNATIVES]]
    for other in others:
        other["why"] = comparison_in_words(plan, other)
    return head | plan | {"alternatives": others}


def plan_of(
    scene: Scene, model: Model, stroke: Array, why: str, execution: Execution, launcher: LauncherModel, *,
    seed: int = 0, effort: Effort | None = None,
) -> dict[str, Any]:  # fmt: skip
    """A given stroke as a plan: its expected outcomes, under the same errors as those of a searched one.

    Args:
        scene: balls and goal; the goal need not be reached.
        model: fitted to the same table and ball.
        stroke: (4,), see planner/launcher/stroke.py; the nearest playable one is used.
        why: the reason for the stroke.
        execution: the launcher's repeatability.
        launcher: the launcher that plays it.
        seed: of all random numbers.
        effort: how much to compute.

    Returns:
        The plan as plain values.
    """
    effort, weights = effort or Effort(), UtilityWeights()
    player = Player(with_published_spread(model), scene, launcher)
    rows = launcher.playable(stroke[None], scene.ball)
    samples = draw_errors(player.model, execution, effort.fresh, seed + 1)
    final, engines, _ = in_both_engines(player, samples, rows, weights, effort.checked)
    plan = _entries(player, final[0], engines[0]) | {"pocket": None, "kind": why, "why": why, "alternatives": []}
    return _head(player, model, execution, weights, GIVEN, seed) | plan | _plays(player, final[0], samples)


def _head(
    player: Player, model: Model, execution: Execution, weights: UtilityWeights, method: str, seed: int
) -> dict[str, Any]:
    """The entries of a plan that do not depend on its stroke; `model` is the one passed in."""
    about = {
        "effects": [e.name() for e in player.model.effects], "fitted": bool(model.estimates),
        "published_sd": {name: float(f"{sd:.3g}") for name, sd in unfitted_spread(model).items()},
    }  # fmt: skip
    return {
        "format": PLAN_FORMAT, "method": method, "seed": seed, "scene": scene_dict(player.scene), "model": about,
        "execution": asdict(execution), "weights": asdict(weights),
    }  # fmt: skip


def _plays(player: Player, evaluation: Evaluation, samples: ErrorSamples) -> dict[str, Any]:
    """The entries of a stroke's evaluation plays; `samples` are their errors."""
    shown = np.flatnonzero(np.isfinite(evaluation.outcomes.cue[:, 0]))[:MAX_PLACES]
    places = {
        "cue": _rounded(evaluation.outcomes.cue[shown]), "potted": evaluation.outcomes.potted[shown].tolist(),
    }  # fmt: skip
    return {"fan": _fan(player, evaluation, samples.first(FAN_PLAYS)), "places": places}


def _baseline_stroke(
    player: Player, execution: Execution, weights: UtilityWeights, seed: int, effort: Effort
) -> tuple[list[RankedStroke], str]:
    """The paper's stroke, evaluated under errors but chosen without them, with the reason, or why there is none."""
    route, q, cost = baseline.search(player, seed=seed)
    pocket = pocket_name(POCKETS[route.pocket])
    if cost > baseline.VIOLATION_COST_M2:
        reason = f": {route.obstacle}" if route.obstacle else ""
        return [], f"no stroke sends the ball within 55 mm of the {pocket}{reason}"
    if cost >= baseline.IN_OFF_COST_M2:
        return [], f"every stroke that sends the ball within 55 mm of the {pocket} loses the cue ball"
    rows, _ = playable(player, q[None], np.zeros(1, np.int64))
    if len(rows) == 0:
        return [], "the stroke found is beyond the launcher's strings"
    samples = draw_errors(player.model, execution, effort.fresh, seed + 1)
    final, engines, _ = in_both_engines(player, samples, rows, weights, effort.checked)
    away = 1e3 * math.sqrt(max(cost, 0.0))
    why = (
        f"differential evolution on the nominal model: the cue ball {away:.0f} mm from the wanted place, the path of "
        f"the ball within 55 mm of the {pocket}; launcher errors did not enter the choice"
    )
    if not player.play(rows).potted[0]:
        why += "; that far from its middle the jaws keep the ball out"
    return [RankedStroke(route, final[0], engines[0])], why


def _stroke_entries(player: Player, stroke: RankedStroke) -> dict[str, Any]:
    """The common entries of a plan's stroke and of its alternatives."""
    about = {"pocket": list(POCKETS[stroke.route.pocket]), "kind": kind_in_words(stroke, player.scene.ball.radius)}
    return _entries(player, stroke.evaluation, stroke.engines) | about


def _entries(player: Player, evaluation: Evaluation, engines: dict[str, Any]) -> dict[str, Any]:
    """The entries of a stroke and its outcomes."""
    return {
        "stroke": stroke_terms(player.launcher, evaluation.q),
        "launcher": player.launcher.command(player.model, evaluation.q), **evaluation.figures(player.scene),
        "tracks": moving(player.tracks(evaluation.q[None], every=TRACK_PERIOD_S)[0]), "engines": engines,
    }  # fmt: skip


def yaw_tolerance(player: Player, q: Array, execution: Execution, seed: int) -> list[float]:
    """Errors of the yaw of a stroke (4,), negative and positive, within which at most MAX_POT_LOSS of the pots is lost.

    Returns:
        Two angles [degrees]: the last of TURNS_DEG, or between coarse ones, at which enough is potted.
    """
    samples = draw_errors(player.model, execution, YAW_SAMPLES, seed)
    coarse = TURNS_DEG[::COARSE_STRIDE]
    potted = _pot_rates(player, samples, q, np.concatenate([-coarse, coarse[1:]]))
    threshold = (1 - MAX_POT_LOSS) * potted[0]
    limits = []
    for sign, rates in ((-1.0, potted[: len(coarse)]), (1.0, np.r_[potted[0], potted[len(coarse) :]])):
        lost = rates < threshold
        k = int(np.argmax(lost)) if lost.any() else len(coarse)
        if k == len(coarse):
            limits.append(sign * float(coarse[-1]))
            continue
        fine = np.linspace(coarse[k - 1], coarse[k], COARSE_STRIDE + 1)[:-1] if k else np.zeros(1)
        rates = np.r_[rates[max(k - 1, 0)], _pot_rates(player, samples, q, sign * fine[1:])]
        limits.append(sign * float(fine[np.flatnonzero(rates >= threshold)[-1]]) if k else 0.0)
    return [round(v, 3) + 0.0 for v in limits]


def _pot_rates(player: Player, samples: ErrorSamples, q: Array, turns: Array) -> Array:
    """Share of plays of a stroke (4,) that pot at each turn of the yaw (n,) [degrees]: (n,)."""
    if len(turns) == 0:
        return np.zeros(0)
    turned = np.repeat(q[None], len(turns), axis=0)
    turned[:, AZIMUTH] += np.radians(turns)
    potted = samples.play(player, turned).potted
    return np.asarray(potted.reshape(len(turns), -1).mean(axis=1))


def _fan(player: Player, evaluation: Evaluation, samples: ErrorSamples) -> list[dict[str, Any]]:
    """Outcomes and tracks of a stroke's first evaluation plays; `samples` are their errors."""
    played = samples.execution.perturb(evaluation.q[None], samples.normal)[0]
    out, entries = evaluation.outcomes, []
    for k, track in enumerate(player.tracks(played, samples.values, every=FAN_PERIOD_S)):
        fouls = [name for name, committed in zip(FOULS, out.fouls[k], strict=True) if committed]
        entries.append({"potted": bool(out.potted[k]), "foul": ", ".join(fouls), "tracks": moving(track)})
    return entries


def moving(track: Track) -> list[dict[str, Any]]:
    """Tracks of the balls that move, until they stop or fall, as the entries of a plan."""
    out = []
    for k, name in enumerate(track.names):
        xy = track.position[:, k]
        on_table = np.isfinite(xy[:, 0])
        fell = next((e for e in track.events if e.kind == "pocket" and e.balls[0] == name), None)
        last = xy[on_table][-1]
        if fell is None and np.array_equal(last, xy[0]) and bool((xy == xy[0]).all()):
            continue
        before_end = np.flatnonzero(on_table & (np.abs(xy - last).max(axis=1) > 1e-6))
        end = min(int(before_end[-1]) + 2, int(on_table.sum())) if before_end.size else 1
        times, places = track.times[:end].round(4).tolist(), _rounded(xy[:end])
        if fell is not None and fell.place is not None:
            if times[-1] >= round(fell.time, 4):  # rounded to the same time
                times, places = times[:-1], places[:-1]
            times.append(round(fell.time, 4))
            places.append([round(float(v), 5) for v in fell.place])
        out.append({"ball": name, "t": times, "xy": places})
    return out


def _rounded(xy: Array) -> list[list[float]]:
    """Positions (n, 2) [m], rounded to a hundredth of a millimetre."""
    return [[float(v) for v in row] for row in np.round(xy, 5)]


def read_plan(path: Path | str) -> dict[str, Any]:
    """The values of a plan file; BadInput if it is not one."""
    return read_json(path, PLAN_FORMAT, "name a plan file (planner plan SCENE --out PLAN.json)")
