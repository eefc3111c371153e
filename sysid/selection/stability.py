"""Reproducibility of a verdict under resampling of the clips.

In: a fit with its named effects, and the quadratic losses of its shots (`Linearised`). Out: `Stability`.

Clips are drawn with replacement, as many as there are, and effects are selected for every draw by the same rule as in
the search (judgement.py): starting without any, the likeliest that passes is added, and one that no longer passes is
dropped (the bootstrap: B. Efron, Annals of Statistics 7, 1979). Fits would take hours. Losses that are quadratic about
the last fit need seconds, and are approximate far from it. Effects refuted by held-out clips are not candidates.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np

from sysid.estimation.fitted import Point
from sysid.estimation.problem import Array, Index
from sysid.selection.fits.view import projected_on
from sysid.selection.formulas.causes import log_odds, mean_odds
from sysid.selection.judgement import ERROR_RATE, Threshold, Unknown, covariances, over_scatter, unknowns_of
from sysid.selection.scoring.score import Linearised, add_known
from sysid.selection.scoring.signatures import candidate

DEFAULT_DRAWS, SEED = 100, 0
LEAST_SHARE = 1e-9  # added to the diagonal, so that undetermined unknowns stay regular


@dataclass(frozen=True)
class Stability:
    """The numbers of draws in which effects are selected."""

    draws: int
    same: int  # draws with exactly the verdict
    times: dict[str, int]  # draws with each effect that was ever selected or is in the verdict, the most frequent first


@dataclass(frozen=True)
class _Block:
    """An effect's unknowns."""

    name: str
    columns: Index
    absent: Array  # change of the unknowns at which the effect vanishes
    low: Array  # bounds of these changes
    high: Array
    known: tuple[Unknown, ...]  # their priors; middles are relative to where the effect vanishes

    @cached_property
    def covariances(self) -> Array:
        """See `judgement.covariances`."""
        return covariances(self.known)

    @property
    def sized(self) -> Index:
        """The unknowns with a size; all shots share a place in any case."""
        return np.flatnonzero([one.sized for one in self.known])


@dataclass(frozen=True)
class _Draw:
    """Quadratic losses of drawn shots, and the evidence for effects from them."""

    information: Array  # (n, u, u) of each shot, repeated as often as it was drawn
    gradients: Array  # (n, u)
    matrix: Array  # (u, u) of all, including priors
    gradient: Array  # (u,)
    constants: Index  # unknowns that are always free
    blocks: tuple[_Block, ...]
    threshold: Threshold

    def best(self, chosen: frozenset[int]) -> Array:
        """Change of the unknowns (u,) that minimises the loss with some of the effects."""
        change = np.zeros(len(self.gradient))
        for block in self.blocks:
            change[block.columns] = block.absent
        some = [self.blocks[k] for k in sorted(chosen)]
        free = self._free(chosen)
        change[free] = 0.0
        own = self.matrix[np.ix_(free, free)]
        scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
        scaled = own / np.outer(scale, scale) + LEAST_SHARE * np.eye(len(free))
        found = -np.linalg.solve(scaled, (self.gradient[free] + self.matrix[free] @ change) / scale) / scale
        q = len(self.constants)
        for block in some:
            found[q : q + len(block.columns)] = np.clip(found[q : q + len(block.columns)], block.low, block.high)
            q += len(block.columns)
        change[free] = found
        return change

    def odds(self, without: frozenset[int], numbers: Sequence[int]) -> dict[int, float]:
        """Log odds of the effects with these indices, given some others."""
        change = self.best(without)
        pull = self.gradient + self.matrix @ change
        free = self._free(without)
        own = self.matrix[np.ix_(free, free)]
        scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
        scaled = own / np.outer(scale, scale) + LEAST_SHARE * np.eye(len(free))
        lift = np.linalg.solve(scaled, self.matrix[free] / scale[:, None]) / scale[:, None]
        projected = pull - lift.T @ pull[free]
        found: dict[int, float] = {}
        for _, few in groupby(sorted(numbers, key=self._size_of), self._size_of):  # by number of unknowns
            alike = list(few)
            rows = np.array([self.blocks[k].columns for k in alike])
            information = self.matrix[rows[:, :, None], rows[:, None]]
            information = information - self.matrix[rows][:, :, free] @ np.moveaxis(lift[:, rows], 0, 1)
            sizes = np.stack([self.blocks[k].covariances for k in alike], axis=1)
            odds = mean_odds(log_odds(information, projected[rows], sizes))
            found |= dict(zip(alike, odds.tolist(), strict=True))
        return found

    def _size_of(self, k: int) -> int:
        """The number of unknowns of an effect."""
        return len(self.blocks[k].columns)

    def is_shared(self, without: frozenset[int], k: int) -> bool:
        """Whether an effect, given some others, is likelier than a separate size for each shot."""
        block = self.blocks[k]
        change = self.best(without | {k})
        at = np.concatenate([self._free(without), block.columns])
        place = len(at) - len(block.columns) + block.sized
        here = self.gradients + self.information @ change
        projected = projected_on(self.information[:, at[:, None], at], here[:, at], place)
        away = (change[block.columns] - block.absent)[block.sized]
        known = [block.known[j] for j in block.sized]
        return over_scatter(away, known, *projected) > self.threshold.sure

    def _free(self, chosen: frozenset[int]) -> Index:
        """Indices of the unknowns that are free with some of the effects."""
        return np.concatenate([self.constants, *(self.blocks[k].columns for k in sorted(chosen))])

    def selected(self) -> frozenset[int]:
        """Indices of the selected effects."""
        chosen = frozenset[int]()
        for _ in self.blocks:
            more = self._added(chosen)
            if more is None:
                break
            chosen = self._without_needless(chosen | {more})
        return chosen

    def _added(self, chosen: frozenset[int]) -> int | None:
        """The effect to add next; None if none passes."""
        names = {self.blocks[k].name for k in chosen}
        found = self.odds(chosen, [k for k, block in enumerate(self.blocks) if block.name not in names])
        for k in sorted(found, key=lambda k: -found[k]):
            if found[k] <= self.threshold.least:
                break
            if self.is_shared(chosen, k):
                return k
        return None

    def _without_needless(self, chosen: frozenset[int]) -> frozenset[int]:
        """The effects without those that no longer pass, given the others."""
        while len(chosen) > 1:
            odds = {k: self.odds(chosen - {k}, [k])[k] for k in sorted(chosen)}
            least = min(odds, key=odds.__getitem__)
            if odds[least] > self.threshold.least and self.is_shared(chosen - {least}, least):
                break
            chosen -= {least}
        return chosen


def stability_of(
    point: Point, verdict: Sequence[str], seen: Linearised, design_effect: float, error_rate: float = ERROR_RATE,
    draws: int = DEFAULT_DRAWS,
) -> Stability:  # fmt: skip
    """Compute how often the effects of a verdict are selected again.

    Args:
        point: the fit with these effects.
        verdict: their names.
        seen: the quadratic losses of its shots, with other candidates.
        design_effect: factor by which the shots are less informative.
        error_rate: of a selected effect.
        draws: number of draws, each of as many clips as there are.
    """
    blocks = _blocks(point, verdict, seen)
    constants = np.array([k for k, name in enumerate(point.names) if name.split(".")[0] not in verdict])
    clips, threshold = len(seen.information), Threshold(max(len({one.name for one in blocks}), 1), error_rate)
    drawn = np.random.default_rng(SEED).multinomial(clips, np.full(clips, 1 / clips), draws)
    found, same = Counter(dict.fromkeys(verdict, 0)), 0
    for times in drawn:
        of = np.repeat(np.arange(clips), times)
        information, gradients = seen.information[of] / design_effect, seen.gradient[of] / design_effect
        matrix, gradient = information.sum(axis=0), gradients.sum(axis=0)
        add_known(matrix, gradient, point, seen.signatures)
        draw = _Draw(information, gradients, matrix, gradient, constants, blocks, threshold)
        names = {blocks[k].name for k in draw.selected()}
        found.update(names)
        same += names == set(verdict)
    order = sorted(found.items(), key=lambda one: (-one[1], one[0]))
    return Stability(draws, same, dict(order))


def _blocks(point: Point, verdict: Sequence[str], seen: Linearised) -> tuple[_Block, ...]:
    """The effects of the verdict, then the candidates."""
    found = []
    for name in verdict:
        rows = [k for k, n in enumerate(point.names) if n.split(".")[0] == name]
        here, meta = point.constants[rows], [point.model.meta(point.names[k]) for k in rows]
        absent = np.array([c if m["off"] is None else m["off"] for m, c in zip(meta, here, strict=True)])
        low, high = np.array([m["bounds"] for m in meta], float).T - here
        kind = next(type(one) for one in point.model.effects if one.name() == name)
        known = tuple(unknowns_of(candidate(kind), point.names))
        found.append(_Block(name, np.array(rows), absent - here, low, high, known))
    start = len(point.names)
    for one in seen.signatures:
        columns = np.arange(start, start + len(one.probe))
        usual = np.abs(one.candidate.usual()) / one.probe
        known = tuple(Unknown(key, 0.0, size, True) for key, size in zip(one.candidate.keys, usual, strict=True))
        found.append(_Block(one.candidate.name, columns, np.zeros(len(columns)), *one.limits, known))
        start += len(columns)
    return tuple(found)
