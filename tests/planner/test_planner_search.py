"""The search for a shot: ways and their geometry, strokes that survive their errors, the paper's method, the plan."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.effects.cloth.table_tilt import TableTilt
from models.effects.cue.squirt import Squirt
from models.engine.play import finish
from models.model_file import full_model
from models.shot import RAIL_NAMES, Array, Ball, Table
from planner.evaluation.outcome import FOULS
from planner.evaluation.play import Player
from planner.evaluation.risk import draw_errors, evaluate
from planner.evaluation.value import UtilityWeights, rest_distance
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, LauncherModel, launch
from planner.planning import make_plan, read_plan
from planner.scene import POCKETS, Goal, Scene, pocket_places, scene_from
from planner.search import baseline
from planner.search.candidates import (
    AIMS_PER_FAN,
    SCAN_OFFSETS,
    SPEED_STEPS,
    Route,
    all_routes,
    describe_route,
    open_routes,
    starting_strokes,
    stroke_grid,
)
from planner.search.search import MIN_MADE_PROBABILITY, Effort, search
from tests.support.clip_samples import refusal
from tests.support.planned_shots import AWAY, BALL, HALF, MODEL, TABLE, R, fitted, ready, scene, straight

QUICK = Effort(
    starts=6, strokes=12, best=4, rounds=3, halved=1, plays=16, finalists=3, closely=64, fresh=256,
)  # fmt: skip
EXACT = Execution(0.0, 0.0, 0.0, 0.0)
REACH = TABLE.centre_limits(BALL)
CUT = scene([0.6, -0.1], [1.2, 0.3], [-0.4, 0.4], pocket=(1, 1), rest=[0.4, 0.3])
# The shot of Robotic Billiards (2015), section VIII, in the table frame.
PAPER = Table(2.96, 1.524)
PUBLISHED = Scene(
    PAPER, BALL, ("white", "red"), np.array([[-0.918, 0.064], [-0.799, -0.107]]),
    Goal("white", "red", (0, -1), np.array([-1.455, -0.488])),
)  # fmt: skip


def way_of(asked: Scene, pocket: tuple[int, int], bank: int = -1, kick: int = -1) -> Route:
    number = POCKETS.index(pocket)
    [found] = [w for w in all_routes(asked) if (w.pocket, w.bank, w.kick) == (number, bank, kick)]
    return found


def mirrored(asked: Scene, signs: Array) -> Scene:
    goal = asked.goal
    pocket = goal.pocket and (int(goal.pocket[0] * signs[0]), int(goal.pocket[1] * signs[1]))
    rest = None if goal.rest is None else goal.rest * signs
    goal = dataclasses.replace(goal, pocket=pocket, rest=rest)
    return dataclasses.replace(asked, position=asked.position * signs, goal=goal)


# Ways to play a scene.


def test_a_direct_way_against_a_hand_calculation() -> None:
    """A red 0.3 m square to both corner cushions, and a white on the level of the ghost ball."""
    red = HALF - 0.3
    ghost = red - 2 * R * AWAY
    asked = scene(ghost - [0.5, 0.0], red)
    way = way_of(asked, (1, 1))
    assert (way.aim, way.cue_path) == pytest.approx((0.0, 0.5))
    assert way.object_path == pytest.approx(0.3 * math.sqrt(2))
    assert way.cut == pytest.approx(math.pi / 4)
    assert way.obstacle == ""
    assert describe_route(way) == "cut of 45 degrees into the corner pocket +x +y"
    assert describe_route(way_of(straight(), (1, 1))) == "straight into the corner pocket +x +y"


def test_ways_over_a_cushion_against_a_hand_calculation() -> None:
    asked = scene([0.3, -0.4], [0.6, 0.2])
    bank, image = way_of(asked, (0, -1), RAIL_NAMES.index("+y")), np.array([0.0, 2 * REACH[1] + HALF[1]])
    line = image - [0.6, 0.2]
    assert bank.object_path == pytest.approx(math.hypot(*line))
    ghost = np.array([0.6, 0.2]) - 2 * R * line / math.hypot(*line)
    assert bank.cue_path == pytest.approx(math.hypot(*(ghost - [0.3, -0.4])))
    assert bank.aim == pytest.approx(math.atan2(ghost[1] + 0.4, ghost[0] - 0.3))
    kick = way_of(asked, (1, 1), kick=RAIL_NAMES.index("-x"))
    line = HALF - [0.6, 0.2]
    ghost = np.array([0.6, 0.2]) - 2 * R * line / math.hypot(*line)
    image = np.array([-2 * REACH[0] - ghost[0], ghost[1]])
    assert kick.aim == pytest.approx(math.atan2(image[1] + 0.4, image[0] - 0.3))
    assert kick.cue_path == pytest.approx(math.hypot(image[0] - 0.3, image[1] + 0.4))
    assert describe_route(kick).endswith(", cue ball via the -x cushion")
    assert not [
        w for w in all_routes(asked) if w.bank >= 0 and POCKETS[w.pocket] == (0, 1) and RAIL_NAMES[w.bank] == "+y"
    ]


def test_what_stands_in_the_way_is_told() -> None:
    red = HALF - 0.5 * AWAY
    for name, place, who in (("b0", red - 0.2 * AWAY, "white"), ("b0", red + 0.2 * AWAY, "red")):
        way = way_of(straight(0.5, 0.4, place), (1, 1))
        assert way.obstacle == f"{name} is in the {who}'s way"
    left = np.array([-AWAY[1], AWAY[0]])
    for aside, shut in ((1.9 * R, True), (2.1 * R, False)):
        assert bool(way_of(straight(0.5, 0.4, red + 0.2 * AWAY + aside * left), (1, 1)).obstacle) == shut
    assert re.fullmatch(r"cut of 1\d\d degrees", way_of(straight(), (-1, -1)).obstacle)
    frozen = scene([-1.0, 0.85], [0.4, REACH[1]])
    assert "against the cushion" in way_of(frozen, (1, -1)).obstacle


@pytest.mark.parametrize("signs", [(1, -1), (-1, 1), (-1, -1)])
def test_ways_of_a_mirrored_scene_are_mirrored(signs: tuple[int, int]) -> None:
    asked = scene([-0.5, 0.2], [0.7, -0.3], [0.2, 0.4], [1.1, -0.5])
    turned = {(w.pocket, w.bank, w.kick): w for w in all_routes(mirrored(asked, np.array(signs)))}
    found = list(all_routes(asked))
    assert len(found) == len(turned) > 25

    def rail(k: int) -> int:
        return k if k < 0 or signs[k // 2] > 0 else k ^ 1

    for way in found:
        x, y = POCKETS[way.pocket]
        other = turned[POCKETS.index((x * signs[0], y * signs[1])), rail(way.bank), rail(way.kick)]
        assert (other.cue_path, other.object_path, other.cut) == pytest.approx((way.cue_path, way.object_path, way.cut))
        assert other.obstacle == way.obstacle
        aim = np.array([math.cos(way.aim), math.sin(way.aim)]) * signs
        assert [math.cos(other.aim), math.sin(other.aim)] == pytest.approx(aim, abs=1e-12)


def test_fans_of_a_mirrored_scene_score_the_same() -> None:
    asked = scene([-0.5, 0.2], [0.7, -0.3], [0.2, 0.4], [1.1, -0.5])
    both = (asked, mirrored(asked, np.array([1, -1])))
    one, other = (starting_strokes(ready(s), open_routes(s), Execution(), UtilityWeights(), 8).score for s in both)
    assert one == pytest.approx(other, abs=1e-6) and len(one) > 2


def test_open_ways_come_direct_ones_first() -> None:
    found = open_routes(scene([-0.5, 0.2], [0.7, -0.3], [0.2, 0.4], [1.1, -0.5]))
    assert found and not any(w.obstacle for w in found)
    direct = [w.bank < 0 and w.kick < 0 for w in found]
    assert direct == sorted(direct, reverse=True)
    assert [w.difficulty for w in found[: sum(direct)]] == sorted(w.difficulty for w in found[: sum(direct)])


def test_combinations_can_be_played() -> None:
    q = stroke_grid(LauncherModel(), CUT)
    assert (
        q.shape == (SPEED_STEPS * len(SCAN_OFFSETS), 4) and LauncherModel().allowed(q, BALL).all() and AIMS_PER_FAN % 2
    )


@pytest.mark.parametrize("cushion", ["bank", "kick"])
def test_fans_over_a_cushion_pot(cushion: str) -> None:
    asked = scene([0.3, -0.3], [0.15, 0.3], pocket=(0, -1)) if cushion == "bank" else scene([0.9, 0.3], [1.4, 0.6])
    rail = "+y" if cushion == "bank" else "-y"
    kind = {"bank": -1, "kick": -1} | {cushion: RAIL_NAMES.index(rail)}
    way = way_of(asked, (0, -1) if cushion == "bank" else (1, 1), **kind)
    player = ready(asked)
    begun = starting_strokes(player, [way], Execution(), UtilityWeights(foul=0.0), 6)
    assert len(begun.q) > 0 and begun.score.max() > 0.2
    out = player.screen(begun.q)
    assert (out.hits[out.potted, 2 if cushion == "bank" else 0] >= 1).all() and out.potted.any()


# The search.


def test_an_easy_pot_is_near_certain() -> None:
    for model in (MODEL, MODEL.add(Squirt(1.7))):
        found = search(ready(straight(pocket=(1, 1)), model), Execution(), UtilityWeights(), effort=QUICK)
        assert found[0].evaluation.made > 0.98
        assert all(one.evaluation.made >= MIN_MADE_PROBABILITY for one in found)
        values = [one.evaluation.value for one in found]
        assert values == sorted(values, reverse=True)


@pytest.mark.parametrize("short", [0.45, 0.8, 0.3])  # of the corner: stun, draw, follow
def test_the_cue_ball_comes_to_a_place_within_reach(short: float) -> None:
    asked = straight(pocket=(1, 1), rest=HALF - short * AWAY)
    best = search(ready(asked), EXACT, UtilityWeights(rest=0.5), effort=QUICK)[0].evaluation
    assert best.made == 1.0 and rest_distance(asked, best.outcomes).max() < 0.020
    q = best.q
    assert (
        np.array_equal(LauncherModel().playable(q[None], BALL)[0], q) and LauncherModel().allowed(q[None], BALL).all()
    )
    # It goes on, or comes back, by the spin that it meets the red with: a ball struck in its middle has picked some up.
    [track] = ready(asked).tracks(q[None], every=0.001)
    k = np.flatnonzero(track.times < track.events[0].time)[-1]
    (vx, vy), (wx, wy, _) = track.velocity[k, 0], track.spin[k, 0]
    assert (best.outcomes.hits[:, 1] == 0).all()
    assert math.copysign(1, vx * wy - vy * wx) == (-1 if short == 0.8 else 1)


@pytest.mark.slow
def test_a_stroke_for_errors_beats_the_best_without_them() -> None:
    execution, wish, made = Execution(0.02, 0.002, 0.001, 0.001), UtilityWeights(), []
    usual = Effort(fresh=256)
    for asked in (CUT, scene([-0.5, 0.3], [0.6, -0.4], pocket=(1, -1)), PUBLISHED):
        player = ready(asked) if asked is not PUBLISHED else Player(full_model(PAPER, BALL), asked, LauncherModel())
        both = np.array([search(player, e, wish, effort=usual, seed=2)[0].evaluation.q for e in (execution, EXACT)])
        made.append([j.value for j in evaluate(player, draw_errors(player.model, execution, 1024, 99), both, wish)])
    values = np.array(made)
    assert (values[:, 0] > values[:, 1] - 0.02).all()
    assert (values[:, 0] - values[:, 1]).max() > 0.1


@pytest.mark.parametrize("number", [0, 1, 2])
def test_probabilities_told_are_those_of_other_plays(number: int) -> None:
    """Not those of the plays that the stroke was chosen by: 4000 independent ones, errors of the model among them."""
    asked = (CUT, scene([-0.5, 0.3], [0.6, -0.4], pocket=(1, -1)), scene([0.1, 0.5], [0.3, -0.3], pocket="any"))[number]
    asked = dataclasses.replace(asked, goal=dataclasses.replace(asked.goal, pocket=None)) if number == 2 else asked
    execution, model, n = Execution(0.02, 0.003, 0.001, 0.001), fitted(0.8), 4000
    player = ready(asked, model)
    best = search(player, execution, UtilityWeights(), effort=dataclasses.replace(QUICK, fresh=1024))[0].evaluation
    rng = np.random.default_rng(number)
    sizes = np.array([0.02 * best.q[SPEED], 0.003, 0.001, 0.001])
    first, second = rng.standard_normal((2, n))
    known = model.parameters()
    values = {
        "decoupled_cloth.slide": known["decoupled_cloth.slide"] + 0.004 * first,
        "decoupled_cloth.roll": known["decoupled_cloth.roll"] + 0.0004 * (0.8 * first + 0.6 * second),
    }
    out = player.screen(best.q + sizes * rng.standard_normal((n, 4)), values)
    assert 0.05 < best.made < 0.999
    assert best.made == pytest.approx(out.made.mean(), abs=0.03)
    assert float(best.outcomes.foul.mean()) == pytest.approx(out.foul.mean(), abs=0.03)


def test_a_tilted_table_is_aimed_off_for() -> None:
    tilted, launcher, wish = (
        MODEL.add(TableTilt(0.0, 0.001)),
        Execution(0.002, 0.0005, 0.0002, 0.0002),
        UtilityWeights(0.8, 0.15),
    )
    asked = scene([0.9, 0.2], [1.5, 0.55], pocket=(1, 1), rest=[0.2, 0.2])
    q = [search(ready(asked, model), launcher, wish, effort=QUICK)[0].evaluation.q for model in (MODEL, tilted)]
    samples = draw_errors(tilted, launcher, 256, 98)
    level, aware = evaluate(ready(asked, tilted), samples, np.array(q), wish)
    assert aware.value > level.value + 0.02
    assert np.median(rest_distance(asked, aware.outcomes)) < np.median(rest_distance(asked, level.outcomes))


# The paper's method.


def test_the_published_stroke() -> None:
    """String '073p', 11 mm of draw, aim 0.515 rad from the paper's x; the cue ball stopped 110 mm off (physics: 90)."""
    speeds = np.array([2.05, 2.1, 2.15, 2.2])
    q = np.zeros((4, 4))
    q[:, SPEED], q[:, AZIMUTH], q[:, HEIGHT] = speeds, 0.515 - math.pi / 2, -0.011 * R / (R + 0.010)
    v, w = np.zeros((4, 2, 2)), np.zeros((4, 2, 3))
    v[:, 0], w[:, 0] = launch(q, np.zeros(4), BALL)
    start = np.broadcast_to(PUBLISHED.position, (4, 2, 2))
    model = full_model(PAPER, BALL).with_values(
        {"decoupled_cloth.slide": 0.212, "ball_impact.restitution": 0.89, "cushion_impact.restitution": 0.98}
    )
    result = finish(model, start, v, w)
    assert PUBLISHED.goal.rest is not None
    assert np.hypot(*(result.position[:, 0] - PUBLISHED.goal.rest).T).max() < 0.110
    early = finish(model, start, v, w, 0.4).position[:, 1]
    line = early - PUBLISHED.position[1]
    assert np.degrees(np.arctan2(line[:, 1], line[:, 0])) + 90 == pytest.approx(np.full(4, 49.7), abs=1.0)
    to = pocket_places(PAPER)[0, -1] - PUBLISHED.position[1]
    past = np.abs(line[:, 0] * to[1] - line[:, 1] * to[0]) / np.hypot(*line.T)
    assert past.max() < baseline.POCKET_TOLERANCE_M


@pytest.mark.slow
def test_the_papers_method_on_the_published_shot() -> None:
    player = Player(full_model(PAPER, BALL), PUBLISHED, LauncherModel())
    way, q, cost = baseline.search(player, seed=0)
    assert POCKETS[way.pocket] == (0, -1)
    assert cost < 0.110**2
    assert q[SPEED] / player.launcher.gain(q[None], BALL)[0] < 2.2
    assert math.hypot(q[SIDE], q[HEIGHT]) < 0.5 * R
    [track] = player.tracks(q[None], every=0.002, jaws=False)
    path = track.position[:, 1][np.isfinite(track.position[:, 1, 0])]
    assert np.hypot(*(path - pocket_places(PAPER)[0, -1]).T).min() < baseline.POCKET_TOLERANCE_M + 0.005
    assert PUBLISHED.goal.rest is not None
    assert np.hypot(*(track.position[-1, 0] - PUBLISHED.goal.rest)) == pytest.approx(math.sqrt(cost), abs=1e-6)
    again = baseline.search(player, seed=0)
    assert np.array_equal(again[1], q) and again[2] == cost


# The plan.


@pytest.fixture(scope="module")
def plan() -> dict[str, Any]:
    return make_plan(CUT, fitted(0.8), Execution(), UtilityWeights(), effort=QUICK, seed=4, threads=2)


def test_a_plan_keeps_the_contract(plan: dict[str, Any]) -> None:
    assert plan["format"] == "billiard-plan/1"
    for one in (plan, *plan["alternatives"]):
        assert set(one["stroke"]) == {"speed", "azimuth", "side", "height", "elevation"}
        assert {"string", "x0_mm", "y0_mm", "theta"} <= set(one["launcher"])
        assert re.fullmatch(r"[012]\d\dp", one["launcher"]["string"])
        for name in ("pot", "foul"):
            p = one[f"{name}_probability"]
            assert 0 <= p["low"] <= p["value"] <= p["high"] <= 1
        assert set(one["fouls"]) == set(FOULS)
        assert len(one["rest"]["mean"]) == len(one["rest"]["sd"]) == 2 and one["why"]
    low, high = plan["launcher"]["theta_tolerance_deg"]
    assert low <= 0 <= high and high - low > 0
    assert json.loads(json.dumps(plan)) == plan
    back = scene_from(plan["scene"], "plan")
    assert back.names == CUT.names and np.array_equal(back.position, CUT.position)
    values = [plan["value"], *(one["value"] for one in plan["alternatives"])]
    assert values == sorted(values, reverse=True)


def test_tracks_and_fan_tell_the_same_as_the_figures(plan: dict[str, Any]) -> None:
    place = dict(zip(CUT.names, CUT.position, strict=True))
    for tracks in (plan["tracks"], *(one["tracks"] for one in plan["fan"])):
        assert {"white", "red"} <= {track["ball"] for track in tracks} <= set(CUT.names)
        for track in tracks:
            assert track["xy"][0] == pytest.approx(place[track["ball"]], abs=1e-5) and track["t"][0] == 0.0
            assert len(track["t"]) == len(track["xy"]) and (np.diff(track["t"]) > 0).all()
    assert len(plan["fan"]) == 40
    share = np.mean([one["potted"] for one in plan["fan"]])
    assert share == pytest.approx(plan["pot_probability"]["value"], abs=0.15)
    for one in plan["fan"]:
        [red] = [track for track in one["tracks"] if track["ball"] == "red"]
        assert one["potted"] == (math.dist(red["xy"][-1], pocket_places(TABLE)[1, 1]) < 0.06)
    mean = np.mean(plan["places"]["cue"], axis=0)
    assert mean == pytest.approx(plan["rest"]["mean"], abs=1e-3)


def test_the_same_seed_gives_the_same_plan_at_any_number_of_threads(plan: dict[str, Any]) -> None:
    again = make_plan(CUT, fitted(0.8), Execution(), UtilityWeights(), effort=QUICK, seed=4, threads=1)
    assert json.dumps(again) == json.dumps(plan)


def test_a_plan_on_a_tilted_table_does_not_depend_on_threads() -> None:
    model, asked = MODEL.add(TableTilt(0.0005, 0.0003)), straight(0.8, 0.5, pocket=(1, 1))
    tiny = dataclasses.replace(QUICK, starts=2, fresh=32)
    one, two = (make_plan(asked, model, Execution(), UtilityWeights(), effort=tiny, threads=k) for k in (1, 2))
    assert json.dumps(one) == json.dumps(two) and one["stroke"]


def test_where_no_stroke_is_made_often_enough_there_is_none() -> None:
    blind = make_plan(straight(1.6, 1.4), MODEL, Execution(azimuth_sd=0.2), UtilityWeights(), effort=QUICK)
    assert blind["stroke"] is None and "paths are open" in blind["why"]


def test_what_cannot_be_planned_is_refused(tmp_path: Path) -> None:
    assert "method is 'best'" in refusal(lambda: make_plan(CUT, MODEL, Execution(), UtilityWeights(), method="best"))
    other = full_model(PAPER, Ball(0.0525, 0.1406))
    assert "the scene and the model differ in table.length" in refusal(
        lambda: make_plan(CUT, other, Execution(), UtilityWeights())
    )
    path = tmp_path / "p.json"
    assert "p.json" in refusal(lambda: read_plan(path))
    for text, words in (("{", "not JSON"), ("[]", "format is 'list'"), ('{"format": "x/2"}', "format is 'x/2'")):
        path.write_text(text)
        assert words in refusal(lambda: read_plan(path))
