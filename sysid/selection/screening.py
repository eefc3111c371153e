"""Screening of candidate effects: all are scored, the best scores are fitted, the fits are ranked by evidence.

In: clips (`Split`), a converged fit (`FittedModel`) and candidates. Out: a `Screening`: scores, fits with their
evidence over the base, the best of them, its margin over the next, and the candidates that these data confound.

Each candidate is fitted from the base's optimum; the base is fitted again from the candidates' optima (warm start)
before an improvement counts. An effect whose fit has not converged is never named.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from models.effect import Effect
from models.model_file import Model, catalogue
from sysid.estimation.fitted import FittedModel
from sysid.estimation.initial_states import fit_states, shot_losses
from sysid.estimation.problem import Array
from sysid.estimation.split import Split, fit_on
from sysid.selection.evidence import (
    MAX_LOSS_RATIO,
    Evidence,
    compare_fits,
    excess_variance,
    generalises,
    loss_ratio_without,
)
from sysid.selection.score import Candidate, Score, Scores, candidate, score_all, with_candidate
from sysid.selection.trials import fit_from_trial, fit_with, most_promising

# Predicted improvement: fall of chi-square that the linear model predicts for a candidate (sysid/selection/score.py).
MIN_IMPROVEMENT = 15.0  # predicted, for a candidate to be fitted
MIN_IMPROVEMENT_OF_BEST = 0.2  # predicted, over that of the best candidate, to be fitted as well
MIN_IMPROVEMENT_OF_SUFFICIENT = 0.5  # the same where the best candidate leaves nothing but noise
MAX_EXCESS_VARIANCE = 0.01  # over the noise's variance, of a fit that leaves nothing but noise
MAX_FITS = 3  # candidates fitted in one screening
MIN_DELTA_BIC = 10.0  # for an effect to be named ("very strong", Kass and Raftery 1995)
MIN_IMPROVEMENT_PER_RESIDUAL = 1e-3  # and its fall of chi-square per residual
MAX_TOP_SHOT_RATIO = 1.5  # loss per residual of the only shot that speaks for an effect, over the median of all
CONFOUNDED_CORRELATION = 0.9  # of two signatures, from which on candidates count as confounded
TRIAL_STEPS = 3  # iterations of the initial states at each trial start of a fit
SMALLER_TRIAL = 0.3  # of a predicted or usual size, at which a fit may start as well
WARM_START_STEPS = 5  # iterations of the initial states from the optimum of another fit
TIED_DELTA_BIC = 10.0  # difference below which the evidence does not separate two candidates
MIN_WARM_START_IMPROVEMENT, MIN_WARM_START_SHARE = 2.0, 1e-3  # of the loss, for another optimum to be taken
MAX_EXCHANGE_EXCESS = 0.3  # excess variance of fits that may differ by the optimum of single shots only
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FittedCandidate:
    """A candidate that was fitted."""

    score: Score
    fitted: FittedModel
    evidence: Evidence  # over the base
    generalises: bool = True  # whether it follows held-out clips no worse than the base

    @property
    def name(self) -> str:
        """The candidate's name."""
        return self.score.candidate.name

    @property
    def converged(self) -> bool:
        """Whether its fit converged; no verdict is drawn from one that did not."""
        return self.fitted.converged


@dataclass(frozen=True)
class Screening:
    """The result of one screening."""

    base: FittedModel
    scores: Scores
    fits: tuple[FittedCandidate, ...]  # best first; of tied ones, that with the fewest constants first
    confounded: tuple[tuple[str, str, float], ...]  # pairs of relevant candidates, with their correlation
    tied: tuple[tuple[str, str], ...]  # pairs of fits that the evidence does not separate
    count: int  # residuals
    windows: int = 0  # of one impact each, on which candidates were scored; 0 where whole shots were

    @property
    def best(self) -> FittedCandidate | None:
        """The effect to name: the best fit that converged and generalises, if its evidence suffices."""
        best = next((one for one in self.fits if one.converged and one.generalises), None)
        return best if best is not None and is_enough(best.evidence, self.count) else None

    @property
    def margin(self) -> float:
        """Delta BIC of the best fit over the next; infinite where no other candidate was fitted."""
        fitted = [t.evidence.delta_bic for t in self.fits if t.converged]
        return fitted[0] - fitted[1] if len(fitted) > 1 else float("inf")

    @property
    def refuted(self) -> tuple[str, ...]:
        """Candidates with evidence in the training clips whose fit follows the held-out ones worse."""
        return tuple(t.name for t in self.fits if not t.generalises and is_enough(t.evidence, self.count))

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Candidates whose fit did not converge."""
        return tuple(t.name for t in self.fits if not t.converged)


def is_enough(evidence: Evidence, count: int) -> bool:
    """Whether the evidence suffices to name an effect, for so many residuals.

    A single shot does not suffice, unless the effect explains it as well as the others: it may depart for a reason of
    its own.
    """
    supported = evidence.others_delta_bic > MIN_DELTA_BIC or evidence.top_shot_ratio < MAX_TOP_SHOT_RATIO
    large = evidence.improvement > MIN_IMPROVEMENT_PER_RESIDUAL * count
    return supported and large and evidence.delta_bic > MIN_DELTA_BIC


def candidates_for(model: Model, extra: Sequence[type[Effect]] = ()) -> list[Candidate]:
    """Effects that the model lacks and that replace none of its own; one that acts in some place at several of them."""
    active, slots = {e.name() for e in model.effects}, {e.slot for e in model.effects if e.slot}
    found = [k for n, k in catalogue().items() if n not in active and k.slot not in slots]
    return [candidate(start) for k in [*found, *extra] for start in k.starts(model.table)]


def screen(
    parts: Split,
    base: FittedModel,
    candidates: Sequence[Candidate],
    share: float = 0.0,
) -> Screening:
    """Score all candidates, fit the best of them and compare the fits.

    Args:
        parts: clips to fit, and those held out.
        base: the fit without any of the candidates.
        candidates: what may be missing.
        share: least predicted improvement of any candidate, as a part of the excess of chi-square over noise.
    """
    scores = score_all(base, candidates)

    def fit(score: Score) -> FittedCandidate:
        return fit_candidate(parts, base, score)

    fits = _fit_chosen(scores, shortlist(scores, share), fit)
    if fits and not any(one.converged for one in fits):  # candidates that predict less were left out for no verdict
        tried = {one.name for one in fits}
        others = [row for row in scores.rows if row.candidate.name not in tried]
        fits += [fit(row) for row in others[:MAX_FITS] if row.predicted_improvement >= least_improvement(scores, share)]
    fits = _with_trial(parts, base, scores, fits)
    if fits:
        fits = _exchange_optima(parts, base, fits)
        best = max(fits, key=lambda one: one.evidence.delta_bic)
        more = excess_variance(best.fitted) >= MAX_EXCESS_VARIANCE
        if more or loss_ratio_without(best.fitted, best.name) <= MAX_LOSS_RATIO:
            base = warm_started(parts, base, best.fitted, "base") or base
        # All are compared at the same correlation time.
        first = max(fits, key=lambda one: one.evidence.improvement)
        tau = compare_fits(base, first.fitted).tau
        fits = [
            dataclasses.replace(
                one, evidence=compare_fits(base, one.fitted, tau), generalises=generalises(base, one.fitted)
            )
            for one in fits
        ]
    return Screening(base, scores, tuple(rank_fits(fits)), *confounded_and_tied(scores, fits), scores.count)


def _fit_chosen(
    scores: Scores,
    chosen: Sequence[Score],
    fit: Callable[[Score], FittedCandidate],
) -> list[FittedCandidate]:
    """Fit the chosen candidates that may still win.

    Where the first leaves nothing but noise, only those close to it are fitted.
    """
    fits: list[FittedCandidate] = []
    for score in chosen:
        sufficient = bool(fits) and excess_variance(fits[0].fitted) < MAX_EXCESS_VARIANCE and fits[0].converged
        correlation = scores.correlation(score.candidate.name, chosen[0].candidate.name) if fits else 0.0
        close = sufficient or correlation > CONFOUNDED_CORRELATION
        bar = MIN_IMPROVEMENT_OF_SUFFICIENT * chosen[0].predicted_improvement if close else 0.0
        if score.predicted_improvement > bar or (score.sudden and not sufficient):
            fits.append(fit(score))
    return fits


def fit_most_promising(
    parts: Split, base: FittedModel, rows: Sequence[Score], fits: Sequence[FittedModel]
) -> FittedCandidate | None:
    """Of some candidates the one that is best fitted, of those whose usual size lowers the loss most.

    None where the base or a fit leaves only noise, and where no candidate rivals these fits. One that follows held-out
    clips worse comes last.
    """
    only_noise = any(at.converged and excess_variance(at) < MAX_EXCESS_VARIANCE for at in fits)
    if only_noise or not rows or excess_variance(base) < MAX_EXCESS_VARIANCE:
        return None
    by_name = {row.candidate.name: row for row in rows}
    tried = []
    for effect in most_promising(base, list(dict.fromkeys(type(row.candidate.effect) for row in rows))):
        found = fit_from_trial(parts, base, effect)
        evidence, row = compare_fits(base, found), by_name[effect.name()]
        row = dataclasses.replace(row, predicted_improvement=max(row.predicted_improvement, evidence.improvement))
        tried.append(FittedCandidate(row, found, evidence, generalises(base, found)))
    return max(tried, key=lambda one: (one.converged and one.generalises, one.evidence.delta_bic), default=None)


def _with_trial(parts: Split, base: FittedModel, scores: Scores, fits: list[FittedCandidate]) -> list[FittedCandidate]:
    """The fits and, where none leaves only noise, one more: of the effect whose usual size lowers the loss most."""
    one = fit_most_promising(parts, base, scores.rows, [other.fitted for other in fits])
    if one is None:
        return fits
    same = next((k for k, other in enumerate(fits) if other.name == one.name), None)
    if same is None:
        return [*fits, one]
    if one.evidence.improvement > fits[same].evidence.improvement:
        fits[same] = one
    return fits


def shortlist(scores: Scores, share: float = 0.0) -> list[Score]:
    """Candidates to fit, the largest predicted improvement first; then those for which it is rough (`sudden`)."""
    if not scores.rows:
        return []
    any_fit = least_improvement(scores, share)
    least = max(any_fit, MIN_IMPROVEMENT_OF_BEST * scores.rows[0].predicted_improvement)
    chosen = [row for row in scores.rows if row.predicted_improvement >= least][:MAX_FITS]
    rough = [row for row in scores.rows if row.sudden and row.predicted_improvement >= any_fit]
    return chosen + [row for row in rough if all(row is not one for one in chosen)]


def least_improvement(scores: Scores, share: float) -> float:
    """Predicted improvement below which no candidate is fitted; for `share` see `screen`."""
    return max(MIN_IMPROVEMENT, share * (scores.chi2 - scores.count))


def fit_candidate(parts: Split, base: FittedModel, score: Score) -> FittedCandidate:
    """Fit a candidate, all constants and initial states from the base's optimum."""
    one = score.candidate
    x, added = _best_start(base, score)
    values = dict(zip(one.keys, added.tolist(), strict=True))
    found = fit_with(parts, base, one, dataclasses.replace(base, initial_states=x), values)
    return FittedCandidate(score, found, compare_fits(base, found))


def _best_start(base: FittedModel, score: Score) -> tuple[Array, Array]:
    """Initial states (n, p) and switching parameters (k,) to start from: of a few trial values those of least loss."""
    one, off = score.candidate, score.candidate.off()
    bounds, usual, step = one.bounds(), one.usual(), score.values - off
    trials = [step, SMALLER_TRIAL * step]
    if one.one_sided:  # such an effect may grow with the square of its parameter
        trials = [step, usual, SMALLER_TRIAL * usual]
    problem = with_candidate(base.problem, one).with_discrepancy(base.discrepancy_rate)
    found = []
    inner = bounds + np.outer(bounds[:, 1] - bounds[:, 0], [1e-4, -1e-4])
    for move in trials:
        values = np.clip(off + move, inner[:, 0], inner[:, 1])
        c = np.concatenate([base.constants, values])
        x = fit_states(problem, base.initial_states, c, TRIAL_STEPS)
        found.append((float(shot_losses(problem, x, c)[0].sum()), x, values))
    _, x, values = min(found, key=lambda one: one[0])
    return x, values


def with_better_states(one: FittedModel, other: FittedModel) -> tuple[FittedModel, float]:
    """`one` with the initial states of `other` in the shots where they give less loss, and by how much it falls."""
    seen = one.weighted
    x = fit_states(seen, other.initial_states, one.constants, WARM_START_STEPS)
    old, new = (shot_losses(seen, at, one.constants)[0] for at in (one.initial_states, x))
    better = new < old
    mixed = np.where(better[:, None], x, one.initial_states)
    return dataclasses.replace(one, initial_states=mixed), float(np.sum((old - new)[better]))


def warm_started(parts: Split, one: FittedModel, other: FittedModel, what: str) -> FittedModel | None:
    """Fit `one` again, from the initial states of `other` in the shots where they give less loss.

    None where that does not lower its loss noticeably.
    """
    mixed, gain = with_better_states(one, other)
    loss = float(shot_losses(one.weighted, one.initial_states, one.constants)[0].sum())
    if gain < max(MIN_WARM_START_IMPROVEMENT, MIN_WARM_START_SHARE * loss):
        return None
    log.info("%s again, from another optimum", what)
    return fit_on(parts, mixed, one, what)


def _exchange_optima(parts: Split, base: FittedModel, fits: list[FittedCandidate]) -> list[FittedCandidate]:
    """Fit the best and every other close fit again, each from the optimum of the other, as single shots may differ."""
    first = max(range(len(fits)), key=lambda k: fits[k].evidence.delta_bic)
    for k in range(len(fits)):
        close = all(excess_variance(fits[i].fitted) < MAX_EXCHANGE_EXCESS for i in (k, first))
        if k == first or not close:
            continue
        for i, other in ((k, first), (first, k)):
            one = fits[i]
            found = warm_started(parts, one.fitted, fits[other].fitted, one.name)
            if found is not None:
                new = dataclasses.replace(one, fitted=found, evidence=compare_fits(base, found))
                if new.evidence.improvement > one.evidence.improvement:
                    fits[i] = new
    return fits


def rank_fits(fits: Sequence[FittedCandidate]) -> list[FittedCandidate]:
    """Fits in the order of `ranking`."""
    values = [(one.evidence.delta_bic, one.fitted.constants.size, one.converged) for one in fits]
    return [fits[k] for k in ranking(values)]


def ranking(fits: Sequence[tuple[float, int, bool]]) -> list[int]:
    """Indices of fits, best first, from delta BIC, number of constants and convergence of each.

    Of those that the evidence does not separate from the best, the one with the fewest constants comes first.
    """
    top = max((delta_bic for delta_bic, _, converged in fits if converged), default=0.0)

    def rank(k: int) -> tuple[bool, int, float]:
        delta_bic, constants, converged = fits[k]
        tied = converged and top - delta_bic < TIED_DELTA_BIC
        return not tied, constants if tied else 0, -delta_bic

    return sorted(range(len(fits)), key=rank)


def confounded_and_tied(
    scores: Scores, fits: Sequence[FittedCandidate]
) -> tuple[tuple[tuple[str, str, float], ...], tuple[tuple[str, str], ...]]:
    """Pairs of confounded candidates of which one matters, and pairs of fits that the evidence does not separate."""
    predicted = {row.candidate.name: row.predicted_improvement for row in scores.rows}
    top = max(predicted.values(), default=0.0)
    confounded = tuple(
        (a, b, value)
        for (a, b), value in sorted(scores.correlations.items())
        if value > CONFOUNDED_CORRELATION and max(predicted[a], predicted[b]) > max(MIN_IMPROVEMENT, 0.5 * top)
    )
    tied = tuple(
        (one.name, two.name)
        for one, two in combinations([one for one in fits if one.converged], 2)
        if abs(one.evidence.delta_bic - two.evidence.delta_bic) < TIED_DELTA_BIC
    )
    return confounded, tied
