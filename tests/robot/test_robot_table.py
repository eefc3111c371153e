"""The verbs at a real table with a camera: how to turn the stand, a stroke that is filmed, a series that is laid."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from models.shot import Table
from planner.scene import write_scene
from planner.study.draws import draw_scene
from robot.emulator.table import PLACE_SIGMA_M
from robot.learning.history import plan_file
from robot.learning.live_rig import LiveRig
from robot.learning.loop import learn
from robot.order import read_order
from robot.play import played_file
from robot.table.placing import MAX_PLACING_TRIES, PLACING_TOLERANCE_M
from sysid.clips import read_clip_set
from sysid.vision import write_camera
from tests.robot.align_pictures import Stick, bare, camera_over, empty, picture
from tests.support.clip_samples import contents
from tests.support.quick_plans import QUICK
from tests.support.robot_commands import Eye, at_port, by_the_words, refused, run
from tests.support.robot_plans import OURS, straight_plan
from tests.support.series_samples import COURSE, SCENE

BALL, AZIMUTH = (0.3, -0.2), 42.0  # [m], [degrees]


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[str | Path, ...]:
    """The options of a camera that sees a cue at rest behind a ball."""
    folder, camera = tmp_path_factory.mktemp("cue"), camera_over()
    table = bare(camera, empty(camera), {"white": BALL})
    shown = picture(camera, Stick(BALL, math.radians(AZIMUTH)), table, 2.0, np.random.default_rng(0))
    writer = cv2.VideoWriter(str(folder / "cue.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, camera.size)
    writer.write(shown)
    writer.release()
    write_camera(folder / "camera.toml", camera)
    return "--camera", folder / "camera.toml", "--video", folder / "cue.mkv"


def turned_plan(path: Path, degrees: float, **change: Any) -> Path:
    """A plan for the ball of the film, with the stand turned so far."""
    data = json.loads(straight_plan(path, theta_deg=degrees).read_text())
    data["scene"]["balls"]["white"] = list(BALL)
    path.write_text(json.dumps(data | change))
    return path


def test_a_film_tells_how_to_turn_the_stand(filmed: Any, tmp_path: Path) -> None:
    turn = r"turn 1\.(2[5-9]|3[0-5]) degrees to the "
    for wanted, status, told in (
        (("--plan", turned_plan(tmp_path / "a.json", AZIMUTH - 360)), 0, r"aligned \(0\.0\d degrees off\)"),
        (("--plan", turned_plan(tmp_path / "b.json", AZIMUTH + 1.3)), 1, rf"{turn}left \(anticlockwise\)"),
        (("--azimuth", AZIMUTH - 1.3), 1, rf"{turn}right \(clockwise\)"),  # and the ball is looked for
    ):
        said = run("align", *filmed, *wanted)
        assert said.status == status and not said.err, said
        first, noted, last = said.out.splitlines()
        assert re.fullmatch(told, first) and noted.startswith("noted: an elevation 1 degree higher"), said.out
        assert re.fullmatch(rf"cue: 4[12]\.\d\d \+- 0\.\d\d degrees, {told}", last), said.out


def test_align_refuses_what_it_cannot_use(filmed: Any, tmp_path: Path) -> None:
    def changed(name: str, **change: Any) -> tuple[str | Path, ...]:
        return (*filmed, "--plan", turned_plan(tmp_path / f"{name}.json", 400.0, **change))

    for words, part in (
        (filmed, "give the direction: --plan PLAN.json, or --azimuth"),
        ((*changed("good"), "--azimuth", 3), "give the direction"),
        (changed("good"), "good.json: the direction is 400; give degrees"),
        (changed("idle", stroke=None, why="hidden"), "holds no stroke (hidden)"),
        (changed("bare", launcher=None), "theta_deg of its launcher is None"),
        (changed("lost", scene=None), "lost.json scene"),
        ((*filmed, "--azimuth", "nan"), "--azimuth: the direction is nan; give degrees"),
        ((filmed[0], tmp_path / "none.toml", *filmed[2:], "--azimuth", 3), "none.toml"),
        ((*filmed[:3], tmp_path / "none.mkv", "--azimuth", 3), "none.mkv: cannot be opened"),
    ):
        refused(run("align", *words), "align", part)


@pytest.fixture
def eye(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Eye:
    """Over the balls of a plan; whoever is asked says yes."""
    one = Eye(straight_plan(tmp_path / "plan.json"))
    monkeypatch.setattr("robot.camera.live.LiveCamera.open", lambda *named, **rest: contextlib.nullcontext(one))
    monkeypatch.setattr("robot.camera.align.align", one.align)
    monkeypatch.setattr("robot.learning.live_rig.align", one.align)
    answer(monkeypatch, one, "yes")
    return one


@pytest.fixture
def options(eye: Eye) -> Iterator[tuple[str, ...]]:
    with at_port(eye, 20.0, 19200) as words:
        yield words


def answer(monkeypatch: pytest.MonkeyPatch, eye: Eye, word: str | None) -> None:
    def typed(prompt: str) -> str:
        eye.note(f"said {word}")
        if word is None:
            raise EOFError
        return word

    monkeypatch.setattr("builtins.input", typed)


def test_a_stroke_is_filmed_from_the_yes_on_and_the_clip_is_kept(eye: Eye, options: Any, tmp_path: Path) -> None:
    clips, order = tmp_path / "set", read_order(eye.plan, OURS)
    said = run("play", eye.plan, *options, "--clips", clips)
    assert said.status == 0 and "aligned (0.00 degrees off)" in said.out and f"clip: {clips}" in said.out, said
    assert said.out.startswith("needed:\n") and f"the balls at the positions in {eye.plan}, within 5 mm" in said.out
    turned = f"aligned to {order.yaw_deg:.2f}, ball told"
    assert eye.asked == [(turned, 0), ("said yes", 0), ("armed", 0), ("filmed", 1)]
    [clip] = read_clip_set(clips).clips
    assert (clip.struck, clip.cue) == ("white", order.cue)
    assert clip.balls["white"].xy[0] == pytest.approx(order.scene.position[0], abs=6 * PLACE_SIGMA_M)
    told = json.loads(played_file(eye.plan).read_text())
    assert told["struck"] == "yes" and told["clip"] == {"folder": str(clips), "file": clip.file}
    assert told["cue_end"] == pytest.approx(clip.balls["white"].xy[-1], abs=6 * PLACE_SIGMA_M)
    eye.put(dict(zip(order.scene.names, order.scene.position, strict=True)))
    assert run("play", eye.plan, *options, "--clips", clips, "--yes").status == 0
    assert len(read_clip_set(clips).clips) == 2 and "said yes" not in dict(eye.asked[4:])


def test_without_a_yes_nothing_is_struck_or_filmed(eye: Eye, options: Any, tmp_path: Path, monkeypatch: Any) -> None:
    before = contents(tmp_path)
    for word in ("no", None):
        eye.asked.clear()
        answer(monkeypatch, eye, word)
        refused(run("play", eye.plan, *options, "--clips", tmp_path / "set"), "play", "nothing was struck")
        assert eye.asked[1:] == [(f"said {word}", 0)] and not eye.strokes and contents(tmp_path) == before


def test_nothing_is_struck_from_a_stand_that_is_not_aligned_or_at_other_balls(eye: Eye, options: Any) -> None:
    eye.off = math.radians(0.5)
    said = run("play", eye.plan, *options, "--yes")
    assert said.status == 2 and "turn 0.50 degrees to the right" in said.out and "is not aligned" in said.err
    eye.off = 0.0
    eye.put({name: xy + np.array([0.02 * (name == "red"), 0.0]) for name, xy in eye.look().items()})
    said = run("play", eye.plan, *options, "--yes")
    assert said.status == 2 and re.search(r"ball red is (19|20)\.\d mm from its place in the plan", said.err)
    assert eye.devices[0].state == "UNHOMED" and not played_file(eye.plan).exists()


def test_a_film_without_a_shot_is_told_and_a_dry_run_asks_nobody(eye: Eye, options: Any, tmp_path: Path) -> None:
    before = contents(tmp_path)
    said = run("play", eye.plan, *options, "--clips", tmp_path / "set", "--dry-run")
    assert said.status == 0 and "would send" in said.out and contents(tmp_path) == before
    assert eye.asked == [] and eye.devices[0].state == "UNHOMED"
    eye.blind = True
    said = run("play", eye.plan, *options, "--clips", tmp_path / "set")
    assert said.status == 1 and "clip: none, no shot was seen" in said.out, said
    told = json.loads(played_file(eye.plan).read_text())
    assert told["struck"] == "yes" and told["clip"] is None and told["potted"] is None


def test_options_that_do_not_go_together(eye: Eye, options: Any, tmp_path: Path) -> None:
    port, camera, video = options[:2], options[2:4], options[4:]
    scene, begun = tmp_path / "scene.toml", ("learn", "--out", tmp_path / "series")
    write_scene(read_order(eye.plan, OURS).scene, scene)
    before = contents(tmp_path)
    for words, part in (
        (("play", eye.plan, *options, "--scene", scene), "the camera sees the balls"),
        (("play", eye.plan, *port, *camera), "--camera CAM.toml and --video SOURCE go together"),
        (("play", eye.plan, *port, "--clips", "x"), "--clips: the shot is not filmed"),
        (("play", eye.plan, *options, "--model", eye.plan), "--model applies to the emulated launcher"),
        (("play", eye.plan, *video), "--video requires a launcher at a --port"),
        ((*begun, *camera, *video), "--camera requires a launcher at a --port"),
        ((*begun, *port), "--port: a series needs a camera"),
        ((*begun, *options, "--effect", "table_tilt"), "--effect applies to the emulated table"),
    ):
        refused(run(*words, "--yes"), str(words[0]), part)
        assert contents(tmp_path) == before and eye.devices[0].state == "UNHOMED"


def test_a_series_ends_where_nobody_lays_its_balls(eye: Eye, options: Any, tmp_path: Path, monkeypatch: Any) -> None:
    for word in ("q", None):
        answer(monkeypatch, eye, word)
        said = run("learn", "--out", tmp_path / "series", *options)
        refused(said, "learn", "shot 1: not set up; the same command continues from here")
        needs, asked = said.out.split("an interrupt (Ctrl-C) stops the launcher\n")
        assert needs.startswith("needed:\n  - the launcher at ") and "camera 0 in the position of cam.toml" in needs
        assert asked.startswith("shot 1: put white ") and eye.asked.pop() == (f"said {word}", 0) and not eye.asked


def stand_of(eye: Eye, ready: Callable[[str], Any], confirm: Callable[[str], Any] = str, **change: Any) -> LiveRig:
    """A table where everything asked is done, but for an answer False."""
    asked = (lambda what: confirm(what) is not False, lambda what: ready(what) is not False)
    return dataclasses.replace(LiveRig(eye, OURS, eye.connect, *asked, eye.said.append), **change)


def test_balls_are_asked_for_until_they_are_seen_in_their_places(eye: Eye) -> None:
    white, red = SCENE.position
    laid = [
        ({"red": red}, "white is not seen"),
        ({"white": white, "red": red, "blue": (-0.5, 0.2)}, "blue is not in the scene"),
        ({"white": white, "red": red + np.array([0.0, 0.1])}, "red is 100 mm from its place"),
        ({}, "no ball is seen"),
        ({"white": white + np.array([0.9 * PLACING_TOLERANCE_M, 0.0]), "red": red}, ""),
    ]
    asked = list[str]()

    def ready(text: str) -> None:
        eye.put(laid[len(asked)][0])
        asked.append(text)

    made = stand_of(eye, ready).set_up(SCENE, 7)
    assert len(asked) == len(laid) and len(set(asked)) == 1 and asked[0].startswith("shot 7: put white ")
    assert all(part in told for told, (_, part) in zip(eye.said, laid[:-1], strict=True)), eye.said
    assert made.camera is eye and len(eye.devices) == 1
    told = by_the_words(asked[0])
    assert np.array([told[name] for name in SCENE.names]) == pytest.approx(SCENE.position, abs=6e-4), "to a millimetre"


def test_a_scene_that_is_not_laid_or_of_another_table_ends_it(eye: Eye) -> None:
    asked, answers = list[str](), iter([True, True, False])
    eye.put({"red": SCENE.position[1]})
    with pytest.raises(BadInput, match="shot 3: not set up; the same command continues"):
        stand_of(eye, lambda text: next(answers)).set_up(SCENE, 3)
    assert eye.said == ["white is not seen"] * 2
    with pytest.raises(BadInput, match="shot 3: white is not seen; check that"):
        stand_of(eye, asked.append).set_up(SCENE, 3)
    with pytest.raises(BadInput, match="start with a model of this table"):
        stand_of(eye, asked.append).set_up(dataclasses.replace(SCENE, table=Table(3.0, 1.5)), 3)
    assert len(asked) == MAX_PLACING_TRIES and not eye.devices


def test_the_stand_is_turned_to_the_plan_within_its_reach(eye: Eye) -> None:
    limits = dataclasses.replace(OURS.limits, yaw_deg=(-90.0, 90.0))
    stand = stand_of(eye, str, settings=dataclasses.replace(OURS, limits=limits))
    eye.put(dict(zip(SCENE.names, SCENE.position, strict=True)))
    stand.turn(math.radians(30))
    assert eye.said == ["turn the stand to 30.0 degrees (its range is -90 to 90)"]
    stand.set_up(SCENE, 1).turn(math.radians(-80))
    with pytest.raises(BadInput, match=r"yaw is 120\.0 degrees; the stand's range is -90"):
        stand.turn(math.radians(120))
    stand.turn(math.radians(90.0) + 1e-15)
    assert [what for what, _ in eye.asked] == ["aligned to 30.00", "aligned to -80.00, ball told", "aligned to 90.00"]
    eye.off = math.radians(0.3)
    with pytest.raises(BadInput, match=r"the stand is not aligned \(turn 0\.30 degrees to the right"):
        stand.turn(0.0)


def test_a_series_is_laid_turned_confirmed_and_gone_on_with(eye: Eye, tmp_path: Path) -> None:
    told, confirmed, answers = list[str](), list[str](), iter([True, False, True])

    def ready(text: str) -> bool:
        eye.put(by_the_words(text))
        return next(answers)

    course, folder = dataclasses.replace(COURSE, shots=2, effort=QUICK), tmp_path / "series"
    stand = stand_of(eye, ready, confirmed.append)
    with pytest.raises(BadInput, match="shot 2: not set up"):
        learn(folder, course, stand, told.append)
    story = learn(folder, course, stand, told.append)
    assert [line.split(":")[0] for line in told] == ["shot   1", "shot   2"]
    assert (len(story.shots), story.refits, story.ended) == (2, (), "all 2 shots are played")
    clips = read_clip_set(folder / "clips").clips
    assert len(confirmed) == eye.strokes == len(clips) == 2
    for k, clip in enumerate(clips):
        asked, order = draw_scene(course.study, k + 1)[0], read_order(plan_file(folder, k + 1), OURS)
        assert order.scene.position == pytest.approx(asked.position, abs=2e-3), "laid by the words alone"
        assert f"yaw {order.yaw_deg:.2f} degrees" in confirmed[k]
        away = np.diff(clip.balls["white"].xy[[0, 20]], axis=0)[0]
        assert math.remainder(math.atan2(*away[::-1]) - order.cue.azimuth, 2 * math.pi) == pytest.approx(0, abs=0.05)
