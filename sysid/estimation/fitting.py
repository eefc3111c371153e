"""A fit of constants and initial states of shots together, from nothing or warm-started from another fit.

In: a `ShotProblem`, or a `Point`: a problem with values for its unknowns. Out: a `FittedModel`.

From nothing, the horizon of the shots grows from event to event with the constants fitted along, so that each impact is
simulated with constants that are already nearly right; sizes of table and ball are held as stated until then. Where
the model lacks something, sizes are also freed only after all else was fitted, and the better fit is kept. The
discrepancy rate, which sets how much a late sample counts, is estimated in turn with the constants until both have
settled. Shots that fit much worse than the rest are grown again from their strike with the new constants, since a model
that lacked an effect may have left them in a false optimum.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from sysid.estimation.fitted import UNFOLLOWED_RATE, FittedModel, HeldOut, Point
from sysid.estimation.initial_states import (
    REGROWN_STEPS,
    fit_states,
    from_other_spins,
    grown_by_stage,
    grown_states,
    losses_per_residual,
    regrown,
    shot_losses,
    with_scatter,
)
from sysid.estimation.lone_shots import SpinScan, scan_lone_shots
from sysid.estimation.problem import Array, Index, shared_constants, values_of
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.joint_fit import Solution, StoppingRule, fit_joint, newton_step
from sysid.estimation.start_values import RUNNING_SPIN

CLOSE_RATE = 3e-4  # discrepancy rate up to which the last digit of constants matters
NO_RATE = 1e-5  # and which counts as none
MAX_ROUNDS = 6
MAX_RATE_RATIO = 0.6  # of the rate to that of the round before: one that falls less is not followed by another
SETTLED_RATE_CHANGE = 0.1  # share of the rate: a change that counts as none
FINE_FIT = StoppingRule(15, 1, 1e-5)
COARSE_FIT = StoppingRule(10, 1, 1e-4)
GROWING_FIT = StoppingRule(6, 2, 1e-5)  # while shots grow
FIRST_EVENTS_FIT = StoppingRule(15, 3, 1e-5)
SHORT_FIT = StoppingRule(4, 1, 1e-5)
NO_STEP = StoppingRule(0, 1, 1e-5)  # information and gradient where the constants are
MIN_LONGER_SHOTS = 4  # shots that must have grown for the constants to be fitted at a stage
ASTRAY_LOSS = 1.5  # loss per residual over the shots' median from which a shot is grown again
ODD_LOSS = 1.15  # the same where shots are followed to the noise
MAX_ALONE_SHARE = 0.5  # of the shots that may be astray for other spins to be tried
NOISE_LOSS = 0.5  # loss per residual of noise
COARSE_STATE_STEPS = 6  # of a shot that is grown again while the fit is coarse
MAX_OUTLIER_TRIALS = 3  # times that shots which stand out are tried anew, while it helps
MIN_IMPROVEMENT = 2.0  # of the loss, for which shots are moved
STUCK_LOSS = 1e-6  # share of the loss by which that of a round differs from that before, at most
CHAOS_RATE = 1e-3  # discrepancy rate beyond which derivatives of whole shots claim too much
CHAOS_EVENTS = 2  # events up to which the derivatives of a shot that is not followed are valid
NEGLIGIBLE_STEP_SD = 0.25  # of a standard deviation: a remaining step that is too small to matter
HELD_OUT_STEPS, HELD_OUT_STEPS_UNFOLLOWED = 40, 8  # of initial states, where the model follows its clips, or not
log = logging.getLogger(__name__)


def fit_from_nothing(problem: ShotProblem, what: str = "", pieces: bool = False) -> FittedModel:
    """Every constant of the problem and every initial state, the shots grown from their beginnings.

    Args:
        problem: whole shots, or pieces of them; its model's values are where the constants begin.
        what: is fitted, for the log.
        pieces: shots begin in motion, so that nothing is known of their spins, and other ones are tried.
    """
    held = problem.with_model(problem.model, [n for n in problem.names if n not in problem.model.sizes])
    x, c = _grown(held, what)
    problem, held = with_scatter(problem, x), with_scatter(held, x)
    start = _freed(problem, held, x, c)
    if not pieces:
        start = _other_spins_of_running(start, what)
        found = fit(start, what, UNFOLLOWED_RATE)
        if held.names != problem.names and found.discrepancy_rate > CLOSE_RATE:
            # What the model lacks may have bent the sizes before the other constants were near their best.
            alone = fit(Point(held, x, c, held.discrepancy_rate(x, c)), f"{what}, sizes as stated", UNFOLLOWED_RATE)
            other = fit(_freed(problem, held, alone.initial_states, alone.constants), what, UNFOLLOWED_RATE)
            found = _better(found, other)
        return settled(found, what)
    for _ in range(2):
        log.info("%s, other spins", what)
        seen = problem.with_discrepancy(start.discrepancy_rate)
        x = from_other_spins(seen, np.arange(len(x)), start.initial_states, start.constants)
        start = Point(problem, x, start.constants, problem.discrepancy_rate(x, start.constants))
        start = found = fit(start, what, UNFOLLOWED_RATE)
    return found


def _other_spins_of_running(start: Point, what: str) -> Point:
    """A start with other spins tried of the clips that begin in mid-motion, of which nothing is known."""
    problem = start.problem
    rows = np.array([k for k, clip in enumerate(problem.clips) if clip.running], np.int64)
    if not rows.size:
        return start
    log.info("%s, other spins of running clips", what)
    seen = problem.with_discrepancy(start.discrepancy_rate)
    x = from_other_spins(seen, rows, start.initial_states, start.constants, RUNNING_SPIN)
    return Point(problem, x, start.constants, problem.discrepancy_rate(x, start.constants))


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
        other = fit(Point(found.problem, x, c, found.discrepancy_rate), what, UNFOLLOWED_RATE)
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
    c, x = values_of(problem.model, problem.names), problem.start.copy()
    for stage in range(problem.stages):
        x = grown_by_stage(problem, x, c, stage)
        longer = problem.horizon_at(stage) > problem.horizon_at(stage - 1)
        if stage and np.sum(longer) >= MIN_LONGER_SHOTS:
            seen = problem.growing(stage)
            found = _solve(seen, x, c, GROWING_FIT, f"{what}, up to event {stage + 1}")
            x, c = found.initial_states, found.constants
        log.info("%s, up to event %d of %d", what, stage + 1, problem.stages)
    return x, c


def fit(start: Point, what: str = "", doubt_below: float = CLOSE_RATE) -> FittedModel:
    """Constants and initial states from a start that is nearly right.

    A model that does not follow the shots to the noise is fitted coarsely: what it lacks moves its constants by more.

    Args:
        start: a problem, and where another fit has arrived or a candidate is expected.
        what: is fitted, for the log.
        doubt_below: discrepancy rate up to which single shots that stand out are tried anew, since the model follows
            the others well enough.
    """
    problem, x, c, rate = start.problem, start.initial_states, start.constants, start.discrepancy_rate
    regrow, trials, cost = True, MAX_OUTLIER_TRIALS, np.inf
    coarse = rate > CLOSE_RATE
    for round_ in range(MAX_ROUNDS):
        found = _solve(problem.with_discrepancy(rate), x, c, COARSE_FIT if coarse else FINE_FIT, what)
        x, c = found.initial_states, found.constants
        new = problem.discrepancy_rate(x, c)
        better = False
        seen = problem.with_discrepancy(min(new, rate))
        astray = _astray(seen, x, c) if regrow else np.zeros(0, np.int64)
        if astray.size:
            regrow = False
            x, count = regrown(seen, astray, x, c, COARSE_STATE_STEPS if coarse else REGROWN_STEPS)
            alone = _astray(seen, x, c)
            if 0 < alone.size <= MAX_ALONE_SHARE * len(x):  # the model follows the others: it is their spin
                before, x = x, from_other_spins(seen, alone, x, c)
                count += int(np.any(x != before))
            if count:
                better, new = True, problem.discrepancy_rate(x, c)
        if new <= doubt_below and trials:
            trials -= 1
            others = _outliers_retried(problem.with_discrepancy(new), x, c)
            if others is None:
                trials = 0
            else:
                log.info("%s, without shots that bias the constants", what)
                x, c = others
                better, new = True, problem.discrepancy_rate(x, c)
        settled = abs(new - rate) < SETTLED_RATE_CHANGE * rate + NO_RATE
        slow = round_ > 0 and new > max(MAX_RATE_RATIO * rate, CLOSE_RATE)
        stuck = abs(cost - found.cost) < STUCK_LOSS * found.cost  # the same fit again would change nothing
        rate, coarse, cost = new, new > CLOSE_RATE, found.cost
        if (settled and not better and (found.converged or stuck)) or slow:
            break
    return _fitted(Point(problem, x, c, rate), found)


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


def _outliers_retried(seen: ShotProblem, x: Array, c: Array) -> tuple[Array, Array] | None:
    """Initial states and constants with the shots that stand out tried anew at the constants of the others.

    A shot in a false optimum biases the constants until it nearly fits; at those of the others alone, it can find its
    true optimum. None where no shot stands out, or where the loss does not improve.
    """
    old, count = shot_losses(seen, x, c)
    losses = old / np.maximum(count, 1)
    odd = np.flatnonzero(losses > ODD_LOSS * float(np.median(losses)))
    rest = np.setdiff1d(np.arange(len(x)), odd)
    if odd.size == 0 or rest.size < max(3, 2 * len(x) // 3):
        return None
    alone = _solve(seen.only(rest), x[rest], c, COARSE_FIT, "the other shots")
    new, at = x.copy(), alone.constants
    new[rest] = alone.initial_states
    new, _ = regrown(seen, odd, new, at)
    new = from_other_spins(seen, odd, new, at)
    return (new, at) if shot_losses(seen, new, at)[0].sum() < old.sum() - MIN_IMPROVEMENT else None


def _astray(seen: ShotProblem, x: Array, c: Array) -> Index:
    """Shots whose loss per residual is far above the median."""
    losses = losses_per_residual(seen, x, c)
    return np.flatnonzero(losses > ASTRAY_LOSS * max(float(np.median(losses)), NOISE_LOSS))


def loss_soon(problem: ShotProblem, x: Array, c: Array) -> float:
    """The loss after a few steps from a point."""
    return _solve(problem, x, c, SHORT_FIT, "a few steps").cost


def fit_held_out(found: Point, problem: ShotProblem, before: HeldOut | None, pieces: bool = False) -> HeldOut:
    """The initial states of held-out clips at the constants of a fit, and the remaining error.

    Args:
        found: the fit.
        problem: the clips; its model and constants are replaced.
        before: initial states that are nearly right; None to grow the shots from their beginnings.
        pieces: see `fit_from_nothing`.
    """
    problem, c = problem.with_model(found.problem.model, found.names), found.constants
    follows = found.discrepancy_rate < UNFOLLOWED_RATE
    # A model that does not follow its training clips need not be fitted finely to others.
    steps = HELD_OUT_STEPS if follows else HELD_OUT_STEPS_UNFOLLOWED
    x = grown_states(problem, c) if before is None else before.initial_states
    seen = problem.with_discrepancy(found.discrepancy_rate)
    x = fit_states(seen, x, c, steps)
    astray = np.flatnonzero(losses_per_residual(problem, x, c) > ODD_LOSS * NOISE_LOSS)
    if pieces and before is None:
        x = from_other_spins(seen, astray, x, c)
    elif astray.size and follows:
        x, _ = regrown(seen, astray, x, c)
        if found.discrepancy_rate < CLOSE_RATE:
            x = from_other_spins(seen, astray, x, c)
    x = fit_states(problem, x, c, steps)
    r = problem.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
    return HeldOut(x, problem.noise * float(np.sqrt(np.nanmean(r**2))), r)
