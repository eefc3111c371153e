"""A round of candidates, a verdict and a discovery in plain words and as tables, for the terminal and the report.

In: a `Screening`, a `Judgement` or a `DiscoveryResult`. Out: lines and rows of text, which nothing is read back from.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from models.commands.console import table
from sysid.estimation.fitted import MISS_OVER_AXIS, FittedModel
from sysid.selection.next_shot import NextShot
from sysid.selection.result import DiscoveryResult
from sysid.selection.scoring.score import Score
from sysid.selection.screening import Diagnosis, Screening

NEW_EFFECT_COMMAND = "sysid new-effect NAME --from result.json"  # in the folder of results
MIN_SHARE_OF_DRAWS = 0.1  # of the clips, in which an effect that is not named must be selected to be mentioned
MAX_LISTED = 8  # candidates in the table of a round
NOTHING_MISSING = "none: nothing is likelier than that the model lacks nothing"


def round_rows(seen: Screening) -> list[tuple[str, ...]]:
    """A round as a table, heads first; with misses where shots were fitted whole, and not windows of them."""
    misses = [_misses_mm(trial.fitted) for trial in seen.fits]
    heads = ("miss mm", "held out mm") if any(map(any, misses)) else ()
    rows: list[tuple[str, ...]] = [("candidate", "delta BIC", *heads, "")]
    for trial, known in zip(seen.fits, misses, strict=True):
        state = "fitted" if trial.converged else "NOT converged: no verdict from it"
        rows.append((trial.name, f"{trial.evidence.delta_bic:.0f}", *known[: len(heads)], state))
    for row in unfitted(seen)[: MAX_LISTED - len(seen.fits)]:
        predicted = f"{predicted_delta_bic(seen, row):.0f}"
        rows.append((row.candidate.name, predicted, *("",) * len(heads), "predicted, not fitted"))
    return rows


def predicted_delta_bic(seen: Screening, row: Score) -> float:
    """Delta BIC of a candidate that was not fitted, by the linear model at the optimum."""
    return row.predicted_improvement - len(row.candidate.keys) * float(np.log(seen.count))


def unfitted(seen: Screening) -> list[Score]:
    """Candidates that were not fitted, the largest predicted improvement first."""
    fitted = {t.name for t in seen.fits}
    rest = [row for row in seen.scores.rows if row.candidate.name not in fitted]
    return sorted(rest, key=lambda row: -predicted_delta_bic(seen, row))


def verdict_lines(judged: Diagnosis, unexplained: Mapping[str, Any] | None) -> list[str]:
    """The verdict of one round in words; `unexplained` describes what no effect of the catalogue explains."""
    seen = judged.screening
    lines = []
    if unexplained is not None:
        lines += unexplained_lines(unexplained)
    elif judged.name is not None and seen.best is not None:
        lines.append(f"missing: {judged.name} (delta BIC {seen.best.evidence.delta_bic:.0f})")
        if np.isfinite(seen.margin):
            rival = next(t.name for t in seen.fits if t.converged and t.name != judged.name)
            lines.append(f"margin over the next best, {rival}: {seen.margin:.0f}")
        elif len(seen.fits) == 1:
            lines.append(_distant_rivals(seen))
    else:
        lines.append(NOTHING_MISSING)
    lines += confounded_lines(seen)
    if seen.doubtful:
        lines.append(f"did not converge, and give no verdict: {', '.join(seen.doubtful)}")
    if not seen.base.converged:
        lines.append("the base model itself did not converge: this is a hint, not a verdict")
    return lines


def _distant_rivals(seen: Screening) -> str:
    """States that only one candidate was fitted, and the prediction for the next."""
    rest = unfitted(seen)
    if not rest:
        return "no other candidate was close enough to be fitted"
    predicted = predicted_delta_bic(seen, rest[0])
    return (
        "no other candidate was close enough to be fitted: for the next best, "
        f"{rest[0].candidate.name}, a delta BIC of {predicted:.0f} is predicted"
    )


def confounded_lines(seen: Screening) -> list[str]:
    """Pairs of candidates that these clips confound."""
    lines = [f"{a} and {b} are confounded in these clips (correlation {r:.2f})" for a, b, r in seen.confounded]
    return lines + [f"these clips cannot distinguish {a} from {b}: film the next shot below" for a, b in seen.tied]


def unexplained_lines(unexplained: Mapping[str, Any]) -> list[str]:
    """What nothing in the catalogue explains, in words."""
    depends = f"it depends on {', '.join(unexplained['depends_on'])}; " if unexplained["depends_on"] else ""
    size = f"{unexplained['what']}: {unexplained['size']:.3g} {unexplained['unit']}"
    lines = [f"something else: {unexplained['where']}", depends + size]
    if unexplained["form"]:
        lines.append(f"as a formula: {unexplained['form']}")
    if left := unexplained.get("left"):
        lines.append(f"what it leaves: {left['where']}; {left['what']}: {left['size']:.3g} {left['unit']}")
    if unexplained.get("alike"):
        lines.append(f"these clips hardly distinguish it from: {'; '.join(unexplained['alike'])}")
    if unexplained["terms"]:
        lines.append(f"to add it: {NEW_EFFECT_COMMAND}")
    elif not unexplained["form"]:
        lines.append("what is left has no formula that holds on clips held out")
    return lines


def shot_lines(shots: Sequence[NextShot]) -> list[str]:
    """The next shots in words, and what they leave in doubt."""
    lines: list[str] = []
    for number, shot in enumerate(shots):
        lines += [
            f"{'then' if number else 'next shot'} ({shot.why}):",
            f"  {shot.in_words()}: {shot.sigmas:.0f} standard deviations apart",
        ]
    if shots and shots[-1].doubt < 1.0:  # of many that may hide, none is improbable
        count = "this shot" if len(shots) == 1 else f"these {len(shots)} shots"
        lines.append(f"after {count} the probability of confusing two models is below {_percent(shots[-1].doubt)}")
    return lines


def _percent(chance: float) -> str:
    """A probability, rounded up."""
    return f"{max(math.ceil(1000.0 * chance) / 10.0, 0.1):g} %"


def label(names: Sequence[str]) -> str:
    """A model of the ladder by the effects added to the base."""
    return " + ".join(["base", *names])


def labelled_models(found: DiscoveryResult) -> list[tuple[str, FittedModel]]:
    """The ladder of models with labels, the one with a formula for the unexplained rest last."""
    models = [(label(names), fitted) for names, fitted in zip(found.verdicts, found.ladder, strict=True)]
    if found.explained is not None:
        models.append((label(found.verdict) + " + the formula", found.explained))
    return models


def discovery_lines(found: DiscoveryResult) -> list[str]:
    """The outcome in words."""
    lines = [f"verdict: {', '.join(found.verdict) or 'none, the base model suffices'}"]
    if not found.verdict and found.unexplained:
        lines = ["verdict: no effect of the catalogue"]
    if found.unexplained:
        lines += unexplained_lines(found.unexplained)
    lines += table_lines(found)
    lines += stability_lines(found)
    if found.parts.spikes:
        lines.append(f"{found.parts.spikes} outliers of the tracker were left out")
    lines += list(dict.fromkeys(found.parts.excluded))
    lines += exchange_lines(found)
    if found.pruned:
        lines.append(f"added in an early round, but dropped in the end: {', '.join(found.pruned)}")
    lines += list(dict.fromkeys(line for r in found.rounds for line in confounded_lines(r)))
    doubtful = sorted({n for r in found.rounds for n in r.doubtful} - set(found.verdict))
    if doubtful:
        lines.append(f"did not converge, and gave no verdict: {', '.join(doubtful)}")
    refuted = sorted(found.refuted - set(found.verdict))
    if refuted:
        lines.append(
            f"explains the clips used but predicts the held-out clips worse, and so is not named: {', '.join(refuted)}"
        )
    lines += [
        f"{name} is not named, as {clip} alone shows it: film more shots like that one"
        for name, clip in found.shown_once.items()
    ]
    if not found.converged:
        lines.append("the last fit did not converge: its constants have no uncertainty")
    return lines + shot_lines(found.next_shots)


def exchange_lines(found: DiscoveryResult) -> list[str]:
    """Held-out clips that were exchanged for training clips, since the model found without them did not follow them."""
    return [
        f"{one}, held out, is not followed by what was found without it: causes are sought with it, and {two} held out"
        for one, two in found.parts.exchanged
    ]


def stability_lines(found: DiscoveryResult) -> list[str]:
    """How often the verdict returns on other draws of the clips, and what is selected beside it or instead."""
    seen = found.stability
    if seen is None:
        return []
    named = [f"{name} in {seen.times[name]}" for name in seen.times if name in found.verdict]
    others = [
        f"{name} in {times}"
        for name, times in seen.times.items()
        if name not in found.verdict and times >= MIN_SHARE_OF_DRAWS * seen.draws
    ]
    if not named and not others:
        return []
    line = f"selected anew on {seen.draws} draws of the clips: {', '.join(named) or 'nothing else'}"
    lines = [f"{line}; this verdict and nothing else in {seen.same}" if named else f"{line}, in {seen.same}"]
    return [*lines, f"and not in the verdict: {', '.join(others)}"] if others else lines


def table_lines(found: DiscoveryResult) -> list[str]:
    """What an image of the wrong scale or aspect implies for the stated sizes of the table."""
    model = found.last.model
    values, table, stated = model.parameters(), model.as_played().table, model.table
    if not {"image_scale", "image_aspect"} & set(found.verdict):
        return []
    scale, aspect = values.get("image_scale.stretch", 0.0), values.get("image_aspect.aspect", 0.0)
    length, width = (size * (1 + scale) * (1 + sign * aspect) for size, sign in ((table.length, 1), (table.width, -1)))
    return [
        f"the cushions appear {length:.4f} m by {width:.4f} m apart, not {stated.length:g} m by "
        f"{stated.width:g} m as in clips.toml: measure the table again; if the tape confirms the picture, correct "
        "clips.toml and repeat this command, since friction is wrong by the same share"
    ]


def ladder_table(found: DiscoveryResult) -> str:
    """The models' rms misses as a table, and the miss that noise alone leaves, for comparison."""
    rows: list[tuple[str, ...]] = [("model", "miss mm", "held out mm", "chi2")]
    rows += [(name, *_misses_mm(fitted), f"{fitted.chi2:.3f}") for name, fitted in labelled_models(found)]
    return f"{table(rows)}\n{noise_line(found.parts.noise)}"


def noise_line(noise: float) -> str:
    """What a miss is, and the miss that noise alone leaves; `noise` per axis [m]."""
    return (
        f"miss: rms distance from the measured to the modelled ball; the tracker's noise alone, {noise * 1e3:.3f} mm "
        f"an axis, leaves {MISS_OVER_AXIS * noise * 1e3:.3f} mm"
    )


def miss_line(name: str, fitted: FittedModel) -> str:
    """The misses of a model in words; of clips held out only where there are some."""
    used, held_out = _misses_mm(fitted)
    return f"{name}: miss {used} mm" + (f", held out {held_out} mm" if held_out else "")


def _misses_mm(fitted: FittedModel) -> tuple[str, str]:
    """Rms miss of the clips used and of those held out [mm]; empty without any."""
    used, held_out = (f"{1e3 * miss:.3f}" if np.isfinite(miss) else "" for miss in (fitted.miss, fitted.held_miss))
    return used, held_out
