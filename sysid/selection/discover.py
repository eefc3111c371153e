"""Discovery: fit, diagnose, add the missing effect, until nothing more is to be explained.

In: a `ClipSet` and a `Model` to start from. Out: a `DiscoveryResult`: the ladder of fits, one effect more on each step,
the screenings on the way, what stays unexplained, and the next shot to film.

Where shots were cut, pieces have named the effects. Constants at impacts that pieces hardly show are those of whole
shots, to which the first and the last model are fitted in the end; effects that do not lower the error of whole shots
held out are dropped.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.errors import BadInput
from models.model_file import Model
from sysid.clips import ClipSet
from sysid.clips.pieces import parent_clip
from sysid.estimation.clip_fit import ClipFit, fit_clips, refit_without
from sysid.estimation.fitted import FittedModel, as_model
from sysid.estimation.split import Split, begin, settled_on
from sysid.selection.departures import without_departing
from sysid.selection.evidence import (
    compare_fits,
    excess_variance,
    generalises,
    holds,
    mean_squares,
)
from sysid.selection.formula import EFFECT_NAME, SparseFormula, describe, score_terms, select_terms
from sysid.selection.judge import diagnose_fit
from sysid.selection.next_shot import NextShot, propose_shot
from sysid.selection.pruning import (
    MIN_DISTANCE_SD,
    Pruned,
    distance_from_absence,
    fit_without,
    without_needless,
    without_unclear,
    without_undetermined,
    without_unsettled,
)
from sysid.selection.remainder import remainder
from sysid.selection.score import Score
from sysid.selection.screening import (
    MAX_EXCESS_VARIANCE,
    MIN_DELTA_BIC,
    Screening,
    fit_candidate,
    is_enough,
)

MAX_EFFECTS = 6  # diagnoses of one discovery, and so effects added
MAX_SD_OF_RANGE = 0.05  # of the bounds' width: an effect of larger standard deviation is imitated by the active ones
NEXT_SHOT_EFFECT_SD = 3.0  # standard deviations: size of the effect that the next shot is to show
MAX_SHAPE_EXCESS = 0.05  # variance beyond noise that a formula's shape may leave
MAX_SHAPE_SHARE = 0.01  # the same over what was left without it
log = logging.getLogger(__name__)
Show = Callable[["DiscoveryResult"], None]
Prune = Callable[[Split, FittedModel, tuple[str, ...]], Pruned]


@dataclass(frozen=True)
class DiscoveryResult:
    """What was found, so far or in the end."""

    parts: Split
    ladder: tuple[FittedModel, ...]  # base first
    verdicts: tuple[tuple[str, ...], ...]  # named effects in each of them
    rounds: tuple[Screening, ...]
    unexplained: Mapping[str, Any] | None = None  # what no effect of the catalogue explains, as result.json has it
    explained: FittedModel | None = None  # the last fit with the formula for it
    next_shot: NextShot | None = None
    pruned: tuple[str, ...] = ()  # effects that were named and later dropped
    whole: Mapping[tuple[str, ...], ClipFit] = field(default_factory=dict)  # by effects; whole shots, where pieces led

    @property
    def verdict(self) -> tuple[str, ...]:
        """Effects added, in order."""
        return self.verdicts[-1]

    @property
    def last(self) -> FittedModel:
        """The fit that was found."""
        return self.ladder[-1]

    @property
    def model(self) -> Model:
        """The model that was found, with values, standard deviations, correlations and sources."""
        return self.model_of(self.last)

    def model_of(self, fitted: FittedModel, command: str = "sysid discover") -> Model:
        """The model of one step of the ladder, with constants of whole shots where they were fitted.

        With a formula for what no effect explains, the constants of the last step are those of the fit that included
        it: without the formula they bend to make up for what is missing.
        """
        for step, verdict in zip(self.ladder, self.verdicts, strict=True):
            if step is not fitted or verdict not in self.whole:
                continue
            made = self.whole[verdict].model
            return dataclasses.replace(made, fitted={**(made.fitted or {}), "command": command})
        if fitted is self.last and self.explained is not None:
            problem = self.explained.problem.with_model(fitted.model, self.explained.names)
            fitted = dataclasses.replace(self.explained, problem=problem)
        files = list(dict.fromkeys(parent_clip(c.file) for c in self.parts.training.clips))
        return as_model(fitted, command, files)

    @property
    def confounded(self) -> tuple[tuple[str, str], ...]:
        """Pairs of effects that the clips confound, or that the evidence did not separate."""
        found = {(a, b) for r in self.rounds for a, b, _ in r.confounded} | {p for r in self.rounds for p in r.tied}
        return tuple(sorted(found))

    def with_step(self, now: FittedModel, verdict: tuple[str, ...]) -> DiscoveryResult:
        """The ladder with one fit more."""
        return dataclasses.replace(self, ladder=(*self.ladder, now), verdicts=(*self.verdicts, verdict))


def prune(parts: Split, found: DiscoveryResult, by: Prune = without_needless) -> DiscoveryResult:
    """The result without the effects that one of the functions of pruning.py drops.

    Beside what is not explained, `unexplained` is that of the fit without them.
    """
    now, verdict = by(parts, found.last, found.verdict)
    if verdict == found.verdict:
        return found
    if not verdict:  # the base that no effect has bent
        now = found.ladder[0]
    less = _ending_with(found, now, verdict)
    return less if found.unexplained is None else dataclasses.replace(less, unexplained=remainder(now))


def _ending_with(found: DiscoveryResult, now: FittedModel, verdict: tuple[str, ...]) -> DiscoveryResult:
    """The ladder with another last fit; before it stay the fits that have only effects of its verdict."""
    steps = [(s, v) for s, v in zip(found.ladder, found.verdicts, strict=True) if set(v) < set(verdict) or not v]
    steps = [*steps[: len(verdict)], (now, verdict)]
    return dataclasses.replace(
        found, ladder=tuple(s for s, _ in steps), verdicts=tuple(v for _, v in steps),
        pruned=(*found.pruned, *(v for v in found.verdict if v not in verdict)),
    )  # fmt: skip


def discover(clip_set: ClipSet, model: Model, show: Show = lambda found: None) -> DiscoveryResult:
    """Add effects until no candidate is named; then drop those that are no longer needed.

    Args:
        clip_set: every fifth clip is held out.
        model: what to start from; all its constants are fitted.
        show: called with the result so far, after each effect.
    """
    parts, now = begin(clip_set, model)
    found = DiscoveryResult(parts, (now,), ((),), ())
    show(found)
    formula: SparseFormula | None = None
    segments = True  # whether segments may still show what whole shots do not
    for _ in range(MAX_EFFECTS):
        diagnosis = diagnose_fit(parts, now, formula=formula is None, segments=segments)
        found = dataclasses.replace(found, rounds=(*found.rounds, *diagnosis.rounds))
        segments = diagnosis.confirmed is not None
        if diagnosis.confirmed is not None and diagnosis.name is not None:
            log.info("found %s", diagnosis.name)
            now = diagnosis.confirmed
            found = found.with_step(now, (*found.verdict, diagnosis.name))
            show(found)
            continue
        if diagnosis.screening.base is not now:
            now = diagnosis.screening.base
            if formula is None:
                found = dataclasses.replace(found, ladder=(*found.ladder[:-1], now))
        if diagnosis.formula is not None and diagnosis.fitted_formula is not None:
            formula, now = diagnosis.formula, diagnosis.fitted_formula.fitted
            found = dataclasses.replace(found, unexplained=describe(formula, now, diagnosis.fitted_formula.evidence))
            continue
        best = diagnosis.screening.best
        if best is None:
            fewer = without_departing(parts, found.ladder) if formula is None else None
            if fewer is None:
                break
            parts, ladder = fewer
            now, found = ladder[-1], dataclasses.replace(found, parts=parts, ladder=ladder)
            show(found)
            continue
        log.info("found %s", best.name)
        now = best.fitted
        found = found.with_step(now, (*found.verdict, best.name))
        if formula is None:
            show(found)
    if formula is not None:
        found = _beside_formula(parts, found, now, formula)
    if found.unexplained is None:
        found = prune(parts, found)
        found = dataclasses.replace(found, unexplained=remainder(found.last))
        if found.unexplained is not None and not parts.cut:  # of cut shots, whole ones decide
            found = prune(parts, found, without_unclear)
    if found.verdict and found.explained is None:
        last = settled_on(parts, found.last)
        found = dataclasses.replace(found, ladder=(*found.ladder[:-1], last))
        if found.unexplained is not None:
            found = prune(parts, found, without_unsettled)
    found = without_idle(parts, clip_set, dataclasses.replace(found, whole=fit_whole_shots(clip_set, found)))
    return dataclasses.replace(found, next_shot=propose_next(parts, found.last, found.rounds, found.verdict))


def fit_whole_shots(clip_set: ClipSet, found: DiscoveryResult) -> dict[tuple[str, ...], ClipFit]:
    """The first and the last model of the ladder fitted to whole shots, by their effects; none where none was cut."""
    fits: dict[tuple[str, ...], ClipFit] = {}
    if not found.parts.cut:
        return fits
    for verdict, fitted in {found.verdicts[0]: found.ladder[0], found.verdict: found.last}.items():
        log.info("whole shots with %s", ", ".join(verdict) or "the base")
        try:
            fits[verdict] = fit_clips(clip_set, found.model_of(fitted), "sysid discover")
        except BadInput as error:  # most shots are lost: pieces are all that can be fitted
            log.info("%s", error)
    return fits


def without_idle(parts: Split, clip_set: ClipSet, found: DiscoveryResult) -> DiscoveryResult:
    """The result without effects that pieces named and whole shots do not need.

    Pieces of one impact show little of what an effect does to a whole shot. It must lower the error of those held out,
    and have a size there that is beyond its own uncertainty.
    """
    base, best = found.whole.get(()), found.whole.get(found.verdict)
    for name in reversed(found.verdict):
        if base is None or best is None:
            break
        verdict = tuple(v for v in found.verdict if v != name)
        known = not best.converged or distance_from_absence(best.fitted, name) >= MIN_DISTANCE_SD
        log.info("whole shots without %s", name)
        less = refit_without(clip_set, best, name, "sysid discover") if verdict else base
        if known and _held_out_error(less) > _held_out_error(best):
            continue
        why = "does not lower the error of whole shots held out" if known else "has no size that whole shots tell"
        log.info("%s %s", name, why)
        best = less
        explained = fit_without(parts, found.explained, name) if found.explained else None
        found = _ending_with(found, fit_without(parts, found.last, name), verdict)
        found = dataclasses.replace(found, explained=explained, whole={(): base, verdict: best})
    return found


def _held_out_error(found: ClipFit) -> float:
    """Mean logarithm of the mean squares of held-out shots, so that one in a false optimum does not outweigh them."""
    held = found.fitted.held_out
    return float(np.mean(np.log(np.maximum(mean_squares(held.residuals)[0], 1.0)))) if held else math.inf


def _beside_formula(parts: Split, found: DiscoveryResult, now: FittedModel, formula: SparseFormula) -> DiscoveryResult:
    """The result where a formula is in the last fit, `now`; the model file holds named effects only.

    Effects that were named before the formula may have stood in for it, or explain what it was found for: then they, or
    it, are dropped.
    """
    now, verdict = without_undetermined(parts, *without_needless(parts, now, found.verdict, least=0))
    earlier = _formula_earlier(parts, found, now, verdict)
    if earlier is not None:
        formula, now, verdict = earlier
    plain = fit_without(parts, now, EFFECT_NAME)
    evidence = compare_fits(plain, now)
    found = _ending_with(found, plain, verdict)
    if not is_enough(evidence, found.rounds[-1].count) or not holds(plain, now):
        log.info("the formula is no longer needed, or does not hold on the clips held out")
        return dataclasses.replace(found, unexplained=None)
    described = describe(formula, now, evidence)
    described |= {"rms_m": now.rms, "held_out_rms_m": now.held_rms, "chi2_reduced": now.chi2}
    return dataclasses.replace(found, unexplained=described, explained=now)


def _formula_earlier(
    parts: Split, found: DiscoveryResult, now: FittedModel, verdict: tuple[str, ...]
) -> tuple[SparseFormula, FittedModel, tuple[str, ...]] | None:
    """A formula, found with fewer named effects, that leaves little, or no more than all of these and theirs leave.

    Effects that imitate parts of what is missing are named one after the other, and the formula for the rest then needs
    each of them. Fitted before them, a formula may need none.
    """
    for step, before in zip(found.ladder, found.verdicts, strict=True):
        if not set(before) < set(verdict) or any(e.name() == EFFECT_NAME for e in step.model.effects):
            continue
        structure = select_terms(*score_terms(step))
        if structure is None:
            continue
        log.info("a formula beside %s: %s", ", ".join(before) or "nothing", ", ".join(t.name for t in structure.terms))
        one = fit_candidate(parts, step, structure.score()).fitted
        # What a formula's shape leaves where it is nearly right is no reason to name effects that fill the gap.
        left = min(MAX_SHAPE_EXCESS, MAX_SHAPE_SHARE * excess_variance(step))
        enough = excess_variance(one) <= max(MAX_EXCESS_VARIANCE, left)
        if (enough or compare_fits(one, now).delta_bic <= MIN_DELTA_BIC) and generalises(now, one):
            return structure, one, before
    return None


def propose_next(
    parts: Split, now: FittedModel, rounds: Sequence[Screening], verdict: Sequence[str]
) -> NextShot | None:
    """The shot that separates the verdict from its closest rival or, without one, shows what the clips may hide most.

    Args:
        parts: the clips.
        now: their last fit.
        rounds: all screenings.
        verdict: effects that were named.
    """
    if not rounds:
        return None
    log.info("the next shot")
    named = [r for r in rounds if r.best is not None and r.best.name in verdict]
    if named and (best := named[-1].best) is not None:
        rivals = [one for one in named[-1].fits if one.name != best.name]
        if rivals:
            rival = rivals[0].fitted
            why = f"to separate {best.name} from {rivals[0].name}, the next best"
            return propose_shot(rival, best.fitted.model, rival.covariance, parts.noise, why)
    # An effect that the active ones can imitate wholly is hidden at any size: no shot would show it.
    rows = [row for row in rounds[-1].scores.rows if _is_separate(row)]
    if not rows:
        return None
    row = max(rows, key=_hidden_share)
    one = row.candidate
    value = np.clip(one.off() + NEXT_SHOT_EFFECT_SD * row.sd, *one.bounds().T)
    hidden = ", ".join(f"{k} = {v:.3g}" for k, v in zip(one.keys, value, strict=True))
    why = f"these clips say least about {one.name}: they could hide {hidden}"
    return propose_shot(now, now.model.add(one.at(value)), now.covariance, parts.noise, why)


def _is_separate(row: Score) -> bool:
    """Whether the active effects do not imitate a candidate."""
    low, high = row.candidate.bounds().T
    return bool(np.all((row.sd > 0) & (row.sd < MAX_SD_OF_RANGE * (high - low))))


def _hidden_share(row: Score) -> float:
    """Standard deviation of a candidate's parameters over their usual size, the largest of them."""
    return float(np.max(row.sd / np.maximum(np.abs(row.candidate.usual()), 1e-12)))
