"""What a stroke is worth when it is not played quite as asked, on a table that is not quite as fitted.

A hand holds the errors of one play: of the stroke (planner/launcher/execution.py) and of the model's constants, normal
with the standard deviations and correlations of the fit, kept within their bounds. All strokes are judged on the same
hands (common random numbers), so that two strokes differ by what they are and not by luck. Probabilities come with
Wilson's 95 % interval for the number of hands, which for scrambled Sobol points is wide. Leaves out that the model may
lack an effect: nothing in it can tell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.model_file import Model
from planner.evaluation.outcome import FOULS, Outcomes
from planner.evaluation.play import Player
from planner.evaluation.value import Wish, distance, worth
from planner.launcher.execution import Execution, draws
from planner.scene import Scene

Array = NDArray[np.float64]
Z = 1.959964  # of a 95 % interval


@dataclass(frozen=True)
class Hands:
    """Errors of m plays."""

    normal: Array  # (m, 4) of the stroke, in standard deviations
    values: dict[str, Array]  # the model's constants, (m,) each
    execution: Execution

    def __len__(self) -> int:
        """Plays."""
        return len(self.normal)

    def first(self, count: int) -> Hands:
        """The first so many, which fill their space evenly too where it is a power of two."""
        return Hands(self.normal[:count], {k: v[:count] for k, v in self.values.items()}, self.execution)

    def play(self, player: Player, q: Array, *, mujoco: bool = False) -> Outcomes:
        """Play strokes (n, 4) with every hand: n m outcomes, those of one stroke together."""
        played = self.execution.spread(q, self.normal).reshape(-1, 4)
        values = {name: np.tile(v, len(q)) for name, v in self.values.items()}
        return player.play(played, values) if mujoco else player.screen(played, values)


def deal(model: Model, execution: Execution, count: int, seed: int) -> Hands:
    """Draw hands: (count,) of them from a seed; the constants without an uncertainty stay as they are."""
    known = model.parameters()
    names = [n for n in known if n in model.estimates and 0 < model.estimates[n].sd < math.inf]
    numbers = draws(count, 4 + len(names), seed)
    values = {}
    if names:
        sd = np.array([model.estimates[n].sd for n in names])
        off = numbers[:, 4:] @ _root(_correlation(model, names)).T * sd
        for k, name in enumerate(names):
            low, high = model.meta(name)["bounds"]
            values[name] = np.clip(float(known[name]) + off[:, k], low, high)
    return Hands(numbers[:, :4], values, execution)


def _correlation(model: Model, names: list[str]) -> Array:
    """Correlations that the fit told, 0 where it told none: (p, p)."""
    told, matrix = list(model.fitted.get("names", ())), model.fitted.get("correlation")
    out = np.eye(len(names))
    if matrix is None or np.shape(matrix) != (len(told), len(told)):
        return out
    given = np.array(matrix, float)
    for i, a in enumerate(names):
        for j, b in enumerate(names):
            if i != j and a in told and b in told:
                value = given[told.index(a), told.index(b)]
                out[i, j] = value if math.isfinite(value) else 0.0
    return out


def _root(correlation: Array) -> Array:
    """A square root of a correlation matrix that rounding may have left not quite positive."""
    size, axes = np.linalg.eigh(0.5 * (correlation + correlation.T))
    root = axes * np.sqrt(np.maximum(size, 0.0))
    return np.asarray(root / np.maximum(np.linalg.norm(root, axis=1, keepdims=True), 1e-12))


def wilson(hits: float, count: int) -> tuple[float, float, float]:
    """A probability and its 95 % interval (Wilson 1927), from `hits` of `count`."""
    if count == 0:
        return math.nan, 0.0, 1.0
    p, z2 = hits / count, Z * Z
    middle = (p + z2 / (2 * count)) / (1 + z2 / count)
    half = Z / (1 + z2 / count) * math.sqrt(p * (1 - p) / count + z2 / (4 * count * count))
    return p, max(0.0, min(p, middle - half)), min(1.0, max(p, middle + half))


@dataclass(frozen=True)
class Judged:
    """One stroke over all hands."""

    q: Array  # (4,)
    value: float  # expected worth
    made: float  # probability of potting without a foul
    outcomes: Outcomes

    def figures(self, scene: Scene) -> dict[str, Any]:
        """The figures of a plan file."""
        out, n = self.outcomes, len(self.outcomes)
        keys = ("value", "low", "high")
        cue = out.cue[np.isfinite(out.cue[:, 0])]
        away = distance(scene, out)
        away = away[np.isfinite(away)]
        told = cue.size > 0
        return {
            "value": self.value,
            "pot_probability": dict(zip(keys, wilson(float(out.potted.sum()), n), strict=True)),
            "made_probability": dict(zip(keys, wilson(float(out.made.sum()), n), strict=True)),
            "foul_probability": dict(zip(keys, wilson(float(out.foul.sum()), n), strict=True)),
            "fouls": {name: float(out.fouls[:, k].mean()) for k, name in enumerate(FOULS)},
            "rest": {
                "mean": cue.mean(axis=0).tolist() if told else None,
                "sd": cue.std(axis=0).tolist() if told else None,
                "distance_median": float(np.median(away)) if away.size else None,
                "distance_90": float(np.quantile(away, 0.9)) if away.size else None,
            },
        }


def judge(player: Player, hands: Hands, q: Array, wish: Wish, *, mujoco: bool = False) -> list[Judged]:
    """Every stroke (n, 4) over all hands."""
    out = hands.play(player, q, mujoco=mujoco)
    m, found = len(hands), []
    values = worth(player.scene, out, wish).reshape(len(q), m).mean(axis=1)
    for k, value in enumerate(values):
        part = out.rows(slice(k * m, (k + 1) * m))
        found.append(Judged(q[k], float(value), float(part.made.mean()), part))
    return found
