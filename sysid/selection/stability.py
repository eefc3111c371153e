"""How often a verdict returns on other draws of the same clips.

In: a fit with its named effects, and the quadratic losses of its shots (`Linearised`). Out: `Stability`.

Clips are drawn with replacement, as many as there are, and effects are selected anew for every draw by the rule by
which they were found (judgement.py): beginning without any, the likeliest that passes is added, and one that no longer
passes is dropped (the bootstrap: B. Efron, Annals of Statistics 7, 1979). Fits would take hours. The losses, quadratic
about the last fit, need seconds; far from that fit they are rough. What held-out clips have refuted is no candidate.
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
from sysid.selection.free_forms import log_odds, mean_odds
from sysid.selection.judgement import ERROR_RATE, Threshold, Unknown, covariances, over_scatter, unknowns_of
from sysid.selection.score import Linearised, add_known
from sysid.selection.signatures import candidate
from sysid.selection.view import projected_on

DRAWS, SEED = 100, 0
LEAST_SHARE = 1e-9  # added to the diagonal, where nothing tells of an unknown


@dataclass(frozen=True)
class Stability:
    """In how many draws of the clips effects are selected."""

    draws: int
    same: int  # those with exactly the verdict
    times: dict[str, int]  # each effect that was selected at all or is in the verdict, the most frequent first


@dataclass(frozen=True)
class _Block:
    """An effect's unknowns."""

    name: str
    columns: Index
    absent: Array  # change of the unknowns at which it vanishes
    low: Array  # bounds of these changes
    high: Array
    known: tuple[Unknown, ...]  # what is known of them beforehand; middles count from where it vanishes

    @cached_property
    def covariances(self) -> Array:
        """See `judgement.covariances`."""
        return covariances(self.known)

    @property
    def sized(self) -> Index:
        """Those whose size counts; a place is shared by all shots in any case."""
        return np.flatnonzero([one.sized for one in self.known])


@dataclass(frozen=True)
class _Draw:
    """Losses of drawn shots, quadratic in all unknowns, and what speaks for an effect there."""

    information: Array  # (n, u, u) of each shot, as often as it was drawn
    gradients: Array  # (n, u)
    matrix: Array  # (u, u) of all, and of what is known beside them
    gradient: Array  # (u,)
    constants: Index  # unknowns that are always free
    blocks: tuple[_Block, ...]
    threshold: Threshold

    def best(self, chosen: frozenset[int]) -> Array:
        """Change of the unknowns (u,) at which the loss with some of the effects is least."""
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
        """Log odds of effects of these numbers beside some."""
        change = self.best(without)
        pull = self.gradient + self.matrix @ change
        free = self._free(without)
        own = self.matrix[np.ix_(free, free)]
        scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
        scaled = own / np.outer(scale, scale) + LEAST_SHARE * np.eye(len(free))
        lift = np.linalg.solve(scaled, self.matrix[free] / scale[:, None]) / scale[:, None]
        projected = pull - lift.T @ pull[free]
        found: dict[int, float] = {}
        for _, few in groupby(sorted(numbers, key=self._size_of), self._size_of):  # those of one size at once
            alike = list(few)
            rows = np.array([self.blocks[k].columns for k in alike])
            information = self.matrix[rows[:, :, None], rows[:, None]]
            information = information - self.matrix[rows][:, :, free] @ np.moveaxis(lift[:, rows], 0, 1)
            sizes = np.stack([self.blocks[k].covariances for k in alike], axis=1)
            odds = mean_odds(log_odds(information, projected[rows], sizes))
            found |= dict(zip(alike, odds.tolist(), strict=True))
        return found

    def _size_of(self, k: int) -> int:
        """How many unknowns an effect has."""
        return len(self.blocks[k].columns)

    def is_shared(self, without: frozenset[int], k: int) -> bool:
        """Whether an effect beside some is likelier than that each shot has a size of it of its own."""
        block = self.blocks[k]
        change = self.best(without | {k})
        at = np.concatenate([self._free(without), block.columns])
        place = len(at) - len(block.columns) + block.sized
        here = self.gradients + self.information @ change
        told = projected_on(self.information[:, at[:, None], at], here[:, at], place)
        away = (change[block.columns] - block.absent)[block.sized]
        known = [block.known[j] for j in block.sized]
        return over_scatter(away, known, *told) > self.threshold.sure

    def _free(self, chosen: frozenset[int]) -> Index:
        """Numbers of the unknowns that are free with some of the effects."""
        return np.concatenate([self.constants, *(self.blocks[k].columns for k in sorted(chosen))])

    def selected(self) -> frozenset[int]:
        """Numbers of the effects that are selected."""
        chosen = frozenset[int]()
        for _ in self.blocks:
            more = self._added(chosen)
            if more is None:
                break
            chosen = self._without_needless(chosen | {more})
        return chosen

    def _added(self, chosen: frozenset[int]) -> int | None:
        """The effect to add next; None where none passes."""
        names = {self.blocks[k].name for k in chosen}
        found = self.odds(chosen, [k for k, block in enumerate(self.blocks) if block.name not in names])
        for k in sorted(found, key=lambda k: -found[k]):
            if found[k] <= self.threshold.least:
                break
            if self.is_shared(chosen, k):
                return k
        return None

    def _without_needless(self, chosen: frozenset[int]) -> frozenset[int]:
        """The effects without those that no longer pass beside the others."""
        while len(chosen) > 1:
            worth = {k: self.odds(chosen - {k}, [k])[k] for k in sorted(chosen)}
            least = min(worth, key=worth.__getitem__)
            if worth[least] > self.threshold.least and self.is_shared(chosen - {least}, least):
                break
            chosen -= {least}
        return chosen


def stability_of(
    point: Point, verdict: Sequence[str], seen: Linearised, design_effect: float, error_rate: float = ERROR_RATE,
    draws: int = DRAWS,
) -> Stability:  # fmt: skip
    """How often the effects of a verdict return.

    Args:
        point: the fit with these effects.
        verdict: their names.
        seen: the quadratic losses of its shots, with other candidates.
        design_effect: by how much less than that the shots tell.
        error_rate: of an effect that is selected.
        draws: of as many clips as there are.
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
