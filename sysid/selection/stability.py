"""How often a verdict returns on other draws of the same clips.

In: a fit with its named effects, and the quadratic losses of its shots (`Linearised`). Out: `Stability`.

Clips are drawn with replacement, as many as there are, and effects are selected anew for every draw: beginning without
any, the one with the largest delta BIC is added as long as that suffices, and one that is no longer needed is dropped
(the bootstrap: B. Efron, Annals of Statistics 7, 1979). Fits would take hours. The losses, quadratic about the last
fit, need seconds; far from that fit they are rough. What held-out clips have refuted is no candidate.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.estimation.fitted import Point
from sysid.estimation.problem import Array, Index
from sysid.selection.score import Linearised, add_known

DRAWS, SEED = 100, 0
MIN_DELTA_BIC = 10.0  # for an effect to be selected ("very strong", Kass and Raftery 1995)
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


@dataclass(frozen=True)
class _Draw:
    """Losses of drawn shots, quadratic in all unknowns, and what speaks for an effect there."""

    seen: Linearised
    weights: Array  # (n,) how often a shot was drawn, over the design effect
    matrix: Array  # (u, u)
    gradient: Array  # (u,)
    constants: Index  # unknowns that are always free
    blocks: tuple[_Block, ...]
    penalty: float  # of delta BIC for every unknown

    def best(self, chosen: frozenset[int]) -> Array:
        """Change of the unknowns (u,) at which the loss with some of the effects is least."""
        change = np.zeros(len(self.gradient))
        for block in self.blocks:
            change[block.columns] = block.absent
        some = [self.blocks[k] for k in sorted(chosen)]
        free = np.concatenate([self.constants, *(block.columns for block in some)])
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

    def loss(self, change: Array) -> float:
        """The loss after a change of the unknowns, less that before."""
        return float(change @ (self.gradient + 0.5 * self.matrix @ change))

    def shot_losses(self, change: Array) -> Array:
        """The same of every shot: (n,)."""
        each = self.seen.gradient @ change + 0.5 * np.einsum("u,nuv,v->n", change, self.seen.information, change)
        return self.weights * each

    def delta_bic(self, less: Array, more: Array, block: _Block) -> float:
        """Evidence for an effect, from the unknowns without and with it."""
        return 2 * (self.loss(less) - self.loss(more)) - len(block.columns) * self.penalty

    def is_enough(self, less: Array, more: Array, block: _Block) -> bool:
        """Whether it suffices, without the shot that speaks most for it as well."""
        gain = self.delta_bic(less, more, block)
        top = 2 * float(np.max(self.shot_losses(less) - self.shot_losses(more)))
        return gain - max(top, 0.0) > MIN_DELTA_BIC

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
        """The effect to add next; None where no evidence suffices."""
        now, names = self.best(chosen), {self.blocks[k].name for k in chosen}
        found = {k: self.best(chosen | {k}) for k, block in enumerate(self.blocks) if block.name not in names}
        gains = {k: self.delta_bic(now, at, self.blocks[k]) for k, at in found.items()}
        for k in sorted(gains, key=lambda k: -gains[k]):
            if gains[k] <= MIN_DELTA_BIC:
                break
            if self.is_enough(now, found[k], self.blocks[k]):
                return k
        return None

    def _without_needless(self, chosen: frozenset[int]) -> frozenset[int]:
        """The effects without those that are no longer needed beside the others."""
        while len(chosen) > 1:
            now = self.best(chosen)
            worth = {k: self.delta_bic(self.best(chosen - {k}), now, self.blocks[k]) for k in sorted(chosen)}
            least = min(worth, key=worth.__getitem__)
            if worth[least] > MIN_DELTA_BIC:
                break
            chosen -= {least}
        return chosen


def stability_of(
    point: Point, verdict: Sequence[str], seen: Linearised, design_effect: float, draws: int = DRAWS
) -> Stability:
    """How often the effects of a verdict return.

    Args:
        point: the fit with these effects.
        verdict: their names.
        seen: the quadratic losses of its shots, with other candidates.
        design_effect: by how much less than that the shots tell.
        draws: of as many clips as there are.
    """
    blocks = _blocks(point, verdict, seen)
    constants = np.array([k for k, name in enumerate(point.names) if name.split(".")[0] not in verdict])
    clips = len(seen.information)
    drawn = np.random.default_rng(SEED).multinomial(clips, np.full(clips, 1 / clips), draws) / design_effect
    penalty = float(np.log(max(seen.count / design_effect, 2.0)))
    found, same = Counter(dict.fromkeys(verdict, 0)), 0
    for weights in drawn:
        matrix, gradient = np.tensordot(weights, seen.information, 1), weights @ seen.gradient
        add_known(matrix, gradient, point, seen.signatures)
        draw = _Draw(seen, weights, matrix, gradient, constants, blocks, penalty)
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
        found.append(_Block(name, np.array(rows), absent - here, low, high))
    start = len(point.names)
    for one in seen.signatures:
        bounds = (one.candidate.bounds() - one.candidate.off()[:, None]) / one.probe[:, None]
        columns = np.arange(start, start + len(one.probe))
        found.append(_Block(one.candidate.name, columns, np.zeros(len(columns)), *bounds.T))
        start += len(columns)
    return tuple(found)
