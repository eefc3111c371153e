"""The shot as others call it: pictures of the dm_control task, and Gymnasium's own check of its interface."""

from __future__ import annotations

import builtins
import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from models.environment.task import ShotEnvironment
from models.errors import BadInput
from models.mjcf.world import colour
from models.model_file import Model
from planner.environment import gymnasium_env, load
from planner.example_environment import example_model, example_scene
from planner.scene import Goal, Scene

LEFT_OUT = "needs the extra gym: pip install -e '.[gym]'"


def scene() -> Scene:
    return example_scene()


def places_of(picture: NDArray[np.uint8], name: str) -> NDArray[np.float64]:
    """Pixels of the colour of a ball: (n, 2), column and row."""
    way = picture.reshape(*picture.shape[:2], 3) / np.maximum(np.linalg.norm(picture, axis=2, keepdims=True), 1)
    wanted = np.array(colour(name)) / np.linalg.norm(colour(name))
    rows, columns = np.nonzero((np.linalg.norm(way - wanted, axis=2) < 0.15) & (picture.max(axis=2) > 60))
    return np.stack([columns, rows], axis=1).astype(float)


@pytest.mark.gl
def test_the_task_draws_its_table_from_above() -> None:
    environment = load(scene(), example_model())
    environment.reset()
    physics = environment.physics
    picture = physics.render(480, 640)
    assert picture.shape == (480, 640, 3) and picture.dtype == np.uint8
    # The camera stands 1.05 lengths above the middle, with 45 degrees from top to bottom.
    high = 1.05 * scene().table.length * np.tan(np.radians(22.5))
    for name, xy in zip(scene().names[1:], scene().position[1:], strict=True):
        expected = 320 + 240 * xy[0] / high, 240 - 240 * xy[1] / high
        seen = places_of(picture, name)
        near = seen[np.hypot(*(seen - expected).T) < 6]
        assert len(near) > 3, name
        assert near.mean(axis=0) == pytest.approx(expected, abs=1.5)
    physics.free()


@pytest.mark.slow
@pytest.mark.gl
def test_pictures_follow_the_shot() -> None:
    environment = load(scene(), example_model(), seed=3)
    environment.reset()
    physics = environment.physics
    before = [physics.render(camera_id=camera) for camera in ("overhead", "corner", 2)]
    assert all(np.array_equal(physics.render(camera_id=k), seen) for k, seen in enumerate(before))
    spec = environment.action_spec()
    environment.step([2.0, 0.0, 0.0, 0.2])
    assert spec.shape == (4,)
    for camera, seen in enumerate(before):
        assert seen.shape == (240, 320, 3)
        changed = np.abs(physics.render(camera_id=camera).astype(int) - seen).max(axis=2) > 30
        assert 4 < changed.sum() < 3000
    environment.reset()
    assert np.array_equal(physics.render(), before[0])


@pytest.mark.gl
def test_a_picture_that_cannot_be_drawn_is_named() -> None:
    environment = load(scene(), example_model())
    with pytest.raises(BadInput, match="unknown camera 'side'; choose from overhead, corner, baulk, or 0 to 2"):
        environment.physics.render(camera_id="side")
    with pytest.raises(BadInput, match="a picture of 320 x 9999 pixels; give up to 2560 x 1440"):
        environment.physics.render(9999)


def test_without_opengl_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(BadInput, match="rendering needs the Debian packages"):
        load(scene(), example_model()).physics.render()


def drawn(rng: np.random.Generator) -> Scene:
    """Two or three balls anywhere on the table's middle."""
    places = np.array([[-0.6, 0.0], [0.6, 0.2], [0.0, -0.5]])[: rng.integers(2, 4)]
    names = ("white", "red", "blue")[: len(places)]
    whole = scene()
    return Scene(
        whole.table, whole.ball, names, places + rng.uniform(-0.2, 0.2, places.shape), Goal("white", "red", None)
    )


@pytest.mark.parametrize("source", [scene(), drawn])
@pytest.mark.parametrize("flat", [False, True])
def test_gymnasium_finds_no_fault(source: Any, flat: bool) -> None:
    pytest.importorskip("shimmy", reason=LEFT_OUT)
    from gymnasium.utils.env_checker import check_env

    check_env(gymnasium_env(source, example_model(), balls=3, flat=flat, mujoco=False), skip_render_check=True)


@pytest.mark.gl
def test_gymnasium_finds_no_fault_in_pictures() -> None:
    pytest.importorskip("shimmy", reason=LEFT_OUT)
    from gymnasium.utils.env_checker import check_env

    env = gymnasium_env(
        scene(), example_model(), render_mode="rgb_array", render_kwargs={"height": 120, "width": 200, "camera_id": 1}
    )
    check_env(env, skip_render_check=True)
    env.reset(seed=0)
    assert env.render().shape == (120, 200, 3)
    env.close()


def test_it_is_the_same_shot_as_dm_controls() -> None:
    pytest.importorskip("shimmy", reason=LEFT_OUT)
    action = np.array([1.5, 0.0, 0.0, 0.3])
    env = gymnasium_env(scene(), example_model(), seed=4)
    observation, _ = env.reset()
    assert observation in env.observation_space
    other: ShotEnvironment = load(scene(), example_model(), seed=4)
    other.reset()
    wanted = other.step(action)
    observation, reward, terminated, truncated, info = env.step(action)
    assert (reward, terminated, truncated) == (wanted.reward, True, False)
    assert all(np.array_equal(observation[k], v) for k, v in wanted.observation.items())
    assert info["timestep.discount"] == 0.0
    ends = []
    for seed in (7, 7, 8):
        env.reset(seed=seed)
        ends.append(env.step(action)[0]["position"][0])
    assert np.array_equal(ends[0], ends[1]) and not np.array_equal(ends[0], ends[2])


def test_what_gymnasium_is_not_given_is_named() -> None:
    pytest.importorskip("shimmy", reason=LEFT_OUT)
    with pytest.raises(BadInput, match="render_mode is 'human'; choose from None, 'rgb_array'"):
        gymnasium_env(scene(), example_model(), render_mode="human")


def test_without_the_extra_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine that has none of its packages."""
    true_import = builtins.__import__

    def barred(name: str, *given: Any, **named: Any) -> Any:
        if name.split(".")[0] in ("shimmy", "gymnasium"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return true_import(name, *given, **named)

    monkeypatch.delitem(sys.modules, "models.environment.gym", raising=False)
    monkeypatch.setattr(builtins, "__import__", barred)
    model: Model = example_model()
    with pytest.raises(BadInput, match=r"needs gymnasium: pip install -e"):
        gymnasium_env(scene(), model)
