"""The search: many strokes screened, the best refined against the launcher's errors, a few judged anew.

1. Fans of aims along every open way (planner/search/candidates.py).
2. The cross-entropy method (Rubinstein 1999) from each of the best: strokes are drawn about a mean, judged over common
   hands, and mean and spread follow the best of them. All starts go side by side; again and again the worse half is
   given up and the other judged over twice as many hands (successive halving, Jamieson and Talwalkar 2016).
3. Those that remain are made playable (string, stage steps), and the best few of them judged over hands that the
   search has not seen: the best of many is partly the luckiest, and its old figures would promise too much. Some of
   these plays are repeated in MuJoCo, and what differs there decides with.

All other plays are the event engine's, with all of the model's effects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.evaluation.play import Player
from planner.evaluation.risk import Hands, Judged, deal, judge
from planner.evaluation.value import Wish
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED
from planner.search.candidates import Way, every_way, starts, ways

Array = NDArray[np.float64]
Report = Callable[[str], None]
PLAIN = 0.15  # offset over radius below which a stroke is called plain
LEAST = 0.05  # probability of a made shot below which none is offered


@dataclass(frozen=True)
class Effort:
    """How long to look."""

    starts: int = 36  # strokes from the fans that are refined
    strokes: int = 24  # drawn about each, a round
    best: int = 6  # of them that the next round follows
    rounds: int = 2  # before the worse half of the starts is given up
    halved: int = 3  # times that it is
    hands: int = 16  # that a drawn stroke is judged over; twice as many each time
    finalists: int = 6  # that are compared more closely
    closely: int = 256  # hands for that
    fresh: int = 1024  # hands that the offered ones are judged over, not seen before
    checked: int = 64  # of them that are played in MuJoCo as well


@dataclass(frozen=True)
class Found:
    """A stroke that the search offers."""

    way: Way
    judged: Judged
    engines: dict[str, float]  # pots without a foul over the same plays, in the event engine and in MuJoCo


def search(
    player: Player, execution: Execution, wish: Wish, *, seed: int = 0, effort: Effort | None = None,
    report: Report | None = None,
) -> list[Found]:  # fmt: skip
    """The best strokes that differ in kind, the best first; none where none is reasonable.

    Args:
        player: the scene on its model.
        execution: how well the launcher repeats.
        wish: what a shot is worth.
        seed: of everything that is drawn.
        effort: how long to look.
        report: told what is being done.
    """
    effort, say = effort or Effort(), report or (lambda line: None)
    open_ways = ways(player.scene)
    say(f"{len(open_ways)} ways lie open; fans of aims along them")
    begun = starts(player, open_ways, execution, wish, effort.starts)
    if len(begun.q) == 0:
        return []
    hands = deal(player.model, execution, effort.closely, seed)
    rng = np.random.default_rng(seed)
    say(f"refining {len(begun.q)} strokes over {effort.hands} plays each, and more")
    shape = (effort.strokes, effort.best, effort.rounds)
    few = [hands.first(effort.hands << k) for k in range(effort.halved + 1)]
    q, live = refine(player, few, begun.q, wish, rng, shape)
    q, way = playable(player, q, begun.way[live])
    if len(q) == 0:
        return []
    close = judge(player, hands, q, wish)
    order = np.argsort([-j.value for j in close], kind="stable")[: effort.finalists]
    fresh = deal(player.model, execution, effort.fresh, seed + 1)
    say(f"judging {len(order)} strokes over {len(fresh)} plays, {effort.checked} of them in MuJoCo too")
    final, engines, shift = in_both(player, fresh, q[order], wish, effort.checked)
    best = sorted(range(len(order)), key=lambda k: -(final[k].value + shift[k]))
    offered = [(int(way[order[k]]), final[k], engines[k]) for k in best if final[k].made >= LEAST]
    return _kinds(player, [Found(_really(player, open_ways, w, j), j, e) for w, j, e in offered])


def in_both(
    player: Player, hands: Hands, q: Array, wish: Wish, checked: int
) -> tuple[list[Judged], list[dict[str, float]], Array]:
    """Strokes judged in the event engine over all hands, and over the first of them in MuJoCo too.

    Returns what they are worth, their pots in both over the same plays, and by how much MuJoCo values each higher (n,):
    a difference over common plays, which a few of them tell.
    """
    final, few = judge(player, hands, q, wish), hands.first(min(checked, len(hands)))
    here, there = (judge(player, few, q, wish, mujoco=mujoco) for mujoco in (False, True))
    pairs = list(zip(here, there, strict=True))
    engines = [{"plays": len(few), "events": a.made, "mujoco": b.made} for a, b in pairs]
    return final, engines, np.array([b.value - a.value for a, b in pairs])


def _really(player: Player, open_ways: list[Way], begun: int, judged: Judged) -> Way:
    """The way that a stroke takes, which began along another one where any pocket counts and another took the ball."""
    out = judged.outcomes
    pocket = int(np.argmax(np.bincount(out.pocket[out.potted], minlength=6)))
    if open_ways[begun].pocket == pocket:
        return open_ways[begun]
    others = [w for w in every_way(player.scene) if w.pocket == pocket]
    return min(others, key=lambda w: (bool(w.lies), abs(math.remainder(w.aim - judged.q[AZIMUTH], 2 * math.pi))))


def playable(player: Player, q: Array, way: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """The strokes as strings and stage steps ask for them, and their ways; without those beyond the launcher."""
    ball = player.scene.ball
    q = player.launcher.playable(q, ball)
    allowed = player.launcher.allowed(q, ball)
    return q[allowed], way[allowed]


def refine(
    player: Player, hands: Sequence[Hands], q: Array, wish: Wish, rng: np.random.Generator,
    shape: tuple[int, int, int],
) -> tuple[Array, NDArray[np.int64]]:  # fmt: skip
    """Strokes (n, 4) moved to where they are worth most over the hands, and which of the given ones they were.

    `shape`: strokes drawn about each in a round, the best of them that count, and rounds over each of the hands;
    between one and the next the worse half of the strokes is given up.
    """
    strokes, best, rounds = shape
    ball, launcher = player.scene.ball, player.launcher
    n, limit = len(q), launcher.offset * ball.radius
    # As wide as the fans' grid is coarse.
    sd = np.empty((n, 4))
    sd[:, SPEED] = 0.12 * q[:, SPEED]
    sd[:, AZIMUTH] = max(0.002, 1.5 * hands[0].execution.azimuth_sd)
    sd[:, [SIDE, HEIGHT]] = 0.2 * limit
    mean, at, live = q.copy(), q.copy(), np.arange(n)
    for number, some in enumerate(hands):
        top = np.full(n, -np.inf)  # over other hands a worth is another
        for _ in range(rounds):
            drawn = mean[live, None] + sd[live, None] * rng.standard_normal((live.size, strokes, 4))
            drawn[:, 0] = at[live]  # the best so far stays among them
            flat = within(player, drawn.reshape(-1, 4))
            values = np.array([j.value for j in judge(player, some, flat, wish)]).reshape(-1, strokes)
            drawn = flat.reshape(-1, strokes, 4)
            order = np.argsort(-values, axis=1, kind="stable")[:, :best]
            chosen = np.take_along_axis(drawn, order[..., None], axis=1)
            first = np.take_along_axis(values, order[:, :1], axis=1)[:, 0]
            at[live] = np.where((first > top[live])[:, None], chosen[:, 0], at[live])
            top[live] = np.maximum(top[live], first)
            mean[live] = 0.8 * chosen.mean(axis=1) + 0.2 * mean[live]
            sd[live] = 0.7 * np.maximum(chosen.std(axis=1), 0.05 * sd[live]) + 0.3 * sd[live]
        if number < len(hands) - 1:
            live = np.sort(live[np.argsort(-top[live], kind="stable")[: max(1, (live.size + 1) // 2)]])
    n, mean, at = live.size, mean[live], at[live]
    last = within(player, mean)
    mine = np.array([j.value for j in judge(player, hands[-1], np.concatenate([last, at]), wish)])
    # The mean of the best is less lucky than the best of all: it need not be quite as good.
    return np.where((mine[:n] >= mine[n:] - 0.01)[:, None], last, at), live


def within(player: Player, q: Array) -> Array:
    """Strokes drawn back to what the launcher can play: (n, 4)."""
    ball, launcher = player.scene.ball, player.launcher
    out, limit = q.copy(), launcher.offset * ball.radius
    off = np.hypot(q[:, SIDE], q[:, HEIGHT])
    shrink = np.minimum(1.0, 0.999 * limit / np.maximum(off, 1e-12))
    out[:, [SIDE, HEIGHT]] *= shrink[:, None]
    gain = launcher.gain(out, ball)
    out[:, SPEED] = np.clip(q[:, SPEED], launcher.slowest * gain, launcher.fastest * gain)
    return out


def kind_of(found: Found, radius: float) -> tuple[object, ...]:
    """What makes two strokes differ in kind: pocket, cushions, draw or follow, side, cushions of the cue ball after."""
    q, out = found.judged.q, found.judged.outcomes
    after = int(np.median(out.hits[:, 1][out.made])) if out.made.any() else 0
    return found.way.pocket, found.way.bank, found.way.kick, after, spin_words(q, radius)


def spin_words(q: Array, radius: float) -> str:
    """What spin a stroke (4,) gives, in words."""
    least = PLAIN * radius
    tilt = "follow" if q[HEIGHT] > least else "draw" if q[HEIGHT] < -least else ""
    side = "right side" if q[SIDE] > least else "left side" if q[SIDE] < -least else ""
    return " and ".join(word for word in (tilt, side) if word) or "no spin"


def _kinds(player: Player, found: list[Found]) -> list[Found]:
    """The best of every kind."""
    kept: dict[tuple[object, ...], Found] = {}
    for one in found:
        kept.setdefault(kind_of(one, player.scene.ball.radius), one)
    return list(kept.values())
