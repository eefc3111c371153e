"""A fit of constants and initial states of shots together, from nothing or warm-started from another fit.

In: a `ShotProblem`, or a `Point`: a problem with values for its unknowns. Out: a `FittedModel`.

From nothing, the horizon of the shots grows from event to event with the constants fitted along, so that each impact is
simulated with constants that are already nearly right; sizes of table and ball are held as stated until then. How much
a shot counts follows from its own discrepancy: one that the model does not follow, or that sits in a false optimum,
pulls the constants little. So constants, discrepancies and, of shots that miss by more than noise, searched initial
states are found in turn until their likelihood stays.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from sysid.estimation.fitted import UNFOLLOWED_RATE, FittedModel, HeldOut, Point
from sysid.estimation.initial_states import fit_states, shot_losses, shot_scores, with_scatter, within_noise
from sysid.estimation.lone_shots import SpinScan, scan_lone_shots
from sysid.estimation.problem import Array, shared_constants, values_of
from sysid.estimation.shot_problem import GROWING_RATE, ShotProblem
from sysid.estimation.solver.joint_fit import Solution, StoppingRule, fit_joint, newton_step
from sysid.estimation.state_search import (
    BETTER_LOSS,
    EFFORTS,
    SETTLING_STEPS,
    Optima,
    best_whole,
    found_states,
    searched_states,
    up_to_event,
)

CLOSE_RATE = 3e-4  # discrepancy rate up to which the last digit of constants matters
MAX_ROUNDS = 20  # of reweighing and searching
FINE_FIT = StoppingRule(15, 1, 1e-5)
COARSE_FIT = StoppingRule(10, 1, 1e-4)
GROWING_FIT = StoppingRule(6, 2, 1e-5)  # while shots grow
FIRST_EVENTS_FIT = StoppingRule(15, 3, 1e-5)
SHORT_FIT = StoppingRule(4, 1, 1e-5)
NO_STEP = StoppingRule(0, 1, 1e-5)  # information and gradient where the constants are
MIN_LONGER_SHOTS = 4  # shots that must have grown for the constants to be fitted at a stage
CHAOS_RATE = 1e-3  # discrepancy rate beyond which derivatives of whole shots claim too much
CHAOS_EVENTS = 2  # events up to which the derivatives of a shot that is not followed are valid
NEGLIGIBLE_STEP_SD = 0.25  # of a standard deviation: a remaining step that is too small to matter
HELD_OUT_STEPS, HELD_OUT_STEPS_UNFOLLOWED = 40, 8  # of initial states, where the model follows its clips, or not
log = logging.getLogger(__name__)


def fit_from_nothing(problem: ShotProblem, what: str = "") -> FittedModel:
    """Every constant of the problem and every initial state, the shots grown from their beginnings.

    Args:
        problem: whole shots, or pieces of them; its model's values are where the constants begin.
        what: is fitted, for the log.
    """
    held = problem.with_model(problem.model, [n for n in problem.names if n not in problem.model.sizes])
    x, c = _grown(held, what)
    problem, held = with_scatter(problem, x), with_scatter(held, x)
    found = fit(_freed(problem, held, x, c), what)
    return settled(found, what)


def _freed(problem: ShotProblem, held: ShotProblem, x: Array, c: Array) -> Point:
    """A start with sizes as stated, from initial states and the constants of a problem that held them."""
    values = values_of(problem.model, problem.names)
    values[[problem.names.index(name) for name in held.names]] = c
    return Point(problem, x, values, problem.discrepancy_rate(x, values))


def _better(one: FittedModel, other: FittedModel) -> FittedModel:
    """The fit of less loss, at the same standard deviations."""
    seen = one.problem.with_discrepancy(min(one.discrepancy_rate, other.discrepancy_rate))
    losses = [shot_losses(seen, at.initial_states, at.constants)[0].sum() for at in (one, other)]
    return other if losses[1] < losses[0] else one


def settled(found: FittedModel, what: str) -> FittedModel:
    """The fit with the shots that determine constants nearly alone at the best of their sidespins.

    It is fitted again where a shot fits better with another sidespin; then standard deviations are widened to hold the
    constants of all sidespins that fit about as well.
    """
    if not found.converged or found.discrepancy_rate > CLOSE_RATE:  # what the model lacks would decide between spins
        return found
    scans = _scans(found, what)
    if any(scan.best for scan in scans):
        x, c = found.initial_states.copy(), found.constants.copy()
        for scan in scans:
            if scan.best:
                x[scan.row], c[scan.some] = scan.states[scan.best], scan.constants[scan.best]
        other = fit(Point(found.problem, x, c, found.discrepancy_rate), what)
        if _better(found, other) is other:
            found, scans = other, _scans(other, what)
    variance = np.diag(found.covariance).copy()
    for scan in scans:
        variance[scan.some] = np.maximum(variance[scan.some], scan.variance)
    grown = np.sqrt(variance / np.diag(found.covariance))
    return dataclasses.replace(found, covariance=found.covariance * np.outer(grown, grown))


def _scans(found: FittedModel, what: str) -> list[SpinScan]:
    problem, x, c = found.weighted, found.initial_states, found.constants
    information = _solve(problem, x, c, NO_STEP, f"{what}, other sidespins").information
    return scan_lone_shots(problem, x, c, information)


def _grown(problem: ShotProblem, what: str) -> tuple[Array, Array]:
    """Initial states and constants, grown from event to event."""
    c, optima = values_of(problem.model, problem.names), Optima.at(problem.start)
    tolerant = problem.with_discrepancy(GROWING_RATE)
    for stage in range(problem.stages):
        optima = up_to_event(tolerant, optima, c, stage)
        longer = problem.horizon_at(stage) > problem.horizon_at(stage - 1)
        if stage and np.sum(longer) >= MIN_LONGER_SHOTS:
            seen, up_to = problem.until(problem.horizon_at(stage)), f"{what}, up to event {stage + 1}"
            _, own = shot_scores(seen, optima.best, c)
            weighted = seen.with_own_rates(own).with_discrepancy(float(np.median(own)))
            found = _solve(weighted, optima.best, c, GROWING_FIT, up_to)
            optima, c = optima.with_best(found.initial_states), found.constants
        log.info("%s, up to event %d of %d", what, stage + 1, problem.stages)
    return best_whole(tolerant, optima, c), c


def fit(start: Point, what: str = "") -> FittedModel:
    """Constants and initial states from a start that is nearly right.

    Each shot counts as much as its own discrepancy lets it, so that those that are followed lead to where all are.
    Where most are not followed in the end, the model lacks something in all of them, and they count alike.

    Args:
        start: a problem, and where another fit has arrived or a candidate is expected.
        what: is fitted, for the log.
    """
    found = _in_turn(start, what)
    if found.discrepancy_rate > CLOSE_RATE:
        found = _in_turn(found, f"{what}, all shots alike", alike=True)
    return found


def _in_turn(start: Point, what: str, alike: bool = False) -> FittedModel:
    """Constants, discrepancies and initial states, found in turn until their likelihood stays.

    Shots count by their own discrepancies, or `alike` by that of the middle one.
    Shots that miss by more than noise are searched again at the new constants, as long as that finds where they began;
    where they are few, with more and more effort, up to the work of searching all. A model that does not follow the
    shots is fitted coarsely: what it lacks moves its constants by more.
    """
    problem, x, c = start.problem, start.initial_states, start.constants
    tolerated, effort, searching, best = GROWING_RATE, 0, True, np.inf
    for _ in range(MAX_ROUNDS):
        elsewhere = 0
        if searching:
            x, elsewhere = _searched(problem, x, c, tolerated, EFFORTS[effort])
        _, own = shot_scores(problem, x, c)
        tolerated = float(np.median(own))
        problem = problem.with_own_rates(np.zeros_like(own) if alike else own)
        rule = COARSE_FIT if tolerated > CLOSE_RATE else FINE_FIT
        found = _solve(problem.with_discrepancy(tolerated), x, c, rule, what)
        x, c = found.initial_states, found.constants
        score = float(shot_scores(problem, x, c)[0].sum())
        log.info("%s: negative log likelihood %.1f, %d shots began elsewhere", what, score, elsewhere)
        improved, best = score < best - BETTER_LOSS, min(score, best)
        if improved:
            searching = elsewhere > 0
        elif not searching:
            searching = True
        elif effort + 1 < len(EFFORTS) and 0 < EFFORTS[effort + 1] * np.count_nonzero(own) <= len(x):
            effort += 1
        else:
            break
    return _fitted(Point(problem, x, c, tolerated), found)


def _searched(problem: ShotProblem, x: Array, c: Array, tolerated: float, effort: int) -> tuple[Array, int]:
    """Initial states (n, p), those of shots that miss by more than noise searched anew; how many began elsewhere."""
    bare = problem.with_own_rates(np.zeros(len(x)))
    odd = np.flatnonzero(~within_noise(*shot_losses(bare.with_discrepancy(0.0), x, c), problem.correlation_time))
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


def widened(found: FittedModel) -> FittedModel:
    """A fit of shots that the model does not follow to the noise, with a realistic uncertainty.

    Beyond some impacts a shot is chaotic and its derivatives claim far too much information. So the uncertainty is that
    of a fit to the first events alone, widened by the difference of its constants from those of the whole shots, and by
    the Newton steps that remain of both. Such a loss is too rough to be minimised to its last digit: the fit has
    converged if those steps are small against that uncertainty.
    """
    if found.discrepancy_rate <= CHAOS_RATE or found.problem.stages <= CHAOS_EVENTS:
        return found
    problem, what = found.weighted, f"up to event {CHAOS_EVENTS + 1}"
    seen = problem.until(problem.horizon_at(CHAOS_EVENTS))
    whole = _solve(problem, found.initial_states, found.constants, NO_STEP, what)
    first = _solve(seen, found.initial_states, found.constants, FIRST_EVENTS_FIT, what)
    bounds = shared_constants(problem.model, problem.names, problem.known).bounds
    covariance, converged = widened_covariance(first, whole, bounds)
    return dataclasses.replace(found, covariance=covariance, converged=converged)


def widened_covariance(first: Solution, whole: Solution, bounds: Array) -> tuple[Array, bool]:
    """Covariance of the constants from first events and whole shots, and whether both have converged; see `widened`."""
    sd = np.sqrt(np.diag(first.covariance))
    newton = [
        newton_step(j.information.sum(axis=0), j.gradient.sum(axis=0), j.constants, bounds)[0] for j in (first, whole)
    ]
    wide = np.sqrt(sd**2 + (first.constants - whole.constants) ** 2 + newton[0] ** 2 + newton[1] ** 2)
    known = np.isfinite(wide)  # a constant that the first events do not determine has no uncertainty to compare with
    arrived = all(bool(np.all(np.abs(step[known]) < NEGLIGIBLE_STEP_SD * wide[known])) for step in newton)
    return np.asarray(first.covariance * np.outer(wide / sd, wide / sd)), arrived


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


def loss_soon(problem: ShotProblem, x: Array, c: Array) -> float:
    """The loss after a few steps from a point."""
    return _solve(problem, x, c, SHORT_FIT, "a few steps").cost


def fit_held_out(found: Point, problem: ShotProblem, before: Array | None) -> HeldOut:
    """The initial states of held-out clips at the constants of a fit, and the remaining error.

    Args:
        found: the fit.
        problem: the clips; its model and constants are replaced.
        before: (n, p) initial states that are nearly right; None to search them.
    """
    problem, c = problem.with_model(found.problem.model, found.names), found.constants
    # A model that does not follow its training clips need not be fitted finely to others.
    steps = HELD_OUT_STEPS if found.discrepancy_rate < UNFOLLOWED_RATE else HELD_OUT_STEPS_UNFOLLOWED
    seen = problem.with_discrepancy(found.discrepancy_rate)
    if before is None:
        x = found_states(seen, c)
    else:
        x = found_states(seen, c, fit_states(seen, before, c, steps))
    x = fit_states(problem, x, c, steps)
    r = problem.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
    return HeldOut(x, problem.noise * float(np.sqrt(np.nanmean(r**2))), r)
