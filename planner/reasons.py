"""Why a stroke is the best: its utility, its tip's place and its advantage over the other strokes, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from planner.evaluation.play import Player
from planner.evaluation.value import UtilityWeights
from planner.scene import POCKETS, pocket_name
from planner.search.candidates import all_routes, describe_route
from planner.search.search import MIN_MADE_PROBABILITY, RankedStroke, cushions_after, spin_in_words


def kind_in_words(stroke: RankedStroke, radius: float) -> str:
    """The route of a stroke, its spin, and the cue ball's way after the object ball."""
    after, over = cushions_after(stroke.evaluation), ("no cushion", "one cushion", "two cushions", "three cushions")
    cushions = over[after] if after < len(over) else f"{after} cushions"
    spin = spin_in_words(stroke.evaluation.q, radius)
    return f"{describe_route(stroke.route)}; {spin}, cue ball over {cushions} after it"


def _utility(stroke: RankedStroke) -> str:
    """The expected utility that ranks a stroke: that in the event engine, and by how much MuJoCo differs."""
    text, gain = f"{stroke.evaluation.value:.3f}", stroke.mujoco_gain
    if round(gain, 3) == 0:
        return text
    return f"{text} in the event engine and {abs(gain):.3f} {'more' if gain > 0 else 'less'} in MuJoCo"


def reasons(player: Player, strokes: Sequence[RankedStroke], weights: UtilityWeights) -> str:
    """The reason for the first stroke, or why there is none."""
    routes = list(all_routes(player.scene))
    names = {p: pocket_name(POCKETS[p]) for p in {r.pocket for r in routes}}
    blocked = [f"{names[r.pocket]}: {r.obstacle}" for r in routes if r.direct and r.obstacle]
    closed = f" Not direct into {'; '.join(blocked)}." if blocked else ""
    if not strokes:
        count = sum(not r.obstacle for r in routes)
        if not count:
            return f"No path to a pocket is open, direct or over one cushion.{closed}"
        return (
            f"{count} paths are open, but no stroke along them pots without a foul in "
            f"{100 * MIN_MADE_PROBABILITY:.0f} of 100 plays with this launcher.{closed}"
        )
    best, goal = strokes[0], player.scene.goal
    parts = "only the pot counts"
    if goal.rest is not None or goal.rest_for:
        place = f"a shot on {goal.rest_for}" if goal.rest_for else "the wanted place"
        parts = (
            f"{100 * (1 - weights.rest):.0f} % of the expected utility is the pot, {100 * weights.rest:.0f} % {place}"
        )
    text = f"The highest expected utility, {_utility(best)} ({parts}; a foul costs {weights.foul:g})"
    if len(strokes) > 1:
        text += f". The next: {kind_in_words(strokes[1], player.scene.ball.radius)}, with {_utility(strokes[1])}"
    made = best.engines
    text += f". Of {made['plays']} plays in both engines {100 * made['events']:.0f} % succeed in the event engine, "
    text += f"{100 * made['mujoco']:.0f} % in MuJoCo{_tip_in_words(made)}"
    return f"{text}.{closed}"


def _tip_in_words(engines: dict[str, Any]) -> str:
    """A clause on the deviation of the tip's stroke in MuJoCo from the plan's assumptions."""
    if "tip" not in engines:
        return ""
    speed, azimuth, spin = (engines["tip"][name] for name in ("speed", "azimuth", "spin"))
    pace, side = "faster" if speed > 0 else "slower", "left" if azimuth > 0 else "right"
    return (
        f", where the launcher's tip strikes: the cue ball leaves it {100 * abs(speed):.1f} % {pace} and "
        f"{math.degrees(abs(azimuth)):.2f} degrees farther to the {side} than planned, with another "
        f"{100 * spin:.1f} % of natural roll in spin"
    )


def comparison_in_words(best: dict[str, Any], other: dict[str, Any]) -> str:
    """A comparison of an alternative with the best stroke: pots, fouls and distance of the cue ball."""
    parts = []
    for key, name in (("pot_probability", "pots"), ("foul_probability", "fouls")):
        points = 100 * (other[key]["value"] - best[key]["value"])
        if abs(points) >= 0.1:
            parts.append(f"{abs(points):.1f} points {'more' if points > 0 else 'fewer'} {name}")
    first, second = best["rest"]["distance_median"], other["rest"]["distance_median"]
    if first is not None and second is not None:
        parts.append(f"the cue ball {abs(1e3 * (second - first)):.0f} mm {'farther' if second > first else 'nearer'}")
    return f"utility {other['value']:.3f}: " + (", ".join(parts) or "as many pots and fouls")
