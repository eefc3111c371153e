"""Expected utility and outcome probabilities of strokes, by Monte Carlo over execution errors and model uncertainty.

In: a model with its standard deviations and correlations, the launcher's repeatability, strokes. Out: for each stroke
its mean utility, its probabilities with Wilson's 95 % interval, and the outcomes they come from.

One Monte Carlo sample holds the errors of one play: of the stroke (planner/launcher/execution.py), and of the model's
constants, normal with the covariance of the fit and clipped to their bounds. All strokes are evaluated on the same
samples (common random numbers), so that luck cancels in the difference of two strokes. The interval is that of
independent samples, which is wide for scrambled Sobol points. Left out: effects that the model lacks.
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
from planner.evaluation.value import UtilityWeights, rest_distance, utility
from planner.launcher.execution import Execution, normal_samples
from planner.launcher.stroke import AZIMUTH
from planner.scene import Scene

Array = NDArray[np.float64]
Z_95 = 1.959964  # standard normal quantile of a two-sided 95 % interval


@dataclass(frozen=True)
class ErrorSamples:
    """Errors of m plays."""

    normal: Array  # (m, 4) of the stroke, in standard deviations
    values: dict[str, Array]  # constants of the model by name, (m,) each
    execution: Execution

    def __len__(self) -> int:
        """Number of plays."""
        return len(self.normal)

    def first(self, count: int) -> ErrorSamples:
        """The first samples; a power of two of them also fills the space evenly."""
        return ErrorSamples(self.normal[:count], {k: v[:count] for k, v in self.values.items()}, self.execution)

    def play(self, player: Player, q: Array, *, mujoco: bool = False) -> Outcomes:
        """Play strokes (n, 4) with every sample: n m outcomes, grouped by stroke."""
        played = self.execution.perturb(q, self.normal).reshape(-1, 4)
        values = {name: np.tile(v, len(q)) for name, v in self.values.items()}
        return player.play(played, values) if mujoco else player.screen(played, values)

    def strike(self, player: Player, q: Array) -> tuple[Outcomes, TipDifference]:
        """Play strokes (n, 4) with every sample by the launcher's tip in MuJoCo; also returns the tip's deviation."""
        launcher = player.mapped()
        asked = self.execution.perturb(q, self.normal).reshape(-1, 4)  # errors are of the ball's motion, as observed
        values = {name: np.tile(v, len(q)) for name, v in self.values.items()}
        out, made = player.strike(launcher.tip_strokes(asked), values)
        velocity, spin = launcher.launch(asked, player.scene.ball)
        got, turned = np.array([m.velocity for m in made]), np.array([m.spin for m in made])
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        away = np.arctan2(got[:, 1], got[:, 0]) - asked[:, AZIMUTH]
        return out, TipDifference(
            np.hypot(got[:, 0], got[:, 1]) / speed - 1.0, (away + math.pi) % (2 * math.pi) - math.pi,
            player.scene.ball.radius * np.linalg.norm(turned - spin, axis=1) / speed,
        )  # fmt: skip


@dataclass(frozen=True)
class TipDifference:
    """Deviation of the tip's strokes from a plan's assumptions: (n m,) each."""

    speed: Array  # fraction
    azimuth: Array  # [rad]
    spin: Array  # R times its difference, over the speed


def draw_errors(model: Model, execution: Execution, count: int, seed: int) -> ErrorSamples:
    """Draw `count` samples from a seed; sizes, and constants of unknown uncertainty, keep their values."""
    known = model.parameters()
    drawn = [n for n in known if n not in model.sizes]  # sizes are known to tenths of a millimetre
    names = [n for n in drawn if n in model.estimates and 0 < model.estimates[n].sd < math.inf]
    normal = normal_samples(count, 4 + len(names), seed)
    values = {}
    if names:
        sd = np.array([model.estimates[n].sd for n in names])
        offsets = normal[:, 4:] @ _square_root(_correlation(model, names)).T * sd
        for k, name in enumerate(names):
            low, high = model.meta(name)["bounds"]
            values[name] = np.clip(float(known[name]) + offsets[:, k], low, high)
    return ErrorSamples(normal[:, :4], values, execution)


def _correlation(model: Model, names: list[str]) -> Array:
    """Correlations from the fit, 0 if it has none: (p, p)."""
    fitted, matrix = list(model.fitted.get("names", ())), model.fitted.get("correlation")
    out = np.eye(len(names))
    if matrix is None or np.shape(matrix) != (len(fitted), len(fitted)):
        return out
    given = np.array(matrix, float)
    for i, a in enumerate(names):
        for j, b in enumerate(names):
            if i != j and a in fitted and b in fitted:
                value = given[fitted.index(a), fitted.index(b)]
                out[i, j] = value if math.isfinite(value) else 0.0
    return out


def _square_root(correlation: Array) -> Array:
    """A square root (p, p) of a correlation matrix that rounding may have made slightly indefinite."""
    eigenvalues, axes = np.linalg.eigh(0.5 * (correlation + correlation.T))
    root = axes * np.sqrt(np.maximum(eigenvalues, 0.0))
    return np.asarray(root / np.maximum(np.linalg.norm(root, axis=1, keepdims=True), 1e-12))


def wilson_interval(hits: float, count: int) -> tuple[float, float, float]:
    """A probability and its 95 % interval (Wilson 1927), from `hits` of `count`."""
    if count == 0:
        return math.nan, 0.0, 1.0
    p, z2 = hits / count, Z_95 * Z_95
    middle = (p + z2 / (2 * count)) / (1 + z2 / count)
    half = Z_95 / (1 + z2 / count) * math.sqrt(p * (1 - p) / count + z2 / (4 * count * count))
    return p, max(0.0, min(p, middle - half)), min(1.0, max(p, middle + half))


@dataclass(frozen=True)
class Evaluation:
    """The evaluation of one stroke over all samples."""

    q: Array  # (4,)
    value: float  # expected utility
    made: float  # probability of potting without a foul
    outcomes: Outcomes

    def figures(self, scene: Scene) -> dict[str, Any]:
        """The figures of a plan file."""
        out, n = self.outcomes, len(self.outcomes)
        cue = out.cue[np.isfinite(out.cue[:, 0])]
        away = rest_distance(scene, out)
        away = away[np.isfinite(away)]

        def probability(flags: NDArray[np.bool_]) -> dict[str, float]:
            return dict(zip(("value", "low", "high"), wilson_interval(float(flags.sum()), n), strict=True))

        return {
            "value": self.value,
            "pot_probability": probability(out.potted),
            "made_probability": probability(out.made),
            "foul_probability": probability(out.foul),
            "fouls": {name: float(out.fouls[:, k].mean()) for k, name in enumerate(FOULS)},
            "rest": {
                "mean": cue.mean(axis=0).tolist() if cue.size else None,
                "sd": cue.std(axis=0).tolist() if cue.size else None,
                "distance_median": float(np.median(away)) if away.size else None,
                "distance_90": float(np.quantile(away, 0.9)) if away.size else None,
            },
        }


def evaluate(
    player: Player, samples: ErrorSamples, q: Array, weights: UtilityWeights, *, mujoco: bool = False
) -> list[Evaluation]:
    """Evaluate strokes (n, 4) over all samples, in the event engine or in MuJoCo."""
    return evaluations(player, q, samples.play(player, q, mujoco=mujoco), weights)


def evaluations(player: Player, q: Array, out: Outcomes, weights: UtilityWeights) -> list[Evaluation]:
    """Evaluations of strokes (n, 4) from their outcomes, equally many for each."""
    m = len(out.potted) // len(q)
    values = utility(player.scene, out, weights).reshape(len(q), m).mean(axis=1)
    parts = [out.rows(slice(k * m, (k + 1) * m)) for k in range(len(q))]
    return [
        Evaluation(stroke, float(value), float(part.made.mean()), part)
        for stroke, value, part in zip(q, values, parts, strict=True)
    ]
