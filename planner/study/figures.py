"""The figures of a study of plans.

In: results of scenes (planner/study/runs.py). Out: plain values: means over scenes with their standard error, the
calibration of the predicted probabilities, figures by effect, the worst scenes; None without data.

A shot is made if it pots without a foul; shares are means over scenes of the part of plays observed on the truth.
Calibration sorts scenes by the predicted probability of a pot, fouls included, into ten bins: of calibrated predictions
as many pot in each bin as predicted, within the standard error.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.evaluation.outcome import FOULS

Array = NDArray[np.float64]
Record = Mapping[str, Any]  # the results of a scene, or the figures of a study
SEARCH, BASELINE = "risk", "ga"  # keys of the two methods
CALIBRATION_BINS = 10
MIN_BIN_SCENES = 5  # fewest scenes of a bin in the largest gap of calibration
WORST_SCENES = 6  # number of worst scenes listed
UTILITY_MARGIN = 0.01  # least advantage of a baseline stroke that counts as overlooked by the search


def figures(scenes: Sequence[Record]) -> dict[str, Any]:
    """All figures of a study, as plain values."""
    good = [s for s in scenes if "error" not in s]
    methods = list(good[0]["methods"]) if good else []
    out: dict[str, Any] = {
        "scenes": len(good), "failed": [[s["number"], s["error"]] for s in scenes if "error" in s],
        "methods": {m: _of_method(good, m) for m in methods},
        "ceiling": {k: _mean([s["ceiling"][k] for s in good]) for k in ("made", "potted")},
        "ceiling_by": dict(Counter(str(s["ceiling"]["by"]) for s in good)),
        "calibration": {m: _calibration(good, m) for m in methods}, "effects": _by_effect(good, methods),
        "constants": _constants(good), "worst": _worst(good, methods[0] if methods else SEARCH),
    }  # fmt: skip
    if SEARCH in methods and BASELINE in methods:
        gain = np.array([observed(s, SEARCH)["made"] - observed(s, BASELINE)["made"] for s in good])
        out["against"] = {
            "better": float((gain > 0).mean()), "equal": float((gain == 0).mean()), "worse": float((gain < 0).mean()),
            "gain": _mean(gain.tolist()), "overlooked": [s["number"] for s in good if _overlooked(s)],
        }  # fmt: skip
    return out


def observed(scene: Record, method: str) -> Record:
    """The observed figures of a method's stroke on the truth."""
    return scene["methods"][method]["seen"]


def calibration_pairs(scenes: Sequence[Record], method: str) -> Array:
    """Predicted probability of a pot and observed share, for each scene with a stroke: (n, 2)."""
    planned = [s["methods"][method] for s in scenes if s["methods"][method]["predicted"]]
    pairs = [[p["predicted"]["pot_probability"]["value"], p["seen"]["potted"]] for p in planned]
    return np.array(pairs).reshape(-1, 2)


def _overlooked(scene: Record) -> bool:
    """Whether the search itself predicts a greater utility for the baseline's stroke than for its own."""
    chosen, other = (scene["methods"][m]["predicted"] for m in (SEARCH, BASELINE))
    return other is not None and other["value"] > (chosen["value"] if chosen else 0.0) + UTILITY_MARGIN


def _mean(values: Sequence[float]) -> dict[str, float | None]:
    """Mean and its standard error."""
    n = len(values)
    se = float(np.std(values, ddof=1) / math.sqrt(n)) if n > 1 else None
    return {"mean": float(np.mean(values)) if n else None, "se": se}


def _quantile(values: Sequence[float | None], part: float) -> float | None:
    """Quantile of the values other than None."""
    known = [v for v in values if v is not None]
    return float(np.quantile(known, part)) if known else None


def _of_method(scenes: Sequence[Record], method: str) -> dict[str, Any]:
    """The figures of one method."""
    seen = [observed(s, method) for s in scenes]
    seconds = [s["seconds"][method] for s in scenes]
    predicted = [p for s in scenes if (p := s["methods"][method]["predicted"])]
    return {
        **{k: _mean([v[k] for v in seen]) for k in ("made", "potted", "foul")},
        "fouls": {name: _mean([v["fouls"][name] for v in seen])["mean"] for name in FOULS},
        "predicted": _mean([p["pot_probability"]["value"] for p in predicted]),
        "none": sum(s["methods"][method]["stroke"] is None for s in scenes),
        "away_pooled": _quantile([d for v in seen for d in v["away"]], 0.5),
        "away_medians": _quantile([v["median"] for v in seen], 0.5),
        "away_all_medians": _quantile([v["median_all"] for v in seen], 0.5),
        "away_predicted": _quantile([p["rest"]["distance_median"] for p in predicted], 0.5),
        "seconds_median": _quantile(seconds, 0.5), "seconds_95": _quantile(seconds, 0.95),
    }  # fmt: skip


def _calibration(scenes: Sequence[Record], method: str) -> dict[str, Any]:
    """Mean prediction and observation of every bin, and the largest gap between them."""
    pairs, bins = calibration_pairs(scenes, method), list[dict[str, Any]]()
    number = np.minimum((pairs[:, 0] * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    for k in np.unique(number):
        rows = pairs[number == k]
        predicted, seen = (float(v) for v in rows.mean(axis=0))
        se = _mean(rows[:, 1].tolist())["se"]
        start = int(k) / CALIBRATION_BINS
        bins.append({"from": start, "predicted": predicted, "seen": seen, "se": se, "scenes": len(rows)})
    gaps = [abs(b["seen"] - b["predicted"]) for b in bins if b["scenes"] >= MIN_BIN_SCENES]
    return {"bins": bins, "largest_gap": max(gaps) if gaps else None}


def _worst(scenes: Sequence[Record], method: str) -> list[dict[str, Any]]:
    """The scenes in which a method is farthest below the ceiling."""
    ranked = sorted(scenes, key=lambda s: (observed(s, method)["made"] - s["ceiling"]["made"], s["number"]))
    return [
        {"number": s["number"], "made": observed(s, method)["made"], "ceiling": s["ceiling"]["made"],
         "effect": s["truth"]["effect"], "planned": s["methods"][method]["stroke"] is not None}
        for s in ranked[:WORST_SCENES]
    ]  # fmt: skip


def _by_effect(scenes: Sequence[Record], methods: Sequence[str]) -> list[dict[str, Any]]:
    """Shots made, by the effect of the truth that the model lacks, and the range of its parameters."""
    rows = []
    for name in sorted({s["truth"]["effect"] for s in scenes}):
        group = [s for s in scenes if s["truth"]["effect"] == name]
        drawn = {key: [min(v), max(v)] for key, v in _collected(group, "values").items()}
        row = {"effect": name, "scenes": len(group), "drawn": drawn}
        row |= {m: _mean([observed(s, m)["made"] for s in group]) for m in methods}
        rows.append(row | {"ceiling": _mean([s["ceiling"]["made"] for s in group])})
    return rows


def _constants(scenes: Sequence[Record]) -> dict[str, dict[str, float]]:
    """Mean and standard deviation of the constants drawn."""
    drawn = _collected(scenes, "constants")
    return {name: {"mean": float(np.mean(v)), "sd": float(np.std(v))} for name, v in drawn.items()}


def _collected(scenes: Sequence[Record], key: str) -> dict[str, list[float]]:
    """All values under a key of the truths, by name."""
    out: dict[str, list[float]] = {}
    for s in scenes:
        for name, value in s["truth"][key].items():
            out.setdefault(name, []).append(value)
    return out
