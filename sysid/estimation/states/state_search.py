"""Search of initial states: several optima of every shot, followed from event to event until samples decide.

In: a problem, constants, the optima up to an event. Out: the optima up to the next one.

A whole shot has many local optima: a sidespin that is invisible before a cushion decides where the ball goes after it.
Knowledge of the initial state up to an event is approximated by a mixture of Gaussians, one at each optimum (Laplace's
approximation, including the prior). New starts are drawn from that mixture, along the undetermined directions, and
fitted up to the next event. Optima within one standard deviation of a better one are the same; the best of the others
are kept. More starts are drawn as long as they find better optima. A discrepancy of the model in proportion to the path
is tolerated on the way, a large one until its size is known; then shots that stand out are searched again with the
known size and more effort. The draws are quasi-random (Sobol) and the same for every shot, so that the result for one
shot does not depend on the others.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from models.messages import counted
from sysid.estimation.problem import Array, Index
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.journal import recorded
from sysid.estimation.solver.least_squares import Objective, fit_each, linearised
from sysid.estimation.states.initial_states import CHANCE_SD, shot_losses, within_noise
from sysid.estimation.windows import columns

MAX_OPTIMA = 8  # most optima of a shot that are kept
FIRST_DRAWS, MORE_DRAWS, MAX_DRAWS = 8, 16, 96  # starts of a shot at an event: at first, while they help, in total
COARSE_STEPS, FINE_STEPS = 2, 4  # iterations of each draw, and of the best ones
FINE_SHARE = 3  # one in this number of draws gets the fine steps
BETTER_LOSS = 0.5  # improvement of a shot's loss that justifies more starts: half a squared standard deviation
SAME_OPTIMUM_SD = 1.0  # standard deviations within which two optima are one
QUARTILE_TO_SD = 1.4826  # of a normal distribution: sd over the distance of its median from its lower quartile
SEARCH_EFFORTS = (1, 3, 9)  # factors on optima and draws, if a shot is not found with fewer
SHOTS_AT_ONCE = 128  # bounds the memory
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Optima:
    """Competing initial states of shots, grouped by shot, the best first."""

    shots: Index  # (k,) number of the shot, ascending
    states: Array  # (k, p)

    @classmethod
    def at(cls, states: Array) -> Optima:
        """One optimum of every shot: (n, p)."""
        return cls(np.arange(len(states)), states)

    @property
    def best(self) -> Array:
        """The best state of every shot: (n, p)."""
        return self.states[np.unique(self.shots, return_index=True)[1]]

    def only(self, rows: Index) -> Optima:
        """The optima of some shots, renumbered in that order; `rows` ascending."""
        mine = np.isin(self.shots, rows)
        return Optima(np.searchsorted(rows, self.shots[mine]), self.states[mine])


def searched_states(problem: ShotProblem, c: Array, effort: int = 1, seed: int = 0) -> Array:
    """The initial state of every shot at constants (q,), searched once from event to event: (n, p).

    Samples have the problem's weights; see `ShotProblem.with_discrepancy`. Searches with other seeds draw other starts.
    """
    optima = Optima.at(problem.start)
    for stage in range(problem.stages):
        optima = up_to_event(problem, optima, c, stage, effort, seed)
        log.info("%s up to event %d of %d", counted(len(problem.clips), "shot"), stage + 1, problem.stages)
    return best_whole(problem, optima, c)


def from_other_sidespins(seen: Objective, x: Array, c: Array, rows: Index, balls: int) -> Array:
    """States of shots or windows (k, p), or those fitted from other sidespins where these are likelier.

    A sidespin that the cloth ends before the next impact changes no sample, and neither does a little more of it, so
    that a fit which begins there ends there. Others begin at sidespins spread evenly over the prior. Two optima are
    compared by the probability around them (Laplace's approximation): many sidespins change nothing, few fit noise.

    Args:
        seen: the objective.
        x: states.
        c: constants.
        rows: (k,) of these in the objective.
        balls: number of balls in a state.
    """
    away = ndtri((np.arange(FIRST_DRAWS) + 0.5) / FIRST_DRAWS)
    for column in [columns(ball, balls)[1][-1] for ball in range(balls)]:
        if column >= x.shape[1]:
            continue
        unknown = True if seen.free is None else seen.free[rows, column]
        wide = np.flatnonzero(np.isfinite(seen.prior.sd[rows, column]) & unknown)
        if not wide.size:
            continue
        which = rows[wide]
        starts = np.repeat(x[wide][None], 1 + FIRST_DRAWS, axis=0)
        starts[1:, :, column] = seen.prior.mean[which, column] + away[:, None] * seen.prior.sd[which, column]
        found, loss = fit_each(
            seen, seen.inside(starts.reshape(-1, x.shape[1])), c, COARSE_STEPS + FINE_STEPS,
            np.tile(which, 1 + FIRST_DRAWS),
        )  # fmt: skip
        found, loss = found.reshape(starts.shape), loss.reshape(starts.shape[:2])
        best = 1 + np.argmin(loss[1:], axis=0)
        own, other = found[0], found[best, np.arange(wide.size)]
        lower = loss[0] - loss[best, np.arange(wide.size)]
        narrower = 0.5 * (_log_det(seen, other, c, which) - _log_det(seen, own, c, which))
        x = x.copy()
        x[wide] = np.where((lower > narrower)[:, None], other, own)
    return x


def _log_det(seen: Objective, x: Array, c: Array, rows: Index) -> Array:
    return np.asarray(np.linalg.slogdet(state_information(seen, x, c, rows))[1])


def best_whole(problem: ShotProblem, optima: Optima, c: Array) -> Array:
    """The best optimum of every shot, by the problem's loss of whole shots: (n, p)."""
    x, loss = fit_each(problem.objective(), optima.states, c, FINE_STEPS, optima.shots)
    order = np.lexsort((loss, optima.shots))
    return Optima(optima.shots[order], x[order]).best


def standing_out(problem: ShotProblem, x: Array, c: Array) -> Index:
    """Shots whose loss per residual exceeds that of noise and of the other shots by more than chance."""
    loss, count = shot_losses(problem, x, c)
    each = loss / np.maximum(count, 1)
    quarter, middle = np.quantile(each, (0.25, 0.5))  # poorly followed shots spread above the median only
    others = each <= middle + CHANCE_SD * QUARTILE_TO_SD * (middle - quarter)
    return np.flatnonzero(~(others | within_noise(loss, count, problem.correlation_time)))


def up_to_event(problem: ShotProblem, optima: Optima, c: Array, stage: int, effort: int = 1, seed: int = 0) -> Optima:
    """Optima up to the event of a stage, from those up to the event before it."""
    rows = np.flatnonzero(problem.horizon_at(stage) > problem.horizon_at(stage - 1))
    if not rows.size:
        return optima
    seen, before = (problem.until(problem.horizon_at(k)) for k in (stage, max(stage - 1, 0)))
    shots, states = [optima.shots], [optima.states]
    for some in np.split(rows, range(SHOTS_AT_ONCE, rows.size, SHOTS_AT_ONCE)):
        found = _recorded(
            seen.only(some).objective(), before.only(some).objective(), optima.only(some), c, effort, seed
        )
        shots.append(some[found.shots])
        states.append(found.states)
    stay = ~np.isin(optima.shots, rows)
    shots[0], states[0] = optima.shots[stay], optima.states[stay]
    every = np.concatenate(shots)
    order = np.argsort(every, kind="stable")
    return Optima(every[order], np.concatenate(states)[order])


def _recorded(seen: Objective, before: Objective, optima: Optima, c: Array, effort: int, seed: int) -> Optima:
    """`_searched`, from the journal if it has the answer."""
    n, most, p = int(optima.shots[-1]) + 1, effort * MAX_OPTIMA, optima.states.shape[1]

    def work() -> tuple[Array, ...]:
        found = _searched(seen, before, optima, c, effort, seed)
        rank = np.arange(len(found.shots)) - np.searchsorted(found.shots, found.shots)
        table = np.full((n, most, p), np.nan)
        table[found.shots, rank] = found.states
        return (table,)

    def fits(found: tuple[Array, ...]) -> bool:
        known = found[0][np.isfinite(found[0]).all(axis=2)]
        return bool(np.isfinite(found[0][:, 0]).all()) and seen.holds(known)

    question = (optima.shots.astype(float), optima.states, c, np.array([seen.cauchy_sd, effort, seed]))
    (table,) = recorded(work, question, ((n, most, p),), fits)
    known = np.isfinite(table).all(axis=2)
    return Optima(np.nonzero(known)[0], table[known])


def _searched(seen: Objective, before: Objective, optima: Optima, c: Array, effort: int, seed: int) -> Optima:
    """Optima of an objective, from those of the previous one."""
    origin = state_information(before, optima.states, c, optima.shots)
    x, loss = fit_each(seen, optima.states, c, COARSE_STEPS + FINE_STEPS, optima.shots)
    found = _distinct(optima.shots, x, loss, state_information(seen, x, c, optima.shots), effort * MAX_OPTIMA)
    drawing, drawn, count, most = np.unique(optima.shots), 0, effort * FIRST_DRAWS, effort * MAX_OPTIMA
    while drawing.size and drawn < effort * MAX_DRAWS:
        shots, starts = _draws(optima, origin, drawing, drawn, count, seed)
        drawn, count = drawn + count, effort * MORE_DRAWS
        x, loss = fit_each(seen, seen.inside(starts), c, COARSE_STEPS, shots)
        some = _best_share(shots, loss)
        shots = shots[some]
        x, loss = fit_each(seen, x[some], c, FINE_STEPS, shots)
        now = _distinct(
            np.concatenate([found.shots, shots]), np.concatenate([found.states, x]),
            np.concatenate([found.losses, loss]),
            np.concatenate([found.information, state_information(seen, x, c, shots)]), most,
        )  # fmt: skip
        gain = found.lowest - now.lowest
        drawing, found = drawing[gain[drawing] > BETTER_LOSS], now
    return Optima(found.shots, found.states)


@dataclass(frozen=True)
class _Found:
    """Optima of shots, sorted by shot and then by loss."""

    shots: Index  # (k,)
    states: Array  # (k, p)
    losses: Array  # (k,)
    information: Array  # (k, p, p)

    @property
    def lowest(self) -> Array:
        """Loss of the best optimum of every shot: (n,)."""
        return self.losses[np.unique(self.shots, return_index=True)[1]]


def _distinct(shots: Index, x: Array, losses: Array, information: Array, most: int) -> _Found:
    """At most `most` best optima of every shot, none within a standard deviation of a better one."""
    order = np.lexsort((losses, shots))
    kept: list[int] = []
    for of_shot in _runs(shots[order]):
        mine: list[int] = []
        for k in order[of_shot]:
            apart = x[mine] - x[k]
            if mine and np.einsum("mp,mpq,mq->m", apart, information[mine], apart).min() <= SAME_OPTIMUM_SD**2:
                continue
            mine.append(int(k))
            if len(mine) == most:
                break
        kept += mine
    return _Found(shots[kept], x[kept], losses[kept], information[kept])


def _runs(numbers: Index) -> Iterator[slice]:
    """Slices of equal numbers in a sorted array."""
    edges = np.flatnonzero(np.diff(numbers)) + 1
    yield from (slice(a, b) for a, b in zip([0, *edges], [*edges, len(numbers)], strict=True))


def _best_share(shots: Index, losses: Array) -> Index:
    """Indices of the best of every shot's draws, one in FINE_SHARE, ascending."""
    order = np.lexsort((losses, shots))
    some = [order[run][: max((run.stop - run.start) // FINE_SHARE, 1)] for run in _runs(shots[order])]
    return np.sort(np.concatenate(some))


def state_information(objective: Objective, x: Array, c: Array, shots: Index) -> Array:
    """Information on initial states (k, p) of these shots from samples and prior: (k, p, p).

    An undetermined state is anywhere within its bounds.
    """
    p = x.shape[1]
    sd = np.broadcast_to(objective.prior.only(shots).sd, x.shape)
    width = objective.bounds[:, 1] - objective.bounds[:, 0]
    known = 1 / sd**2 + 1 / width**2
    return linearised(objective, x, c, shots, np.zeros(0)).matrix + np.einsum("np,pq->npq", known, np.eye(p))


@cache
def _normal_draws(unknowns: int, seed: int) -> Array:
    """Evenly spread points of a standard normal distribution, enough for the greatest effort: (m, p)."""
    power = int(np.ceil(np.log2(SEARCH_EFFORTS[-1] * (MAX_DRAWS + MORE_DRAWS))))
    return np.asarray(ndtri(qmc.Sobol(unknowns, seed=seed).random_base2(power)))


def _draws(
    optima: Optima, information: Array, drawing: Index, first: int, count: int, seed: int
) -> tuple[Index, Array]:
    """Indices of shots, and starts drawn for each from the mixture of Gaussians at its optima."""
    diagonal = np.sqrt(np.einsum("kpp->kp", information))
    scaled = information / (diagonal[:, :, None] * diagonal[:, None, :])
    values, vectors = np.linalg.eigh(scaled)
    spread = vectors / np.sqrt(np.maximum(values, np.finfo(float).eps))[:, None, :] / diagonal[:, :, None]
    begin = np.searchsorted(optima.shots, drawing)
    size = np.searchsorted(optima.shots, drawing, side="right") - begin
    turn = first + np.arange(count)
    rows = (begin[:, None] + turn % size[:, None]).ravel()
    normal = np.tile(_normal_draws(optima.states.shape[1], seed)[turn], (drawing.size, 1))
    return np.repeat(drawing, count), optima.states[rows] + np.einsum("kpq,kq->kp", spread[rows], normal)
