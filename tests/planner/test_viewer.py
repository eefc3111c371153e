"""`planner view`: strokes by keys in a stand-in for MuJoCo's viewer, where strokes come from, pictures, bad input."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np
import pytest

from models.errors import BadInput
from models.model_file import full_model, write_model
from models.shot import Table
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.cli.verbs import main
from planner.cli.view import GivenStroke, Shown, setup, view
from planner.example_environment import example_scene
from planner.planning import PLAN_FORMAT
from planner.scene import scene_dict
from planner.viewer import RESET_KEY, STRIKE_KEY, Setup, ViewedWorld, watch
from sysid.cli.identification.demo import EXAMPLE_FOLDER as CLIPS
from sysid.clips import read_clip_set
from tests.support.running_clips import cut_in_motion, written_running

MODEL = full_model(SNOOKER_TABLE, SNOOKER_BALL)
SETUP = Setup(("white", "red"), np.array([[-1.0, 0.0], [0.2, 0.05]]), (1.5, 0.0, 0.0, 0.0), 0.0)


class Stand:
    """A viewer that looks on at the table, presses keys at given pictures, and is closed after the last one."""

    def __init__(self, pictures: int, keys: dict[int, int]) -> None:
        self.pictures, self.keys, self.time = pictures, keys, 0.0
        self.cam, self.seen = mujoco.MjvCamera(), list[tuple[float, float, float]]()

    @contextlib.contextmanager
    def open(
        self, model: mujoco.MjModel, data: mujoco.MjData, *, key_callback: Callable[[int], None], **panels: bool
    ) -> Iterator[Stand]:
        self.data, self.press = data, key_callback
        yield self

    def lock(self) -> Any:
        return contextlib.nullcontext()

    def is_running(self) -> bool:
        return len(self.seen) < self.pictures

    def sync(self) -> None:
        if (key := self.keys.get(len(self.seen))) is not None:
            self.press(key)
        self.seen.append((self.data.time, float(self.data.qpos[0]), float(self.data.qvel[0])))

    def clock(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds


def watched(pictures: int, keys: dict[int, int], pace: float = 1.0) -> list[tuple[float, float, float]]:
    """Time, place and speed of the white in every picture."""
    stand = Stand(pictures, keys)
    watch(ViewedWorld(MODEL, SETUP), stand.open, pace=pace, clock=stand.clock, sleep=stand.sleep)
    return stand.seen


@pytest.mark.slow
def test_the_stroke_is_played_in_real_time_and_slower() -> None:
    seen = watched(31, {})
    assert seen[0] == (0.0, -1.0, 1.5)
    assert seen[30][0] == pytest.approx(0.5, abs=0.003)
    assert -1.0 < seen[10][1] < seen[20][1] < seen[30][1]
    assert watched(31, {}, pace=0.2)[30][0] == pytest.approx(0.1, abs=0.003)


def test_space_strikes_again_and_r_puts_the_balls_back() -> None:
    seen = watched(100, {30: STRIKE_KEY, 60: RESET_KEY, 80: STRIKE_KEY, 90: ord("X")})
    assert seen[30][2] < 1.4 and seen[31][2] == pytest.approx(1.5, abs=0.05)
    assert seen[31][1] > -0.6, "from where it lies"
    assert seen[62][1:] == (-1.0, 0.0) and seen[80][2] == 0.0
    assert seen[81][1] > -1.0 and seen[81][2] == pytest.approx(1.5, abs=0.05)
    assert seen[95][2] < seen[81][2]


def test_a_computer_that_falls_behind_loses_time_not_steps() -> None:
    stand = Stand(4, {})
    watch(ViewedWorld(MODEL, SETUP), stand.open, clock=stand.clock, sleep=lambda _: stand.sleep(10.0))
    assert np.diff([t for t, _, _ in stand.seen]) == pytest.approx([0.1] * 3, abs=1e-9)


def test_a_potted_cue_ball_is_struck_from_where_it_began() -> None:
    setup = dataclasses.replace(SETUP, position=np.array([[1.3, 0.4], [0.0, 0.0]]))
    session = ViewedWorld(MODEL, dataclasses.replace(setup, stroke=(1.5, math.atan2(0.489, 0.4845), 0.0, 0.0)))
    session.strike()
    session.world.advance(session.data, 2.0)
    assert session.world.in_play(session.data) == ("red",)
    session.strike()
    assert session.data.qpos[:2] == pytest.approx([1.3, 0.4])


def setup_of(*given: str) -> Setup:
    values = view.make_context("view", list(given)).params

    def chosen(kind: Any) -> Any:
        return kind(**{field.name: values[field.name] for field in dataclasses.fields(kind)})

    return setup(chosen(Shown), chosen(GivenStroke))[1]


def test_balls_and_strokes_come_from_scenes_plans_and_clips(tmp_path: Path) -> None:
    spots = setup_of()
    assert len(spots.names) == 22 and spots.names[:2] == ("white", "red 1")
    scene = setup_of("planner/example.toml", "--speed", "3", "--side", "0.002")
    way = scene.position[1] - scene.position[0]
    assert scene.stroke == (3.0, pytest.approx(math.atan2(way[1], way[0])), 0.002, 0.0)
    plan = {"speed": 1.2, "azimuth": 0.4, "side": 0.001, "height": -0.003, "elevation": 0.11}
    file = tmp_path / "plan.json"
    file.write_text(
        json.dumps(
            {"format": PLAN_FORMAT, "scene": scene_dict(example_scene()), "stroke": plan, "launcher": {"swerve": 7e-5}}
        )
    )
    planned = setup_of(str(file), "--height", "0.004")
    assert (planned.stroke, planned.swerve) == ((1.2, 0.4, 0.001, 0.004), pytest.approx(0.001 * math.sin(0.11)))
    assert setup_of(str(file)).swerve == 7e-5, "that of the plan's contact"
    assert planned.names == example_scene().names
    clip = setup_of(str(CLIPS), "--clip", "2")
    assert clip.names[0] and 0.1 < clip.stroke[0] < 10


def test_a_plan_with_wrong_entries_is_named(tmp_path: Path) -> None:
    right = {"speed": 1.2, "azimuth": 0.4, "side": 0.001, "height": -0.003, "elevation": 0.11}
    file = tmp_path / "plan.json"
    for stroke, swerve in (({"speed": 1.2}, 0.0), (right | {"speed": "fast"}, 0.0), ([1], 0.0), (right, "x")):
        plan = {"format": PLAN_FORMAT, "scene": scene_dict(example_scene()), "stroke": stroke}
        file.write_text(json.dumps(plan | {"launcher": {"swerve": swerve}}))
        with pytest.raises(
            BadInput, match=r"plan\.json: (lacks|has a wrong entry:) .*; make it again with: planner plan"
        ):
            setup_of(str(file))


@pytest.mark.gl
def test_pictures_of_a_stroke(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "pictures"
    given = ["view", "planner/example.toml", "--frames", "3", "--out", str(out), "--fps", "10", "--width", "320"]
    assert main(given) == 0
    assert f"pictures: 3 in {out}" in capsys.readouterr().out
    pictures = [cv2.imread(str(out / f"000{k}.png")).astype(int) for k in (1, 2, 3)]
    assert pictures[0].shape == (180, 320, 3)
    assert all(np.abs(a - b).max() > 40 for a, b in zip(pictures[1:], pictures, strict=False))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "there is no display (DISPLAY is not set); run it on a desktop, or write pictures: --frames 50 --out DIR"),
        (["--frames", "5"], "--frames and --out go together"),
        (["--speed", "99"], "--speed 99: give a number from 0.01 to 15"),
        (["--frames", "1", "--out", "x", "--side", "0.03"], "30.0 mm off the centre misses a ball of 26.2 mm"),
        (["planner/example.toml", "--frames", "1", "--out", "x", "--clip", "2"], "is not a clip set; omit it"),
        (["nowhere.toml", "--frames", "1", "--out", "x"], "nowhere.toml"),
        ([str(CLIPS), "--frames", "1", "--out", "x", "--clip", "99"], "there is no clip 99: choose from"),
    ],
)
def test_bad_input_is_named(
    given: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", *given]) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert said in told[-1] and told[-1].startswith("planner view: ")


def test_a_clip_that_begins_in_mid_motion_has_no_stroke(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = read_clip_set(CLIPS)
    few = dataclasses.replace(whole, clips=whole.clips[:1])
    written_running(cut_in_motion(few, 1), tmp_path / "cut")
    given = ["--frames", "1", "--out", str(tmp_path / "pictures"), "--clip", "1"]
    assert main(["view", str(tmp_path / "cut"), *given]) == 2
    assert "--clip 1: begins in mid-motion, without a stroke to play" in capsys.readouterr().err


def test_a_model_of_another_table_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_model(full_model(Table(2.0, 1.0), SNOOKER_BALL), tmp_path / "m.toml")
    given = ["--frames", "1", "--out", str(tmp_path), "--model", str(tmp_path / "m.toml")]
    assert main(["view", "planner/example.toml", *given]) == 2
    assert "its table and ball differ from those of planner/example.toml" in capsys.readouterr().err
