"""Signatures of candidates: the change of residuals by a missing effect, as a derivative or at a given size.

In: a converged fit (`Point`) and candidates. Out: `Signature`s, each from one or two batches of simulations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from sysid.estimation.fitted import Point
from sysid.estimation.problem import Array, Index
from sysid.estimation.shot_problem import ShotProblem

PROBE_CHANGE_SD = 0.5  # target change of the residuals by a probe, median over shots
FIRST_PROBE_OF_RANGE = 1e-3  # first probe, over the bounds' width
PROBE_LIMITS_OF_RANGE = (1e-7, 0.4)  # smallest and largest probe, over the bounds' width
PROBE_PASSES = 4  # most iterations to find a probe with the target change
LARGER_SIZE = 3.0  # larger size tested for effects that vanish at a bound, over the usual one
MAX_CHANGE_SD = 30.0  # a residual that changes more is due to another impact, not a derivative


@dataclass(frozen=True)
class Candidate:
    """A possibly missing effect, and the parameters that switch it on."""

    effect: Effect  # at usual values; parameters without an off value keep them
    keys: tuple[str, ...]
    size: float | None = None  # size of the signature, over the usual one; None for the derivative

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.effect.name()

    def at(self, values: Sequence[float] | Array) -> Effect:
        """The effect with values of its switching parameters."""
        return dataclasses.replace(self.effect, **dict(zip(self.keys, values, strict=True)))

    def off(self) -> Array:
        """Parameter values at which it vanishes: (k,)."""
        known = self.effect.parameters()
        return np.array([known[k]["off"] for k in self.keys], float)

    def bounds(self) -> Array:
        """Lower and upper bounds of the switching parameters: (k, 2)."""
        known = self.effect.parameters()
        return np.array([known[k]["bounds"] for k in self.keys], float)

    @property
    def one_sided(self) -> bool:
        """Whether the effect vanishes at a bound of one of its parameters."""
        return bool(np.isclose(self.off()[:, None], self.bounds()).any())

    def usual(self) -> Array:
        """Usual values of the switching parameters, as distances from their off values: (k,)."""
        return np.array([getattr(self.effect, k) for k in self.keys], float) - self.off()


def candidate(effect: type[Effect] | Effect) -> Candidate:
    """A candidate from an effect's class: every parameter with an off value switches it on."""
    one = effect if isinstance(effect, Effect) else effect()
    return Candidate(one, tuple(k for k, m in one.parameters().items() if m["off"] is not None))


def with_candidate(problem: ShotProblem, one: Candidate, names: Sequence[str] | None = None) -> ShotProblem:
    """The problem with a candidate in its model, its switching parameters added to the constants."""
    more = tuple(f"{one.name}.{k}" for k in one.keys) if names is None else tuple(names)
    return problem.with_model(problem.model.add(one.effect), (*problem.names, *more))


@dataclass(frozen=True)
class Signature:
    """The change of the residuals by a candidate, for one probe of each parameter."""

    candidate: Candidate
    probe: Array  # (k,) change of each parameter from its off value
    columns: Array  # (k, n, m) change of the residuals [standard deviations]

    @property
    def limits(self) -> tuple[Array, Array]:
        """Bounds of the parameters, as distances from their off values in probes: (k,), (k,)."""
        low, high = ((self.candidate.bounds() - self.candidate.off()[:, None]) / self.probe[:, None]).T
        return low, high


def signature(point: Point, base: Array, one: Candidate, quick: bool = False) -> Signature:
    """The signature of a candidate by finite differences.

    Args:
        point: the converged fit.
        base: (n, m) its residuals.
        one: the candidate.
        quick: use one-sided differences and fewer passes for the probes.
    """
    problem = with_candidate(point.problem, one)
    off, bounds, k = one.off(), one.bounds(), len(one.keys)
    width = bounds[:, 1] - bounds[:, 0]
    sign = np.where(bounds[:, 1] - off >= 0.25 * width, 1.0, -1.0)  # towards the inside of the bounds
    room = np.where(sign > 0, bounds[:, 1] - off, off - bounds[:, 0])
    both = np.minimum(bounds[:, 1] - off, off - bounds[:, 0])
    probe = np.minimum(FIRST_PROBE_OF_RANGE * width, room)
    n, rows = len(point.initial_states), np.arange(len(point.initial_states))
    columns = np.zeros((k, *base.shape))
    todo = np.arange(k)

    def changes(which: Index, by: Array) -> dict[int, Array]:
        """Change of the residuals with each of these parameters moved from off."""
        at = [np.concatenate([point.constants, off + by * (np.arange(k) == j)]) for j in which]
        values = np.repeat(at, n, axis=0)
        states = np.concatenate([_states(point, one, constants[len(point.constants) :]) for constants in at])
        r = problem.evaluate(states, values, np.tile(rows, which.size))
        parts = r.reshape(which.size, *base.shape) - base
        np.nan_to_num(parts, copy=False)
        return dict(zip(which.tolist(), parts, strict=True))

    used = np.maximum(np.isfinite(base).sum(axis=1), 1)
    for _ in range(2 if quick else PROBE_PASSES):
        change = changes(todo, sign * probe)
        for number, part in change.items():
            np.multiply(part, sign[number], out=columns[number])
        again = []
        for j in todo.tolist():
            size = _size(change[j], used)
            low, high = PROBE_LIMITS_OF_RANGE[0] * width[j], min(PROBE_LIMITS_OF_RANGE[1] * width[j], room[j])
            wanted = float(np.clip(probe[j] * np.clip(PROBE_CHANGE_SD / max(size, 1e-9), 1e-3, 1e3), low, high))
            if not 0.3 < wanted / probe[j] < 3.0:
                probe[j] = wanted
                again.append(j)
        if not again:
            break
        todo = np.array(again)
    # Central differences cancel even terms and the integrator's step error, if both sides are within the bounds.
    two = np.flatnonzero(both > probe)
    if two.size and not quick:
        for number, part in changes(two, -sign * probe).items():
            columns[number] = 0.5 * (columns[number] - part * sign[number])
    columns[np.abs(columns) > MAX_CHANGE_SD] = 0.0
    return Signature(one, probe, columns)


def _size(change: Array, used: Array) -> float:
    """Size of a change of residuals (n, m) in the used shots (n,): the median over shots of its rms."""
    squares = np.minimum(change**2, MAX_CHANGE_SD**2).sum(axis=1)
    median, mean = float(np.median(np.sqrt(squares / used))), float(np.sqrt(squares.sum() / used.sum()))
    return max(median, 0.5 * mean)  # an effect in few shots stays in its linear range


def at_sizes(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates as derivatives and at their usual sizes; also at a larger size if they vanish at a bound.

    Sizes reveal what derivatives cannot: an effect that grows with the square of its parameter, or one whose absence
    has biased the constants of a fit.
    """
    larger = [one for one in candidates if one.one_sided]
    sizes = ((candidates, None), (candidates, 1.0), (larger, LARGER_SIZE))
    return [dataclasses.replace(one, size=size) for some, size in sizes for one in some]


def secant(point: Point, base: Array, one: Candidate, size: float) -> Signature:
    """The signature of a candidate at a multiple of its usual size, one parameter at a time."""
    move = np.clip(one.off() + size * one.usual(), *one.bounds().T) - one.off()
    problem, n = with_candidate(point.problem, one), len(point.initial_states)
    columns = np.zeros((len(move), *base.shape))
    for j, by in enumerate(move):
        values = one.off() + by * (np.arange(len(move)) == j)
        c = np.concatenate([point.constants, values])
        r = problem.evaluate(_states(point, one, values), np.tile(c, (n, 1)), np.arange(n))
        columns[j] = np.nan_to_num(r - base) * np.sign(by)
    return Signature(one, np.maximum(np.abs(move), np.finfo(float).tiny), columns)


def strike_signature(point: Point, jx: Array, one: Candidate) -> Signature:
    """The signature of an effect that acts at the strike alone, by the chain rule.

    Such an effect only shifts the initial states, so its signature is jx (n, m, p), the derivatives by these, times the
    shift. The difference of two simulations would drown it in the integrator's step error, at thin cuts above all.
    """
    off, bounds, problem = one.off(), one.bounds(), point.problem
    probe = FIRST_PROBE_OF_RANGE * (bounds[:, 1] - bounds[:, 0])
    shifts = np.zeros((*point.initial_states.shape, len(off)))
    for j, by in enumerate(probe):
        step = by * (np.arange(len(off)) == j)
        plus, minus = (problem.struck(point.initial_states, one.at(off + s * step)) for s in (1.0, -1.0))
        shifts[..., j] = 0.5 * (plus - minus)
    return Signature(one, probe, np.einsum("nmp,npk->knm", jx, shifts))


def _states(point: Point, one: Candidate, values: Array) -> Array:
    """Initial states (n, p) for a candidate at parameter values (k,): those of the fit, as the camera reports them.

    A signature is projected on what states may not explain, so that these may move along. Otherwise an effect of the
    camera alone would change how thick a ball is hit: much more than it changes what is seen.
    """
    if one.effect.opens_only("observe"):
        return point.problem.seen_alike(point.initial_states, one.at(values))
    return point.initial_states


def signature_of(point: Point, base: Array, jx: Array, one: Candidate, quick: bool) -> Signature:
    """The signature of a candidate by the suitable method.

    Args:
        point: the converged fit.
        base: (n, m) its residuals.
        jx: (n, m, p) their derivatives by initial states.
        one: the candidate.
        quick: see `signature`.
    """
    if one.size is not None:
        return secant(point, base, one, one.size)
    if one.effect.opens_only("strike"):
        return strike_signature(point, jx, one)
    return signature(point, base, one, quick)
