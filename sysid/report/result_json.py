"""A diagnosis or a discovery as plain values for JSON: `billiard-diagnosis/1` and `billiard-discovery/1`.

In: a `Diagnosis` or a `DiscoveryResult`. Out: dicts, whose keys are the files' format.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid.estimation.clip_fit import band_rate
from sysid.estimation.fitted import FittedModel
from sysid.estimation.split import Split
from sysid.report.findings import predicted_delta_bic, unfitted
from sysid.report.health import health_lines
from sysid.residuals.compare import coverage
from sysid.residuals.comparison import Comparison
from sysid.selection.next_shot import NextShot
from sysid.selection.result import DiscoveryResult
from sysid.selection.screening import CONFOUNDED_CORRELATION, Diagnosis, Screening


def result_of(
    found: DiscoveryResult, elapsed: float, compared: Sequence[tuple[str, Comparison]] = ()
) -> dict[str, Any]:
    """`billiard-discovery/1`; `compared` are models of the ladder, each compared with all clips; `elapsed` in s."""
    now = found.last
    ladder = [
        {"effects": list(v), "rms_m": s.rms, "held_out_rms_m": s.held_rms, "chi2_reduced": s.chi2,
         "converged": s.converged}
        for s, v in zip(found.ladder, found.verdicts, strict=True)
    ]  # fmt: skip
    best = found.explained or now
    values = {n: best.value(n) for n in now.names}
    parameters = {n: {"value": v, "sd": sd, "unit": now.model.meta(n)["unit"]} for n, (v, sd) in values.items()}
    return {
        "format": "billiard-discovery/1", "verdict": list(found.verdict),
        "unexplained": dict(found.unexplained) if found.unexplained else None,
        "noise_floor_m": found.parts.noise, "ladder": ladder, "rounds": [round_json(r) for r in found.rounds],
        "look_alikes": [list(p) for p in found.confounded], "look_alike_from": CONFOUNDED_CORRELATION,
        **_shots_json(found.next_shots), "parameters": parameters,
        "spikes_set_aside": found.parts.spikes,
        "stability": vars(found.stability) if found.stability else None,
        "pruned": list(found.pruned), "converged": found.converged,
        "doubtful": sorted({n for r in found.rounds for n in r.doubtful} - set(found.verdict)), "elapsed_s": elapsed,
        "whole_shots": [
            whole_json(found.verdicts[k], found.ladder[k], comparison)
            for k, (_, comparison) in zip((0, -1), compared, strict=False)
        ],
        "engines": {name: engines_json(one) for name, one in compared},
        "health": health_lines(compared[-1][1].model) if compared else [],
    }  # fmt: skip


def whole_json(verdict: Sequence[str], fitted: FittedModel, comparison: Comparison) -> dict[str, Any]:
    """The first or the last model of the ladder on whole shots."""
    rate = band_rate(fitted)
    return {
        "effects": list(verdict), "rms_m": fitted.rms, "held_out_rms_m": fitted.held_rms,
        "converged": fitted.converged, "band_rate": rate, "held_out_coverage": coverage(comparison, rate),
        "struck_rms_median_held_out_m": comparison.summary()["struck_rms_median_held_out_m"],
        "segment_ratio_median": comparison.summary()["segment_ratio_median"],
    }  # fmt: skip


def judgement_json(
    parts: Split, judged: Diagnosis, unexplained: Mapping[str, Any] | None, shots: Sequence[NextShot]
) -> dict[str, Any]:
    """`billiard-diagnosis/1`."""
    seen = judged.screening
    return {
        "format": "billiard-diagnosis/1", "verdict": [judged.name] if judged.name else [],
        "unexplained": dict(unexplained) if unexplained else None, "noise_floor_m": parts.noise,
        "base": {"rms_m": seen.base.rms, "held_out_rms_m": seen.base.held_rms, "chi2_reduced": seen.base.chi2,
                 "converged": seen.base.converged},
        "windows": seen.windows, "candidates": round_json(seen),
        "margin_delta_bic": seen.margin if np.isfinite(seen.margin) else None,
        "look_alikes": [[a, b] for a, b, _ in seen.confounded], "not_told_apart": [list(p) for p in seen.tied],
        "doubtful": list(seen.doubtful), **_shots_json(shots),
    }  # fmt: skip


def _shots_json(shots: Sequence[NextShot]) -> dict[str, Any]:
    """The next shot, and the whole sequence."""
    entries = [shot.to_dict() for shot in shots]
    return {"next_shot": entries[0] if entries else None, "next_shots": entries}


def engines_json(comparison: Comparison) -> dict[str, float]:
    """Medians over all clips of the rms distance [m], in the event engine and with the same constants in MuJoCo."""
    medians = comparison.summary()
    return {"events_rms_m": medians["rms_median_m"], "mujoco_rms_m": medians["mujoco_rms_median_m"]}


def round_json(seen: Screening) -> list[dict[str, Any]]:
    """Candidates of one round, best first: those fitted, then the predictions for the others."""
    fitted = [
        {"effect": t.name, "delta_bic": t.evidence.delta_bic, "held_out_gain": _held_out_gain(seen.base, t.fitted),
         "fitted": True, "converged": t.converged, "predicted_improvement": t.score.predicted_improvement,
         "rms_m": t.fitted.rms, "held_out_rms_m": t.fitted.held_rms, "samples_that_count_as_one": t.evidence.tau}
        for t in seen.fits
    ]  # fmt: skip
    rest = [
        {"effect": row.candidate.name, "delta_bic": predicted_delta_bic(seen, row), "held_out_gain": None,
         "fitted": False, "predicted_improvement": row.predicted_improvement}
        for row in unfitted(seen)
    ]  # fmt: skip
    return [*fitted, *rest]


def _held_out_gain(base: FittedModel, new: FittedModel) -> float:
    """Share of the held-out rms error that the new model removes; nan where there was none."""
    return 1.0 - new.held_rms / base.held_rms if base.held_rms > 0 else float("nan")
