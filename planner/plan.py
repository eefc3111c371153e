"""From a scene and a fitted model to a plan file, billiard-plan/1: the stroke, what it promises, and why it was chosen.

Stroke in physical terms and in the launcher's; probabilities with their intervals over launcher errors and the model's
uncertainty; where the cue ball stops, with its spread; how far the yaw, which is set by hand, may be off before a tenth
of the pots is lost; predicted tracks, in MuJoCo with all effects; the best strokes of other kinds.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.model_file import Model
from models.shot import Track
from planner.evaluation.outcome import FOULS
from planner.evaluation.play import Player
from planner.evaluation.risk import Hands, Judged, deal
from planner.evaluation.value import Wish
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, Launcher, stroke_terms
from planner.scene import POCKETS, Scene, pocket_name, scene_dict
from planner.search import baseline
from planner.search.candidates import describe, every_way
from planner.search.search import LEAST, Effort, Found, in_both, playable, search, spin_words

Array = NDArray[np.float64]
FORMAT = "billiard-plan/1"
METHODS = ("risk", "ga")
FAN = 40  # plays drawn, of those that a stroke is judged by
CLOUD = 500  # resting places kept
EVERY, COARSE = 0.02, 0.08  # seconds between the points of a track, of the fan's
LOST = 0.1  # part of the pots that the tolerance of the yaw may cost
TURNS = np.concatenate([np.arange(0.0, 0.2, 0.01), np.arange(0.2, 1.0, 0.02), np.arange(1.0, 4.01, 0.1)])  # [degrees]
TURNED = 256  # plays that a turn of the yaw is judged by
COARSELY = 7  # of them at a time, before the one is sought at which too much is lost
OTHERS = 4  # strokes of other kinds that are told


def make_plan(
    scene: Scene, model: Model, execution: Execution, wish: Wish, *, method: str = "risk", seed: int = 0,
    launcher: Launcher | None = None, effort: Effort | None = None, threads: int = 0,
    report: Callable[[str], None] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Plan a shot.

    Args:
        scene: balls and goal.
        model: fitted to the same table and ball.
        execution: how well the launcher repeats.
        wish: what a shot is worth.
        method: "risk", the search over errors, or "ga", the paper's on the nominal model.
        seed: of everything that is drawn; the same seed gives the same plan at any number of threads.
        launcher: the default one where not given.
        effort: how long to look.
        threads: at most; 0 for all.
        report: told what is being done.

    Returns:
        The plan as plain values; "stroke" is None where no shot is reasonable.

    Raises:
        BadInput: for a model that does not fit the scene, and an unknown method.
    """
    if method not in METHODS:
        raise BadInput(f"method is {method!r}; choose from {', '.join(METHODS)}")
    launcher, say = launcher or Launcher(), report or (lambda line: None)
    effort = effort or Effort()
    player = Player(model, scene, launcher, threads)
    head: dict[str, Any] = {
        "format": FORMAT, "method": method, "seed": seed, "scene": scene_dict(scene),
        "model": {"effects": [e.name() for e in player.model.effects], "fitted": bool(model.estimates)},
        "execution": asdict(execution), "wish": asdict(wish),
    }  # fmt: skip
    if method == "ga":
        found, why = _paper(player, execution, wish, seed, effort, say)
    else:
        found = search(player, execution, wish, seed=seed, effort=effort, report=say)
        why = _why(player, found, wish)
    if not found:
        return head | {"stroke": None, "launcher": None, "alternatives": [], "why": why}
    say("tracks, and the tolerance of the yaw")
    hands = deal(model, execution, effort.fresh, seed + 1)
    few = hands.first(FAN)
    best = found[0]
    plan = _told(player, best) | {"why": why}
    plan["launcher"]["theta_tolerance_deg"] = yaw_tolerance(player, best.judged.q, execution, seed + 2)
    spread = few.execution.spread(best.judged.q[None], few.normal)[0]
    tracks = player.tracks(spread, few.values, every=COARSE)
    plan["fan"] = [_drawn(track, best.judged, k) for k, track in enumerate(tracks)]
    out = best.judged.outcomes
    shown = np.flatnonzero(np.isfinite(out.cue[:, 0]))[:CLOUD]
    plan["places"] = {"cue": _rounded(out.cue[shown]), "potted": out.potted[shown].tolist()}
    others = [_told(player, one) for one in found[1 : 1 + OTHERS]]
    for one in others:
        one["why"] = _beside(plan, one)
    return head | plan | {"alternatives": others}


def _paper(
    player: Player, execution: Execution, wish: Wish, seed: int, effort: Effort, say: Callable[[str], None]
) -> tuple[list[Found], str]:
    """The paper's stroke, judged over errors as ours are, though it was chosen without them."""
    way, q, cost = baseline.search(player, seed=seed, report=say)
    pocket = pocket_name(POCKETS[way.pocket])
    if cost > baseline.ABOVE:
        return [], f"no stroke sends the ball within 55 mm of the {pocket}" + (f": {way.lies}" if way.lies else "")
    if cost >= baseline.IN_OFF:
        return [], f"every stroke that sends the ball within 55 mm of the {pocket} loses the cue ball"
    rows, _ = playable(player, q[None], np.zeros(1, np.int64))
    if len(rows) == 0:
        return [], "the stroke found lies beyond the launcher's strings"
    hands = deal(player.model, execution, effort.fresh, seed + 1)
    final, engines, _ = in_both(player, hands, rows, wish, effort.checked)
    judged = final[0]
    away = 1e3 * math.sqrt(max(cost, 0.0))
    why = (
        f"differential evolution on the nominal model: the cue ball {away:.0f} mm from the wanted place, the path of "
        f"the ball within 55 mm of the {pocket}; launcher errors did not enter the choice"
    )
    if not player.play(rows).potted[0]:
        why += "; that far from its middle the jaws keep the ball out"
    return [Found(way, judged, engines[0])], why


def _told(player: Player, found: Found) -> dict[str, Any]:
    """One stroke's entries, all but what is drawn of the first one alone."""
    judged, model = found.judged, player.model
    made = judged.outcomes.made
    after = int(np.median(judged.outcomes.hits[made, 1])) if made.any() else 0
    over = ("no cushion", "one cushion", "two cushions", "three cushions")
    kind = f"{describe(found.way)}; {spin_words(judged.q, player.scene.ball.radius)}, "
    kind += f"cue ball over {over[after] if after < len(over) else f'{after} cushions'} after it"
    track = player.tracks(judged.q[None], every=EVERY)[0]
    return {
        "stroke": stroke_terms(player.launcher, judged.q), "launcher": player.launcher.terms(model, judged.q),
        "pocket": list(POCKETS[found.way.pocket]), "kind": kind, **judged.figures(player.scene),
        "tracks": moving(track), "engines": found.engines,
    }  # fmt: skip


def yaw_tolerance(player: Player, q: Array, execution: Execution, seed: int) -> list[float]:
    """How far the yaw may be off, below and above, before LOST of the pots is lost: two numbers [degrees]."""
    hands = deal(player.model, execution, TURNED, seed)
    coarse = TURNS[::COARSELY]
    both = np.concatenate([-coarse, coarse[1:]])
    potted = _potted(player, hands, q, both)
    least = (1 - LOST) * potted[0]
    found = []
    for sign, rates in ((-1.0, potted[: len(coarse)]), (1.0, np.r_[potted[0], potted[len(coarse) :]])):
        lost = rates < least
        k = int(np.argmax(lost)) if lost.any() else len(coarse)
        if k == len(coarse):
            found.append(sign * float(coarse[-1]))
            continue
        between = np.linspace(coarse[k - 1], coarse[k], COARSELY + 1)[:-1] if k else np.zeros(1)
        rates = np.r_[rates[max(k - 1, 0)], _potted(player, hands, q, sign * between[1:])]
        found.append(sign * float(between[np.flatnonzero(rates >= least)[-1]]) if k else 0.0)
    return [round(v, 3) + 0.0 for v in found]


def _potted(player: Player, hands: Hands, q: Array, turns: Array) -> Array:
    """The share of plays that pot at each turn of the yaw [degrees]: (n,)."""
    if len(turns) == 0:
        return np.zeros(0)
    turned = np.repeat(q[None], len(turns), axis=0)
    turned[:, AZIMUTH] += np.radians(turns)
    potted = hands.play(player, turned).potted
    return np.asarray(potted.reshape(len(turns), -1).mean(axis=1))


def moving(track: Track) -> list[dict[str, Any]]:
    """Tracks of the balls that move, until they stop or fall, as plain values."""
    out = []
    for k, name in enumerate(track.names):
        xy = track.position[:, k]
        seen = np.isfinite(xy[:, 0])
        fell = next((e for e in track.events if e.kind == "pocket" and e.balls[0] == name), None)
        last = xy[seen][-1]
        if fell is None and np.array_equal(last, xy[0]) and bool((xy == xy[0]).all()):
            continue
        still = np.flatnonzero(seen & (np.abs(xy - last).max(axis=1) > 1e-6))
        end = min(int(still[-1]) + 2, int(seen.sum())) if still.size else 1
        times, places = track.times[:end].round(4).tolist(), _rounded(xy[:end])
        if fell is not None and fell.place is not None:
            times.append(round(fell.time, 4))
            places.append([round(float(v), 5) for v in fell.place])
        out.append({"ball": name, "t": times, "xy": places})
    return out


def _rounded(xy: Array) -> list[list[float]]:
    """Places (n, 2) to a hundredth of a millimetre."""
    return [[float(v) for v in row] for row in np.round(xy, 5)]


def _drawn(track: Track, judged: Judged, k: int) -> dict[str, Any]:
    """One play of the fan: the one that `judged` was told by."""
    fouls = [name for name, has in zip(FOULS, judged.outcomes.fouls[k], strict=True) if has]
    return {"potted": bool(judged.outcomes.potted[k]), "foul": ", ".join(fouls), "tracks": moving(track)}


def _why(player: Player, found: Sequence[Found], wish: Wish) -> str:
    """Why this stroke, or why none."""
    every = list(every_way(player.scene))
    names = {p: pocket_name(POCKETS[p]) for p in {w.pocket for w in every}}
    shut = [f"{names[w.pocket]}: {w.lies}" for w in every if w.bank < 0 and w.kick < 0 and w.lies]
    closed = f" Not direct into {'; '.join(shut)}." if shut else ""
    if not found:
        ways = sum(not w.lies for w in every)
        if not ways:
            return f"No way to a pocket lies open, direct or over one cushion.{closed}"
        return (
            f"{ways} ways lie open, and no stroke along them pots without a foul in {100 * LEAST:.0f} plays of a "
            f"hundred with this launcher.{closed}"
        )
    best = found[0].judged
    goal = player.scene.goal
    aim = "the pot counts alone"
    if goal.rest is not None or goal.rest_for:
        place = f"a shot on {goal.rest_for}" if goal.rest_for else "the wanted place"
        aim = f"{100 * (1 - wish.rest):.0f} % of the worth is the pot, {100 * wish.rest:.0f} % {place}"
    text = f"The highest expected worth, {best.value:.3f} ({aim}; a foul costs {wish.foul:g})"
    if len(found) > 1:
        next_ = found[1]
        text += f"; the best of another kind, {describe(next_.way)}, has {next_.judged.value:.3f}"
    both = found[0].engines
    text += f". Of {both['plays']} plays in both engines {100 * both['events']:.0f} % succeed in the event engine, "
    text += f"{100 * both['mujoco']:.0f} % in MuJoCo"
    return f"{text}.{closed}"


def _beside(best: dict[str, Any], other: dict[str, Any]) -> str:
    """What another stroke has less or more of than the best."""
    pots = 100 * (other["pot_probability"]["value"] - best["pot_probability"]["value"])
    fouls = 100 * (other["foul_probability"]["value"] - best["foul_probability"]["value"])
    parts = []
    if abs(pots) >= 0.1:
        parts.append(f"{abs(pots):.1f} points {'more' if pots > 0 else 'fewer'} pots")
    if abs(fouls) >= 0.1:
        parts.append(f"{abs(fouls):.1f} points {'more' if fouls > 0 else 'fewer'} fouls")
    mine, its = best["rest"]["distance_median"], other["rest"]["distance_median"]
    if mine is not None and its is not None:
        parts.append(f"the cue ball {abs(1e3 * (its - mine)):.0f} mm {'farther' if its > mine else 'nearer'}")
    return f"worth {other['value']:.3f}: " + (", ".join(parts) or "as many pots and fouls")


def read_plan(path: Path | str) -> dict[str, Any]:
    """A plan file's values; BadInput where it is none."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}; name a plan file (planner plan SCENE --out PLAN.json)") from None
    except ValueError as error:
        raise BadInput(f"{path}: is not JSON ({error}); make the plan again") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        told = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise BadInput(f"{path}: format is {told!r}; this version reads {FORMAT}")
    return data
