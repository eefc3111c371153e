"""Multiple shooting: constants of a model from shots of many impacts, each predicted from one window to the next.

In: windows of shots (sysid/estimation/windows.py), a model and its constants. Out: a `ChainFit`.

A model that is a little wrong at every impact is far off after a dozen: whole shots then have as many false optima as
impacts, and say little about constants. Here every window has a state of its own. Where one ends and the next begins
may differ by what the model lacks: by a share of the change of velocity at an impact (`Spread.impact`), beside a little
for the cloth between. Samples may differ by an error that grows along the way (`Spread.path`). Both are estimated along
with the constants. So each impact is judged by itself, at the spin that the impacts before it have left, and no error
grows (H. G. Bock, 1983; the smoother of a state-space model with process noise).

The normal equations of a shot are block tridiagonal; they are small, and solved densely. Initial states are eliminated
as in solver/joint_fit.py, and steps damped likewise.
"""

from __future__ import annotations

import dataclasses
import logging
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from models.engine.play import Layout
from models.model_file import Model
from sysid.estimation.discrepancy import likely_rate
from sysid.estimation.fitting import NEGLIGIBLE_STEP_SD
from sysid.estimation.problem import CAUCHY_SD, Array, Index, shared_constants
from sysid.estimation.residual_rows import ShotResiduals, Weighting, residuals
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.joint_fit import SharedConstants, covariance, newton_step
from sysid.estimation.solver.journal import recorded
from sysid.estimation.solver.least_squares import Prior, loss, weights
from sysid.estimation.windows import Mask, Windows, columns

PLACE_SD_M = 3e-4  # by which a window may begin elsewhere than the one before it ends
MOTION_SD_M_S, MOTION_SHARE = 3e-3, 2e-3  # the same of velocity: at least, and of the speed, for the cloth
SPIN_OF_IMPULSE = 2.5  # change of R omega over that of velocity by a tangential impulse: radius^2 mass over inertia
FIRST_DAMPING, MIN_DAMPING, MAX_ATTEMPTS = 1e-3, 1e-7, 5
LEAST_SHARE, LEAST_INFORMATION = 1e-9, 1e-6  # added to the diagonal, where nothing tells of a state
TOLERANCE = 1e-4  # share of the loss by which a step must lower it for another to be taken

log = logging.getLogger(__name__)


class Spread(NamedTuple):
    """How far the model is off: what is unknown beside noise."""

    impact: float  # of the change of velocity at an impact
    path: float  # error of a place per way from the beginning of its window


FIRST_SPREAD = Spread(0.05, 3e-3)


@dataclass(frozen=True)
class Chain:
    """Windows of shots, played by a model with constants to fit."""

    problem: ShotProblem  # the same shots as a whole: noise, and what is known of constants
    windows: Windows
    model: Model
    names: tuple[str, ...]
    spread: Spread = FIRST_SPREAD

    def with_model(self, model: Model, names: tuple[str, ...]) -> Chain:
        """The same windows, played by another model."""
        return dataclasses.replace(self, problem=self.problem.with_model(model, names), model=model, names=names)

    def with_spread(self, spread: Spread) -> Chain:
        """The same, with other errors of the model."""
        return dataclasses.replace(self, spread=spread)

    @property
    def shared(self) -> SharedConstants:
        """How the constants may move."""
        return shared_constants(self.model, self.names, self.problem.known)

    @cached_property
    def _layout(self) -> Layout:
        return Layout(self.model, self.names)

    @cached_property
    def sample_sd(self) -> Array:
        """Standard deviation of each sample's place: (w, b, s) [m]."""
        return np.asarray(np.hypot(self.problem.noise_of_fits, self.spread.path * self.windows.travelled))

    @cached_property
    def _played(self) -> ShotResiduals:
        count = len(self.windows.shot)
        theta = np.full(count, self.problem.sd_theta[0] if len(self.problem.sd_theta) else 1.0)
        return ShotResiduals(self._layout, self.windows.data, Weighting(self.sample_sd, theta, np.full(count, np.inf)))

    def play(self, states: Array, c: Array, which: Index) -> tuple[Array, Array]:
        """Residuals (k, m) of windows over their standard deviations, and the states in which they end (k, p)."""
        balls = self.windows.balls
        ends = np.full((len(states), balls, 7), np.nan)
        at = self._played
        r = residuals(at.layout, at.data, at.weighting, states, c, which, at.data.size, ends)
        ends[..., 4:] *= self._layout.game(c).radius[:, None, None]
        out = np.empty(states.shape)
        for i in range(balls):
            place, motion = columns(i, balls)
            out[:, place], out[:, motion] = ends[:, i, :2], ends[:, i, 2:]
        return r, out

    def evaluate(self, states: Array, c: Array, which: Index) -> Array:
        """Residuals of windows alone: (k, m)."""
        return self.play(states, c, which)[0]

    def changes(self, states: Array) -> Array:
        """Change of velocity of each ball in the windows that another follows: (k, b) [m/s]."""
        before, after = self.windows.following
        out = np.empty((len(before), self.windows.balls))
        for i in range(self.windows.balls):
            velocity = columns(i, self.windows.balls)[1][:2]
            old = states[before][:, velocity]
            if i == 0:  # the first ball of a first window has the frame of its shot
                turned = self.windows.data.azimuth[before]
                cs, sn = np.cos(turned), np.sin(turned)
                old = np.stack([cs * old[:, 0] - sn * old[:, 1], sn * old[:, 0] + cs * old[:, 1]], axis=1)
            out[:, i] = np.hypot(*(self.windows.start[after][:, velocity] - old).T)
        return out

    def gap_sd(self, states: Array) -> Array:
        """By how much a window may begin elsewhere than the one before it ends: (k, p), inf where nothing is known."""
        before, after = self.windows.following
        change, out = self.changes(states), np.full((len(before), states.shape[1]), np.inf)
        for i in range(self.windows.balls):
            place, motion = columns(i, self.windows.balls)
            speed = np.hypot(*self.windows.start[after][:, motion[:2]].T)
            least = MOTION_SD_M_S + MOTION_SHARE * speed
            hit = self.windows.hit[before, i]
            sd = np.where(hit, np.hypot(least, self.spread.impact * change[:, i]), least)
            out[:, place] = PLACE_SD_M
            out[:, motion[:2]] = sd[:, None]
            out[:, motion[2:]] = (np.where(hit, SPIN_OF_IMPULSE, 1.0) * sd)[:, None]
        return np.where(self.windows.free[after], out, np.inf)

    def gaps(self, states: Array, ends: Array, sd: Array) -> Array:
        """From the beginning of a window to the end of the one before it, over its sd: (k, p), NaN unknown."""
        before, after = self.windows.following
        return np.where(np.isfinite(sd), (ends[before] - states[after]) / sd, np.nan)

    def losses(self, states: Array, c: Array, sd: Array) -> Array:
        """Loss of every shot: (n,)."""
        r, ends = self.play(states, np.tile(c, (len(states), 1)), np.arange(len(states)))
        return self.summed(states, r, self.gaps(states, ends, sd))

    def summed(self, states: Array, r: Array, z: Array) -> Array:
        """Loss of every shot from the residuals of its windows and its gaps: (n,)."""
        each = loss(r, CAUCHY_SD) + 0.5 * np.sum(self.windows.prior.residuals(states) ** 2, axis=1)
        each[self.windows.following[0]] += loss(z, CAUCHY_SD)
        return np.asarray(np.add.reduceat(each, np.flatnonzero(self.windows.first)))


class Equations(NamedTuple):
    """Normal equations of a shot: of its states (m,) that are free, and of constants (q,)."""

    free: Mask  # (windows, p) which they are
    states: Array  # (m, m)
    by_constant: Array  # (m, q)
    constants: Array  # (q, q)
    state_gradient: Array  # (m,)
    constant_gradient: Array  # (q,)

    def solved(self, damping: float) -> Array:
        """(m, q + 1): by how much states follow each constant, and the step to their own best, signs reversed."""
        matrix = self.states + np.diag((damping + LEAST_SHARE) * np.diag(self.states) + LEAST_INFORMATION)
        return np.asarray(np.linalg.solve(matrix, np.column_stack([self.by_constant, self.state_gradient])), float)


def derivatives(chain: Chain, states: Array, c: Array, steps_c: Array) -> tuple[Array, Array]:
    """Residuals (1 + p + q, w, m) and ends (1 + p + q, w, p) with each unknown moved by its step, divided by it.

    The first are those at the point itself, the others derivatives.
    """
    (count, p), q = states.shape, len(steps_c)
    rows, constants = np.tile(states, (1 + p + q, 1, 1)), np.tile(c, (1 + p + q, count, 1))
    steps = np.concatenate([chain.windows.steps, steps_c])
    for k in range(p):
        rows[1 + k, :, k] += steps[k]
    for k in range(q):
        constants[1 + p + k, :, k] += steps_c[k]
    shape = (1 + p + q, count)
    r, ends = chain.play(
        rows.reshape(-1, p), constants.reshape(shape[0] * count, c.size), np.tile(np.arange(count), shape[0])
    )
    r, ends = r.reshape(*shape, -1), ends.reshape(*shape, p)
    r[1:] = np.nan_to_num((r[1:] - r[0]) / steps[:, None, None])
    ends[1:] = np.nan_to_num((ends[1:] - ends[0]) / steps[:, None, None])
    return r, ends


def equations(chain: Chain, states: Array, sd: Array, r: Array, ends: Array) -> tuple[Array, list[Equations]]:
    """Losses of shots (n,), and their normal equations, from `derivatives`."""
    w, p = chain.windows, states.shape[1]
    before, after = w.following
    z = chain.gaps(states, ends[0], sd)
    by = np.where(np.isfinite(sd), 1 / sd, 0.0)
    j = np.moveaxis(r[1:], 0, 2)  # (w, m, p + q)
    weighted = j * weights(r[0], CAUCHY_SD)[..., None]
    matrix = np.swapaxes(weighted, 1, 2) @ j
    gradient = np.einsum("wmk,wm->wk", weighted, np.nan_to_num(r[0]))
    jz = np.moveaxis(ends[1:][:, before], 0, 2) * by[..., None]  # (k, p, p + q)
    heavy = weights(z, CAUCHY_SD)
    matrix[before] += np.swapaxes(jz * heavy[..., None], 1, 2) @ jz
    gradient[before] += np.einsum("kmj,km->kj", jz * heavy[..., None], np.nan_to_num(z))
    cross = -jz * (heavy * by)[..., None]  # by the state of the next window
    matrix[np.ix_(after, np.arange(p), np.arange(p))] += np.einsum("kp,pq->kpq", heavy * by**2, np.eye(p))
    gradient[after, :p] -= heavy * by * np.nan_to_num(z)
    known = 1 / w.prior.sd**2
    matrix[:, :p, :p] += np.einsum("wp,pq->wpq", known, np.eye(p))
    gradient[:, :p] += np.where(known > 0, states - w.prior.mean, 0.0) * known
    number = np.full(len(w.shot), -1)
    number[after] = np.arange(len(after))
    found = []
    for run in w.runs:
        size = run.size * p
        block, mixed = np.zeros((size, size)), matrix[run][:, :p, p:].reshape(size, -1)
        for k, window in enumerate(run):
            here = slice(k * p, (k + 1) * p)
            block[here, here] = matrix[window, :p, :p]
            if k:
                link, last = cross[number[window]], slice((k - 1) * p, k * p)
                block[here, last], block[last, here] = link[:, :p], link[:, :p].T
                mixed[here] += link[:, p:]
        free = w.free[run]
        f = free.ravel()
        found.append(
            Equations(
                free, block[np.ix_(f, f)], mixed[f], matrix[run, p:, p:].sum(axis=0), gradient[run, :p].ravel()[f],
                gradient[run, p:].sum(axis=0),
            )
        )  # fmt: skip
    return chain.summed(states, r[0], z), found


def settled_states(chain: Chain, states: Array, c: Array, steps: int, sd: Array | None = None) -> Array:
    """States (w, p) of windows at constants (q,) from nearly right ones; `sd` of the gaps, if other than `gap_sd`."""
    sd = chain.gap_sd(states) if sd is None else sd

    def work() -> tuple[Array, ...]:
        return (_settled(chain, states, c, steps, sd),)

    (found,) = recorded(work, (states, c, sd, np.array([steps])), (states.shape,), _are_finite)
    return found


def _are_finite(found: tuple[Array, ...]) -> bool:
    return all(bool(np.isfinite(values).all()) for values in found)


def _settled(chain: Chain, states: Array, c: Array, steps: int, sd: Array) -> Array:
    """See `settled_states`."""
    damping = np.full(len(chain.windows.runs), FIRST_DAMPING)
    active = np.ones(len(damping), bool)
    for _ in range(steps):
        cost, shots = equations(chain, states, sd, *derivatives(chain, states, c, np.zeros(0)))
        states, new, damping = _lowered(chain, states, c, sd, cost, shots, damping, active)
        active &= cost - new > TOLERANCE * cost
        if not active.any():
            break
    return states


def _lowered(
    chain: Chain, states: Array, c: Array, sd: Array, cost: Array, shots: list[Equations], damping: Array, active: Mask
) -> tuple[Array, Array, Array]:  # fmt: skip
    """States after a step of each shot that lowers its loss, those losses, and the dampings (n,) that it took."""
    todo, found, damping = active.copy(), states.copy(), damping.copy()
    for _ in range(MAX_ATTEMPTS):
        trial = states.copy()
        for k in np.flatnonzero(todo):
            _move(trial, chain.windows.runs[k], shots[k], -shots[k].solved(damping[k])[:, -1])
        new = chain.losses(trial, c, sd)
        better = todo & (new < cost)
        for k in np.flatnonzero(better):
            found[chain.windows.runs[k]] = trial[chain.windows.runs[k]]
        cost = np.where(better, new, cost)
        damping[better] = np.maximum(damping[better] / 10, MIN_DAMPING)
        todo &= ~better
        damping[todo] *= 10
        if not todo.any():
            break
    return found, cost, damping


def _move(states: Array, run: Index, shot: Equations, by: Array) -> None:
    """Move the free states of a shot, in place."""
    step = np.zeros(shot.free.shape)
    step[shot.free] = by
    states[run] += step


@dataclass(frozen=True)
class ChainFit:
    """Constants and states of windows at their best."""

    chain: Chain
    states: Array  # (w, p)
    constants: Array  # (q,)
    losses: Array  # (n,) of shots
    information: Array  # (n, q, q) of each shot on the constants, its states eliminated
    gradient: Array  # (n, q)
    converged: bool


def fit_chain(chain: Chain, states: Array, c: Array, steps: int, what: str) -> ChainFit:
    """Constants (q,) and states (w, p) of windows from nearly right ones."""
    shared, sd = chain.shared, chain.gap_sd(states)

    def work() -> tuple[Array, ...]:
        return _minimised(chain, states, c, sd, steps, what)

    def fits(found: tuple[Array, ...]) -> bool:
        low, high = shared.bounds.T
        return _are_finite(found) and bool(np.all((found[1] >= low) & (found[1] <= high)))

    question = (states, c, sd, shared.bounds, np.array([steps, *chain.spread]))
    states, c = recorded(work, question, (states.shape, c.shape), fits)
    cost, shots = equations(chain, states, sd, *derivatives(chain, states, c, shared.steps_from(c)))
    _, information, gradient = reduced(shots)
    full = _newton(shared, shared.prior(c), information, gradient, c)
    converged = negligible(full, information, gradient, shared.width)
    return ChainFit(chain, states, c, cost, information, gradient, converged)


def _newton(
    shared: SharedConstants, prior: Prior, information: Array, gradient: Array, c: Array, damping: float = 0.0
) -> Array:  # fmt: skip
    """The step (q,) to subtract from constants within their bounds."""
    h = information.sum(axis=0) + np.diag(1 / prior.sd**2)
    g = gradient.sum(axis=0) + (c - prior.mean) / prior.sd**2
    return newton_step(h + damping * np.diag(np.diag(h)), g, c, shared.bounds)[0]


def _minimised(chain: Chain, states: Array, c: Array, sd: Array, steps: int, what: str) -> tuple[Array, Array]:
    """States and constants of less loss, until a step of the constants would be negligible."""
    shared, damping = chain.shared, FIRST_DAMPING
    low, high = shared.bounds.T
    prior = shared.prior(c)
    every, active = np.full(len(chain.windows.runs), FIRST_DAMPING), np.ones(len(chain.windows.runs), bool)
    for step in range(steps):
        cost, shots = equations(chain, states, sd, *derivatives(chain, states, c, shared.steps_from(c)))
        solved, information, gradient = reduced(shots)
        if negligible(_newton(shared, prior, information, gradient, c), information, gradient, shared.width):
            break
        total = float(cost.sum()) + 0.5 * float(np.sum(prior.residuals(c) ** 2))
        log.info("%s, step %d: loss %.0f", what, step, total)
        for _ in range(MAX_ATTEMPTS):
            new = np.clip(c - _newton(shared, prior, information, gradient, c, damping), low, high)
            trial = states.copy()
            for run, shot, y in zip(chain.windows.runs, shots, solved, strict=True):
                _move(trial, run, shot, y[:, :-1] @ (c - new) - y[:, -1])
            moved, stayed = chain.losses(trial, new, sd), chain.losses(states, new, sd)
            for k in np.flatnonzero(~(moved <= stayed)):
                trial[chain.windows.runs[k]] = states[chain.windows.runs[k]]
            there, shots_there = equations(chain, trial, sd, *derivatives(chain, trial, new, np.zeros(0)))
            trial, losses, _ = _lowered(chain, trial, new, sd, there, shots_there, every, active)
            if float(losses.sum()) + 0.5 * float(np.sum(prior.residuals(new) ** 2)) < total:
                break
            damping = max(10 * damping, FIRST_DAMPING)
        else:
            break
        states, c, damping = trial, new, max(damping / 10, MIN_DAMPING)
    return states, c


def negligible(step: Array, information: Array, gradient: Array, width: Array) -> bool:
    """Whether a step of the constants is small beside their standard deviations over shots."""
    sd = np.sqrt(np.diag(covariance(information, gradient, width)))
    known = np.isfinite(sd)
    return bool(np.all(np.abs(step[known]) < NEGLIGIBLE_STEP_SD * sd[known]))


def reduced(shots: list[Equations]) -> tuple[list[Array], Array, Array]:
    """Of each shot how its states follow, and with these eliminated its information (n, q, q) and gradient (n, q)."""
    solved = [shot.solved(0.0) for shot in shots]
    information = np.array([s.constants - s.by_constant.T @ y[:, :-1] for s, y in zip(shots, solved, strict=True)])
    gradient = np.array([s.constant_gradient - s.by_constant.T @ y[:, -1] for s, y in zip(shots, solved, strict=True)])
    return solved, information, gradient


def likely_spread(chain: Chain, states: Array, c: Array) -> Spread:
    """The most likely errors of the model beside noise, at these states and constants."""
    w = chain.windows
    unweighted = dataclasses.replace(chain, spread=Spread(chain.spread.impact, 0.0))
    r, ends = unweighted.play(states, np.tile(c, (len(states), 1)), np.arange(len(states)))
    before, after = w.following
    change, gaps, sizes = chain.changes(states), [], []
    for i in range(w.balls):
        velocity = columns(i, w.balls)[1][:2]
        some = w.hit[before, i] & w.moving[after, i]
        gaps.append((ends[before[some]][:, velocity] - states[after[some]][:, velocity]).ravel())
        sizes.append(np.repeat(change[some, i], 2))
    impact = likely_rate(np.concatenate(gaps), np.concatenate(sizes), MOTION_SD_M_S)
    errors, ways = [], []
    for k, count in enumerate(w.data.count):
        at = 0
        for i, n in enumerate(count):
            errors.append(r[k, at : at + 2 * n] * chain.problem.noise_of_fits)
            ways.append(np.repeat(w.travelled[k, i, :n], 2))
            at += 3 * n
    path = likely_rate(np.concatenate(errors), np.concatenate(ways), chain.problem.noise_of_fits)
    return Spread(impact, path)
