"""The search for strokes of greatest expected utility under the launcher's errors and the model's uncertainty.

In: a scene on its model, the launcher's repeatability, the weights of the utility. Out: strokes of different kinds,
each with its probabilities, the best first.

1. Fans of aims along every open route give the starting strokes (planner/search/candidates.py).
2. The cross-entropy method (Rubinstein 1999) runs from each of them: strokes are drawn from a normal distribution and
   evaluated over common random numbers; mean and spread follow the best of them. All starts run side by side; at each
   stage the worse half is dropped and the rest is evaluated over twice as many samples (successive halving, Jamieson
   and Talwalkar 2016).
3. The remaining strokes are rounded to playable ones, and the best few are evaluated over new samples: the best of
   many is partly the luckiest, so its old figures are biased upwards. Some of these plays are repeated in MuJoCo,
   where the launcher's tip strikes, and the difference enters the final order.

Everything else is played in the event engine, with all of the model's effects.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.messages import counted
from planner.evaluation.play import Player
from planner.evaluation.risk import ErrorSamples, Evaluation, draw_errors, evaluate, evaluations
from planner.evaluation.value import UtilityWeights
from planner.launcher.execution import Execution
from planner.launcher.mapped import MappedLauncher
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED
from planner.search.candidates import Route, all_routes, open_routes, starting_strokes

Array = NDArray[np.float64]
log = logging.getLogger(__name__)
NO_SPIN_OFFSET = 0.15  # contact offset over radius below which a stroke is described as without spin
MIN_MADE_PROBABILITY = 0.05  # least probability of success of an offered shot


@dataclass(frozen=True)
class Effort:
    """The amount of computation; the field names are keys of a study's settings file."""

    starts: int = 36  # starting strokes that are refined
    strokes: int = 24  # strokes drawn around each in an iteration
    best: int = 6  # best of these, which set mean and spread
    rounds: int = 2  # iterations before the worse half of the starts is dropped
    halved: int = 3  # number of halvings
    plays: int = 16  # samples of an evaluation; doubled after each halving
    finalists: int = 6  # strokes that are evaluated over new samples
    closely: int = 256  # samples for the choice of finalists
    fresh: int = 1024  # new samples for the finalists
    checked: int = 8  # samples of these that are also played in MuJoCo, at some 10 ms each


@dataclass(frozen=True)
class RankedStroke:
    """A stroke offered by the search."""

    route: Route
    evaluation: Evaluation
    engines: dict[str, Any]  # shots made over the same plays in either engine, and the tip's deviation
    mujoco_gain: float = 0.0  # expected utility in MuJoCo minus that in the event engine, over these plays


def search(
    player: Player, execution: Execution, weights: UtilityWeights, *, seed: int = 0, effort: Effort | None = None
) -> list[RankedStroke]:  # fmt: skip
    """The best stroke of every kind, the best first; empty if none is made often enough.

    Args:
        player: the scene on its model.
        execution: the launcher's repeatability.
        weights: of the utility.
        seed: of all random numbers.
        effort: amount of computation.
    """
    effort = effort or Effort()
    routes = open_routes(player.scene)
    log.info("%s; fans of aims along them", counted(len(routes), "open route"))
    start = starting_strokes(player, routes, execution, weights, effort.starts)
    if len(start.q) == 0:
        return []
    samples = draw_errors(player.model, execution, effort.closely, seed)
    log.info("refining %s over %d plays each, then more", counted(len(start.q), "stroke"), effort.plays)
    stages = [samples.first(effort.plays << k) for k in range(effort.halved + 1)]
    q, live = _Refinement(player, weights, effort, np.random.default_rng(seed)).run(stages, start.q)
    q, route = playable(player, q, start.route[live])
    if len(q) == 0:
        return []
    close = evaluate(player, samples, q, weights)
    order = np.argsort([-e.value for e in close], kind="stable")[: effort.finalists]
    fresh = draw_errors(player.model, execution, effort.fresh, seed + 1)
    strokes = counted(len(order), "stroke")
    log.info("evaluating %s over %d plays, %d of them in MuJoCo too", strokes, len(fresh), effort.checked)
    final, engines, shift = in_both_engines(player, fresh, q[order], weights, effort.checked)
    ranking = sorted(range(len(order)), key=lambda k: -(final[k].value + shift[k]))
    offered = [
        RankedStroke(
            _played_route(player, routes, int(route[order[k]]), final[k]), final[k], engines[k], float(shift[k])
        )
        for k in ranking
        if final[k].made >= MIN_MADE_PROBABILITY
    ]
    return _best_of_each_kind(offered, player.scene.ball.radius)


def in_both_engines(
    player: Player, samples: ErrorSamples, q: Array, weights: UtilityWeights, checked: int
) -> tuple[list[Evaluation], list[dict[str, Any]], Array]:
    """Strokes (n, 4) evaluated in the event engine over all samples, and in MuJoCo over the first `checked`.

    In MuJoCo the launcher's tip strikes if its map is known; otherwise the ball starts as planned.

    Returns:
        Their evaluations, the shots made in either engine over the same plays with the tip's deviation from the plan
        ("tip": mean differences of speed as a fraction, azimuth [rad], and R times spin over speed), and the expected
        utility in MuJoCo minus that in the event engine (n,), which common plays estimate well.
    """
    final, few = evaluate(player, samples, q, weights), samples.first(min(checked, len(samples)))
    events = evaluate(player, few, q, weights)
    extras: list[dict[str, Any]] = [{} for _ in q]
    if isinstance(player.launcher, MappedLauncher):
        out, off = few.strike(player, q)
        mujoco = evaluations(player, q, out, weights)
        parts = {"speed": off.speed, "azimuth": off.azimuth, "spin": off.spin}
        for k, one in enumerate(extras):
            one["tip"] = {n: float(v.reshape(len(q), -1)[k].mean()) for n, v in parts.items()}
    else:
        mujoco = evaluate(player, few, q, weights, mujoco=True)
    pairs = list(zip(events, mujoco, strict=True))
    engines = [
        {"plays": len(few), "events": a.made, "mujoco": b.made} | one for (a, b), one in zip(pairs, extras, strict=True)
    ]
    return final, engines, np.array([b.value - a.value for a, b in pairs])


def _played_route(player: Player, routes: list[Route], start: int, evaluation: Evaluation) -> Route:
    """The actual route of a stroke, which may differ from its start route if any pocket counts."""
    out = evaluation.outcomes
    pocket = int(np.argmax(np.bincount(out.pocket[out.potted], minlength=6)))
    if routes[start].pocket == pocket:
        return routes[start]
    aim = evaluation.q[AZIMUTH]
    others = [r for r in all_routes(player.scene) if r.pocket == pocket]
    return min(others, key=lambda r: (bool(r.obstacle), abs(math.remainder(r.aim - aim, 2 * math.pi))))


def playable(player: Player, q: Array, route: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Strokes (n, 4) rounded to speed strings and stage steps, and their routes; without those out of bounds."""
    ball = player.scene.ball
    q = player.launcher.playable(q, ball)
    allowed = player.launcher.allowed(q, ball)
    return q[allowed], route[allowed]


@dataclass(frozen=True)
class _Refinement:
    """The cross-entropy method with successive halving."""

    player: Player
    weights: UtilityWeights
    effort: Effort
    rng: np.random.Generator

    def run(self, stages: Sequence[ErrorSamples], q: Array) -> tuple[Array, NDArray[np.int64]]:
        """Improve strokes (n, 4) in expected utility; after each stage of samples the worse half is dropped.

        Returns:
            The remaining strokes, and the indices of their start strokes.
        """
        effort, n = self.effort, len(q)
        sd = self._initial_spread(q, stages[0].execution)
        mean, best, live = q.copy(), q.copy(), np.arange(n)
        for number, samples in enumerate(stages):
            top = np.full(n, -np.inf)  # utility of `best` over these samples
            for _ in range(effort.rounds):
                drawn = mean[live, None] + sd[live, None] * self.rng.standard_normal((live.size, effort.strokes, 4))
                drawn[:, 0] = best[live]  # keep the best so far
                flat = within_bounds(self.player, drawn.reshape(-1, 4))
                values = self._values(samples, flat).reshape(-1, effort.strokes)
                drawn = flat.reshape(-1, effort.strokes, 4)
                order = np.argsort(-values, axis=1, kind="stable")[:, : effort.best]
                elite = np.take_along_axis(drawn, order[..., None], axis=1)
                first = np.take_along_axis(values, order[:, :1], axis=1)[:, 0]
                best[live] = np.where((first > top[live])[:, None], elite[:, 0], best[live])
                top[live] = np.maximum(top[live], first)
                mean[live] = 0.8 * elite.mean(axis=1) + 0.2 * mean[live]
                sd[live] = 0.7 * np.maximum(elite.std(axis=1), 0.05 * sd[live]) + 0.3 * sd[live]
            if number < len(stages) - 1:
                live = np.sort(live[np.argsort(-top[live], kind="stable")[: max(1, (live.size + 1) // 2)]])
        n, mean, best = live.size, mean[live], best[live]
        last = within_bounds(self.player, mean)
        values = self._values(stages[-1], np.concatenate([last, best]))
        # The mean of the best is less biased by luck than the very best, so it may be slightly worse.
        return np.where((values[:n] >= values[n:] - 0.01)[:, None], last, best), live

    def _initial_spread(self, q: Array, execution: Execution) -> Array:
        """Standard deviations (n, 4) of the grid spacing of the fans."""
        sd = np.empty((len(q), 4))
        sd[:, SPEED] = 0.12 * q[:, SPEED]
        sd[:, AZIMUTH] = max(0.002, 1.5 * execution.azimuth_sd)
        sd[:, [SIDE, HEIGHT]] = 0.2 * self.player.launcher.max_offset(self.player.scene.ball)
        return sd

    def _values(self, samples: ErrorSamples, q: Array) -> Array:
        """Expected utility of strokes (n, 4): (n,)."""
        return np.array([e.value for e in evaluate(self.player, samples, q, self.weights)])


def within_bounds(player: Player, q: Array) -> Array:
    """Strokes (n, 4) moved into the launcher's bounds of offset and cue speed."""
    ball, launcher = player.scene.ball, player.launcher
    out, limit = q.copy(), launcher.max_offset(ball)
    offset = np.hypot(q[:, SIDE], q[:, HEIGHT])
    shrink = np.minimum(1.0, 0.999 * limit / np.maximum(offset, 1e-12))
    out[:, [SIDE, HEIGHT]] *= shrink[:, None]
    gain = launcher.gain(out, ball)
    out[:, SPEED] = np.clip(q[:, SPEED], launcher.slowest * gain, launcher.fastest * gain)
    return out


def cushions_after(evaluation: Evaluation) -> int:
    """Cushions that the cue ball touches after the object ball: median over successful plays."""
    out = evaluation.outcomes
    return int(np.median(out.hits[out.made, 1])) if out.made.any() else 0


def spin_in_words(q: Array, radius: float) -> str:
    """The spin of a stroke (4,) in words."""
    threshold = NO_SPIN_OFFSET * radius
    tilt = "follow" if q[HEIGHT] > threshold else "draw" if q[HEIGHT] < -threshold else ""
    side = "right side" if q[SIDE] > threshold else "left side" if q[SIDE] < -threshold else ""
    return " and ".join(word for word in (tilt, side) if word) or "no spin"


def _best_of_each_kind(strokes: Sequence[RankedStroke], radius: float) -> list[RankedStroke]:
    """The first stroke of every combination of pocket, bank, kick, cushions after the object ball and spin."""
    best: dict[tuple[object, ...], RankedStroke] = {}
    for one in strokes:
        route, evaluation = one.route, one.evaluation
        spin = spin_in_words(evaluation.q, radius)
        best.setdefault((route.pocket, route.bank, route.kick, cushions_after(evaluation), spin), one)
    return list(best.values())
