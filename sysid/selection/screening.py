"""Which effect is missing: every candidate scored beside the active parameters, the best ones fitted, one named.

A candidate that promises nothing is not fitted. Those that are start from the base's optimum; the base is fitted again
from theirs before a gain is believed, and none that has not converged is named. The margin between the best and the
next is told, and which candidates these data cannot tell apart.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from models.model_file import Model, catalogue
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.initial_states import fit_states, shot_losses
from sysid.estimation.problem import Array
from sysid.estimation.split import Split, fit_on
from sysid.selection.evidence import LACKING_LOSS, Evidence, compare_fits, left_over, loss_without
from sysid.selection.score import Candidate, Score, Scores, candidate, score_all, with_candidate

PROMISES = 15.0  # fall of chi-square from which a candidate is worth a fit
RIVALS = 0.2  # of the best candidate's promise: fitted as well
CLOSE = 0.5  # and of the best one's, where that one explains all
REST = 0.01  # of the noise's square: what may be left where all is explained
MOST = 3  # candidates fitted in a round
NAMED = 10.0  # delta BIC from which an effect is named
MATTERS = 1e-3  # and the fall of chi-square per residual
ALIKE = 0.9  # correlation of signatures from which two candidates are look-alikes
TRIED_STEPS, WARM_STEPS = 3, 5  # of the initial states, to choose a start, and from the optimum of another fit
TIED = 10.0  # delta BIC below which two candidates are not told apart
MOVES = 2.0  # loss by which another optimum is better
NEAR = 0.3  # of the noise's square: left over by a fit that differs from another by single shots
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Trial:
    """One candidate, fitted."""

    score: Score
    fitted: FittedModel
    evidence: Evidence  # over the base

    @property
    def name(self) -> str:
        """The candidate's name."""
        return self.score.candidate.name

    @property
    def converged(self) -> bool:
        """Whether its fit came to an optimum; no verdict is drawn from one that has not."""
        return self.fitted.converged


@dataclass(frozen=True)
class Round:
    """One look for a missing effect."""

    base: FittedModel
    scores: Scores
    trials: tuple[Trial, ...]  # best first, and among equals the simplest
    alike: tuple[tuple[str, str, float], ...]  # look-alikes among those that matter, with their correlation
    tied: tuple[tuple[str, str], ...]  # pairs that these data do not tell apart
    count: int  # residuals
    runs: int = 0  # that were looked at, without impacts; 0 where it was whole shots, or pieces of them

    @property
    def best(self) -> Trial | None:
        """The effect to name: the best fit that converged, with evidence enough; None if there is none."""
        for trial in self.trials:
            if trial.converged:
                enough = trial.evidence.delta_bic > NAMED and trial.evidence.gain > MATTERS * self.count
                return trial if enough else None
        return None

    @property
    def margin(self) -> float:
        """Delta BIC of the best fit over the next; infinite where nothing else was worth a fit."""
        fitted = [t.evidence.delta_bic for t in self.trials if t.converged]
        return fitted[0] - fitted[1] if len(fitted) > 1 else float("inf")

    @property
    def doubtful(self) -> tuple[str, ...]:
        """Candidates whose fit did not converge."""
        return tuple(t.name for t in self.trials if not t.converged)


@dataclass(frozen=True)
class Begun:
    """What is known of a look before it begins."""

    scores: Scores
    fitted: tuple[Trial, ...] = ()


def candidates_for(model: Model, extra: Sequence[type[Effect]] = ()) -> list[Candidate]:
    """Effects that the model lacks and that replace none of its own."""
    active, slots = {e.name() for e in model.effects}, {e.slot for e in model.effects if e.slot}
    found = [k for n, k in catalogue().items() if n not in active and k.slot not in slots]
    return [candidate(k) for k in [*found, *extra]]


def look(
    parts: Split,
    base: FittedModel,
    candidates: Sequence[Candidate],
    beside: Callable[[], float] = lambda: 0.0,
    share: float = 0.0,
    begun: Begun | None = None,
) -> Round:
    """One round: score, fit the promising, compare.

    `beside` says what others must promise if the first is not all; `share`, of what goes beyond noise, what any must;
    `begun`, what of this very look is known already.
    """
    begun = begun or Begun(score_all(base, candidates))
    scores, known = begun.scores, {t.name: t for t in begun.fitted}
    chosen = shortlist(scores, share)

    def fitted(score: Score) -> Trial:
        return known.get(score.candidate.name) or try_one(parts, base, score)

    trials = _trials(scores, chosen, fitted, beside)
    if trials:
        trials = _settle(parts, base, trials)
        best = max(trials, key=lambda t: t.evidence.delta_bic)
        if left_over(best.fitted) >= REST or loss_without(best.fitted, best.name) <= LACKING_LOSS:
            base = warm_started(parts, base, best.fitted, "base") or base
        by = min((t.fitted for t in trials), key=lambda s: s.discrepancy_rate)  # what is compared is weighted alike
        first = max(trials, key=lambda t: t.evidence.gain)
        tau = compare_fits(base, first.fitted, by).tau
        trials = [dataclasses.replace(t, evidence=compare_fits(base, t.fitted, by, tau)) for t in trials]
    return Round(base, scores, tuple(_ranked(trials)), *_look_alikes(scores, trials), scores.count)


def _trials(
    scores: Scores, chosen: Sequence[Score], fitted: Callable[[Score], Trial], beside: Callable[[], float]
) -> list[Trial]:
    """The candidates worth it, fitted.

    Beside an effect that leaves nothing but noise only a close rival is worth a fit; beside one that leaves more, those
    that promise as much as structure outside the catalogue does.
    """
    trials: list[Trial] = []
    least = 0.0
    for score in chosen:
        settled = bool(trials) and left_over(trials[0].fitted) < REST and trials[0].converged
        if len(trials) == 1 and not settled:
            least = beside()
        same = bool(trials) and scores.likeness(score.candidate.name, chosen[0].candidate.name) > ALIKE
        bar = max(least, CLOSE * chosen[0].gain if settled or same else 0.0)
        if score.gain > bar or (score.sudden and not settled):
            trials.append(fitted(score))
    return trials


def shortlist(scores: Scores, share: float = 0.0) -> list[Score]:
    """Candidates worth a fit, the most promising first; then those whose promise is a rough one."""
    if not scores.rows:
        return []
    beyond = share * (scores.chi2 - scores.count)
    least = max(PROMISES, RIVALS * scores.rows[0].gain, beyond)
    chosen = [row for row in scores.rows if row.gain >= least][:MOST]
    rough = [row for row in scores.rows if row.sudden and row.gain >= max(PROMISES, beyond)]
    return chosen + [row for row in rough if all(row is not one for one in chosen)]


def try_one(parts: Split, base: FittedModel, score: Score) -> Trial:
    """A candidate fitted from the base's optimum."""
    one = score.candidate
    keys = tuple(one.effect.parameters())
    problem = with_candidate(base.problem, one, [f"{one.name}.{k}" for k in keys])
    x, added = _start(base, score)
    known = dict(zip(one.keys, added, strict=True))
    values = np.array([known.get(k, float(getattr(one.effect, k))) for k in keys])
    start = Point(problem, x, np.concatenate([base.constants, values]), base.discrepancy_rate)
    found = fit_on(parts, start, base, f"with {one.name}")
    return Trial(score, found, compare_fits(base, found))


def _start(base: FittedModel, score: Score) -> tuple[Array, Array]:
    """Initial states and switching parameters to start from: the promised step, or where the loss falls most."""
    one, off = score.candidate, score.candidate.off()
    known = one.effect.parameters()
    bounds = np.array([known[k]["bounds"] for k in one.keys], float)
    step = score.step - off
    usual = np.array([getattr(one.effect, k) for k in one.keys], float) - off
    tries = [step, 0.3 * step]
    one_sided = np.any(np.isclose(off, bounds[:, 0])) or np.any(np.isclose(off, bounds[:, 1]))
    if one_sided:  # such an effect may grow with the square of its parameter
        tries = [step, usual, 0.3 * usual]
    problem = with_candidate(base.problem, one).with_discrepancy(base.discrepancy_rate)
    found = []
    inner = bounds + np.outer(bounds[:, 1] - bounds[:, 0], [1e-4, -1e-4])
    for move in tries:
        values = np.clip(off + move, inner[:, 0], inner[:, 1])
        c = np.concatenate([base.constants, values])
        x = fit_states(problem, base.initial_states, c, TRIED_STEPS)
        found.append((float(shot_losses(problem, x, c)[0].sum()), x, values))
    _, x, values = min(found, key=lambda one: one[0])
    return x, values


def warm_started(parts: Split, one: FittedModel, other: FittedModel, what: str) -> FittedModel | None:
    """A fit from the optimum of another, shot by shot, where that is a better one than its own."""
    seen = one.weighted
    x = fit_states(seen, other.initial_states, one.constants, WARM_STEPS)
    old, new = (shot_losses(seen, at, one.constants)[0] for at in (one.initial_states, x))
    better = new < old
    if float(np.sum((old - new)[better])) < max(MOVES, 1e-3 * float(old.sum())):
        return None
    log.info("%s again, from another optimum", what)
    mixed = Point(one.problem, np.where(better[:, None], x, one.initial_states), one.constants, one.discrepancy_rate)
    return fit_on(parts, mixed, one, what)


def _settle(parts: Split, base: FittedModel, trials: list[Trial]) -> list[Trial]:
    """Close fits that may differ by where single shots ended: each tries the optimum of the other."""
    first = max(range(len(trials)), key=lambda k: trials[k].evidence.delta_bic)
    for k in range(len(trials)):
        near = all(left_over(trials[i].fitted) < NEAR for i in (k, first))
        if k == first or not near:
            continue
        for i, other in ((k, first), (first, k)):
            one = trials[i]
            found = warm_started(parts, one.fitted, trials[other].fitted, one.name)
            if found is not None:
                new = dataclasses.replace(one, fitted=found, evidence=compare_fits(base, found))
                if new.evidence.gain > one.evidence.gain:
                    trials[i] = new
    return trials


def _ranked(trials: Sequence[Trial]) -> list[Trial]:
    """Best first; of those that these data do not tell from the best, the one with the fewest parameters."""
    top = max((t.evidence.delta_bic for t in trials if t.converged), default=0.0)

    def rank(trial: Trial) -> tuple[bool, int, float]:
        tied = trial.converged and top - trial.evidence.delta_bic < TIED
        return not tied, trial.fitted.constants.size if tied else 0, -trial.evidence.delta_bic

    return sorted(trials, key=rank)


def _look_alikes(
    scores: Scores, trials: Sequence[Trial]
) -> tuple[tuple[tuple[str, str, float], ...], tuple[tuple[str, str], ...]]:
    """Look-alikes of what was fitted or promised much, and pairs of fits that the evidence does not part."""
    promise = {row.candidate.name: row.gain for row in scores.rows}
    top = max(promise.values(), default=0.0)
    alike = tuple(
        (a, b, value)
        for (a, b), value in sorted(scores.alike.items())
        if value > ALIKE and max(promise[a], promise[b]) > max(PROMISES, 0.5 * top)
    )
    tied = []
    fitted = [t for t in trials if t.converged]
    for a, one in enumerate(fitted):
        for two in fitted[a + 1 :]:
            if abs(one.evidence.delta_bic - two.evidence.delta_bic) < TIED:
                tied.append((one.name, two.name))
    return alike, tuple(tied)
