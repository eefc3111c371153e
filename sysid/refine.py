"""A fit that starts where another one has arrived, with an effect more or less in the model.

Shots that do not follow the rest are grown again from their strike with the new constants, since a model that lacked
something may have left them in a false optimum. The error of the model per way, which says how much a late sample
counts, is estimated anew with the constants until both have settled.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.clips import ClipSet
from sysid.evidence import Point
from sysid.fit import error_rate
from sysid.own import ROBUST, Growth, fit_own, with_error
from sysid.problem import Array, Index, ShotProblem, constant_bounds, constant_steps
from sysid.solve import Joint, Prior, fit_each, fit_joint, loss

ASTRAY = 1.5  # loss per residual over the shots' median from which a shot is grown again
ROUNDS = 6
FALLS = 0.6  # by which the error per way falls in a round, while it is worth another
CLOSE = 3e-4  # error per way up to which the last digit of constants matters
LONG, MEDIUM, SHORT = 40, 15, 6  # steps of a shot tried again
ITERATIONS, COARSE_ITERATIONS, FEW = 15, 10, 4
FINE, COARSE = 1e-5, 1e-4  # tolerance of the loss
FOLLOWED = 2e-3  # error per way up to which shots are followed to the noise
EARLY = 4  # events up to which shots are used, as long as they are not: then they are chaos
STANDS_OUT = 1.15  # loss per residual over the median, where shots are followed to the noise
# Where a sidespin has died out before a cushion, its start no longer shows: other spins (unknown, shift over speed) are
# tried by hand.
SIDES = (0.03, 0.07, 0.12, 0.2, 0.35, 0.6, 0.9)
SPINS = (*((6, s * sign) for s in SIDES for sign in (-1, 1)), (5, -0.3), (5, 0.3))
GAINS = 2.0  # of the loss, for which shots are moved
SETTLED = 0.1
DOUBTS = 3  # times that shots which stand out are tried anew, while it helps
STUCK = 1e-6  # by which the loss of a round differs from that before
NOISE = 1e-5  # error per way that counts as none
Report = Callable[[str], None]


@dataclass(frozen=True)
class Refined:
    """A fit of a model to clips."""

    point: Point  # its problem has the noise of the camera alone
    joint: Joint
    rate: float  # error of the model per way travelled

    @property
    def converged(self) -> bool:
        """Whether the joint fit came to its optimum."""
        return self.joint.converged


def prior_of(names: Sequence[str], known: Mapping[str, tuple[float, float]]) -> Prior | None:
    """What is known of constants, as a prior over them; None for nothing."""
    if not any(n in known for n in names):
        return None
    pairs = np.array([known.get(n, (0.0, np.inf)) for n in names])
    return Prior(pairs[:, 0], pairs[:, 1])


def trusted_until(growth: Growth, rate: float) -> Array:
    """Until when shots tell something of a model with an error rate: to their ends, or to the first few events (n,)."""
    return growth.horizon(EARLY if rate > FOLLOWED else growth.stages - 1)


def shot_losses(problem: ShotProblem, x: Array, c: Array) -> tuple[Array, Array]:
    """Loss of every shot, its prior with it, and how many residuals it has: (n,), (n,)."""
    n = len(x)
    r = problem.evaluate(x, np.tile(c, (n, 1)), np.arange(n))
    return loss(r, ROBUST) + 0.5 * np.sum(problem.prior.residuals(x) ** 2, axis=1), np.isfinite(r).sum(axis=1)


def shot_costs(problem: ShotProblem, x: Array, c: Array) -> Array:
    """Loss of every shot per residual: (n,)."""
    total, count = shot_losses(problem, x, c)
    return np.asarray(total / np.maximum(count, 1))


def loss_soon(problem: ShotProblem, x: Array, c: Array, known: Mapping[str, tuple[float, float]]) -> float:
    """The loss a few steps from a point."""
    steps, bounds = constant_steps(problem.model, problem.names), constant_bounds(problem.model, problem.names)
    return fit_joint(
        problem.evaluate, x, c, problem.steps, steps, problem.prior, bounds, ROBUST, FEW, 1,
        known=prior_of(problem.names, known),
    ).cost  # fmt: skip


def regrow(
    problem: ShotProblem, clip_set: ClipSet, sigma: float, rows: Index, x: Array, c: Array, iterations: int = LONG
) -> tuple[Array, int]:
    """Grow some shots from their strike at constants (q,); those that end better are kept: own unknowns, how many."""
    part = problem.only(rows)
    new = fit_own(part, dataclasses.replace(clip_set, clips=part.clips), c, sigma)
    new, _ = fit_each(part.evaluate, new, c, part.steps, part.prior, ROBUST, iterations)
    better = shot_costs(part, new, c) < shot_costs(part, x[rows], c) * (1 - 1e-3)
    x = x.copy()
    x[rows[better]] = new[better]
    return x, int(better.sum())


def other_spins(problem: ShotProblem, rows: Index, x: Array, c: Array) -> Array:
    """Own unknowns with some shots tried from other spins, at constants (q,); those that end better are kept.

    From where they are, and from where they began: one that has gone far astray has no good optimum near it.
    """
    shifts = [(base, *spin) for base in (x, problem.start) for spin in SPINS] + [(problem.start, 6, 0.0)]
    k = len(shifts)
    which, moved = np.tile(rows, k), np.stack([base[rows] for base, _, _ in shifts])
    for trial, (_, unknown, shift) in zip(moved, shifts, strict=True):
        trial[:, unknown] += shift * np.hypot(trial[:, 2], trial[:, 3])
    prior = Prior(problem.prior.mean[which], problem.prior.sd[which])
    tried, cost = fit_each(
        problem.evaluate, moved.reshape(len(which), -1), c, problem.steps, prior, ROBUST, MEDIUM, which
    )
    best = np.argmin(cost.reshape(k, len(rows)), axis=0)
    better = cost.reshape(k, -1)[best, np.arange(len(rows))] < shot_losses(problem, x, c)[0][rows]
    x = x.copy()
    x[rows[better]] = tried.reshape(k, len(rows), -1)[best, np.arange(len(rows))][better]
    return x


def _doubt(
    seen: ShotProblem, clip_set: ClipSet, sigma: float, x: Array, c: Array, known: Mapping[str, tuple[float, float]]
) -> tuple[Array, Array] | None:
    """Own unknowns and constants with the shots that stand out tried anew at the constants of the others.

    A shot in a false optimum bends the constants until it nearly fits; at those that the others have by themselves, it
    finds its place. None where no shot stands out, or where nothing is gained.
    """
    old, count = shot_losses(seen, x, c)
    costs = old / np.maximum(count, 1)
    odd = np.flatnonzero(costs > STANDS_OUT * float(np.median(costs)))
    rest = np.setdiff1d(np.arange(len(x)), odd)
    if odd.size == 0 or rest.size < max(3, 2 * len(x) // 3):
        return None
    part = seen.only(rest)
    steps, bounds = constant_steps(seen.model, seen.names), constant_bounds(seen.model, seen.names)
    alone = fit_joint(
        part.evaluate, x[rest], c, seen.steps, steps, part.prior, bounds, ROBUST, COARSE_ITERATIONS, 1,
        tolerance=COARSE, known=prior_of(seen.names, known),
    )  # fmt: skip
    new, at = x.copy(), alone.constants
    new[rest] = alone.own
    new, _ = regrow(seen, clip_set, sigma, odd, new, at)
    new = other_spins(seen, odd, new, at)
    return (new, at) if shot_losses(seen, new, at)[0].sum() < old.sum() - GAINS else None


def refine(
    point: Point,
    clip_set: ClipSet,
    growth: Growth,
    rate: float,
    report: Report = lambda line: None,
    what: str = "",
    known: Mapping[str, tuple[float, float]] | None = None,
    doubtful: float = CLOSE,
    fine: bool = False,
) -> Refined:
    """Fit constants and own unknowns from a point; `growth` holds the ways of the same shots.

    A model that does not follow the shots to the noise is fitted coarsely: what it lacks moves its constants by more.
    `known`: mean and standard deviation of constants that are known beside the clips. `doubtful`: error per way up to
    which single shots that stand out are doubted, since the others are followed well enough. `fine`: to the last digit.
    """
    problem, sigma, x, c = point.problem, growth.sigma, point.x, point.c
    steps, bounds = constant_steps(problem.model, problem.names), constant_bounds(problem.model, problem.names)
    grown, doubts, cost = False, DOUBTS, np.inf

    def error(x: Array, c: Array) -> float:
        return error_rate(growth.at(problem), x, c)

    coarse = rate > CLOSE and not fine
    for round_ in range(ROUNDS):
        seen = with_error(problem, sigma, rate, growth.way).until(trusted_until(growth, rate))
        joint = fit_joint(
            seen.evaluate, x, c, problem.steps, steps, problem.prior, bounds, ROBUST,
            COARSE_ITERATIONS if coarse else ITERATIONS, 1,
            tolerance=COARSE if coarse else FINE,
            report=lambda step, cost, _c: report(f"{what}, step {step}: loss {cost:.0f}"),
            known=prior_of(problem.names, known or {}),
        )  # fmt: skip
        x, c = joint.own, joint.constants
        new = error(x, c)
        seen = with_error(problem, sigma, min(new, rate), growth.way)
        costs = shot_costs(seen, x, c)
        astray = np.flatnonzero(costs > ASTRAY * max(float(np.median(costs)), 0.5))
        better = 0
        if astray.size and not grown:
            grown = True
            x, better = regrow(seen, clip_set, sigma, astray, x, c, SHORT if coarse else LONG)
            if better:
                new = error(x, c)
        if new <= doubtful and doubts:
            doubts -= 1
            without = _doubt(with_error(problem, sigma, new, growth.way), clip_set, sigma, x, c, known or {})
            if without is None:
                doubts = 0
            else:
                report(f"{what}, without shots that bend the constants")
                x, c = without
                better, new = better + 1, error(x, c)
        settled = abs(new - rate) < SETTLED * rate + NOISE
        slow = round_ > 0 and new > max(FALLS * rate, CLOSE)
        rate, coarse = new, new > CLOSE and not fine
        stuck = abs(cost - joint.cost) < STUCK * joint.cost  # the same fit again would end where it began
        cost = joint.cost
        if (settled and not better and (joint.converged or stuck)) or slow:
            break
    return Refined(Point(problem, x, c), joint, rate)
