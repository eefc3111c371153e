"""Discovery where not every whole shot is followed: effects judged by how each impact follows from the one before it.

In: a fit of windows. Out: the effects that they name, and whole shots with these.

Where a model lacks much, or after a dozen impacts, whole shots say little (sysid/estimation/chain.py). Windows of one
impact that hang together do: every candidate is scored on them at once, the best are fitted, and the one that explains
most is named if its evidence suffices, if windows of held-out clips do not follow each other worse beyond chance, and
if its size is beyond its uncertainty over the clips. In the end each effect must still be needed beside the others. How
shots scatter about the model says how much less than independent residuals they tell (their design effect).
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from sysid.estimation.chain import Beside, equations, reduced
from sysid.estimation.chain_fit import fit_chain, settled_states
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.from_nothing import WindowFit, moved_to, searched, whole_shots
from sysid.estimation.problem import CAUCHY_SD, Array
from sysid.estimation.solver.least_squares import weights
from sysid.selection.evidence import Evidence, chi2_of_known
from sysid.selection.formula import EFFECT_NAME, SparseFormula, describe, grown, term_candidates
from sysid.selection.free_forms import causes
from sysid.selection.pruning import MIN_DISTANCE_SD, distance_from_absence, size_in_sd
from sysid.selection.result import DiscoveryResult
from sysid.selection.score import Candidate, Linearised, Score, Scores, Signature, scores_of
from sysid.selection.screening import (
    MAX_FITS,
    MIN_DELTA_BIC,
    MIN_IMPROVEMENT,
    MIN_IMPROVEMENT_OF_BEST,
    SMALLER_TRIAL,
    TRIAL_STEPS,
    FittedCandidate,
    Screening,
    candidates_for,
    confounded_and_tied,
    is_enough,
    rank_fits,
)
from sysid.selection.stability import Stability, stability_of
from sysid.selection.terms import Term

MAX_TRIALS = 2 * MAX_FITS  # of candidates in a round, as long as none is needed
CANDIDATE_STEPS, FINAL_STEPS = 6, 30  # of the constants: with or without an effect, of the last model
PROBE_OF_USUAL = 0.1  # change of a candidate's parameter, over its usual size, from which its derivative is taken
log = logging.getLogger(__name__)


def score_windows(at: WindowFit, candidates: Sequence[Candidate]) -> Scores:
    """Scores of candidates beside all constants and states of windows."""
    return scores_of(as_point(at), linearise_windows(at, candidates), at.fitted.design_effect)


def as_point(at: WindowFit) -> Point:
    """Where a fit of windows is, without states."""
    chain = at.fitted.chain
    return Point(chain.problem, np.zeros((0, 0)), at.fitted.constants, chain.spread.impact)


def linearise_windows(at: WindowFit, candidates: Sequence[Candidate]) -> Linearised:
    """A fit of windows with candidates beside it as quadratic losses of its shots."""
    found = at.fitted
    chain, c, states = found.chain, found.constants, found.states
    signatures, beside = list[Signature](), list[Beside]()
    for one in candidates:
        off, probe = one.off(), PROBE_OF_USUAL * one.usual()
        keys = tuple(f"{one.name}.{key}" for key in one.keys)
        changed = chain.with_model(chain.model.add(one.effect), (*chain.names, *keys))
        beside.append(Beside(changed, off, probe))
        signatures.append(Signature(one, np.abs(probe), np.zeros((0, 0, len(off)))))
    _, shots = equations(chain, states, c, chain.gap_sd(states), chain.shared.steps_from(c), beside)
    _, information, gradient = reduced(shots)
    marginal = np.sum([s.constants for s in shots], axis=0).diagonal()[len(c) :]
    r = chain.play(states, np.tile(c, (len(states), 1)), np.arange(len(states)))[0]
    chi2, residuals = float(np.sum(weights(r, CAUCHY_SD) * np.nan_to_num(r) ** 2)), int(np.isfinite(r).sum())
    return Linearised(tuple(signatures), information, gradient, marginal, chi2, residuals)


def with_effect(at: WindowFit, score: Score) -> WindowFit:
    """The fit with one effect more, or with another formula, from the likeliest of a few sizes.

    These are its predicted, a smaller and its usual size; what a formula had already begins where it is.
    """
    one, found = score.candidate, at.fitted
    had = dict(zip(found.chain.names, found.constants.tolist(), strict=True))
    bare = {name: value for name, value in had.items() if not name.startswith(f"{one.name}.")}
    keys = tuple(one.effect.parameters())
    names = (*bare, *(f"{one.name}.{key}" for key in keys))
    chain = found.chain.with_model(found.chain.model.add(one.effect), names)
    low, high = one.bounds().T
    begin = np.array([had.get(f"{one.name}.{key}", off) for key, off in zip(one.keys, one.off().tolist(), strict=True)])
    sd, tried = chain.gap_sd(found.states), list[tuple[float, Array]]()
    for step in (score.values - begin, SMALLER_TRIAL * (score.values - begin), one.off() + one.usual() - begin):
        values = np.clip(begin + step, low + 1e-3 * (high - low), high - 1e-3 * (high - low))
        tried_at = dict(zip(one.keys, values.tolist(), strict=True))
        c = np.array([*bare.values(), *(tried_at.get(key, float(getattr(one.effect, key))) for key in keys)])
        states = settled_states(chain, found.states, c, TRIAL_STEPS)
        tried.append((float(chain.losses(states, c, sd).sum()), c))
    _, c = min(tried, key=lambda trial: trial[0])
    return moved_to(at, fit_chain(chain, found.states, c, CANDIDATE_STEPS, f"with {one.name}"))


def continued(at: WindowFit) -> WindowFit:
    """The fit after as many steps more as one with a candidate gets."""
    found = at.fitted
    return moved_to(at, fit_chain(found.chain, found.states, found.constants, CANDIDATE_STEPS, "with nothing more"))


def without_effect(at: WindowFit, name: str) -> WindowFit:
    """The fit without one of its effects."""
    found = at.fitted
    keep = [k for k, n in enumerate(found.chain.names) if not n.startswith(f"{name}.")]
    names = tuple(found.chain.names[k] for k in keep)
    chain = found.chain.with_model(found.chain.model.without(name), names)
    return moved_to(at, fit_chain(chain, found.states, found.constants[keep], CANDIDATE_STEPS, f"without {name}"))


def evidence(less: WindowFit, more: WindowFit) -> Evidence:
    """Evidence for a fit with more constants, on the same windows at the same errors of the model.

    Shots tell as much as they scatter about the better of the two.
    """
    gain = 2.0 * (less.fitted.losses - more.fitted.losses)
    tau = (more if gain.sum() > 0 else less).fitted.design_effect
    chain = more.fitted.chain
    count = float(chain.windows.data.count.sum())
    penalty = (len(chain.names) - len(less.fitted.chain.names)) * float(np.log(max(2 * count / tau, 2.0)))
    known = chi2_of_known(as_point(less)) - chi2_of_known(as_point(more))
    total, top = float(gain.sum()), int(np.argmax(gain))
    others = total - float(gain[top])
    counts = np.array([chain.windows.data.count[run].sum() for run in chain.windows.runs])
    share = more.fitted.losses / np.maximum(counts, 1)
    ratio = float(share[top] / max(float(np.median(share)), 1e-12))
    return Evidence(total / tau + known - penalty, total + known * tau, tau, others / tau + known - penalty, ratio)


def is_needed(less: WindowFit, more: WindowFit, name: str, found: FittedModel, seen: Evidence) -> bool:
    """Whether evidence and its own size speak for an effect, and held-out clips not against it.

    These do where their loss rises by more than the standard error of its change over shots.
    """
    gains = less.held_losses() - more.held_losses()
    held, error = float(gains.sum()), float(gains.std()) * math.sqrt(len(gains)) if len(gains) else 0.0
    distance = (size_in_sd if name == EFFECT_NAME else distance_from_absence)(found, name)
    log.info(
        "%s: delta BIC %.0f, held out %.0f +- %.0f, %.1f sd from none", name, seen.delta_bic, held, error, distance
    )
    count = 2 * int(more.fitted.chain.windows.data.count.sum())
    return is_enough(seen, count) and distance >= MIN_DISTANCE_SD and held >= -error


def of_windows(at: WindowFit, base: FittedModel) -> FittedModel:
    """A fit of windows as one of whole shots that are not played: with constants, and without any error."""
    found = at.fitted
    problem = base.problem.with_model(found.chain.model, found.chain.names)
    return dataclasses.replace(
        base, problem=problem, constants=found.constants, covariance=found.covariance, converged=found.converged,
        rms=math.nan, chi2=math.nan, held_out=None,
    )  # fmt: skip


@dataclass(frozen=True)
class WindowScreening:
    """What windows say that a model lacks."""

    screening: Screening
    name: str | None  # of the effect to add
    fitted: WindowFit  # with it, or with the formula, or as it was
    formula: SparseFormula | None = None  # with one term more, where that explains more than any effect


def screen_windows(at: WindowFit, base: FittedModel, formula: SparseFormula | None = None) -> WindowScreening:
    """Candidates scored on windows, the best fitted, and what follows.

    Args:
        at: windows, fitted without any of the candidates.
        base: the same fit as one of whole shots.
        formula: that it has already.
    """
    scores = score_windows(at, candidates_for(at.model))
    less = continued(at)
    fits, needed, least = list[FittedCandidate](), dict[str, WindowFit](), MIN_IMPROVEMENT
    for row in scores.rows:
        # Where none of the first is needed, more was predicted of them than they gain: others may win.
        if row.predicted_improvement < least or len(fits) >= (MAX_FITS if needed else MAX_TRIALS):
            break
        name, more = row.candidate.name, with_effect(at, row)
        # In few steps it need not arrive: it is judged by what it gains.
        fitted, seen = dataclasses.replace(of_windows(more, base), converged=True), evidence(less, more)
        fits.append(FittedCandidate(row, fitted, seen, is_needed(less, more, name, fitted, seen)))
        if fits[-1].generalises:
            needed[name] = more
            least = max(least, MIN_IMPROVEMENT_OF_BEST * row.predicted_improvement)
    fits, needed = ranked(fits, needed)
    best = next((one for one in fits if one.name in needed), None)
    screening = Screening(
        base, scores, tuple(fits), *confounded_and_tied(scores, fits), scores.count, len(at.fitted.states)
    )
    rival = None if best is None else needed[best.name]
    if rival is None or rival.fitted.design_effect > 1.0:  # it leaves more than noise
        found = explained_by_formula(at, less, base, formula, rival)
        if found is not None:
            return WindowScreening(screening, None, *found)
    if best is None:
        return WindowScreening(screening, None, at)
    return WindowScreening(screening, best.name, needed[best.name])


def explained_by_formula(
    at: WindowFit, less: WindowFit, base: FittedModel, formula: SparseFormula | None, rival: WindowFit | None
) -> tuple[WindowFit, SparseFormula] | None:
    """A formula with as many terms more as it takes to explain more than an effect, or with one where there is none.

    Args:
        at: windows, fitted without any of both.
        less: the same after as many steps as one with a term gets.
        base: the same fit as one of whole shots.
        formula: that it has already.
        rival: the fit with the effect.
    """
    had = 0 if formula is None else len(formula.terms)
    while True:
        formula = grown(formula, as_point(at), partial(score_windows, at))
        if formula is None:
            return None
        more = with_effect(at, formula.score())
        if not is_needed(less, more, EFFECT_NAME, of_windows(more, base), evidence(less, more)):
            return None
        at = less = searched(more)
        if rival is None or outdoes(formula.terms[had:], at, rival):
            return at, formula


def ranked(
    fits: list[FittedCandidate], needed: dict[str, WindowFit]
) -> tuple[list[FittedCandidate], dict[str, WindowFit]]:
    """Fits, the best first, and those that are needed, all at the errors of the best of them.

    They were fitted at those of the model that lacks them all, which hide by how much they differ.
    """
    fits = sorted(fits, key=lambda one: -one.evidence.delta_bic)
    first = next((one for one in fits if one.name in needed), None)
    if first is None:
        return fits, needed
    found = {first.name: searched(needed[first.name])}
    spread = found[first.name].fitted.chain.spread
    found |= {name: searched(fit, spread) for name, fit in needed.items() if name != first.name}
    more = {name: evidence(found[first.name], fit).delta_bic for name, fit in found.items() if name != first.name}
    fits = [
        dataclasses.replace(
            one, evidence=dataclasses.replace(one.evidence, delta_bic=first.evidence.delta_bic + more[one.name])
        )
        if one.name in more
        else one
        for one in fits
    ]
    return rank_fits(fits), found


def outdoes(terms: Sequence[Term], more: WindowFit, best: WindowFit) -> bool:
    """Whether a fit with terms explains more than one with an effect, and one of them something beside that effect.

    A term that is the law of the effect explains nothing beside it, however many steps each of the fits has come.
    """
    beside = causes(score_windows(best, term_candidates(terms)))[0].log_odds
    spread = min(best.fitted.chain.spread, more.fitted.chain.spread)
    one, two = (fit if fit.fitted.chain.spread == spread else searched(fit, spread) for fit in (best, more))
    likelier = evidence(one, two).delta_bic
    log.info("%s: delta BIC %.0f over the best effect, log odds %.1f beside it", terms[-1].name, likelier, beside)
    return beside > 0.0 and likelier > MIN_DELTA_BIC


def discover_by_windows(
    found: DiscoveryResult, at: WindowFit
) -> tuple[DiscoveryResult, WindowFit, SparseFormula | None]:
    """Effects that windows name, and whole shots with them, added to a result that has the base alone.

    Where a formula explains more than any effect, whole shots with it as well, as what `explained` the result; and the
    formula.
    """
    parts, base = found.parts, found.last
    now, verdict, formula = base, tuple[str, ...](), None
    while True:  # each round adds one of the catalogue's effects, or a term
        seen = screen_windows(at, now, formula)
        found, formula = dataclasses.replace(found, rounds=(*found.rounds, seen.screening)), seen.formula or formula
        if seen.name is None and seen.formula is None:
            break
        if seen.name is not None:
            log.info("found %s", seen.name)
            verdict = (*verdict, seen.name)
        at = seen.fitted
        now = of_windows(at, base)
    at, kept = without_needless(at, verdict, base)
    with_formula, at = at, without_effect(at, EFFECT_NAME) if formula is not None else at
    if kept:
        last = at.fitted
        at = moved_to(at, fit_chain(last.chain, last.states, last.constants, FINAL_STEPS, "the last model"))
        found = found.with_step(whole_shots(parts, at), kept)
    found = dataclasses.replace(found, pruned=tuple(name for name in verdict if name not in kept))
    if formula is None:
        return found, at, None
    last = with_formula.fitted
    described = described_in_windows(formula, at, with_formula, base)
    with_formula = searched(
        moved_to(with_formula, fit_chain(last.chain, last.states, last.constants, FINAL_STEPS, "with the formula"))
    )
    return dataclasses.replace(found, unexplained=described, explained=whole_shots(parts, with_formula)), at, formula


def described_in_windows(
    formula: SparseFormula, less: WindowFit, more: WindowFit, base: FittedModel
) -> dict[str, Any]:  # fmt: skip
    """A formula as result.json has it, from fits without and with it."""
    return describe(formula, of_windows(more, base), evidence(less, more))


def stability_by_windows(found: DiscoveryResult, at: WindowFit) -> Stability:
    """How often the verdict returns, see `stability_of`."""
    losses = linearise_windows(at, [one for one in candidates_for(at.model) if one.name not in found.refuted])
    return stability_of(as_point(at), found.verdict, losses, at.fitted.design_effect)


def without_needless(at: WindowFit, verdict: tuple[str, ...], base: FittedModel) -> tuple[WindowFit, tuple[str, ...]]:
    """The fit without the effects that are no longer needed beside the others, those of least size first."""
    while len(at.model.effects) > len(base.model.effects) + 1:  # the only one was needed when it was added
        seen = of_windows(at, base)
        name = min(verdict, key=partial(distance_from_absence, seen))
        less = without_effect(at, name)
        if is_needed(less, at, name, seen, evidence(less, at)):
            break
        log.info("%s is not needed", name)
        at, verdict = less, tuple(v for v in verdict if v != name)
    return at, verdict
