"""Score test of missing effects: their predicted improvement, before any of them is fitted.

In: a converged fit (`Point`) and candidates. Out: `Scores`: for each candidate the predicted improvement of chi-square,
the parameter values that would give it with their standard deviations, and correlations between candidates.

The signature of a candidate is the change of the residuals when it is switched on a little. With H the information of
initial states, constants and candidates together, the Schur complement S of the candidates' block is the information
that their signatures add to everything fitted; with the gradient g, projected likewise, the predicted improvement is
g' S^-1 g (Rao 1948). It costs one batch of simulations for each candidate.
"""

from __future__ import annotations

import dataclasses
import logging
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from models.model_file import Model
from sysid.estimation.fitted import Point
from sysid.estimation.problem import CAUCHY_SD, Array, Index, constant_bounds, constant_steps
from sysid.estimation.solver.joint_fit import eliminated
from sysid.estimation.solver.least_squares import differences, weights
from sysid.estimation.solver.normal_equations import from_columns
from sysid.selection.scoring.signatures import Candidate, Signature, signature_of

MIN_INFORMATION_LEFT = 1e-9  # Schur over marginal information below which nothing is left after projection
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Score:
    """The predicted improvement by a candidate, given everything active."""

    candidate: Candidate
    predicted_improvement: float  # fall of chi-square by the linear model
    values: Array  # (k,) parameter values for it
    sd: Array  # (k,) their standard deviations
    constants: Mapping[str, float] = field(default_factory=dict)  # of the fit, by name, that go with these values

    def constants_in(self, model: Model, names: Sequence[str], own: Array) -> Array:
        """The constants (q,) of these names that go with its values, within their bounds; others keep their `own`."""
        c = [self.constants.get(name, value) for name, value in zip(names, own.tolist(), strict=True)]
        return np.clip(np.array(c), *constant_bounds(model, names).T)


@dataclass(frozen=True)
class Scores:
    """The scores of all candidates at one operating point."""

    rows: tuple[Score, ...]  # best first
    chi2: float  # weighted sum of squares
    count: int  # of residuals
    schur_information: Array  # (K, K) of all probes, initial states and constants projected off
    gradient: Array  # (K,) of half of chi-square by the probes, projected likewise
    marginal_information: Array  # (K,) of each probe alone, nothing projected off
    blocks: dict[str, slice]  # the probes of each candidate
    probe: Array  # (K,) parameter change of one probe
    constants: dict[str, float]  # likeliest of the fit without any candidate, by name
    response: Array  # (q, K) their change by one probe

    def only(self, names: Collection[str]) -> Scores:
        """The scores of some candidates."""
        kept = [name for name in self.blocks if name in names]
        at = np.concatenate(
            [np.zeros(0, np.int64), *(np.arange(self.blocks[n].start, self.blocks[n].stop) for n in kept)]
        )
        ends = np.cumsum([0, *(self.blocks[n].stop - self.blocks[n].start for n in kept)]).tolist()
        return dataclasses.replace(
            self, rows=tuple(row for row in self.rows if row.candidate.name in names),
            schur_information=self.schur_information[np.ix_(at, at)], gradient=self.gradient[at],
            marginal_information=self.marginal_information[at], probe=self.probe[at], response=self.response[:, at],
            blocks={n: slice(*ends[k : k + 2]) for k, n in enumerate(kept)},
        )  # fmt: skip

    def constants_beside(self, probes: Index, values: Array) -> dict[str, float]:
        """Likeliest constants of the fit, by name, where some probes (k,) have moved parameters by `values` (k,)."""
        moved = self.response[:, probes] @ (values / self.probe[probes])
        return {name: c + by for (name, c), by in zip(self.constants.items(), moved.tolist(), strict=True)}

    @cached_property
    def correlations(self) -> dict[tuple[str, str], float]:
        """Correlation of the projected signatures of every two candidates."""
        return _canonical_correlations(self.schur_information, self.blocks)

    def correlation(self, one: str, two: str) -> float:
        """Correlation of the projected signatures of two candidates; 0 if one was not scored."""
        return self.correlations.get((one, two), self.correlations.get((two, one), 0.0))


@dataclass(frozen=True)
class Linearised:
    """Quadratic losses of shots in the constants and the candidates' probes, with states eliminated."""

    signatures: tuple[Signature, ...]  # of the candidates, with K probes in all
    information: Array  # (n, q + K, q + K), or (1, q + K, q + K) of all shots together
    gradient: Array  # (n, q + K), or (1, q + K)
    marginal_information: Array  # (K,) see `Scores`
    chi2: float  # weighted sum of squares
    count: int  # of residuals

    def held(self, rows: Index, away: Array) -> Linearised:
        """The losses with some constants held at an offset (k,) below their values, no longer unknowns."""
        rest = np.setdiff1d(np.arange(self.gradient.shape[1]), rows)
        gradient = self.gradient - self.information[:, :, rows] @ away
        return dataclasses.replace(
            self, information=self.information[:, rest[:, None], rest], gradient=gradient[:, rest]
        )  # fmt: skip


def score_all(point: Point, candidates: Sequence[Candidate], quick: bool = False) -> Scores:
    """Score every candidate jointly with initial states and constants.

    Args:
        point: a converged fit; candidates are scored at the standard deviations of its discrepancy rate.
        candidates: possible causes; of several with the same name only the best is kept.
        quick: see `signature`.
    """
    return scores_of(point, linearise(point, candidates, quick, together=True))


def linearise(
    point: Point, candidates: Sequence[Candidate], quick: bool = False, *, together: bool = False
) -> Linearised:  # fmt: skip
    """Quadratic losses of a fit and candidates (see `score_all`), for each shot or all together."""
    if candidates:
        log.info("scoring %d candidates in addition to %s", len(candidates), ", ".join(point.names) or "nothing")
    problem = point.weighted
    point = dataclasses.replace(point, problem=problem)
    x, n = point.initial_states, len(point.initial_states)
    steps_c = constant_steps(problem.model, problem.names)
    r, jx, jc = differences(problem.evaluate, x, point.constants, np.arange(n), problem.steps, steps_c)

    several = Counter(one.name for one in candidates)
    signatures = tuple(signature_of(point, r, jx, one, quick or several[one.name] > 1) for one in candidates)
    own = np.moveaxis(np.concatenate([jx, jc], axis=2), 2, 0)
    columns, first = [*own, *(column for s in signatures for column in s.columns)], jx.shape[2] + jc.shape[2]
    size = len(columns) - jx.shape[2]
    groups = 1 if together else n
    information, gradient = np.zeros((groups, size, size)), np.zeros((groups, size))
    marginal = np.zeros(len(columns) - first)
    for k, normal in enumerate(from_columns(r, columns, CAUCHY_SD)):
        found = eliminated(normal, x[k : k + 1], problem.prior.only(np.array([k])))
        information[k % groups] += found.information[0]
        gradient[k % groups] += found.gradient[0]
        marginal += normal.matrix[0].diagonal()[first:]
    chi2 = float(np.sum(weights(r, CAUCHY_SD) * np.nan_to_num(r) ** 2))
    return Linearised(signatures, information, gradient, marginal, chi2, int(np.isfinite(r).sum()))


def scores_of(point: Point, seen: Linearised, design_effect: float = 1.0) -> Scores:
    """Compute the scores of candidates.

    Args:
        point: the constants and their priors.
        seen: quadratic losses of the shots.
        design_effect: factor by which the shots are less informative.
    """
    q, signatures, marginal = len(point.constants), seen.signatures, seen.marginal_information / design_effect
    information, gradient = seen.information.sum(axis=0) / design_effect, seen.gradient.sum(axis=0) / design_effect
    add_known(information, gradient, point, signatures)
    schur, projected, lift = _without_constants(information, gradient, q)
    ends = np.cumsum([0, *(len(one.probe) for one in signatures)])
    columns = [np.arange(*ends[k : k + 2]) for k in range(len(signatures))]
    every = [
        _score(one, schur[np.ix_(at, at)], projected[at], marginal[at])
        for one, at in zip(signatures, columns, strict=True)
    ]
    kept = _best_of_each(every)
    chosen = np.concatenate([np.zeros(0, np.int64), *(columns[k] for k in kept)])
    rows, start, blocks = [every[k] for k in kept], 0, {}
    for row in rows:
        blocks[row.candidate.name] = slice(start, start + len(row.values))
        start += len(row.values)
    probes = np.concatenate([np.zeros(0), *(signatures[k].probe for k in kept)])
    alone = dict(zip(point.names, (point.constants + lift[:, 0]).tolist(), strict=True))
    found = Scores(
        (), seen.chi2, seen.count, schur[np.ix_(chosen, chosen)], projected[chosen], marginal[chosen], blocks, probes,
        alone, lift[:, 1:][:, chosen],
    )  # fmt: skip
    for k, row in enumerate(rows):
        at = np.arange(len(probes))[blocks[row.candidate.name]]
        rows[k] = dataclasses.replace(row, constants=found.constants_beside(at, row.values - row.candidate.off()))
    order = tuple(sorted(rows, key=lambda row: -row.predicted_improvement))
    return dataclasses.replace(found, rows=order)


def _best_of_each(rows: Sequence[Score]) -> list[int]:
    """Indices of the best row of each name, in order."""
    best: dict[str, int] = {}
    for k, row in enumerate(rows):
        before = best.setdefault(row.candidate.name, k)
        if row.predicted_improvement > rows[before].predicted_improvement:
            best[row.candidate.name] = k
    return sorted(best.values())


def _without_constants(information: Array, gradient: Array, q: int) -> tuple[Array, Array, Array]:
    """Schur complement of the first q unknowns, the gradient projected likewise, and how these follow.

    Returns:
        (K, K), (K,), and (q, 1 + K): their likeliest change alone, and by a unit of each of the others.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    cc = information[:q, :q] / np.outer(scale[:q], scale[:q])
    pull = np.column_stack([gradient[:q], information[:q, q:]])
    lift = -np.linalg.lstsq(cc, pull / scale[:q, None], rcond=1e-10)[0] / scale[:q, None]
    return information[q:, q:] + information[q:, :q] @ lift[:, 1:], gradient[q:] + lift[:, 1:].T @ gradient[:q], lift


def _score(s: Signature, schur: Array, gradient: Array, marginal: Array) -> Score:
    """Score of one candidate, within its bounds, from its Schur information (k, k), gradient and marginal (k,)."""
    k = len(s.probe)
    distinct = np.diag(schur) > MIN_INFORMATION_LEFT * np.maximum(marginal, 1e-300)
    step, sd = np.zeros(k), np.full(k, np.inf)
    if distinct.any():
        inverse = np.linalg.pinv(schur[np.ix_(distinct, distinct)], rcond=1e-10)
        step[distinct] = -inverse @ gradient[distinct]
        sd[distinct] = np.sqrt(np.maximum(np.diag(inverse), 0)) * s.probe[distinct]
    step = np.clip(step, *s.limits)
    improvement = -float(2.0 * gradient @ step + step @ schur @ step)
    return Score(s.candidate, max(improvement, 0.0), s.candidate.off() + step * s.probe, sd)


def add_known(information: Array, gradient: Array, point: Point, signatures: Sequence[Signature]) -> None:
    """Add the priors of constants (per unit) and of switching parameters (per probe), in place."""
    entries = [(name, float(c), 1.0) for name, c in zip(point.names, point.constants, strict=True)]
    for s in signatures:
        named = [f"{s.candidate.name}.{k}" for k in s.candidate.keys]
        entries += list(zip(named, s.candidate.off().tolist(), s.probe.tolist(), strict=True))
    known = point.problem.known
    for k, (name, value, unit) in enumerate(entries):
        if name in known:
            mean, sd = known[name]
            information[k, k] += (unit / sd) ** 2
            gradient[k] += unit * (value - mean) / sd**2


def _canonical_correlations(schur: Array, blocks: dict[str, slice]) -> dict[tuple[str, str], float]:
    """Largest canonical correlation of the projected signatures of every two candidates."""

    def whiten(block: Array) -> Array:
        value, vector = np.linalg.eigh(block)
        keep = value > 1e-10 * max(value.max(initial=0.0), 1e-300)
        return np.asarray(vector[:, keep] / np.sqrt(value[keep]))

    found = {}
    names = list(blocks)
    roots = {n: whiten(schur[blocks[n], blocks[n]]) for n in names}
    for a, one in enumerate(names):
        for two in names[a + 1 :]:
            cross = roots[one].T @ schur[blocks[one], blocks[two]] @ roots[two]
            found[one, two] = float(np.linalg.svd(cross, compute_uv=False)[0]) if cross.size else 0.0
    return found
