"""What speaks for an effect that the model does not hold, before it is fitted.

The signature of a candidate is how the residuals change when it is switched on a little. It is projected off all that
the fit already moves, each shot's initial states and the constants, and what is left of it is held against the
residuals: a score test, of all candidates at one operating point, which costs one batch of simulations each.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from sysid.estimation.fitted import Point
from sysid.estimation.joint_fit import eliminated
from sysid.estimation.least_squares import differences, weights
from sysid.estimation.normal_equations import from_jacobian
from sysid.estimation.problem import CAUCHY_SD, Array, Index, constant_steps
from sysid.estimation.shot_problem import ShotProblem

TARGET = 0.5  # change of the residuals that a probe aims at, in standard deviations, median over shots
PROBE = 1e-3  # first probe, of the bounds' width
RANGE = (1e-7, 0.4)  # of the bounds' width, smallest and largest probe
PASSES = 4
GONE = 3.0  # times the target that an effect may still be in the smallest probes, if it fades with its parameter
FADES = (0.3, 0.7)  # times the last probe: one so much smaller, that does so much of what that did, shows no fading
JUMP = 30.0  # a residual that a probe moves by so many standard deviations met another ball: no derivative
log = logging.getLogger(__name__)
FLAT = 1e-9  # of a signature's own size: what is left after projection is nothing


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing, and the parameters by which it is switched on."""

    effect: Effect  # at usual values; parameters that only shape it keep them
    keys: tuple[str, ...]

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.effect.name()

    def at(self, values: Sequence[float] | Array) -> Effect:
        """The effect with values of its switching parameters."""
        return dataclasses.replace(self.effect, **dict(zip(self.keys, values, strict=True)))

    def off(self) -> Array:
        """Where it vanishes: (k,)."""
        known = self.effect.parameters()
        return np.array([known[k]["off"] for k in self.keys], float)


def candidate(effect: type[Effect] | Effect) -> Candidate:
    """A candidate from an effect's class: every parameter that has an off value switches it on."""
    one = effect if isinstance(effect, Effect) else effect()
    return Candidate(one, tuple(k for k, m in one.parameters().items() if m["off"] is not None))


def with_candidate(problem: ShotProblem, one: Candidate, names: Sequence[str] | None = None) -> ShotProblem:
    """The problem with a candidate in its model, its switching parameters added to the constants."""
    more = tuple(f"{one.name}.{k}" for k in one.keys) if names is None else tuple(names)
    return problem.with_model(problem.model.add(one.effect), (*problem.names, *more))


@dataclass(frozen=True)
class Signature:
    """How a candidate changes the residuals, per probe."""

    candidate: Candidate
    probe: Array  # (k,) what each parameter was moved by from off
    columns: Array  # (n, m, k) change of the residuals for one probe
    sudden: bool = False  # whether it does not fade as its parameters go to off: then it was looked at its usual size


def signature(point: Point, base: Array, one: Candidate, quick: bool = False) -> Signature:
    """The change of residuals `base` (n, m) when a candidate is switched on, each parameter by a probe of its own.

    `quick` takes one-sided differences and probes that are less well chosen.
    """
    problem = with_candidate(point.problem, one)
    known, off = one.effect.parameters(), one.off()
    k = len(one.keys)
    bounds = np.array([known[key]["bounds"] for key in one.keys], float)
    width = bounds[:, 1] - bounds[:, 0]
    way = np.where(bounds[:, 1] - off >= 0.25 * width, 1.0, -1.0)  # towards the inside
    room = np.where(way > 0, bounds[:, 1] - off, off - bounds[:, 0])
    both = np.minimum(bounds[:, 1] - off, off - bounds[:, 0])
    probe = np.minimum(PROBE * width, room)
    n, rows = len(point.initial_states), np.arange(len(point.initial_states))
    columns = np.zeros((*base.shape, k))
    todo, before = np.arange(k), np.full((2, k), np.inf)  # probe and size of the pass before
    sudden: list[int] = []

    def moved(which: Index, by: Array) -> dict[int, Array]:
        """Change of the residuals with each of these parameters moved from off."""
        at = [np.concatenate([point.constants, off + by * (np.arange(k) == j)]) for j in which]
        values = np.repeat(at, n, axis=0)
        r = problem.evaluate(np.tile(point.initial_states, (which.size, 1)), values, np.tile(rows, which.size))
        return {int(j): part - base for j, part in zip(which, r.reshape(which.size, *base.shape), strict=True)}

    for _ in range(2 if quick else PASSES):
        change = moved(todo, way * probe)
        for number, part in change.items():
            columns[..., number] = np.nan_to_num(part) * way[number]
        again = []
        for j in todo.tolist():
            size = float(np.median(np.sqrt(np.nanmean(np.minimum(change[j] ** 2, JUMP**2), axis=1))))
            top = float(np.sqrt(np.nanmean(np.minimum(change[j] ** 2, JUMP**2))))
            size = max(size, 0.5 * top)  # one that shows in few shots shall not be driven out of its linear range
            low, high = RANGE[0] * width[j], min(RANGE[1] * width[j], room[j])
            wanted = float(np.clip(probe[j] * np.clip(TARGET / max(size, 1e-9), 1e-3, 1e3), low, high))
            if size > GONE * TARGET and probe[j] < FADES[0] * before[0, j] and size > FADES[1] * before[1, j]:
                sudden.append(j)
                continue
            before[:, j] = probe[j], size
            if not 0.3 < wanted / probe[j] < 3.0:
                probe[j] = wanted
                again.append(j)
        if not again:
            break
        todo = np.array(again)
    if sudden:
        usual = np.array([getattr(one.effect, key) for key in one.keys], float) - off
        probe[sudden] = np.abs(usual[sudden])
        for number, part in moved(np.array(sudden), usual).items():
            columns[..., number] = np.nan_to_num(part) * np.sign(usual[number])
    # Where both sides are open, the difference of both takes out what is even in the parameter and steps' own error.
    two = np.setdiff1d(np.flatnonzero(both > probe), sudden)
    if two.size and not quick:
        for number, part in moved(two, -way * probe).items():
            columns[..., number] = 0.5 * (columns[..., number] - np.nan_to_num(part) * way[number])
    columns[np.abs(columns) > JUMP] = 0.0
    return Signature(one, probe, columns, bool(sudden))


def of_strike(point: Point, jx: Array, one: Candidate) -> Signature:
    """The signature of an effect that is open at the strike alone, from the derivatives jx (n, m, p) by initial states.

    All that it does is to begin the shot with other unknowns, so nothing but what is known of these tells of it. The
    difference of two simulations would drown that: it says as much of a thin cut as its steps are uneven.
    """
    known, off, problem = one.effect.parameters(), one.off(), point.problem
    probe = np.array([PROBE * np.subtract(*known[k]["bounds"][::-1]) for k in one.keys])
    shifts = np.zeros((*point.initial_states.shape, len(off)))
    for j, by in enumerate(probe):
        step = by * (np.arange(len(off)) == j)
        there, back = (problem.struck(point.initial_states, one.at(off + s * step)) for s in (1.0, -1.0))
        shifts[..., j] = 0.5 * (there - back)
    return Signature(one, probe, np.einsum("nmp,npk->nmk", jx, shifts))


def strikes_only(effect: Effect) -> bool:
    """Whether an effect's only hook is the strike."""
    return effect.opens("strike") and not effect.opens("edit", "forces", "horizon", "impact", "exposures", "observe")


@dataclass(frozen=True)
class Score:
    """What a candidate promises beside all that is active."""

    candidate: Candidate
    gain: float  # fall of chi-square that the linear model promises
    step: Array  # (k,) parameter values it would take
    sd: Array  # (k,) of them
    sudden: bool = False  # see `Signature`: then this promise is a rough one


@dataclass(frozen=True)
class Scores:
    """All candidates at one operating point."""

    rows: tuple[Score, ...]  # best first
    alike: dict[tuple[str, str], float]  # correlation of the projected signatures of two candidates
    chi2: float  # weighted sum of squares
    count: int  # of residuals
    schur_information: Array  # (K, K) of all probes, initial states and constants projected off
    gradient: Array  # (K,) of half the loss by them
    marginal_information: Array  # (K,) what they would have alone
    blocks: dict[str, slice]  # which of them belong to a candidate
    probe: Array  # (K,) parameter change of one probe

    def likeness(self, one: str, two: str) -> float:
        """Correlation of what two candidates would do; 0 for one that was not scored."""
        return self.alike.get((one, two), self.alike.get((two, one), 0.0))


def score_all(point: Point, candidates: Sequence[Candidate], quick: bool = False) -> Scores:
    """Score every candidate jointly with initial states and constants.

    Args:
        point: where a fit has arrived; candidates are scored at the standard deviations of its discrepancy rate.
        candidates: what may be missing.
        quick: see `signature`.
    """
    log.info("scoring %d candidates beside %s", len(candidates), ", ".join(point.names) or "nothing")
    problem = point.weighted
    point = dataclasses.replace(point, problem=problem)
    x, n = point.initial_states, len(point.initial_states)
    steps_c = constant_steps(problem.model, problem.names)
    r, jx, jc = differences(problem.evaluate, x, point.constants, np.arange(n), problem.steps, steps_c)

    signatures = [
        of_strike(point, jx, one) if strikes_only(one.effect) else signature(point, r, one, quick) for one in candidates
    ]
    extra = np.concatenate([s.columns for s in signatures], axis=2) if signatures else np.zeros((*r.shape, 0))
    j = np.concatenate([jc, extra], axis=2)
    information, score, _, _ = eliminated(r, jx, j, x, problem.prior, CAUCHY_SD)
    info, grad = information.sum(axis=0), score.sum(axis=0)
    w = weights(r, CAUCHY_SD)
    own = from_jacobian(r, j, CAUCHY_SD).matrix.sum(axis=0).diagonal()
    q = len(point.constants)
    _add_known(info, grad, point, signatures)
    scale = np.sqrt(np.maximum(np.diag(info), 1e-300))
    cc = info[:q, :q] / np.outer(scale[:q], scale[:q])
    lift = np.linalg.lstsq(cc, info[:q, q:] / scale[:q, None], rcond=1e-10)[0] / scale[:q, None]
    left = info[q:, q:] - info[q:, :q] @ lift
    pull = grad[q:] - lift.T @ grad[:q]
    chi2 = float(np.sum(w * np.nan_to_num(r) ** 2))
    rows, at, blocks = [], 0, {}
    for s in signatures:
        k = len(s.probe)
        part = slice(at, at + k)
        block, g = left[part, part], pull[part]
        size = own[q:][part]
        fine = np.diag(block) > FLAT * np.maximum(size, 1e-300)
        gain, step, step_sd = 0.0, np.zeros(k), np.full(k, np.inf)
        if fine.any():
            inverse = np.linalg.pinv(block[np.ix_(fine, fine)], rcond=1e-10)
            taken = -inverse @ g[fine]
            gain = float(g[fine] @ inverse @ g[fine])
            step[fine] = taken * s.probe[fine]
            step_sd[fine] = np.sqrt(np.maximum(np.diag(inverse), 0)) * s.probe[fine]
        rows.append(Score(s.candidate, gain, s.candidate.off() + step, step_sd, s.sudden))
        blocks[s.candidate.name] = part
        at += k
    alike = _alike(left, blocks)
    probes = np.concatenate([s.probe for s in signatures]) if signatures else np.zeros(0)
    order = tuple(sorted(rows, key=lambda row: -row.gain))
    return Scores(order, alike, chi2, int(np.isfinite(r).sum()), left, pull, own[q:], blocks, probes)


def _add_known(info: Array, grad: Array, point: Point, signatures: Sequence[Signature]) -> None:
    """Put in what is known of constants (per unit) and of switching parameters (per probe)."""
    entries = [(name, float(c), 1.0) for name, c in zip(point.names, point.constants, strict=True)]
    for s in signatures:
        named = [f"{s.candidate.name}.{k}" for k in s.candidate.keys]
        entries += list(zip(named, s.candidate.off().tolist(), s.probe.tolist(), strict=True))
    known = point.problem.known
    for k, (name, value, unit) in enumerate(entries):
        if name in known:
            mean, sd = known[name]
            info[k, k] += (unit / sd) ** 2
            grad[k] += unit * (value - mean) / sd**2


def _alike(left: Array, blocks: dict[str, slice]) -> dict[tuple[str, str], float]:
    """Largest canonical correlation of every two candidates."""

    def whiten(block: Array) -> Array:
        value, vector = np.linalg.eigh(block)
        keep = value > 1e-10 * max(value.max(initial=0.0), 1e-300)
        return np.asarray(vector[:, keep] / np.sqrt(value[keep]))

    found = {}
    names = list(blocks)
    roots = {n: whiten(left[blocks[n], blocks[n]]) for n in names}
    for a, one in enumerate(names):
        for two in names[a + 1 :]:
            cross = roots[one].T @ left[blocks[one], blocks[two]] @ roots[two]
            found[one, two] = float(np.linalg.svd(cross, compute_uv=False)[0]) if cross.size else 0.0
    return found
