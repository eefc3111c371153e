"""The shot as a dm_control task: dm_env's own tests, symmetry, repeatable chance, rewards, bounds, bad input."""

from __future__ import annotations

import dataclasses
import math
import unittest
from collections import OrderedDict
from typing import Any

import numpy as np
import pytest
from dm_control.rl import control
from dm_env import StepType, test_utils
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.effect_catalogue import effect_class
from models.environment.task import ActionBounds, ShotEnvironment, ShotPhysics, ShotTask
from models.errors import BadInput
from models.model_file import Estimate, Model, full_model
from models.shot import Table
from models.table.pocket_shape import read_pockets
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner import example_environment
from planner.environment import as_strokes, load
from planner.evaluation.play import Player
from planner.evaluation.value import UtilityWeights, utility
from planner.launcher.execution import Execution
from planner.launcher.stroke import LauncherModel
from planner.scene import POCKETS, Goal, Scene

Array = NDArray[np.float64]
STEADY = Execution(0.0, 0.0, 0.0, 0.0)
LAUNCHER = LauncherModel()
STRAIGHT = math.atan2(0.889 - 0.45, 1.7845 - 1.35)  # from the white over the red to the corner
UNSURE = {"decoupled_cloth.roll": 0.0006, "ball_impact.restitution": 0.01, "cushion_impact.friction": 0.02}
BOUNDS = ActionBounds(0.3, 2.2, 0.018)


def model(unsure: bool = False) -> Model:
    base = full_model(SNOOKER_TABLE, SNOOKER_BALL)
    known = {name: Estimate(sd) for name, sd in UNSURE.items()} if unsure else {}
    return dataclasses.replace(base, estimates=known)


def scene(mirrored: bool = False, **goal: Any) -> Scene:
    """White, red and the corner in line, a blue aside."""
    red = np.array([1.35, 0.45])
    places = np.array([red - 0.5 * np.array([math.cos(STRAIGHT), math.sin(STRAIGHT)]), red, [0.0, -0.5]])
    sign = np.array([1.0, -1.0 if mirrored else 1.0])
    given = {"pocket": (1, -1 if mirrored else 1)} | goal
    return Scene(SNOOKER_TABLE, SNOOKER_BALL, ("white", "red", "blue"), places * sign, Goal("white", "red", **given))


def drawn(rng: np.random.Generator) -> Scene:
    """Two to four balls anywhere, apart from each other."""
    places = np.array([[-1.2, 0.4], [-0.4, -0.4], [0.4, 0.4], [1.2, -0.4]])[: rng.integers(2, 5)]
    names = ("white", "red", "blue", "pink")[: len(places)]
    goal = Goal("white", "red", POCKETS[rng.integers(6)] if rng.random() < 0.5 else None)
    return Scene(SNOOKER_TABLE, SNOOKER_BALL, names, places + rng.uniform(-0.3, 0.3, places.shape), goal)


def asks(n: int, seed: int) -> Array:
    """Actions of all kinds, near the line of the pot."""
    rng = np.random.default_rng(seed)
    out = rng.uniform([0.5, -0.012, -0.012, 0], [2.2, 0.012, 0.012, 0], (n, 4))
    out[:, 3] = STRAIGHT + rng.normal(0, 0.02, n)
    return out


class Conforms(test_utils.EnvironmentTestMixin, unittest.TestCase):
    """dm_env's own tests, on one scene in MuJoCo."""

    def make_object_under_test(self) -> ShotEnvironment:
        return load(scene(rest=np.array([0.5, 0.0])), model(unsure=True))

    def make_action_sequence(self) -> list[Array]:
        return list(asks(6, 0))


class ConformsOnDrawnScenes(Conforms):
    """The same with a number of balls that changes, in the event engine."""

    def make_object_under_test(self) -> ShotEnvironment:
        return load(drawn, model(), balls=5, mujoco=False)


class ConformsFlat(Conforms):
    """The same with one vector observed."""

    def make_object_under_test(self) -> ShotEnvironment:
        return load(scene(), model(), flat=True)


def test_it_is_a_task_of_dm_control_and_ends_after_a_shot() -> None:
    environment = load(scene(), model())
    assert isinstance(environment, control.Environment)
    assert isinstance(environment.task, ShotTask) and isinstance(environment.task, control.Task)
    assert isinstance(environment.physics, ShotPhysics) and isinstance(environment.physics, control.Physics)
    spec, first = environment.observation_spec(), environment.reset()
    assert isinstance(first.observation, OrderedDict) and list(first.observation) == list(spec)
    assert (environment.physics.time(), environment.control_timestep()) == (0.0, 1.0)
    last = environment.step(asks(1, 1)[0])
    assert (last.step_type, last.discount, environment.physics.time()) == (StepType.LAST, 0.0, 1.0)
    assert environment.step(asks(1, 1)[0]).step_type is StepType.FIRST


def test_a_mirrored_scene_pays_the_same_for_mirrored_actions() -> None:
    actions = asks(30, 2)
    rest = np.array([0.5, 0.1])
    one = load(scene(rest=rest), model(), STEADY, UtilityWeights(far=2.0)).rewards(actions)
    other = load(scene(mirrored=True, rest=rest * [1, -1]), model(), STEADY, UtilityWeights(far=2.0)).rewards(
        actions * [1, -1, 1, -1]
    )
    assert one == pytest.approx(other, abs=1e-6)
    assert len(set(one.round(3))) > 3


def test_the_reward_is_the_worth_of_the_shot() -> None:
    wish = UtilityWeights(rest=0.4, far=1.0, foul=0.3)
    where = scene(rest=np.array([0.9, 0.2]))
    environment, player = load(where, model(), STEADY, wish), Player(model(), where, LAUNCHER)
    actions = asks(8, 3)
    wanted = utility(where, player.play(as_strokes(LAUNCHER, model(), actions)), wish)
    assert len(set(wanted.round(3))) > 2
    for action, reward in zip(actions, wanted, strict=True):
        environment.reset()
        assert environment.step(action).reward == pytest.approx(reward, abs=1e-12)


@pytest.mark.parametrize("mujoco", [True, False])
def test_hand_made_shots_pay_what_anyone_can_tell(mujoco: bool) -> None:
    environment = load(scene(), model(), STEADY, UtilityWeights(rest=0.2, far=0.5, foul=0.5), mujoco=mujoco)
    environment.reset()
    stun = environment.step([1.2, 0.0, 0.0, STRAIGHT])
    assert stun.reward == 1.0  # potted, any place will do
    assert stun.observation["on_table"].tolist() == [True, False, True]
    assert np.all(stun.observation["position"][1] == 0)
    assert stun.observation["position"][2] == pytest.approx([0.0, -0.5])
    environment.reset()
    assert environment.step([0.4, 0.0, 0.0, STRAIGHT + math.pi]).reward == -0.5  # hits nothing
    environment.reset()
    follow = environment.step([2.0, 0.0, 0.017, STRAIGHT])
    assert follow.reward == 0.5 - 1.0  # potted, and in after it: a foul
    assert not follow.observation["on_table"][:2].any()


def test_the_engine_pays_what_mujoco_does() -> None:
    actions, known = asks(40, 4), model(unsure=True)
    slow, fast = (load(scene(), known, seed=5, mujoco=mujoco) for mujoco in (True, False))
    assert slow.rewards(actions) == pytest.approx(fast.rewards(actions), abs=1e-6)


@pytest.mark.parametrize("mujoco", [True, False])
def test_all_effects_act(mujoco: bool) -> None:
    tilted = model().add(effect_class("table_tilt")(slope_x=0.004))
    action = [0.7, 0.0, 0.0, STRAIGHT]
    ends = []
    for known in (model(), tilted):
        environment = load(scene(), known, STEADY, mujoco=mujoco)
        environment.reset()
        ends.append(environment.step(action).observation["position"][0])
    assert float(np.hypot(*(ends[0] - ends[1]))) > 0.01


def test_actions_are_in_the_launchers_terms() -> None:
    actions = asks(20, 6)
    q = as_strokes(LAUNCHER, model(), actions)
    terms = [LAUNCHER.command(model(), row) for row in q]
    assert [t["cue_speed"] for t in terms] == pytest.approx(actions[:, 0].tolist())
    for key, column in (("x0_mm", 1), ("y0_mm", 2)):
        assert [t[key] for t in terms] == pytest.approx((1e3 * actions[:, column]).tolist(), abs=1e-3)
    assert [t["theta"] for t in terms] == pytest.approx(actions[:, 3].tolist())
    # A cue that is offset to the right sends the ball to the left; a model that says so itself is told the cue's aim.
    assert np.all(np.sign(q[:, 1] - actions[:, 3]) == np.sign(actions[:, 1]))
    squirting = model().add(effect_class("squirt")())
    assert as_strokes(LAUNCHER, squirting, actions)[:, 1] == pytest.approx(actions[:, 3])


@pytest.mark.parametrize("source", [scene(), drawn])
def test_a_seed_says_all_that_is_drawn(source: Any) -> None:
    def told(seed: int) -> list[Any]:
        environment, out = load(source, model(unsure=True), seed=seed, balls=5), []
        for action in asks(2, 7):
            first, last = environment.reset(), environment.step(action)
            out += [v for t in (first, last) for v in (*t.observation.values(), t.reward)]
            out.append(environment.expected([action], 2))
        return out

    one, same, other = told(3), told(3), told(4)
    assert all(np.array_equal(a, b) for a, b in zip(one, same, strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_every_reset_draws_other_physics_that_are_not_shown() -> None:
    environment = load(scene(), model(unsure=True), STEADY, seed=8, mujoco=False)
    first, ends, values = environment.reset(), [], []
    for _ in range(60):
        assert all(np.array_equal(v, first.observation[k]) for k, v in environment.reset().observation.items())
        ends.append(environment.step([1.0, 0.0, 0.0, STRAIGHT + 0.1]).observation["position"][0])
        values.append([float(environment.physics.episode.samples.values[name][0]) for name in UNSURE])
    assert len({tuple(end) for end in ends}) == 60
    known = model().parameters()
    for name, found in zip(UNSURE, np.array(values).T, strict=True):
        assert abs(found.mean() - known[name]) < 4 * UNSURE[name] / math.sqrt(60)
        assert 0.7 < found.std() / UNSURE[name] < 1.3
    sure = load(scene(), model(), STEADY)
    again = [(sure.reset(), sure.step([1.0, 0.0, 0.0, 0.9]).observation["position"][0])[1] for _ in range(3)]
    assert all(np.array_equal(a, again[0]) for a in again)


def test_the_launcher_errs_differently_every_time() -> None:
    environment = load(scene(), model(), Execution(), seed=9)
    ends = []
    for _ in range(4):
        environment.reset()
        last = environment.step([1.0, 0.0, 0.0, STRAIGHT + 0.1])
        ends.append(tuple(last.observation["position"][0]))
        assert last.observation["sent"].tolist() == [1.0, 0.0, 0.0, STRAIGHT + 0.1]
    assert len(set(ends)) == 4


def test_many_at_once_are_paid_as_one_by_one_would_be() -> None:
    environment, actions = load(scene(), model(unsure=True), seed=10), asks(6, 11)
    environment.reset()
    together = environment.rewards(actions)
    paid = environment.step(actions[0]).reward
    assert paid == together[0]
    assert environment.rewards(actions[3:4]) == together[3:4]  # after the shot too, from the same start
    assert np.array_equal(load(scene(), model(unsure=True), seed=10).rewards(actions), together)
    assert environment.rewards(np.zeros((0, 4))).shape == (0,)


def test_the_mean_reward_falls_for_a_bad_stroke_and_an_unsteady_hand() -> None:
    good, fair, bad = [1.2, 0.0, 0.0, STRAIGHT], [1.2, 0.0, 0.0, STRAIGHT + 0.008], [1.2, 0.0, 0.0, STRAIGHT + 0.2]
    environment = load(scene(), model(unsure=True), seed=12, mujoco=False)
    values = environment.expected([good, fair, bad, good], 48)
    assert 1.0 >= values[0] > values[1] + 0.05
    assert values[1] > values[2]
    assert values[0] == values[3]  # one set of samples for all
    unsteady = load(scene(), model(unsure=True), Execution(azimuth_sd=0.01), seed=12, mujoco=False)
    assert unsteady.expected([good], 48)[0] < values[0] - 0.1


def test_the_goal_is_observed() -> None:
    where = scene(rest=np.array([0.5, 0.1]), rest_radius=0.2, avoid=("blue",))
    seen = load(where, model(), balls=4).reset().observation
    assert seen["pocket"] == pytest.approx([1.7845, 0.889])
    assert seen["rest"] == pytest.approx([0.5, 0.1])
    assert (seen["any_pocket"][0], seen["any_rest"][0], seen["rest_radius"][0]) == (False, False, 0.2)
    assert seen["avoid"].tolist() == [False, False, True, False]
    assert seen["on_table"].tolist() == [True, True, True, False]
    assert seen["position"][:3] == pytest.approx(where.position)
    free = load(scene(pocket=None, rest_for="blue"), model(), balls=4).reset().observation
    assert (free["any_pocket"][0], free["any_rest"][0]) == (True, True)
    assert free["rest_for"].tolist() == [False, False, True, False]
    seen["position"][:] = 9.0
    assert np.all(load(where, model()).reset().observation["position"] < 2)


def test_bounds_are_the_launchers() -> None:
    spec = load(scene(), model()).action_spec()
    axis = 0.5 * (0.02625 + 0.010)  # half the radius at the contact, farther out at the axis
    assert spec.maximum == pytest.approx([2.2, axis, axis, math.pi])
    assert spec.minimum == pytest.approx([0.3, -axis, -axis, -math.pi])
    rim = np.array([[2.2, axis * math.cos(a), axis * math.sin(a), 0.1] for a in np.linspace(0, 6, 25)])
    assert LAUNCHER.allowed(as_strokes(LAUNCHER, model(), rim), SNOOKER_BALL).all()


@given(st.lists(st.tuples(*[st.floats(-40, 40)] * 4), min_size=1, max_size=5))
@settings(max_examples=200)
def test_what_is_sent_lies_within_reach_and_points_the_same_way(rows: list[tuple[float, ...]]) -> None:
    asked = np.array(rows) * [0.1, 1e-3, 1e-3, 0.2]
    sent = BOUNDS.clip(asked)
    spec, slack = BOUNDS.spec(), 1e-12
    assert (sent >= spec.minimum - slack).all() and (sent <= spec.maximum + slack).all()
    assert (np.hypot(sent[:, 1], sent[:, 2]) <= BOUNDS.offset + slack).all()
    assert sent[:, 1] * asked[:, 2] == pytest.approx(sent[:, 2] * asked[:, 1], abs=1e-15)
    assert (sent[:, 1:3] * asked[:, 1:3] >= 0).all()
    assert np.cos(sent[:, 3] - asked[:, 3]) == pytest.approx(np.ones(len(asked)))
    assert BOUNDS.clip(sent) == pytest.approx(sent, abs=1e-15)
    inside = (
        (np.hypot(asked[:, 1], asked[:, 2]) < BOUNDS.offset)
        & (asked[:, 0] >= 0.3) & (asked[:, 0] <= 2.2) & (np.abs(asked[:, 3]) <= math.pi)
    )  # fmt: skip
    assert np.array_equal(sent[inside], asked[inside])


def test_an_action_beyond_reach_says_what_was_played() -> None:
    environment = load(scene(), model(), STEADY)
    limit = float(environment.action_spec().maximum[1])
    environment.reset()
    beyond = environment.step([9.0, 3 * limit, 4 * limit, STRAIGHT])
    assert beyond.observation["sent"] == pytest.approx([2.2, 0.6 * limit, 0.8 * limit, STRAIGHT])
    environment.reset()
    within = environment.step(beyond.observation["sent"])
    assert within.observation["position"] == pytest.approx(beyond.observation["position"])


def test_bad_input_is_named() -> None:
    environment = load(scene(), model())
    environment.reset()
    with pytest.raises(ValueError, match="holds nan; give finite cue speed"):
        environment.step([1.0, math.nan, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"shape \(1, 3\); give \(n, 4\)"):
        environment.step([1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="n_sub_steps is 2"):
        environment.physics.step(2)
    with pytest.raises(BadInput, match="plays is 0; give 1 or more"):
        environment.expected(asks(1, 0), 0)
    with pytest.raises(BadInput, match="3 balls, but 2 are observed; increase `balls`"):
        load(scene(), model(), balls=2)
    with pytest.raises(BadInput, match=r"differ in table.length \(3.569 and 2.0\) and table.width"):
        load(scene(), full_model(Table(2.0, 1.0), SNOOKER_BALL))
    with pytest.raises(BadInput, match=r'differ in table.pockets \("snooker" and "pool 9 ft"\): correct the scene'):
        load(scene(), full_model(dataclasses.replace(SNOOKER_TABLE, pockets=read_pockets("pool 9 ft")), SNOOKER_BALL))


@pytest.mark.slow
def test_the_example_finds_a_shot(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(example_environment, "FINAL_SAMPLES", 64)
    assert example_environment.main(["--seed", "1"]) == 0
    before, after = (float(part.split()[-2]) for part in capsys.readouterr().out.split("(")[0].split(":")[1].split(","))
    assert before < 0.1
    assert after > 0.9
    assert example_environment.main(["--scene", "one.toml"]) == 2
    assert "--scene and --model go together" in capsys.readouterr().err
    assert example_environment.main(["--seed", "-1"]) == 2
    assert "--seed -1: give a whole number of 0 or more" in capsys.readouterr().err
