"""What a diagnosis or a discovery found: as a model file, as result.json, as text and as parts of a report."""

from __future__ import annotations

import base64
import dataclasses
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from models.console import table
from models.model_file import Model
from sysid.clips.pieces import parent_clip
from sysid.estimation.fitted import FittedModel, as_model
from sysid.estimation.split import Split
from sysid.report.plots_where import missing_map_svg
from sysid.report.text import in_words
from sysid.residuals.comparison import Comparison
from sysid.selection.discover import DiscoveryResult
from sysid.selection.judge import Diagnosis
from sysid.selection.next_shot import NextShot
from sysid.selection.score import Score
from sysid.selection.screening import CONFOUNDED_CORRELATION, MIN_DELTA_BIC, Screening

SHOWN = 8  # candidates listed in a round
NONE = f"none: no effect of the catalogue is worth its parameters (delta BIC under {MIN_DELTA_BIC:.0f})"


def model_of(found: DiscoveryResult, now: FittedModel, command: str) -> Model:
    """A stage's model, with uncertainties, correlations and where they come from.

    Beside a formula for what no effect explains the constants are those of the fit that had it: without it they bend
    to make up for what is missing.
    """
    if now is found.last and found.explained is not None:
        now = dataclasses.replace(
            found.explained, problem=found.explained.problem.with_model(now.model, found.explained.names)
        )
    files = list(dict.fromkeys(parent_clip(c.file) for c in found.parts.training.clips))
    return as_model(now, command, files)


def result_of(
    found: DiscoveryResult, elapsed: float, compared: Sequence[tuple[str, Comparison]] = ()
) -> dict[str, Any]:
    """`billiard-discovery/1`; `compared` are models of the ladder held against all clips."""
    now = found.last
    ladder = [
        {"effects": list(v), "rms_m": s.rms, "held_out_rms_m": s.held_rms, "chi2_reduced": s.chi2,
         "converged": s.converged}
        for s, v in zip(found.ladder, found.verdicts, strict=True)
    ]  # fmt: skip
    best = found.explained or now
    parameters = {
        n: {"value": best.value(n)[0], "sd": best.value(n)[1], "unit": now.model.meta(n)["unit"]} for n in now.names
    }
    return {
        "format": "billiard-discovery/1", "verdict": list(found.verdict),
        "unexplained": dict(found.unexplained) if found.unexplained else None,
        "noise_floor_m": found.parts.noise, "ladder": ladder, "rounds": [round_told(r) for r in found.rounds],
        "look_alikes": [list(p) for p in found.confounded], "look_alike_from": CONFOUNDED_CORRELATION,
        "next_shot": found.next_shot.to_dict() if found.next_shot else None, "parameters": parameters,
        "spikes_set_aside": found.parts.spikes, "shots_cut": found.parts.cut,
        "pruned": list(found.pruned), "converged": now.converged,
        "doubtful": sorted({n for r in found.rounds for n in r.doubtful} - set(found.verdict)), "elapsed_s": elapsed,
        "engines": {name: engines_of(one) for name, one in compared},
    }  # fmt: skip


def engines_of(comparison: Comparison) -> dict[str, float]:
    """Medians over all clips of the rms distance [m], in the event engine and with the same constants in MuJoCo."""
    said = comparison.summary()
    return {"events_rms_m": said["rms_median_m"], "mujoco_rms_m": said["mujoco_rms_median_m"]}


def round_told(seen: Screening) -> list[dict[str, Any]]:
    """Candidates of one round, best first: those fitted, then what the others promised."""
    fitted = [
        {"effect": t.name, "delta_bic": t.evidence.delta_bic, "held_out_gain": _gain(seen.base, t.fitted),
         "fitted": True, "converged": t.converged, "promised": t.score.predicted_improvement, "rms_m": t.fitted.rms,
         "held_out_rms_m": t.fitted.held_rms, "samples_that_count_as_one": t.evidence.tau}
        for t in seen.fits
    ]  # fmt: skip
    rest = [
        {"effect": row.candidate.name, "delta_bic": _promise(seen, row), "held_out_gain": None, "fitted": False,
         "promised": row.predicted_improvement}
        for row in _unfitted(seen)
    ]  # fmt: skip
    return [*fitted, *rest]


def _gain(base: FittedModel, new: FittedModel) -> float:
    """Part of the held-out error that is gone."""
    return 1.0 - new.held_rms / base.held_rms if base.held_rms > 0 else float("nan")


def judgement_told(
    parts: Split, judged: Diagnosis, told: Mapping[str, Any] | None, shot: NextShot | None
) -> dict[str, Any]:
    """`billiard-diagnosis/1`."""
    seen = judged.screening
    return {
        "format": "billiard-diagnosis/1", "verdict": [judged.name] if judged.name else [],
        "unexplained": dict(told) if told else None, "noise_floor_m": parts.noise,
        "base": {"rms_m": seen.base.rms, "held_out_rms_m": seen.base.held_rms, "chi2_reduced": seen.base.chi2,
                 "converged": seen.base.converged},
        "runs": seen.segments, "candidates": round_told(seen),
        "margin_delta_bic": seen.margin if np.isfinite(seen.margin) else None,
        "look_alikes": [[a, b] for a, b, _ in seen.confounded], "not_told_apart": [list(p) for p in seen.tied],
        "doubtful": list(seen.doubtful), "next_shot": shot.to_dict() if shot else None,
    }  # fmt: skip


def round_rows(seen: Screening) -> list[tuple[str, ...]]:
    """A round as a table."""
    rows: list[tuple[str, ...]] = [("candidate", "delta BIC", "rms mm", "held out mm", "")]
    for trial in seen.fits:
        state = "fitted" if trial.converged else "NOT converged: no verdict from it"
        held = f"{trial.fitted.held_rms * 1e3:.3f}"
        rows.append((trial.name, f"{trial.evidence.delta_bic:.0f}", f"{trial.fitted.rms * 1e3:.3f}", held, state))
    for row in _unfitted(seen)[: SHOWN - len(seen.fits)]:
        rows.append((row.candidate.name, f"{_promise(seen, row):.0f}", "", "", "promised, not fitted"))
    return rows


def _promise(seen: Screening, row: Score) -> float:
    """Delta BIC that a candidate promises by the linear model at the optimum."""
    return row.predicted_improvement - len(row.candidate.keys) * float(np.log(seen.count))


def _unfitted(seen: Screening) -> list[Score]:
    """Candidates that were not worth a fit, the most promising first."""
    fitted = {t.name for t in seen.fits}
    rest = [row for row in seen.scores.rows if row.candidate.name not in fitted]
    return sorted(rest, key=lambda row: -_promise(seen, row))


def verdict_lines(judged: Diagnosis, told: Mapping[str, Any] | None) -> list[str]:
    """The verdict in words."""
    seen = judged.screening
    lines = []
    if told is not None:
        lines += unexplained_lines(told)
    elif judged.name is not None and seen.best is not None:
        lines.append(f"missing: {judged.name} (delta BIC {seen.best.evidence.delta_bic:.0f})")
        if np.isfinite(seen.margin):
            rival = next(t.name for t in seen.fits if t.converged and t.name != judged.name)
            lines.append(f"margin over the next best, {rival}: {seen.margin:.0f}")
        elif len(seen.fits) == 1:
            rest = _unfitted(seen)
            near = f": the next best, {rest[0].candidate.name}, promises {_promise(seen, rest[0]):.0f}" if rest else ""
            lines.append(f"no other was near enough to be fitted{near}")
    else:
        lines.append(NONE)
    lines += alike_lines(seen)
    if seen.doubtful:
        lines.append(f"did not converge, and give no verdict: {', '.join(seen.doubtful)}")
    if not seen.base.converged:
        lines.append("the base itself did not converge: take this as a hint, not as a verdict")
    return lines


def alike_lines(seen: Screening) -> list[str]:
    """Look-alikes of a round in words."""
    lines = [f"{a} and {b} look alike in these clips (correlation {r:.2f})" for a, b, r in seen.confounded]
    return lines + [f"these clips do not tell {a} from {b}: film the next shot below" for a, b in seen.tied]


def unexplained_lines(told: Mapping[str, Any]) -> list[str]:
    """What nothing in the catalogue explains, in words."""
    depends = f"it depends on {', '.join(told['depends_on'])}; " if told["depends_on"] else ""
    lines = [f"something else: {told['where']}", f"{depends}{told['what']}: {told['size']:.3g} {told['unit']}"]
    if told["form"]:
        lines.append(f"as a formula: {told['form']}")
    if told["terms"]:
        lines.append("to add it: sysid new-effect NAME --from result.json")
    return lines


def shot_lines(shot: NextShot | None) -> list[str]:
    """The next shot in words."""
    if shot is None:
        return []
    c = shot.cue
    other = f", another at {shot.other[0]:.3f}, {shot.other[1]:.3f} m" if shot.other else ""
    return [
        f"next shot ({shot.why}):",
        f"  ball at x = {shot.place[0]:.3f}, y = {shot.place[1]:.3f} m{other}; speed {c.speed:.2f} m/s,"
        f" azimuth {c.azimuth:.3f} rad, side {c.side * 1e3:+.1f} mm, height {c.height * 1e3:+.1f} mm:"
        f" {shot.sigmas:.0f} standard deviations apart",
    ]


def ladder_rows(found: DiscoveryResult) -> list[tuple[str, ...]]:
    """The ladder of models as a table."""
    rows: list[tuple[str, ...]] = [("model", "rms mm", "held out mm", "chi2")]
    for s, names in zip(found.ladder, found.verdicts, strict=True):
        rows.append((label(names), *_errors(s)))
    if found.explained is not None:
        rows.append((label(found.verdict) + " + the formula", *_errors(found.explained)))
    return rows


def _errors(s: FittedModel) -> tuple[str, str, str]:
    return f"{s.rms * 1e3:.3f}", f"{s.held_rms * 1e3:.3f}", f"{s.chi2:.3f}"


def label(names: Sequence[str]) -> str:
    """A stage by the effects it has."""
    return " + ".join(["base", *names])


def discovery_lines(found: DiscoveryResult) -> list[str]:
    """The outcome in words."""
    lines = [f"verdict: {', '.join(found.verdict) or 'none, the base model suffices'}"]
    if not found.verdict and found.unexplained:
        lines = ["verdict: no effect of the catalogue"]
    if found.unexplained:
        lines += unexplained_lines(found.unexplained)
    if found.parts.cut:
        lines.append(cut_line(found.parts))
    if found.parts.spikes:
        lines.append(f"{found.parts.spikes} samples that the tracker threw elsewhere were set aside")
    if found.pruned:
        lines.append(f"named on the way, and no longer needed: {', '.join(found.pruned)}")
    if found.rounds:
        lines += list(dict.fromkeys(line for r in found.rounds for line in alike_lines(r)))
    doubtful = sorted({n for r in found.rounds for n in r.doubtful} - set(found.verdict))
    if doubtful:
        lines.append(f"did not converge, and gave no verdict: {', '.join(doubtful)}")
    if not found.last.converged:
        lines.append("the last fit did not converge: its constants carry no uncertainty")
    return lines + shot_lines(found.next_shot)


def print_ladder(found: DiscoveryResult) -> None:
    """The ladder, and the noise beside it."""
    print(table(ladder_rows(found)))
    print(f"noise of the tracker: {found.parts.noise * 1e3:.3f} mm an axis")


def failures(name: str, comparison: Comparison) -> list[str]:
    """Where the first model fails, as parts of an HTML report: in words, and drawn."""
    out = [f'<h2>Where the first model fails</h2><p class="sub">{escape(name)}, all its constants fitted</p>']
    out.append('<ul class="notes">' + "".join(f"<li>{escape(line)}</li>" for line in in_words(comparison)) + "</ul>")
    picture = missing_map_svg(comparison)
    if picture is not None:
        data = base64.b64encode(picture.encode()).decode()
        out.append(
            '<figure><img alt="Map of the accelerations that the first model lacks" '
            f'src="data:image/svg+xml;base64,{data}"><figcaption>Accelerations that rolling balls have and this model '
            "lacks: arrows point where balls are pulled, colour says how sure that is. The same picture of the last "
            "model is below.</figcaption></figure>"
        )
    return out


def sections(rounds: Sequence[Screening]) -> list[str]:
    """Rounds as parts of an HTML report."""
    out = ["<h2>What could be missing</h2>"]
    for number, seen in enumerate(rounds, 1):
        rows = round_rows(seen)
        top = max([1.0, *(float(r[1]) for r in rows[1:])])
        head = "".join(f"<th{' class=n' if 0 < k < 4 else ''}>{escape(c)}</th>" for k, c in enumerate(rows[0]))
        body = []
        for row in rows[1:]:
            width = 100 * max(0.0, np.log1p(max(float(row[1]), 0.0)) / np.log1p(top))
            cells = "".join(f"<td{' class=n' if 0 < k < 4 else ''}>{escape(c)}</td>" for k, c in enumerate(row))
            body.append(f'<tr>{cells}<td><div class="bar"><i style="width:{width:.1f}%"></i></div></td></tr>')
        where = f", at {seen.segments} runs between impacts" if seen.segments else ""
        beside = ", ".join(e.name() for e in seen.base.model.effects) or "nothing"
        out.append(
            f"<h3>Look {number}{where}, beside {escape(beside)}</h3><table><thead><tr>{head}"
            f"<th>delta BIC, logarithmic</th></tr></thead><tbody>{''.join(body)}</tbody></table>"
        )
        lines = alike_lines(seen) if seen.best else [NONE, *alike_lines(seen)]
        if lines:
            out.append('<ul class="notes">' + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>")
    out.append(
        '<p class="more">Delta BIC is the fall of chi-square, discounted for residuals that hang together, less what '
        "the parameters cost; above 10 speaks for an effect. Promised values come from the linear model at the optimum "
        "and are computed for every candidate; the most promising are fitted.</p>"
    )
    return out


def cut_line(parts: Split) -> str:
    """That long shots were cut, and into what."""
    count = len(parts.training.clips) + (len(parts.held_out.clips) if parts.held_out else 0)
    return (
        f"{parts.cut} shots cut into {count} pieces of one impact each: the cloth alone misses by more than the noise, "
        "and every further impact multiplies that; errors are those of the pieces"
    )
