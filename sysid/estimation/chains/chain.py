"""Multiple shooting: constants of a model from shots of many impacts, each predicted from one window to the next.

In: windows of shots (sysid/estimation/windows.py), a model and its constants. Out: a `Chain`: losses, their normal
equations, and how far the model is off. chain_fit.py fits it.

A model that is a little wrong at every impact is far off after a dozen: whole shots then have as many false optima as
impacts, and say little about constants. Here every window has its own state. The end of one and the beginning of the
next may differ by the model's error: a share of the change of velocity at an impact (`Spread.impact`), plus a little
for the cloth between. Samples may differ by an error that grows along the path (`Spread.path`). Both are estimated
together with the constants. So each impact is judged on its own, at the spin left by the impacts before it, and errors
do not grow (H. G. Bock, 1983; the smoother of a state-space model with process noise).

The normal equations of a shot are block tridiagonal; they are small, and solved densely. Initial states are eliminated
as in solver/joint_fit.py, and steps damped likewise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from models.engine.play import Layout
from models.model_file import Model
from sysid.estimation.discrepancy import likely_rate
from sysid.estimation.problem import CAUCHY_SD, Array, Index, shared_constants
from sysid.estimation.residual_rows import Weighting, residuals
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.joint_fit import SharedConstants
from sysid.estimation.solver.least_squares import NO_STEPS, Moves, batches, loss, weights
from sysid.estimation.solver.normal_equations import NormalEquations, from_derivatives, from_differences
from sysid.estimation.windows import Mask, Windows, columns

PLACE_SD_M = 3e-4  # sd of the position gap between a window's end and the next one's beginning
MOTION_SD_M_S, MOTION_SHARE = 3e-3, 2e-3  # sd of the velocity gap due to the cloth: least value, and share of the speed
SPIN_OF_IMPULSE = 2.5  # change of R omega over that of velocity by a tangential impulse: radius^2 mass over inertia
LEAST_SHARE, LEAST_INFORMATION = 1e-9, 1e-6  # added to the diagonal, so that undetermined states stay regular


class Spread(NamedTuple):
    """The model's error beyond noise, as standard deviations."""

    impact: float  # of the change of velocity at an impact
    path: float  # error of a position per path length from the beginning of its window


FIRST_SPREAD = Spread(0.05, 3e-3)


@dataclass(frozen=True)
class Chain:
    """Windows of shots, played by a model with constants to fit."""

    problem: ShotProblem  # the same shots as a whole, with the model and the constants to fit
    windows: Windows
    spread: Spread = FIRST_SPREAD
    roughness: float = 1.0  # variance of constants between halves of the shots, over what their information claims

    @property
    def model(self) -> Model:
        """The model that plays the windows."""
        return self.problem.model

    @property
    def names(self) -> tuple[str, ...]:
        """The constants to fit."""
        return self.problem.names

    def with_model(self, model: Model, names: tuple[str, ...]) -> Chain:
        """These windows, played by another model."""
        return dataclasses.replace(self, problem=self.problem.with_model(model, names))

    def with_spread(self, spread: Spread) -> Chain:
        """This chain with other errors of the model."""
        return dataclasses.replace(self, spread=spread)

    def only(self, shots: Index) -> Chain:
        """The chain of some of the shots, in order."""
        return dataclasses.replace(self, problem=self.problem.only(shots), windows=self.windows.only(shots))

    @property
    def shared(self) -> SharedConstants:
        """Steps, bounds and priors of the constants."""
        return shared_constants(self.model, self.names, self.problem.known)

    @cached_property
    def _layout(self) -> Layout:
        return Layout(self.model, self.names)

    @cached_property
    def _weighting(self) -> Weighting:
        shot = self.windows.shot
        sd = np.hypot(self.problem.noise_of_fits, self.spread.path * self.windows.travelled)
        return Weighting(sd, self.problem.sd_theta[shot], np.full(len(shot), np.inf))

    def play(self, states: Array, c: Array, which: Index) -> tuple[Array, Array]:
        """Residuals (k, m) of windows over their standard deviations, and the states in which they end (k, p).

        Rows have the length of the longest of these windows; shorter ones are padded with NaN.
        """
        balls = self.windows.balls
        ends = np.full((len(states), balls, 7), np.nan)
        size = int(self.windows.lengths[which].max(initial=0))
        r = residuals(self._layout, self.windows.data, self._weighting, states, c, which, size, ends)
        ends[..., 4:] *= self._layout.game(c).radius[:, None, None]
        out = np.empty(states.shape)
        for i in range(balls):
            place, motion = columns(i, balls)
            out[:, place], out[:, motion] = ends[:, i, :2], ends[:, i, 2:]
        return r, out

    def evaluate(self, states: Array, c: Array, which: Index) -> Array:
        """Residuals of windows without the states in which they end: (k, m)."""
        return self.play(states, c, which)[0]

    def changes(self, states: Array) -> Array:
        """Change of velocity of each ball in the windows that have a successor: (k, b) [m/s]."""
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
        """Standard deviations of the gaps between windows: (k, p), inf if nothing is known."""
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
        """Gaps from the beginning of a window to the end of the one before it, over their sd; NaN unknown: (k, p)."""
        before, after = self.windows.following
        return np.where(np.isfinite(sd), (ends[before] - states[after]) / sd, np.nan)

    def losses(self, states: Array, c: Array, sd: Array) -> Array:
        """Loss of every shot: (n,)."""
        r, ends = self.play(states, np.tile(c, (len(states), 1)), np.arange(len(states)))
        return self.summed(states, loss(r, CAUCHY_SD), self.gaps(states, ends, sd))

    def summed(self, states: Array, of_samples: Array, z: Array) -> Array:
        """Loss of every shot, as the sum over its windows' samples and gaps: (n,)."""
        each = of_samples + 0.5 * np.sum(self.windows.prior.residuals(states) ** 2, axis=1)
        each[self.windows.following[0]] += loss(z, CAUCHY_SD)
        return np.asarray(np.add.reduceat(each, np.flatnonzero(self.windows.first)))


class Equations(NamedTuple):
    """Normal equations of a shot, in its free states (m,) and the constants (q,)."""

    free: Mask  # (windows, p) which they are
    states: Array  # (m, m)
    by_constant: Array  # (m, q)
    constants: Array  # (q, q)
    state_gradient: Array  # (m,)
    constant_gradient: Array  # (q,)

    def solved(self, damping: float) -> Array:
        """Response of the states to each constant, and their own step, signs reversed: (m, q + 1)."""
        matrix = self.states + np.diag((damping + LEAST_SHARE) * np.diag(self.states) + LEAST_INFORMATION)
        return np.asarray(np.linalg.solve(matrix, np.column_stack([self.by_constant, self.state_gradient])), float)


def limited_move(at: Array, forward: Array, backward: Array) -> Array:
    """Differences of a forward move (k, ...), limited by those of a backward one, and 0 if their signs differ.

    A slope limiter (minmod: P. L. Roe, Annual Review of Fluid Mechanics 18, 1986): where an impact comes or goes
    within a step, a difference over it is no derivative.
    """
    ahead, behind = forward - at, at - backward
    slope = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)
    return at + np.where(ahead * behind > 0, slope, 0.0)


def _differences(
    chain: Chain, states: Array, c: Array, steps_c: Array, limited: bool
) -> tuple[NormalEquations, Array]:  # fmt: skip
    """Normal equations of windows' samples, and their ends with the k derivatives of these: (1 + k, w, p).

    By the states and constants (q,) of steps `steps_c`: k in all. `limited`: see `equations`.
    """
    count, p = states.shape  # of windows, and of what each has
    steps = np.concatenate([chain.windows.steps, steps_c])
    k = len(steps)
    normal = NormalEquations(np.empty(count), np.empty((count, k, k)), np.empty((count, k)))
    ends = np.empty((1 + k, count, p))
    inside = np.zeros(0, np.int64)  # constants that can move in both directions
    if limited:
        low, high = chain.shared.bounds.T
        inside = np.flatnonzero((c - steps_c >= low) & (c - steps_c <= high))
    for which in batches(chain.windows.lengths):
        x, free = states[which], chain.windows.free[which]
        moves = Moves.of(x, c, which, chain.windows.steps, steps_c, free=free)
        rows, last = (moves.laid_out(part) for part in chain.play(moves.x, moves.c, moves.which))
        if inside.size:
            back = Moves.of(x, c, which, NO_STEPS, -steps_c)
            for moved, found in zip((rows, last), chain.play(back.x, back.c, back.which), strict=True):
                moved[1 + p + inside] = limited_move(moved[0], moved[1 + p + inside], back.laid_out(found)[1 + inside])
        ends[:, which] = last
        part = from_differences(rows, steps, CAUCHY_SD)
        normal.loss[which], normal.matrix[which], normal.gradient[which] = part.loss, part.matrix, part.gradient
    ends[1:] = np.nan_to_num((ends[1:] - ends[0]) / steps[:, None, None])
    return normal, ends


def equations(
    chain: Chain, states: Array, c: Array, sd: Array, steps_c: Array = NO_STEPS, *, limited: bool = False
) -> tuple[Array, list[Equations]]:  # fmt: skip
    """Losses of shots (n,), and their normal equations at constants (q,).

    Args:
        chain: the windows.
        states: (w, p) of them.
        c: constants.
        sd: (k, p) of the gaps.
        steps_c: (q,) finite differences of the constants; none where these are held.
        limited: whether derivatives by constants are those that hold on both sides, see `limited_move`.
    """
    w, p = chain.windows, states.shape[1]
    of_samples, ends = _differences(chain, states, c, steps_c, limited)
    gaps = Gaps.of(chain, states, ends, sd)
    of_gaps = from_derivatives(gaps.z, gaps.derivatives, CAUCHY_SD)
    matrix, gradient = of_samples.matrix, of_samples.gradient
    matrix[w.following[0]] += of_gaps.matrix
    gradient[w.following[0]] += of_gaps.gradient
    shared = [matrix[run, p:, p:].sum(axis=0) for run in w.runs]
    return chain.summed(states, of_samples.loss, gaps.z), gaps.joined(matrix[:, :p], gradient, shared)


@dataclass(frozen=True)
class Gaps:
    """Gaps between the end of each window and the state of the next: residuals and derivatives."""

    chain: Chain
    states: Array  # (w, p) of windows
    z: Array  # (k, p) residuals
    by: Array  # (k, p) by the state of the next window
    derivatives: Array  # (u, k, p) by all unknowns of the window before: its state, then constants

    @classmethod
    def of(cls, chain: Chain, states: Array, ends: Array, sd: Array) -> Gaps:
        """Gaps from ends with derivatives (1 + u, w, p) and standard deviations (k, p)."""
        by = np.where(np.isfinite(sd), 1 / sd, 0.0)
        return cls(chain, states, chain.gaps(states, ends[0], sd), by, ends[1:][:, chain.windows.following[0]] * by)

    def joined(self, rows: Array, gradient: Array, shared: Sequence[Array]) -> list[Equations]:
        """Normal equations of every shot, its windows joined by the gaps.

        Args:
            rows: (w, p, u) of the state of each window, with samples and the gap after it; changed in place.
            gradient: (w, u) likewise.
            shared: (q, q) of each shot, of its constants.
        """
        w, (_, p) = self.chain.windows, self.states.shape
        after, heavy, diagonal = w.following[1], weights(self.z, CAUCHY_SD), np.arange(p)
        cross = -np.moveaxis(self.derivatives, 0, 2) * (heavy * self.by)[..., None]  # by the state of the next window
        rows[after[:, None], diagonal, diagonal] += heavy * self.by**2
        gradient[after, :p] -= heavy * self.by * np.nan_to_num(self.z)
        known = 1 / w.prior.sd**2
        rows[:, diagonal, diagonal] += known
        gradient[:, :p] += np.where(known > 0, self.states - w.prior.mean, 0.0) * known
        number = np.full(len(w.shot), -1)
        number[after] = np.arange(len(after))
        found = []
        for run, constants in zip(w.runs, shared, strict=True):
            size = run.size * p
            block, mixed = np.zeros((size, size)), rows[run][:, :, p:].reshape(size, -1)
            for k, window in enumerate(run):
                here = slice(k * p, (k + 1) * p)
                block[here, here] = rows[window, :, :p]
                if k:
                    link, last = cross[number[window]], slice((k - 1) * p, k * p)
                    block[here, last], block[last, here] = link[:, :p], link[:, :p].T
                    mixed[here] += link[:, p:]
            free = w.free[run]
            f = free.ravel()
            of_states, of_constants = gradient[run, :p].ravel()[f], gradient[run, p:].sum(axis=0)
            found.append(Equations(free, block[np.ix_(f, f)], mixed[f], constants, of_states, of_constants))
        return found


def reduced(shots: list[Equations]) -> tuple[list[Array], Array, Array]:
    """Responses of each shot's states, and with these eliminated its information (n, q, q) and gradient (n, q)."""
    solved = [shot.solved(0.0) for shot in shots]
    information = np.array([s.constants - s.by_constant.T @ y[:, :-1] for s, y in zip(shots, solved, strict=True)])
    gradient = np.array([s.constant_gradient - s.by_constant.T @ y[:, -1] for s, y in zip(shots, solved, strict=True)])
    return solved, information, gradient


def likely_spread(chain: Chain, states: Array, c: Array) -> Spread:
    """The most likely errors of the model beyond noise, at these states and constants."""
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
