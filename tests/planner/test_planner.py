"""What a stroke is and what comes of it: launcher errors, launcher terms, outcomes, worth and probabilities."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

import planner.evaluation.play
from models.analytic.cloth import rolling_velocity, slip
from models.effects.cue.squirt import Squirt
from models.model_file import full_model
from models.shot import Array, Table
from planner.evaluation.outcome import FOULS, Outcomes, concatenate
from planner.evaluation.risk import draw_errors, evaluate, wilson_interval
from planner.evaluation.value import UtilityWeights, position_quality, rest_distance, utility
from planner.launcher.execution import Execution, execution_from, normal_samples, read_execution
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, LauncherModel, launch, stroke_terms, with_speeds
from planner.scene import POCKETS, Scene, scene_dict, scene_from
from sysid.clips import Clip, ClipSet, CueCommand, Observation
from sysid.estimation.problem import turn
from sysid.estimation.shot_problem import shot_problem
from tests.support.clip_samples import refusal
from tests.support.planned_shots import (
    AWAY,
    BALL,
    DIAGONAL,
    HALF,
    MODEL,
    ROLL,
    SLIDE,
    TABLE,
    R,
    fitted,
    ready,
    scene,
    straight,
    stroke,
    strokes,
)


def fate(asked: Scene, q: Array) -> tuple[bool, tuple[str, ...]]:
    """Whether a stroke pots, and its fouls."""
    out = ready(asked).screen(q)
    return bool(out.potted[0]), tuple(name for name, has in zip(FOULS, out.fouls[0], strict=True) if has)


# Errors of the launcher.


def test_strokes_are_spread_by_what_is_asked() -> None:
    execution = Execution(0.02, 0.003, 0.0004, 0.0007)
    q = np.array([[1.5, 0.3, 0.004, -0.006], [0.8, -2.0, 0.0, 0.01]])
    played = execution.perturb(q, normal_samples(4096, 4, 3))
    assert played.shape == (2, 4096, 4)
    for row, asked in zip(played, q, strict=True):
        assert row.std(axis=0) == pytest.approx([0.02 * asked[0], 0.003, 0.0004, 0.0007], rel=0.01)
        assert np.abs(row.mean(axis=0) - asked) == pytest.approx(np.zeros(4), abs=1e-4)
    assert np.array_equal(Execution(0, 0, 0, 0).perturb(q, normal_samples(8, 4, 0)), np.repeat(q[:, None], 8, axis=1))


@pytest.mark.parametrize("seed", [0, 7])
def test_draws_are_the_same_again_and_even(seed: int) -> None:
    x = normal_samples(1024, 9, seed)
    assert np.array_equal(x, normal_samples(1024, 9, seed))
    assert not np.allclose(x, normal_samples(1024, 9, seed + 1))
    assert np.abs(x.mean(axis=0)).max() < 0.01
    assert x.std(axis=0) == pytest.approx(np.ones(9), abs=0.02)
    assert np.abs(np.corrcoef(x.T) - np.eye(9)).max() < 0.05
    for column in x.T:  # one point in each of so many equally likely intervals
        assert np.array_equal(np.sort((ndtr(column) * 1024 + 1e-7).astype(int)), np.arange(1024))
    assert normal_samples(100, 4, seed).shape == (100, 4)


def test_repeatability_is_read_from_a_file_and_from_a_model(tmp_path: Path) -> None:
    path = tmp_path / "e.toml"
    path.write_text("[execution]\nspeed_sd = 0.02\nheight_sd = 0\n[other]\nx = 1\n")
    assert read_execution(path) == Execution(speed_sd=0.02, height_sd=0.0)
    other = Execution(0.01, 0.002, 0.0, 0.001)
    assert execution_from(dataclasses.asdict(other), "model file") == other
    path.write_text("speed_sd = 0.02\n")
    assert "e.toml: [execution] is missing" in refusal(lambda: read_execution(path))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"sped_sd": 0.1}, ("sped_sd", "did you mean 'speed_sd'?")),
        ({"speed_sd": -0.1}, ("speed_sd = -0.1", "0 to 0.3")),
        ({"side_sd": "big"}, ("side_sd = 'big'", "write a number")),
        ({"azimuth_sd": True}, ("azimuth_sd = True",)),
        ({"azimuth_sd": 3.0}, ("azimuth_sd = 3.0", "looks like degrees")),
        ({"height_sd": math.nan}, ("height_sd = nan",)),
        (0.01, ("execution = 0.01", "azimuth_sd")),
    ],
)
def test_what_is_no_repeatability_is_named(data: Any, words: tuple[str, ...]) -> None:
    line = refusal(lambda: execution_from(data, "here"))
    assert line.startswith("here") and all(word in line for word in words)


# Strokes and launcher terms.


def test_a_launch_is_what_the_workbench_reads_from_a_cue() -> None:
    """The same command in a clip: speed along the aim, and spin, as sysid begins its fit from."""
    t = np.arange(30) / 120
    for q, elevation in zip(strokes(6, 1), (0.0, 0.11, 0.3, 0.0, 0.11, 0.3), strict=True):
        velocity, spin = launch(q[None], q[None, SIDE] * math.sin(elevation), BALL)
        seen = Observation(t, t[:, None] * velocity, np.full(30, np.nan))
        clip = Clip("a", "white", {"white": seen}, CueCommand(*(float(v) for v in q), elevation))
        mean = shot_problem(MODEL, (), ClipSet(TABLE, BALL, 120.0, (clip,)), 5e-4).prior.mean[0]
        back = turn(q[AZIMUTH]).T
        assert back @ velocity[0] == pytest.approx(mean[2:4], abs=1e-12)
        assert R * np.append(back @ spin[0, :2], spin[0, 2]) == pytest.approx(mean[4:7], abs=1e-12)


def test_strings_of_the_paper() -> None:
    full = with_speeds(LauncherModel(), 0.30, 2.75)
    for number, speed in ((1, 2.75), (200, 0.30), (73, 1.864)):
        assert full.cue_speed(number) == pytest.approx(speed, abs=5e-4)
        assert full.string(speed) == number
    speeds = [full.cue_speed(k) for k in range(1, 201)]
    assert (np.diff(speeds) < 0).all()
    assert [full.string(v) for v in speeds] == list(range(1, 201))
    assert (full.string(9.0), full.string(0.0)) == (1, 200)
    assert (
        LauncherModel().cue_speed(LauncherModel().string(2.75))
        <= 2.2
        < LauncherModel().cue_speed(LauncherModel().string(2.75) - 1)
    )


def test_ball_speed_over_cue_speed() -> None:
    """Published ratios, in the direction of the cue, for contacts to the side, above and below."""
    for offset, ratio in ((0.0, 1.366), (0.303, 1.157), (0.331, 1.125)):
        q = offset * R * np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, -1.0]])
        assert LauncherModel().gain(q, BALL) == pytest.approx(ratio * math.cos(math.radians(6.5)), abs=2e-3)


def test_two_fifths_of_the_radius_above_the_centre_give_natural_roll() -> None:
    velocity, spin = launch(np.array([[1.3, 0.7, 0.0, 0.4 * R]]), np.zeros(1), BALL)
    assert slip(velocity[0], spin[0], R) == pytest.approx([0, 0], abs=1e-12)


@pytest.mark.parametrize(("a", "angle"), [(0.1, 0.65), (0.2, 1.31), (0.304, 1.98), (0.331, 2.16), (0.5, 3.26)])
def test_swerve_is_the_published_one(a: float, angle: float) -> None:
    """The angle between aim and final roll at an elevation of 6.5 degrees, to the struck side.

    Here the offset is that of the spin over the horizontal speed, which is 0.6 % below the speed along the cue.
    """
    velocity, spin = launch(np.array([[1.0, 0.3, a * R, 0.0]]), np.array([a * R * math.sin(math.radians(6.5))]), BALL)
    rolling = rolling_velocity(velocity[0], spin[0], R)
    assert math.degrees(0.3 - math.atan2(rolling[1], rolling[0])) == pytest.approx(angle, rel=0.01)


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.95, 1.0]))
def test_what_strings_and_steps_can_ask_for_is_near(seed: int, out: float) -> None:
    launcher, q = LauncherModel(), strokes(8, seed)
    size, limit = np.hypot(q[:, SIDE], q[:, HEIGHT]), launcher.offset * R
    q[:, [SIDE, HEIGHT]] *= (out * limit / size if out else np.minimum(1.0, 0.95 * limit / size))[:, None]
    got = launcher.playable(q, BALL)
    assert launcher.playable(got, BALL) == pytest.approx(got, abs=1e-12)
    assert launcher.allowed(got, BALL).all()
    assert np.array_equal(got[:, AZIMUTH], q[:, AZIMUTH])
    step = launcher.step * R / (R + launcher.cue.tip_radius)
    most = (0.5 if out < 1 else 1.0) * step + 1e-12
    assert np.abs(got - q)[:, [SIDE, HEIGHT]].max() <= most
    assert got[:, [SIDE, HEIGHT]] / step == pytest.approx(np.round(got[:, [SIDE, HEIGHT]] / step), abs=1e-6)
    gain = launcher.gain(got, BALL)
    cue_speed = np.clip(q[:, SPEED] / gain, launcher.slowest, launcher.fastest)
    assert np.abs(got[:, SPEED] / gain - cue_speed).max() <= 0.5 * 2.45 / 199 + 1e-12


def test_launcher_terms() -> None:
    launcher = LauncherModel()
    for q in launcher.playable(strokes(20, 4), BALL):
        terms = launcher.command(MODEL, q)
        assert terms["x0_mm"] == pytest.approx(1e3 * q[SIDE] * (R + 0.010) / R, abs=6e-4)
        assert terms["y0_mm"] == pytest.approx(1e3 * q[HEIGHT] * (R + 0.010) / R, abs=6e-4)
        assert launcher.cue_speed(int(terms["string"][:3])) == pytest.approx(terms["cue_speed"], abs=1e-9)
        assert terms["string"][3:] == "p" and len(terms["string"]) == 4
        # The cue is turned so that squirt, to the side away from the tip, brings the ball back on its way.
        assert math.sin(terms["theta"] + terms["squirt"] - q[AZIMUTH]) == pytest.approx(0.0, abs=1e-12)
        thrown = ready(straight(), MODEL.add(Squirt(2.5 / R / (3.5 + 20)))).deflection(q[None])[0]
        assert math.copysign(1, terms["squirt"]) == math.copysign(1, thrown)
        assert thrown == pytest.approx(terms["squirt"], rel=0.2)
        assert terms["theta_deg"] == pytest.approx(math.degrees(terms["theta"]), abs=6e-4)
        aware = launcher.command(MODEL.add(Squirt(1.5)), q)
        assert aware["squirt"] == 0.0 and aware["theta"] == pytest.approx(q[AZIMUTH])
        assert aware["string"] == terms["string"]


def test_a_stroke_by_names() -> None:
    told = stroke_terms(LauncherModel(), np.array([1.5, 4.0, 0.001, -0.002]))
    assert list(told) == ["speed", "azimuth", "side", "height", "elevation"]
    assert list(told.values()) == pytest.approx([1.5, 4.0 - 2 * math.pi, 0.001, -0.002, math.radians(6.5)])


# What comes of shots.


def test_shots_of_known_fate() -> None:
    line = straight()
    assert fate(line, stroke(1.6, height=-0.3)) == (True, ())
    assert fate(line, stroke(1.6, height=0.5)) == (True, ("in-off",))  # follows straight in
    assert fate(line, stroke(1.6, azimuth=-2.0)) == (False, ("wrong ball first",))  # hits nothing
    assert fate(straight(pocket=(1, -1)), stroke(1.6, height=-0.3)) == (False, ())
    middle = line.position.mean(axis=0)
    assert fate(straight(0.5, 0.4, middle), stroke(1.6)) == (True, ("wrong ball first",))  # by way of it
    assert fate(straight(0.5, 0.4, middle, avoid=("b0",)), stroke(1.6))[1] == ("wrong ball first", "forbidden touch")
    # A ball that the red drives in before it.
    plant = straight(0.8, 0.4, HALF - 0.3 * AWAY)
    assert fate(plant, stroke(1.6, height=-0.3)) == (False, ("another ball potted",))
    plant = straight(0.8, 0.4, HALF - 0.3 * AWAY, avoid=("b0",))
    assert fate(plant, stroke(1.6, height=-0.3)) == (False, ("another ball potted", "forbidden touch"))


def test_which_pocket_and_where_the_balls_stay() -> None:
    asked = straight(0.5, 0.4, [-1.0, 0.2])
    out = ready(asked).screen(np.concatenate([stroke(1.6, height=-0.3), stroke(1.6, height=0.5), stroke(0.9, -2.0)]))
    assert [POCKETS[k] for k in out.pocket[:2]] == [(1, 1), (1, 1)] and out.pocket[2] == -1
    assert np.isnan(out.place[:2, 1]).all() and np.isfinite(out.place[2]).all()
    assert np.isfinite(out.cue[0]).all() and np.isnan(out.cue[1]).all()
    assert out.place[:, 2].tolist() == [[-1.0, 0.2]] * 3
    assert out.made.tolist() == [True, False, False]
    both = concatenate([out.rows(slice(0, 1)), out.rows(np.array([False, True, True]))])
    assert np.array_equal(both.place, out.place, equal_nan=True) and np.array_equal(both.fouls, out.fouls)


def test_cushions_are_counted_by_ball_and_before_and_after() -> None:
    kick = scene([0.3, 0.0], [1.2, 0.0])
    aim = math.atan2(2 * TABLE.centre_limits(BALL)[1], 0.9)
    player, fan = ready(kick), aim + np.linspace(-0.1, 0.1, 201)
    out = player.screen(np.concatenate([stroke(2.0, a) for a in fan]))
    met = out.fouls[:, FOULS.index("wrong ball first")] == 0
    assert met.sum() > 20 and (out.hits[met, 0] == 1).all() and out.hits[met, 1].any()
    assert (out.hits[~met, 1:] == 0).all()  # none comes after a ball that was not met
    bank = ready(scene([-1.0, 0.0], [-0.5, 0.0])).screen(stroke(1.8, 0.0)).hits[0]
    assert bank[0] == 0 and bank[2] >= 1


def test_a_shot_that_is_given_up_is_no_pot_and_no_foul(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner.evaluation.play, "MAX_EVENTS", 2)
    out = ready(straight()).screen(stroke(1.6, height=0.5))
    assert not out.potted[0] and not out.foul[0] and out.pocket[0] == -1 and np.isnan(out.cue).all()


def test_a_model_of_another_table_is_refused() -> None:
    line = refusal(lambda: ready(straight(), full_model(Table(3.5, 1.75), BALL)))
    assert "differ in table.length (3.569 and 3.5) and table.width (1.778 and 1.75)" in line
    bare = dataclasses.replace(MODEL, effects=MODEL.effects[:2])
    assert "it has no effect for cushion; fit one" in refusal(lambda: ready(straight(), bare))


# What outcomes are worth.


def ended(cue: Any, *others: Any, made: bool = True, foul: bool = False) -> Outcomes:
    """One outcome with the cue ball at a place, the red gone."""
    place = np.array([[cue, [np.nan, np.nan], *others]], float)
    fouls = np.array([[foul, False, False, False]])
    return Outcomes(np.array([made]), np.array([0]), fouls, place, np.zeros((1, 3), np.int64))


def test_worth_falls_with_the_distance_from_the_wanted_place() -> None:
    asked = straight(rest=[0.2, 0.1])
    wish = UtilityWeights(rest=0.4, far=0.5, foul=0.7)
    places = [[0.2 + d, 0.1] for d in (0.0, 0.1, 0.25, 0.5, 0.8)]
    told = [float(utility(asked, ended(xy), wish)[0]) for xy in places]
    assert told == pytest.approx([1.0, *(0.6 + 0.4 * np.exp(-np.array([0.2, 0.5, 1.0, 1.6])))], abs=1e-9)
    assert utility(asked, ended([0.2, 0.1], made=False), wish)[0] == 0.0
    assert utility(asked, ended([0.2, 0.1], made=False, foul=True), wish)[0] == pytest.approx(-0.7)
    assert utility(asked, ended([np.nan, np.nan], made=False, foul=True), wish)[0] == pytest.approx(-0.7)
    assert utility(straight(), ended([-1.0, 0.5]), wish)[0] == 1.0
    assert np.isnan(rest_distance(asked, ended([np.nan, np.nan]))).all()


def test_all_places_of_a_region_are_as_good() -> None:
    asked = straight(rest=[0.2, 0.1], rest_radius=0.2)
    told = [float(position_quality(asked, ended([0.2, 0.1 + d]), 0.5)[0]) for d in (0.0, 0.2, 0.3, 0.45, 0.7, 0.9)]
    assert told == pytest.approx([1.0, 1.0, *np.exp(-np.array([0.2, 0.5, 1.0, 1.4]))])
    assert rest_distance(asked, ended([0.2, 0.45]))[0] == pytest.approx(0.15)


def test_the_next_shot() -> None:
    blue = HALF - 0.5 * AWAY
    asked = scene([-1, 0], [0, 0], blue, [-1.5, 0.0], rest_for="b0")

    def good(cue: Any, other: Any = (-1.5, 0.0)) -> float:
        return float(position_quality(asked, ended(cue, blue, other), 0.5)[0])

    near, far = blue - 0.4 * AWAY, blue - 0.8 * AWAY
    assert good(near) == pytest.approx(math.exp(-(0.4 - 2 * R + 0.5) / 3.0))
    assert good(near) > good(far) > 0
    thin = blue + 0.8 * np.array([math.sin(DIAGONAL - 1.25), -math.cos(DIAGONAL - 1.25)])
    assert good(thin) < 0.7 * good(near)
    assert good(near, blue - 0.2 * AWAY) < 0.5 * good(near)  # a ball between them leaves other pockets
    assert good(near, blue + 0.2 * AWAY) < 0.5 * good(near)
    assert good([np.nan, np.nan]) == 0.0
    shut = scene([-1, 0], [0, 0], blue, pocket=(1, 1), rest_for="b0")
    ring = [blue + 2.05 * R * np.array([math.cos(a), math.sin(a)]) for a in np.arange(6) * math.pi / 3]
    assert (
        position_quality(dataclasses.replace(shut, names=(*shut.names, *"uvwxyz")), ended(near, blue, *ring), 0.5)[0]
        == 0.0
    )


# Probabilities.


@pytest.mark.parametrize("correlation", [-0.9, 0.0, 0.8])
def test_constants_come_as_uncertain_and_as_correlated_as_fitted(correlation: float) -> None:
    model = fitted(correlation)
    samples = draw_errors(model, Execution(), 2048, 3)
    assert set(samples.values) == {SLIDE, ROLL} and len(samples) == 2048
    for name, sd in ((SLIDE, 0.004), (ROLL, 0.0004)):
        assert samples.values[name].mean() == pytest.approx(model.parameters()[name], abs=0.02 * sd)
        assert samples.values[name].std() == pytest.approx(sd, rel=0.02)
    every = np.column_stack([samples.normal, samples.values[ROLL], samples.values[SLIDE]])
    found = np.corrcoef(every.T) - np.eye(6)
    found[4:, 4:] -= correlation * (1 - np.eye(2))
    assert np.abs(found).max() < 0.03
    again = draw_errors(model, Execution(), 2048, 3)
    assert np.array_equal(again.normal, samples.normal) and np.array_equal(again.values[ROLL], samples.values[ROLL])
    assert np.array_equal(samples.first(64).values[ROLL], samples.values[ROLL][:64])


def test_constants_stay_within_their_bounds() -> None:
    samples = draw_errors(fitted(sd=60.0), Execution(), 512, 0)
    for name, values in samples.values.items():
        low, high = MODEL.meta(name)["bounds"]
        assert low <= values.min() and values.max() <= high and values.std() > 0
    assert draw_errors(MODEL, Execution(), 16, 0).values == {}


@pytest.mark.parametrize(
    ("hits", "count", "low", "high"),
    # Newcombe (1998), table I, and values of R's prop.test without continuity correction.
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718),
     (29, 29, 0.8830, 1.0), (0, 10, 0.0, 0.2775), (10, 20, 0.2993, 0.7007)],
)  # fmt: skip
def test_intervals_of_the_tables(hits: int, count: int, low: float, high: float) -> None:
    assert wilson_interval(hits, count) == pytest.approx((hits / count, low, high), abs=6e-5)
    assert wilson_interval(0, 0)[1:] == (0.0, 1.0) and math.isnan(wilson_interval(0, 0)[0])


def test_a_probability_is_that_of_independent_plays() -> None:
    """Common samples against plain draws with their own errors of stroke and table, 4000 of them."""
    execution, model = Execution(0.02, 0.006, 0.001, 0.001), fitted(0.8, 3.0)
    player, q = ready(straight(0.9, 0.7, rest=[0.5, 0.0]), model), stroke(1.4, side=0.1, height=-0.2)
    told = evaluate(player, draw_errors(model, execution, 1024, 9), q, UtilityWeights())[0]
    rng, n = np.random.default_rng(4), 4000
    played = q + rng.standard_normal((n, 4)) * [0.02 * q[0, 0], 0.006, 0.001, 0.001]
    first, second = rng.standard_normal((2, n))
    off = {SLIDE: 0.012 * first, ROLL: 0.0012 * (0.8 * first + 0.6 * second)}
    out = player.screen(played, {k: model.parameters()[k] + v for k, v in off.items()})
    brute = out.made.mean()
    assert 0.1 < brute < 0.9
    assert told.made == pytest.approx(brute, abs=3 * math.sqrt(brute * (1 - brute) * (1 / n + 1 / 1024)))
    figures = told.figures(player.scene)
    assert figures["made_probability"]["low"] < told.made < figures["made_probability"]["high"]
    cue = out.cue[np.isfinite(out.cue[:, 0])]
    assert figures["rest"]["mean"] == pytest.approx(cue.mean(axis=0), abs=0.01)
    assert figures["rest"]["sd"] == pytest.approx(cue.std(axis=0), rel=0.1)
    assert figures["fouls"].keys() == set(FOULS)
    assert told.value == pytest.approx(utility(player.scene, out, UtilityWeights()).mean(), abs=0.03)


def test_a_table_without_room_for_its_pockets_is_refused_as_a_scene() -> None:
    tiny = dataclasses.replace(scene((0, 0), (0.08, 0)), table=Table(0.3, 0.28))
    told = refusal(lambda: scene_from(scene_dict(tiny), "s.toml"))
    assert told.startswith(
        "s.toml [table]: a table of 0.3 x 0.28 m has no room for its pockets: correct length and width"
    )
