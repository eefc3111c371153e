"""Constants and states of windows at the least loss of a `Chain`.

In: a chain, states of its windows and constants that are nearly right. Out: states, or a `ChainFit`.

Levenberg and Marquardt's method, the states of each shot eliminated from its normal equations; a shot whose states do
not follow a step of the constants keeps them.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np

from sysid.estimation.chains.chain import Chain, Equations, equations, reduced
from sysid.estimation.problem import Array, Index
from sysid.estimation.solver.joint_fit import SharedConstants, covariance, is_within, newton_step
from sysid.estimation.solver.journal import recorded
from sysid.estimation.solver.least_squares import Prior
from sysid.estimation.windows import Mask

FIRST_DAMPING, MIN_DAMPING, MAX_ATTEMPTS = 1e-3, 1e-7, 5
NEGLIGIBLE_STEP_SD = 0.25  # remaining step that is too small to matter, in standard deviations
LOSS_TOLERANCE = 1e-4  # share of the loss by which a step must lower it for another to be taken
log = logging.getLogger(__name__)


def settled_states(chain: Chain, states: Array, c: Array, steps: int) -> Array:
    """States (w, p) of windows at constants (q,) from nearly right ones."""
    sd = chain.gap_sd(states)

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
        cost, shots = equations(chain, states, c, sd)
        states, new, damping = _lowered(chain, states, c, sd, cost, shots, damping, active)
        active &= cost - new > LOSS_TOLERANCE * cost
        if not active.any():
            break
    return states


def _lowered(
    chain: Chain, states: Array, c: Array, sd: Array, cost: Array, shots: list[Equations], damping: Array, active: Mask
) -> tuple[Array, Array, Array]:  # fmt: skip
    """States after a step that lowers the loss of each shot, the losses (n,) and the dampings (n,) used."""
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
    """Fitted constants and states of windows."""

    chain: Chain
    states: Array  # (w, p)
    constants: Array  # (q,)
    losses: Array  # (n,) of shots
    information: Array  # (n, q, q) of each shot about the constants, with its states eliminated
    gradient: Array  # (n, q)
    step: Array  # (q,) remaining step to the optimum, its sign reversed

    @property
    def design_effect(self) -> float:
        """The factor by which shots are less informative than as many independent residuals, see `design_effect`."""
        return design_effect(self.information, self.gradient)

    @property
    def covariance(self) -> Array:
        """Covariance of the constants (q, q) from the scatter over shots, their priors, and the remaining step."""
        return self._over_shots + np.outer(self.step, self.step)

    @property
    def converged(self) -> bool:
        """Whether the remaining step moves no constant by a standard deviation; the covariance includes that step.

        A rough loss has optima from which no step leads down, although a better point is near.
        """
        return is_within(self.step, self._over_shots)

    @property
    def _over_shots(self) -> Array:
        """The covariance without that step, to compare halves of the shots: a rough loss has many optima."""
        shared = self.chain.shared
        sd = shared.prior(self.constants).sd
        known = np.where(sd < shared.width, 1 / sd**2, 0.0)
        # Roughness reduces the information of each shot, and its gradients scatter more by the same factor.
        rough = self.chain.roughness
        return covariance(self.information / rough, self.gradient / math.sqrt(rough), shared.width, known)


def fit_chain(chain: Chain, states: Array, c: Array, steps: int, what: str) -> ChainFit:
    """Fit constants (q,) and states (w, p) of windows, from nearly right ones."""
    shared, sd = chain.shared, chain.gap_sd(states)

    def work() -> tuple[Array, ...]:
        return _minimised(chain, states, c, sd, steps, what)

    def fits(found: tuple[Array, ...]) -> bool:
        low, high = shared.bounds.T
        return _are_finite(found) and bool(np.all((found[1] >= low) & (found[1] <= high)))

    question = (states, c, sd, shared.bounds, np.array([steps, *chain.spread, chain.roughness]))
    states, c = recorded(work, question, (states.shape, c.shape), fits)
    cost, shots = equations(chain, states, c, sd, shared.steps_from(c), limited=True)
    _, information, gradient = reduced(shots)
    return ChainFit(
        chain, states, c, cost, information, gradient, _newton(shared, shared.prior(c), information, gradient, c)
    )


def _newton(
    shared: SharedConstants, prior: Prior, information: Array, gradient: Array, c: Array, damping: float = 0.0
) -> Array:  # fmt: skip
    """The step (q,) to subtract from constants within their bounds."""
    h = information.sum(axis=0) + np.diag(1 / prior.sd**2)
    g = gradient.sum(axis=0) + (c - prior.mean) / prior.sd**2
    return newton_step(h + damping * np.diag(np.diag(h)), g, c, shared.bounds)[0]


def _minimised(chain: Chain, states: Array, c: Array, sd: Array, steps: int, what: str) -> tuple[Array, Array]:
    """Lower the loss by steps of states and constants, until a step of the constants would be negligible."""
    shared, damping = chain.shared, FIRST_DAMPING
    low, high = shared.bounds.T
    prior = shared.prior(c)
    every, active = np.full(len(chain.windows.runs), FIRST_DAMPING), np.ones(len(chain.windows.runs), bool)
    for step in range(steps):
        cost, shots = equations(chain, states, c, sd, shared.steps_from(c))
        solved, information, gradient = reduced(shots)
        full = _newton(shared, prior, information, gradient, c)
        if _distance(chain, full, information, gradient) < NEGLIGIBLE_STEP_SD:
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
            there, shots_there = equations(chain, trial, new, sd)
            trial, losses, _ = _lowered(chain, trial, new, sd, there, shots_there, every, active)
            gain = total - float(losses.sum()) - 0.5 * float(np.sum(prior.residuals(new) ** 2))
            if gain > 0:
                break
            damping = max(10 * damping, FIRST_DAMPING)
        else:
            break
        states, c, damping = trial, new, max(damping / 10, MIN_DAMPING)
        # The loss is a parabola of the distance, so that so small a distance gains too little for another step.
        if gain < 0.5 * NEGLIGIBLE_STEP_SD**2 * _count_as_one(chain, information, gradient):
            break
    return states, c


def _distance(chain: Chain, step: Array, information: Array, gradient: Array) -> float:
    """Length of a step of the constants [standard deviations over shots]."""
    squared_sd = float(gradient.sum(axis=0) @ step) / _count_as_one(chain, information, gradient)
    return math.sqrt(max(squared_sd, 0.0))


def _count_as_one(chain: Chain, information: Array, gradient: Array) -> float:
    """Share of twice the loss that is equivalent to one independent residual."""
    return design_effect(information, gradient) * chain.roughness


def design_effect(information: Array, gradient: Array) -> float:
    """Scatter of the shots' gradients (n, q) over that expected from their information (n, q, q); at least 1."""
    total, scatter = information.sum(axis=0), gradient.T @ gradient
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total / np.outer(scale, scale), hermitian=True)
    return max(float(np.trace(inverse @ (scatter / np.outer(scale, scale)))) / len(scale), 1.0)
