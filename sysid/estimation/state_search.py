"""Several optima of every shot, kept alive from event to event until its samples decide between them.

In: a problem, constants, the optima up to an event. Out: the optima up to the next one.

A whole shot has many local optima: a sidespin that does not show before a cushion decides where the ball goes after it.
What is known of the initial state up to an event is taken as a mixture of Gaussians, one about each optimum (Laplace's
approximation, the prior included). So new starts are drawn from that mixture, along what is not yet determined, and
fitted up to the next event. Optima within one standard deviation of a better one are the same; the best of the others
go on. More starts are drawn as long as they find better optima. A discrepancy of the model in proportion to the path
is tolerated on the way, a large one until its size is known; then shots that stand out are searched again with that,
and with more effort. The draws are quasi-random (Sobol), the same for every shot, so that the result for one shot
depends on no other.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from sysid.estimation.initial_states import CHANCE_SD, shot_losses, within_noise
from sysid.estimation.problem import Array, Index
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.journal import recorded
from sysid.estimation.solver.least_squares import Objective, fit_each, linearised

MAX_OPTIMA = 8  # of a shot that go on
FIRST_DRAWS, MORE_DRAWS, MAX_DRAWS = 8, 16, 96  # starts of a shot at an event: at first, while they help, in all
COARSE_STEPS, FINE_STEPS = 2, 4  # of a draw, and of those that are then the best
FINE_SHARE = 3  # one of so many draws goes on to the fine steps
BETTER_LOSS = 0.5  # of a shot's loss, for which more starts are drawn: half a standard deviation squared
SAME_OPTIMUM_SD = 1.0  # standard deviations within which two optima are one
QUARTILE_TO_SD = 1.4826  # of a normal distribution: sd over the distance of its median from its lower quartile
EFFORTS = (1, 3, 9)  # times as many optima and draws, where a shot is not found with fewer
SHOTS_AT_ONCE = 128  # which bounds the memory
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Optima:
    """Rival initial states of shots, those of one shot side by side, the best first."""

    shots: Index  # (k,) number of the shot, ascending
    states: Array  # (k, p)

    @classmethod
    def at(cls, states: Array) -> Optima:
        """One optimum of every shot: (n, p)."""
        return cls(np.arange(len(states)), states)

    @property
    def best(self) -> Array:
        """Of every shot: (n, p)."""
        return self.states[np.unique(self.shots, return_index=True)[1]]

    def with_best(self, states: Array) -> Optima:
        """Those with other states in place of the best ones: (n, p)."""
        moved = self.states.copy()
        moved[np.unique(self.shots, return_index=True)[1]] = states
        return Optima(self.shots, moved)

    def only(self, rows: Index) -> Optima:
        """Those of some shots, which are then numbered in that order; `rows` ascending."""
        mine = np.isin(self.shots, rows)
        return Optima(np.searchsorted(rows, self.shots[mine]), self.states[mine])


def searched_states(problem: ShotProblem, c: Array, effort: int = 1) -> Array:
    """The initial state of every shot at constants (q,), searched once from event to event: (n, p).

    Samples count as the problem weighs them; see `ShotProblem.with_discrepancy`.
    """
    optima = Optima.at(problem.start)
    for stage in range(problem.stages):
        optima = up_to_event(problem, optima, c, stage, effort)
        log.info("%d shots up to event %d of %d", len(problem.clips), stage + 1, problem.stages)
    return best_whole(problem, optima, c)


def best_whole(problem: ShotProblem, optima: Optima, c: Array) -> Array:
    """The best of the optima of every shot as the problem weighs whole shots: (n, p)."""
    x, loss = fit_each(problem.objective(), optima.states, c, FINE_STEPS, optima.shots)
    order = np.lexsort((loss, optima.shots))
    return Optima(optima.shots[order], x[order]).best


def standing_out(problem: ShotProblem, x: Array, c: Array) -> Index:
    """Shots whose loss per residual is beyond that of noise, and of the other shots, by more than chance."""
    loss, count = shot_losses(problem, x, c)
    each = loss / np.maximum(count, 1)
    quarter, middle = np.quantile(each, (0.25, 0.5))  # shots that are followed worse spread above the middle
    others = each <= middle + CHANCE_SD * QUARTILE_TO_SD * (middle - quarter)
    return np.flatnonzero(~(others | within_noise(loss, count, problem.correlation_time)))


def up_to_event(problem: ShotProblem, optima: Optima, c: Array, stage: int, effort: int = 1) -> Optima:
    """Optima up to the event of a stage, from those up to the one before it."""
    rows = np.flatnonzero(problem.horizon_at(stage) > problem.horizon_at(stage - 1))
    if not rows.size:
        return optima
    seen, before = (problem.until(problem.horizon_at(k)) for k in (stage, max(stage - 1, 0)))
    shots, states = [optima.shots], [optima.states]
    for some in np.split(rows, range(SHOTS_AT_ONCE, rows.size, SHOTS_AT_ONCE)):
        found = _recorded(seen.only(some).objective(), before.only(some).objective(), optima.only(some), c, effort)
        shots.append(some[found.shots])
        states.append(found.states)
    stay = ~np.isin(optima.shots, rows)
    shots[0], states[0] = optima.shots[stay], optima.states[stay]
    every = np.concatenate(shots)
    order = np.argsort(every, kind="stable")
    return Optima(every[order], np.concatenate(states)[order])


def _recorded(seen: Objective, before: Objective, optima: Optima, c: Array, effort: int) -> Optima:
    """`_searched`; from the journal, where one is kept and knows it."""
    n, most, p = int(optima.shots[-1]) + 1, effort * MAX_OPTIMA, optima.states.shape[1]

    def work() -> tuple[Array, ...]:
        found = _searched(seen, before, optima, c, effort)
        rank = np.arange(len(found.shots)) - np.searchsorted(found.shots, found.shots)
        table = np.full((n, most, p), np.nan)
        table[found.shots, rank] = found.states
        return (table,)

    def fits(found: tuple[Array, ...]) -> bool:
        known = found[0][np.isfinite(found[0]).all(axis=2)]
        return bool(np.isfinite(found[0][:, 0]).all()) and seen.holds(known)

    question = (optima.shots.astype(float), optima.states, c, np.array([seen.cauchy_sd, effort]))
    (table,) = recorded(work, question, ((n, most, p),), fits)
    known = np.isfinite(table).all(axis=2)
    return Optima(np.nonzero(known)[0], table[known])


def _searched(seen: Objective, before: Objective, optima: Optima, c: Array, effort: int) -> Optima:
    """Optima of an objective, from those of the one before it."""
    origin = state_information(before, optima.states, c, optima.shots)
    x, loss = fit_each(seen, optima.states, c, COARSE_STEPS + FINE_STEPS, optima.shots)
    found = _distinct(optima.shots, x, loss, state_information(seen, x, c, optima.shots), effort * MAX_OPTIMA)
    drawing, drawn, count, most = np.unique(optima.shots), 0, effort * FIRST_DRAWS, effort * MAX_OPTIMA
    while drawing.size and drawn < effort * MAX_DRAWS:
        shots, starts = _draws(optima, origin, drawing, drawn, count)
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
        """Loss of the best of every shot: (n,)."""
        return self.losses[np.unique(self.shots, return_index=True)[1]]


def _distinct(shots: Index, x: Array, losses: Array, information: Array, most: int) -> _Found:
    """The best optima of every shot, so many at most, of which none is within a standard deviation of a better one."""
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
    """Where equal numbers stand in a sorted list."""
    edges = np.flatnonzero(np.diff(numbers)) + 1
    yield from (slice(a, b) for a, b in zip([0, *edges], [*edges, len(numbers)], strict=True))


def _best_share(shots: Index, losses: Array) -> Index:
    """Numbers of those of the least loss of every shot, one of FINE_SHARE: ascending."""
    order = np.lexsort((losses, shots))
    some = [order[run][: max((run.stop - run.start) // FINE_SHARE, 1)] for run in _runs(shots[order])]
    return np.sort(np.concatenate(some))


def state_information(objective: Objective, x: Array, c: Array, shots: Index) -> Array:
    """Of initial states (k, p) of these shots, what is known beside the samples with it: (k, p, p).

    A state that nothing determines is anywhere within its bounds.
    """
    p = x.shape[1]
    sd = np.broadcast_to(objective.prior.only(shots).sd, x.shape)
    width = objective.bounds[:, 1] - objective.bounds[:, 0]
    known = 1 / sd**2 + 1 / width**2
    return linearised(objective, x, c, shots, np.zeros(0)).matrix + np.einsum("np,pq->npq", known, np.eye(p))


@cache
def _normal_draws(unknowns: int) -> Array:
    """Points of a standard normal distribution, evenly spread, enough for the greatest effort: (m, p)."""
    power = int(np.ceil(np.log2(EFFORTS[-1] * (MAX_DRAWS + MORE_DRAWS))))
    return np.asarray(ndtri(qmc.Sobol(unknowns, seed=0).random_base2(power)))


def _draws(optima: Optima, information: Array, drawing: Index, first: int, count: int) -> tuple[Index, Array]:
    """Numbers of shots and starts, so many for each: from the mixture of Gaussians about the optima of each in turn."""
    diagonal = np.sqrt(np.einsum("kpp->kp", information))
    scaled = information / (diagonal[:, :, None] * diagonal[:, None, :])
    values, vectors = np.linalg.eigh(scaled)
    spread = vectors / np.sqrt(np.maximum(values, np.finfo(float).eps))[:, None, :] / diagonal[:, :, None]
    begin = np.searchsorted(optima.shots, drawing)
    size = np.searchsorted(optima.shots, drawing, side="right") - begin
    turn = first + np.arange(count)
    rows = (begin[:, None] + turn % size[:, None]).ravel()
    normal = np.tile(_normal_draws(optima.states.shape[1])[turn], (drawing.size, 1))
    return np.repeat(drawing, count), optima.states[rows] + np.einsum("kpq,kq->kp", spread[rows], normal)
