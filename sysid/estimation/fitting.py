"""A fit of constants and initial states of whole shots together, from a start that is nearly right.

In: a `Point`: a problem with values for its unknowns (from_nothing.py finds the first). Out: a `FittedModel`.

A shot's weight follows from its own discrepancy: one that the model does not follow, or that is in a false optimum,
hardly affects the constants. Constants, discrepancies and, for shots that miss by more than noise, searched initial
states are therefore found in turn until their likelihood stays.
"""

from __future__ import annotations

import logging

import numpy as np

from models.messages import counted
from sysid.estimation.fitted import UNFOLLOWED_RATE, FittedModel, HeldOut, Point
from sysid.estimation.problem import Array, shared_constants
from sysid.estimation.shot_problem import GROWING_RATE, ShotProblem
from sysid.estimation.solver.joint_fit import Solution, StoppingRule, fit_joint, reduced_system
from sysid.estimation.states.initial_states import fit_states, followed, shot_scores
from sysid.estimation.states.state_search import BETTER_LOSS, SEARCH_EFFORTS, searched_states

CLOSE_RATE = 3e-4  # largest discrepancy rate at which the last digit of constants matters
MAX_ROUNDS = 20  # rounds of reweighting and searching
FINE_FIT = StoppingRule(15, 1e-6)
COARSE_FIT = StoppingRule(10, 1e-4)
SHORT_FIT = StoppingRule(4, 1e-5)
HELD_OUT_STEPS, HELD_OUT_STEPS_UNFOLLOWED = 40, 8  # iterations, if the model follows its clips, or does not
SETTLING_STEPS = 20  # iterations of a shot that was searched again
log = logging.getLogger(__name__)


def fit(start: Point, what: str = "", searching: bool = True) -> FittedModel:
    """Fit constants and initial states from a start that is nearly right.

    Each shot is weighted by its own discrepancy, so that shots that are followed guide the constants. If most are not
    followed in the end, the model lacks something in all of them, and they get equal weights.

    Args:
        start: a problem, with the values of another fit or those expected of a candidate.
        what: name of the fit, for the log.
        searching: whether to search initial states again for shots that miss by more than most.
    """
    found = _in_turn(start, what, searching)
    if found.discrepancy_rate > CLOSE_RATE:
        found = _in_turn(found, f"{what}, all shots alike", searching, alike=True)
    return found


def _in_turn(start: Point, what: str, searches: bool, alike: bool = False) -> FittedModel:
    """Fit constants, discrepancies and initial states in turn until their likelihood stays.

    Shots are weighted by their own discrepancies, or `alike` by the median one. With `searches`, shots that miss by
    more than noise, and by more than most shots, are searched again at the new constants, as long as that helps; if
    they are few, with increasing effort, up to the work of searching all. A model that does not follow the shots is
    fitted coarsely, since its own errors move its constants by more; one whose discrepancies still change, in a few
    steps at a time.
    """
    problem, x, c = start.problem, start.initial_states, start.constants
    tolerated, effort, searching, best, settled = GROWING_RATE, 0, searches, np.inf, False
    usual, last_effort = start.discrepancy_rate, len(SEARCH_EFFORTS) - 1
    for _ in range(MAX_ROUNDS):
        elsewhere = 0
        if searching:
            x, elsewhere = _searched(problem, x, c, tolerated, SEARCH_EFFORTS[effort], usual)
        _, own = shot_scores(problem, x, c)
        tolerated = usual = float(np.median(own))
        problem = problem.with_own_rates(np.zeros_like(own) if alike else own)
        rule = COARSE_FIT if tolerated > CLOSE_RATE else FINE_FIT if settled else SHORT_FIT
        found = _solve(problem.with_discrepancy(tolerated), x, c, rule, what)
        x, c = found.initial_states, found.constants
        score = float(shot_scores(problem, x, c)[0].sum())
        log.info(
            "%s: negative log likelihood %.1f, %s with new initial states", what, score, counted(elsewhere, "shot")
        )
        improved, best = score < best - BETTER_LOSS, min(score, best)
        if improved:
            searching = elsewhere > 0
        elif not settled:
            settled = True
        elif searches and not searching:
            searching = True
        elif searches and effort < last_effort and 0 < SEARCH_EFFORTS[effort + 1] * np.count_nonzero(own) <= len(x):
            effort += 1
        else:
            break
    return _fitted(Point(problem, x, c, tolerated), found)


def _searched(
    problem: ShotProblem, x: Array, c: Array, tolerated: float, effort: int, usual: float
) -> tuple[Array, int]:
    """Initial states (n, p), searched again for shots that miss by more than usual, and how many of them changed.

    Args:
        problem: the shots.
        x: (n, p) initial states.
        c: constants.
        tolerated: discrepancy rate that the search tolerates.
        effort: of the search.
        usual: discrepancy rate that only worse shots exceed.
    """
    bare = problem.with_own_rates(np.zeros(len(x)))
    odd = np.flatnonzero(~followed(problem, x, c, usual))
    if not odd.size:
        return x, 0
    part = bare.only(odd)
    own = part.with_own_rates(shot_scores(part, x[odd], c)[1]).with_discrepancy(0.0)
    searched = searched_states(part.with_discrepancy(tolerated), c, effort)
    old, new = (fit_states(own, at, c, SETTLING_STEPS) for at in (x[odd], searched))
    elsewhere = shot_scores(part, new, c)[0] < shot_scores(part, old, c)[0] - BETTER_LOSS
    x = x.copy()
    x[odd] = np.where(elsewhere[:, None], new, old)
    return x, int(elsewhere.sum())


def _fitted(at: Point, found: Solution) -> FittedModel:
    r = at.residuals()
    freedom = max(int(np.isfinite(r).sum()) - at.initial_states.size - at.constants.size, 1)
    rms = at.problem.noise * float(np.sqrt(np.nanmean(r**2)))
    return FittedModel(
        at.problem, at.initial_states, at.constants, at.discrepancy_rate, found.covariance, found.converged, rms,
        float(np.nansum(r**2)) / freedom,
    )  # fmt: skip


def _solve(problem: ShotProblem, x: Array, c: Array, rule: StoppingRule, what: str) -> Solution:
    shared = shared_constants(problem.model, problem.names, problem.known)
    return fit_joint(problem.objective(), x, c, shared, rule, what)


def few_steps(problem: ShotProblem, x: Array, c: Array) -> tuple[Array, Array, float]:
    """Initial states (n, p) and constants (q,) after a few steps of a fit, and the loss there."""
    found = _solve(problem, x, c, SHORT_FIT, "a few steps")
    return found.initial_states, found.constants, found.cost


def fit_held_out(found: FittedModel, problem: ShotProblem, before: Array, searching: bool = True) -> HeldOut:
    """Fit the initial states of held-out clips at the constants of a fit; returns the remaining error.

    Args:
        found: the fit.
        problem: the clips; its model and constants are replaced.
        before: (n, p) nearly right initial states.
        searching: see `fit`.
    """
    problem, c = problem.with_model(found.problem.model, found.names), found.constants
    # A model that does not follow its training clips needs no fine fit to others.
    steps = HELD_OUT_STEPS if found.discrepancy_rate < UNFOLLOWED_RATE else HELD_OUT_STEPS_UNFOLLOWED
    weighted = problem.with_discrepancy(found.discrepancy_rate)
    x = fit_states(weighted, before, c, steps)
    if searching:
        rate = found.discrepancy_rate
        x, _ = _searched(weighted, x, c, max(rate, GROWING_RATE), SEARCH_EFFORTS[0], rate)
    x = fit_states(problem, x, c, steps)
    r = problem.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
    return HeldOut(x, problem.noise * float(np.sqrt(np.nanmean(r**2))), r, _open_residuals(found, problem, x, r))


def _open_residuals(found: FittedModel, problem: ShotProblem, x: Array, r: Array) -> Array:
    """Residuals (n, m) of held-out shots with the constants moved within their uncertainty.

    A clip with events that are rare in the training clips, such as a collision, informs about the constants and does
    not contradict the model. So constants and initial states take one Newton step together, with the fit's knowledge
    of the constants as the prior.

    Args:
        found: the fit, with the covariance of its constants.
        problem: the held-out shots.
        x: (n, p) their initial states at the constants of the fit.
        r: (n, m) their residuals there, kept for shots that do not improve.
    """
    seen, c, rows = problem.with_discrepancy(found.discrepancy_rate), found.constants, np.arange(len(x))
    shared = shared_constants(seen.model, seen.names, seen.known)
    shots = reduced_system(seen.objective(), x, c, shared)
    known = np.isfinite(np.diag(found.covariance))
    covariance = np.diag(shared.width**2)
    covariance[np.ix_(known, known)] = found.covariance[np.ix_(known, known)]
    covariance += np.diag(shared.steps**2)  # no constant is known better than the step of its derivative
    scale = np.sqrt(np.diag(covariance))
    prior = np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    step = np.linalg.lstsq(shots.information.sum(axis=0) + prior, shots.gradient.sum(axis=0), rcond=None)[0]
    moved = np.clip(c - step, *shared.bounds.T)
    states = seen.objective().inside(x - shots.state_by_constant @ (moved - c))
    states = fit_states(problem, states, moved, HELD_OUT_STEPS_UNFOLLOWED)
    other = problem.evaluate(states, np.tile(moved, (len(x), 1)), rows)
    closer = np.nansum(other**2, axis=1) < np.nansum(r**2, axis=1)
    return np.where(closer[:, None], other, r)
