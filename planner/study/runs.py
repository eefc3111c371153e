"""Plans over many random scenes, evaluated on a truth that the planner does not know.

In: a `Study` and the number of a scene (planner/study/draws.py). Out: the results of that scene as plain values: scene,
truth, planned strokes with their predicted and observed figures, and the ceiling.

Strokes are planned on the model and played on the truth in MuJoCo, with new execution errors. The ceiling is the best
stroke of the same search if it knows the truth and has no goal position; it is chosen on one set of samples and
evaluated on another, that of the planners, so that it is not biased by the choice. Left out: errors that are correlated
from shot to shot.
"""

from __future__ import annotations

import dataclasses
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.model_file import Model
from planner.evaluation.outcome import FOULS
from planner.evaluation.play import Player
from planner.evaluation.risk import ErrorSamples, draw_errors, evaluate
from planner.evaluation.value import UtilityWeights, rest_distance
from planner.launcher.stroke import LauncherModel, stroke_terms
from planner.planning import moving
from planner.scene import Scene, scene_dict
from planner.search import baseline
from planner.search.search import playable, search
from planner.study.draws import PLACE_DECIMALS, Stream, Study, draw_scene, draw_truth

Array = NDArray[np.float64]
STUDY_SCENE_FORMAT = "billiard-study-scene/1"
CEILING_SAMPLES = 64  # samples that order the ceiling's strokes, before their final evaluation
TRACK_PERIOD_S = 0.04  # time between points of a track


def study_scene(study: Study, number: int) -> dict[str, Any]:
    """Draw, plan and evaluate one scene; an unexpected exception becomes its "error", and the scene does not count."""
    began = time.perf_counter()
    result: dict[str, Any] = {"format": STUDY_SCENE_FORMAT, "number": number}
    try:
        scene, tries = draw_scene(study, number)
        result |= {"scene": scene_dict(scene), "tries": tries} | _SceneStudy(study, number, scene).results()
    except BadInput:
        raise
    except Exception as error:  # noqa: BLE001 (a fault in one scene must not end the others)
        last = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__} in {Path(last.filename).name} line {last.lineno}: {error}"
        result |= {"error": " ".join(text.split()), "seconds": {}}
    result["seconds"]["all"] = time.perf_counter() - began
    return result


def _plan_by_search(study: Study, player: Player, seed: int) -> Array | None:
    """The stroke (4,) of the search under errors."""
    strokes = search(player, study.execution, study.weights, seed=seed, effort=study.effort)
    return strokes[0].evaluation.q if strokes else None


def _plan_by_baseline(study: Study, player: Player, seed: int) -> Array | None:
    """The stroke (4,) of the paper's method."""
    _, q, cost = baseline.search(player, seed=seed)
    if cost > baseline.VIOLATION_COST_M2:
        return None
    rows, _ = playable(player, q[None], np.zeros(1, np.int64))
    return rows[0] if len(rows) else None


PLANNERS: dict[str, Callable[[Study, Player, int], Array | None]] = {
    "risk": _plan_by_search,
    "ga": _plan_by_baseline,
}


class _SceneStudy:
    """One scene of a study: planned on the model, evaluated on the truth."""

    def __init__(self, study: Study, number: int, scene: Scene) -> None:
        """Draw the truth and the errors of the plays on it."""
        self.study, self.number = study, number
        self.player = Player(study.model, scene, LauncherModel(), threads=1)
        model, self.drawn = draw_truth(study, number)
        self.truth = Player(model, scene, LauncherModel(), threads=1)
        self.samples = self._draw(model, study.plays, self._seed(Stream.OBSERVED))

    def _seed(self, stream: Stream) -> int:
        return self.study.number(self.number, stream)

    def _draw(self, model: Model, count: int, seed: int) -> ErrorSamples:
        return draw_errors(model, self.study.execution, count, seed)

    def results(self) -> dict[str, Any]:
        """The entries of the scene's file."""
        seconds, methods, strokes = {}, {}, []
        for method in self.study.methods:
            began = time.process_time()  # wall-clock time would include other work of the cores
            q = PLANNERS[method](self.study, self.player, self._seed(Stream.PLAN))
            seconds[method] = time.process_time() - began
            methods[method] = self._stroke_entries(q)
            if q is not None:
                strokes.append((method, q))
        return {"truth": self.drawn, "methods": methods, "ceiling": self._ceiling(strokes), "seconds": seconds}

    def _stroke_entries(self, q: Array | None) -> dict[str, Any]:
        """Predicted figures of a stroke (4,), and those observed on the truth; None pots nothing."""
        if q is None:
            none = {"potted": 0.0, "made": 0.0, "foul": 0.0, "fouls": dict.fromkeys(FOULS, 0.0), "away": []}
            return {"stroke": None, "predicted": None, "seen": none | {"median": None, "median_all": None}}
        study, player = self.study, self.player
        # The samples that ordered the search's finalists, as for the figures of a plan file.
        fresh = self._draw(player.model, study.effort.fresh, self._seed(Stream.PLAN) + 1)
        predicted = evaluate(player, fresh, q[None], study.weights, mujoco=True)[0]
        tracks = moving(player.tracks(q[None], every=TRACK_PERIOD_S)[0])
        return {
            "stroke": stroke_terms(player.launcher, q), "predicted": predicted.figures(player.scene),
            "seen": self._observed(q),
            "tracks": [{"ball": t["ball"], "xy": np.round(t["xy"], PLACE_DECIMALS).tolist()} for t in tracks],
        }  # fmt: skip

    def _observed(self, q: Array) -> dict[str, Any]:
        """Figures of a stroke (4,) played on the truth."""
        out = self.samples.play(self.truth, q[None], mujoco=True)
        away = rest_distance(self.truth.scene, out)
        rests = np.isfinite(away)
        of_pots = np.sort(away[out.potted & rests])
        return {
            "potted": float(out.potted.mean()), "made": float(out.made.mean()), "foul": float(out.foul.mean()),
            "fouls": {name: float(out.fouls[:, k].mean()) for k, name in enumerate(FOULS)},
            "away": np.round(of_pots, PLACE_DECIMALS).tolist(),
            "median": float(np.median(of_pots)) if of_pots.size else None,
            "median_all": float(np.median(away[rests])) if rests.any() else None,
        }  # fmt: skip

    def _ceiling(self, strokes: list[tuple[str, Array]]) -> dict[str, Any]:
        """The best pot on the truth, among a search that knows it and the planned strokes (4,)."""
        study, truth, seed = self.study, self.truth, self._seed(Stream.CEILING)
        effort = dataclasses.replace(study.effort, fresh=min(study.effort.fresh, CEILING_SAMPLES))
        pot_alone = UtilityWeights(rest=0.0, foul=0.0)
        found = search(truth, study.execution, pot_alone, seed=seed, effort=effort)
        offered = [("search", one.evaluation.q) for one in found] + strokes
        if not offered:
            return {"potted": 0.0, "made": 0.0, "by": None, "stroke": None}
        others = self._draw(truth.model, study.plays, seed + 2)
        rows = np.array([q for _, q in offered])
        best = int(np.argmax([e.made for e in evaluate(truth, others, rows, pot_alone, mujoco=True)]))
        by, q = offered[best]
        out = self.samples.play(truth, q[None], mujoco=True)
        stroke = stroke_terms(truth.launcher, q)
        return {"potted": float(out.potted.mean()), "made": float(out.made.mean()), "by": by, "stroke": stroke}
