"""Scenes: written and read alike, every fault named in one line, and made from what a camera saw."""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.shot import Array, Ball, Table, largest_overlap
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE, racked
from planner.from_picture import balls_in_clip, balls_in_picture, scene_from_clips, scene_from_picture, scene_of
from planner.scene import (
    MAX_OVERLAP_M,
    POCKETS,
    Goal,
    Scene,
    pocket_name,
    pocket_of,
    pocket_places,
    read_scene,
    scene_dict,
    scene_from,
    separate_overlaps,
    write_scene,
)
from sysid.clips import Clip, ClipSet, Observation, read_clip_set, write_clip_set
from sysid.vision.camera.projection import write_camera
from tests.footage.cameras import overhead
from tests.footage.film import Look, Picture, film
from tests.footage.motion import Motion
from tests.support.clip_samples import refusal
from tests.support.plan_samples import TEXT

EXAMPLE = Path(__file__).resolve().parents[2] / "sysid" / "example"
LENGTH, WIDTH, MASS, RED = "length = 3.569", "width = 1.778", "mass = 0.1406", "red = [1.0, 0.4]"
CUE, OBJECT, POCKET = 'cue = "white"', 'object = "red"', "pocket = [1, 1]"
REST, AVOID = 'rest_for = "blue"', 'avoid = ["red 2"]'


def same(one: Scene, other: Scene) -> bool:
    return scene_dict(one) == scene_dict(other) and one.names == other.names


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Scenes of 2 to 22 balls, some of them touching a cushion or each other."""
    table = Table(draw(st.floats(1.0, 4.0)), draw(st.floats(0.6, 1.0)))
    ball = Ball(draw(st.floats(0.04, 0.06)), draw(st.floats(0.1, 0.2)))
    rng, count = np.random.default_rng(draw(st.integers(0, 10**6))), draw(st.integers(2, 22))
    reach, places = table.centre_limits(ball), list[Array]()
    while len(places) < count:
        place = np.clip(rng.uniform(-1.1, 1.1, 2) * reach, -reach, reach)
        if places and rng.random() < 0.3:
            turn = rng.uniform(0, 2 * math.pi)
            place = places[-1] + (ball.diameter + 1e-9) * np.array([math.cos(turn), math.sin(turn)])
        free = all(np.hypot(*(place - other)) >= ball.diameter for other in places)
        if free and (np.abs(place) <= reach).all() and pocket_of(place, table, ball) is None:
            places.append(place)
    names = tuple(f"ball {k} é" for k in range(len(places)))
    rest = np.clip(rng.uniform(-0.8, 0.8, 2) * reach, -reach, reach)
    ways: list[dict[str, Any]] = [{}, {"rest": rest}, {"rest": rest, "rest_radius": float(rng.uniform(0.01, 0.5))}]
    ways += [{"rest_for": names[-1]}] if len(names) > 2 else []
    pocket = draw(st.sampled_from([None, *POCKETS]))
    goal = Goal(names[0], names[1], pocket, **draw(st.sampled_from(ways)), avoid=names[2:4])
    return Scene(table, ball, names, np.array(places), goal)


@settings(max_examples=60)
@given(scenes())
def test_a_scene_comes_back_as_it_was_written(tmp_path_factory: pytest.TempPathFactory, scene: Scene) -> None:
    path = tmp_path_factory.mktemp("scene") / "s.toml"
    write_scene(scene, path)
    back = read_scene(path)
    assert same(back, scene)
    assert np.array_equal(back.position, scene.position)
    assert same(scene_from(json.loads(json.dumps(scene_dict(scene))), "plan"), scene)


def test_a_scene_is_read_with_cue_and_object_first(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(TEXT)
    scene = read_scene(tmp_path / "s.toml")
    assert scene.names == ("white", "red", "blue", "red 2")
    assert scene.position.tolist() == [[-0.5, 0.2], [1.0, 0.4], [0.0, 0.0], [1.2, -0.5]]
    assert scene.goal == Goal("white", "red", (1, 1), rest_for="blue", avoid=("red 2",))
    assert scene.table.pockets
    for line, rest, radius in (("", None, 0), ("rest = [1, 0]", [1, 0], 0), ("rest_region = [1, 0, 0.2]", [1, 0], 0.2)):
        (tmp_path / "s.toml").write_text(TEXT.replace(REST, line).replace(POCKET, 'pocket = "any"'))
        goal = read_scene(tmp_path / "s.toml").goal
        assert (goal.pocket, goal.rest_for, goal.rest_radius) == (None, "", radius)
        assert (None if goal.rest is None else goal.rest.tolist()) == rest


def test_pockets_are_where_the_nose_lines_meet() -> None:
    places = pocket_places(SNOOKER_TABLE)
    assert set(places) == {(x, y) for x in (-1, 0, 1) for y in (-1, 1)}
    for (sx, sy), place in places.items():
        assert place == pytest.approx([sx * 3.569 / 2, sy * 1.778 / 2])
        assert SNOOKER_TABLE.to_pocket(place) == pytest.approx(0.0)
    assert pocket_places(Table(2.0, 1.0, False)) == {}
    assert [pocket_name(p) for p in ((-1, 1), (1, -1), (0, -1))] == ["corner -x +y", "corner +x -y", "middle -y"]


def test_a_ball_on_the_brink_is_on_the_table() -> None:
    half, reach = np.array([3.569, 1.778]) / 2, SNOOKER_TABLE.centre_limits(SNOOKER_BALL)
    assert pocket_of(np.array([0.0, reach[1]]), SNOOKER_TABLE, SNOOKER_BALL) is None
    assert pocket_of(np.array([0.0, -half[1]]), SNOOKER_TABLE, SNOOKER_BALL) == (0, -1)
    assert pocket_of(half - 0.03, SNOOKER_TABLE, SNOOKER_BALL) == (1, 1)
    assert pocket_of(half - 0.04, SNOOKER_TABLE, SNOOKER_BALL) is None
    assert pocket_of(half - 0.01, Table(3.569, 1.778, False), SNOOKER_BALL) is None


def test_rounded_places_are_moved_apart_and_no_others() -> None:
    """A rack with its places rounded to a tenth of a millimetre; balls at the cushions beyond them by as much."""
    exact = racked(SNOOKER_TABLE, SNOOKER_BALL)
    middle = np.mean([xy for name, xy in exact.items() if name.startswith("red")], axis=0)
    tight = {n: middle + (xy - middle) * 0.0525 / 0.053 for n, xy in exact.items() if n.startswith("red")}
    rounded = np.array([xy.round(4) for xy in tight.values()])
    reach = SNOOKER_TABLE.centre_limits(SNOOKER_BALL)
    places = np.concatenate([rounded, [[-1.0, reach[1] + 2e-4], [-1.0, -0.3], [-reach[0] - 1e-4, 0.1]]])
    assert largest_overlap(places, SNOOKER_BALL)[0] > 1e-5
    after = separate_overlaps(places, SNOOKER_TABLE, SNOOKER_BALL)
    assert largest_overlap(after, SNOOKER_BALL)[0] <= 0
    assert (np.abs(after) <= reach).all()
    assert np.abs(after - places).max() < 5e-4
    assert after[-2].tolist() == [-1.0, -0.3]
    assert np.array_equal(separate_overlaps(after, SNOOKER_TABLE, SNOOKER_BALL), after)
    mirrored = separate_overlaps(places * [-1, 1], SNOOKER_TABLE, SNOOKER_BALL) * [-1, 1]
    assert mirrored == pytest.approx(after, abs=1e-12)


def test_a_slight_overlap_is_mended_in_reading_and_a_deep_one_is_not() -> None:
    slight, deep = (tomllib.loads(TEXT.replace(RED, f"red = [{0.0525 - k * MAX_OVERLAP_M}, 0.0]")) for k in (0.9, 1.1))
    assert largest_overlap(scene_from(slight, "s").position, SNOOKER_BALL)[0] <= 0
    assert "overlap" in refusal(lambda: scene_from(deep, "s"))


FAULTS = [
    ('format = "billiard-scene/1"', "", ("format is missing", "billiard-scene/1")),
    ("format =", "fromat =", ("'fromat'", "did you mean 'format'")),
    ("scene/1", "scene/2", ("billiard-scene/2", 'reads format = "billiard-scene/1"')),
    ("[table]", "[tabel]", ("'tabel'", "did you mean 'table'")), (LENGTH, 'length = "3"', ("length", "not a number")),
    ("[goal]", "[camera]\nfps = 1\n[goal]", ("'camera'", "choose from", "goal")),
    ("[table]\nlength = 3.569\nwidth = 1.778", "table = 3", ("table = 3 is not a table", "write [table]")),
    ("length = 3.569\n", "", ("[table]", "length is missing", "in m")),
    (LENGTH, "length = 3569", ("[table]", "3569", "looks like mm", "3.569")),
    (LENGTH, "lenght = 3.569", ("'lenght'", "did you mean 'length'")),
    (LENGTH, "length = 1.569", ("width = 1.778", "exchange")), (LENGTH, "length = inf", ("length", "not finite")),
    (WIDTH, WIDTH + "\ncloth = 2", ("'cloth'", "remove it")), (MASS, "mass = 140.6", ("[ball]", "looks like g")),
    (WIDTH, WIDTH + "\npockets = false", ("pockets = false",)), (MASS, "mass = 4.0", ("mass = 4 kg", "does not fit")),
    (WIDTH, WIDTH + "\npockets = 6", ("pockets = 6", "true or false")),
    ("diameter = 0.0525", "diameter = 52.5", ("[ball]", "looks like mm", "0.0525")),
    ("length = 3.569\nwidth = 1.778", "length = 0.4\nwidth = 0.2", ("diameter = 0.0525", "0.2 m wide")),
    (RED, "red = [1000, 400]", ("'red'", "looks like mm", "[1.0, 0.4]")),
    (RED, "red = [1.0, nan]", ("'red'", "not finite")), (RED, "red = [1.0, true]", ("'red'", "not a number")),
    (RED, 'red = "spot"', ("'red'", "'spot'", "not 2 numbers")), (CUE, 'queue = "white"', ("'queue'", "cue")),
    (RED, "red = [1.0, 0.88]", ("'red'", "outside the playing surface", "|y| is at most 0.8649")),
    (RED, "red = [1.76, -0.86]", ("'red'", "in the pocket corner +x -y")),
    (RED, "red = [0.03, 0.88]", ("'red'", "in the pocket middle +y")),
    (RED, "red = [0.02, 0.01]", ("'blue' and 'red'", "22.4 mm apart", "52.5 mm")),
    (RED, RED + '\n"" = [1.0, 0.1]', ("ball ''", "empty")), (RED, RED + '\n"a/b" = [1.0, 0.1]', ("'a/b'", "slashes")),
    (RED, "red = [1.0]", ("'red'", "not 2 numbers", "[x, y]")), (POCKET, 'pocket = "left"', ("'left'", '"any"')),
    (RED, "red = [-1.9, 0.4]", ("'red'", "outside", "|x|")), (CUE, "cue = 1", ("cue = 1", "name of a ball")),
    (RED, RED + "".join(f"\nb{k} = [{0.1 * k - 1}, -0.7]" for k in range(19)), ("23 balls", "22")),
    ('cue = "white"\n', "", ("[goal]", "cue is missing", "name of a ball")),
    (CUE, 'cue = "whit"', ("cue = 'whit'", "did you mean 'white'")),
    (OBJECT, 'object = "pink"', ("object = 'pink'", "not among the balls", "'red'")),
    (OBJECT, 'object = "white"', ("object = 'white'", "is the cue ball")),
    ("pocket = [1, 1]\n", "", ("pocket is missing", '"any"')), (POCKET, "pocket = [1, 0]", ("[1, 0]", "end cushions")),
    (POCKET, "pocket = [0, 0]", ("[0, 0]", "middle of the table", "sx")),
    (POCKET, "pocket = [2, 1]", ("[2, 1]", "a pocket", "sx")), (POCKET, "pocket = [true, 1]", ("a pocket", "sx")),
    (REST, 'rest_for = "blue"\nrest = [0, 0.3]', ("rest and rest_for exclude each other",)),
    (REST, "rest = [0.5, 0.9]", ("rest = [0.5, 0.9]", "outside the playing surface")),
    (REST, "rest = [1.77, 0.87]", ("rest =", "pocket corner +x +y")),
    (REST, "rest = [0.0, 0.889]", ("rest =", "pocket middle +y")), ("[goal]", "[goal", ("not TOML",)),
    (REST, "rest_region = [0.5, 0.3]", ("rest_region", "3 numbers", "radius")),
    (REST, "rest_region = [0.5, 0.3, 0]", ("rest_region", "not positive")),
    (REST, "rest_region = [0.5, 0.3, 150]", ("rest_region", "150", "in m")),
    (REST, 'rest_for = "red"', ("rest_for = 'red'", "gone", "'blue'")), ("[goal]", "[balls.x]\n[goal2]", ("goal2",)),
    (REST, 'rest_for = "white"', ("rest_for = 'white'", "is the cue ball")),
    (REST, 'rest_for = "bleu"', ("rest_for = 'bleu'", "did you mean 'blue'")),
    (REST, "rest = [500, 300]", ("rest =", "looks like mm")), ("[goal]", "day = 2024-02-31\n[goal]", ("TOML",)),
    (REST, "rest_region = [0.5, 1.3, 0.1]", ("rest_region", "outside")),
    (AVOID, 'avoid = ["red"]', ("avoid = 'red'", "is the object ball")),
    (AVOID, 'avoid = ["white"]', ("avoid = 'white'", "is the cue ball")),
    (AVOID, 'avoid = ["red_2"]', ("avoid = 'red_2'", "did you mean 'red 2'")),
    (AVOID, 'avoid = "blue"', ("avoid = 'blue'", "not a list")),
    ("avoid =", "aviod =", ("'aviod'", "did you mean 'avoid'")),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "words"), FAULTS, ids=[new[:40] or old for old, new, _ in FAULTS])
def test_a_fault_is_named_in_one_line(tmp_path: Path, old: str, new: str, words: tuple[str, ...]) -> None:
    assert TEXT.count(old) == 1
    path = tmp_path / "s.toml"
    path.write_text(TEXT.replace(old, new))
    line = refusal(lambda: read_scene(path))
    assert str(path) in line
    assert [word for word in words if word not in line] == []


@pytest.mark.parametrize("section", ["table", "ball", "balls", "goal"])
def test_a_missing_section_is_named(section: str) -> None:
    data = tomllib.loads(TEXT)
    del data[section]
    assert f"[{section}] is missing" in refusal(lambda: scene_from(data, "plan.json: scene"))
    for value in (3, "x", [1]):
        assert f"[{section}]" in refusal(lambda value=value: scene_from(data | {section: value}, "s"))  # type: ignore[misc]


def test_what_is_no_scene_at_all(tmp_path: Path) -> None:
    assert "no.toml" in refusal(lambda: read_scene(tmp_path / "no.toml"))
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    assert "b.toml" in refusal(lambda: read_scene(tmp_path / "b.toml"))
    assert str(tmp_path) in refusal(lambda: read_scene(tmp_path))
    for value in (None, [], "scene", 3):
        assert "is not a billiard-scene/1" in refusal(lambda value=value: scene_from(value, "plan.json: scene"))  # type: ignore[misc]
    scene = scene_from(tomllib.loads(TEXT), "s")
    assert "cannot be written" in refusal(lambda: write_scene(scene, tmp_path / "nowhere" / "s.toml"))


SMALL = Table(1.0, 0.65)
CAMERA = overhead(SMALL, 0.0525, (480, 360), 1.6, 1.26, (0.04, -0.06))
NAMES = ("white", "red a", "red b", "yellow")
PLACES = np.array([[-0.3, -0.1], [0.25, 0.15], [-0.05, 0.2], [0.3, -0.2]])
LOOK = Look(colours=dict.fromkeys(("red a", "red b"), (0.72, 0.05, 0.07)))


def filmed(places: Array, names: tuple[str, ...] = NAMES, look: Look = LOOK) -> list[Picture]:
    """Pictures of balls at places (k, n, 2) [m]."""
    k, n = places.shape[:2]
    times, moving = np.arange(k + 1, dtype=float), np.concatenate([places, places[-1:]])
    motion = Motion(names, times, moving, np.tile([0.0, 0, 0, 1], (k + 1, n, 1)))
    return list(film(CAMERA, motion, times[:k], look, 0))


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a camera's file and a photo."""
    folder = tmp_path_factory.mktemp("photo")
    write_camera(folder / "cam.toml", CAMERA)
    cv2.imwrite(str(folder / "photo.png"), filmed(PLACES[None])[0])
    return folder


def test_a_scene_from_a_photo(photo: Path) -> None:
    goal = {"object": "red 2", "pocket": [1, 1], "rest_for": "red", "avoid": ["yellow"], "rest": None}
    scene, found = scene_from_picture(photo / "photo.png", photo / "cam.toml", goal)
    assert sorted(found.names) == ["red", "red 2", "white", "yellow"]
    assert scene.names[:2] == ("white", "red 2")
    assert scene.goal == Goal("white", "red 2", (1, 1), rest_for="red", avoid=("yellow",))
    assert (scene.table, scene.ball.diameter) == (SMALL, 0.0525)
    assert scene.ball.mass == pytest.approx(0.1406)
    assert not [line for line in found.notes if "not recognised" in line]
    at = dict(zip(scene.names, scene.position, strict=True))
    truth = dict(zip(("white", "red 2", "red", "yellow"), PLACES, strict=True))  # reds from left to right
    assert max(np.hypot(*(at[name] - xy)) for name, xy in truth.items()) < 5e-4
    write_scene(scene, photo / "s.toml")
    assert same(read_scene(photo / "s.toml"), scene)
    for goal, words in (
        ({"object": "blue", "pocket": "any"}, ("'blue'", "'red'", "'white'", "photo.png")),
        ({"object": "red_2", "pocket": "any"}, ("'red_2'", "did you mean 'red 2'")),
        ({"pocket": "any"}, ("object is missing", "name of a ball")),
        ({"object": "red"}, ("pocket is missing",)),
        ({"object": "red", "pocket": "any", "rest": [0.1, 0.4]}, ("outside the playing surface",)),
    ):
        line = refusal(lambda goal=goal: scene_of(found, goal, "photo.png"))  # type: ignore[misc]
        assert [word for word in words if word not in line] == []


@pytest.mark.slow
def test_balls_in_a_pack_are_told_if_not_made_out(photo: Path, tmp_path: Path) -> None:
    ring = 0.0527 * np.array([(math.cos(a), math.sin(a)) for a in np.arange(6) * math.pi / 3])
    packed = np.concatenate([[[-0.3, -0.1], [0.2, 0.05]], np.array([0.2, 0.05]) + ring])
    names = ("white", *(f"red {k}" for k in range(7)))
    look = Look(colours=dict.fromkeys(names[1:], (0.72, 0.05, 0.07)))
    cv2.imwrite(str(tmp_path / "pack.png"), filmed(packed[None], names, look)[0])
    found = balls_in_picture(tmp_path / "pack.png", photo / "cam.toml")
    (line,) = (line for line in found.notes if "not recognised" in line)
    assert (missing := 8 - len(found.names)) > 0
    assert f"of {'one ball' if missing == 1 else f'{missing} balls'} at 0.2" in line


def test_a_picture_that_is_not_the_cameras_or_shows_no_ball(photo: Path, tmp_path: Path) -> None:
    goal = {"object": "red", "pocket": "any"}
    cv2.imwrite(str(tmp_path / "wide.png"), np.zeros((100, 200, 3), np.uint8))
    line = refusal(lambda: scene_from_picture(tmp_path / "wide.png", photo / "cam.toml", goal))
    assert "200 x 100 and 480 x 360" in line
    cv2.imwrite(str(tmp_path / "bare.png"), filmed(np.zeros((1, 0, 2)), ())[0])
    assert "no ball" in refusal(lambda: scene_from_picture(tmp_path / "bare.png", photo / "cam.toml", goal))
    assert "gone.mp4" in refusal(lambda: scene_from_picture(tmp_path / "gone.mp4", photo / "cam.toml", goal))


@pytest.mark.slow
def test_the_last_frame_of_a_row_of_pictures_counts(photo: Path, tmp_path: Path) -> None:
    """White rolls and comes to rest, a red is taken away, and yellow still moves when the film ends."""
    rows = np.repeat(PLACES[None], 3, axis=0)
    rows[0, 0] -= [0.1, 0.05]
    rows[:, 3] += np.arange(3)[:, None] * [-0.01, 0.0]
    pictures = [*filmed(rows[:1]), *filmed(rows[1:, [0, 1, 3]], ("white", "red a", "yellow"))]
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / f"{k:02d}.png"), picture)
    scene, found = scene_from_picture(tmp_path, photo / "cam.toml", {"object": "red", "pocket": [0, 1]})
    assert scene.names == ("white", "red", "yellow")
    assert scene.position == pytest.approx(rows[-1][[0, 1, 3]], abs=7e-4)
    assert [line.split()[0] for line in found.notes if "moves" in line] == ["yellow"]


def clips(folder: Path, rows: Mapping[str, Array]) -> Path:
    """A clip set of one clip, of places (k, 2) of balls from its start on, 100 a second."""
    balls = {n: Observation(np.arange(len(xy)) / 100, xy, np.full(len(xy), np.nan)) for n, xy in rows.items()}
    made = ClipSet(SMALL, Ball(0.0525, 0.1406), 100.0, (Clip("clips/1.csv", "cue", balls),), 1e-4)
    write_clip_set(made, folder)
    return folder


def test_balls_that_a_camera_sees_within_each_other_or_in_a_pocket(tmp_path: Path) -> None:
    rows = {"cue": (0.0, 0.0), "red": (0.0505, 0.0), "blue": (0.3, 0.1)}
    found = balls_in_clip(clips(tmp_path / "a", {n: np.tile(xy, (10, 1)) for n, xy in rows.items()}))
    assert largest_overlap(found.position, found.ball)[0] <= 0
    assert np.abs(found.position - [[0, 0], [0.0505, 0], [0.3, 0.1]]).max() < 1.1e-3
    assert found.notes == ()
    rows |= {"red": (-0.2, 0.0), "blue": (0.0, 0.345)}
    dropped = balls_in_clip(clips(tmp_path / "b", {n: np.tile(xy, (10, 1)) for n, xy in rows.items()}))
    assert dropped.names == ("cue", "red")
    assert any("middle +y" in line for line in dropped.notes)


def test_a_ball_that_has_just_come_to_rest_does_not_move(tmp_path: Path) -> None:
    time, noise = np.arange(40) / 100, np.random.default_rng(0).normal(0, 1e-4, (2, 40, 2))
    way = np.where(time < time[35], time - time[35], 0.0)[:, None] * [0.5, 0.0]
    slow = (time - time[-1])[:, None] * [0.0, 0.1]
    rows = {"cue": [0.2, 0.1] + way + noise[0], "red": [-0.2, 0.1] + slow + noise[1]}
    found = balls_in_clip(clips(tmp_path / "set", rows))
    assert found.position == pytest.approx(np.array([[0.2, 0.1], [-0.2, 0.1]]), abs=3e-4)
    assert [line.split()[0] for line in found.notes] == ["red"]


def test_the_end_of_a_clip_of_the_example() -> None:
    known = read_clip_set(EXAMPLE)
    goal = {"object": "red", "pocket": "any", "rest": [0.5, 0.2]}
    scene, _ = scene_from_clips(EXAMPLE, goal, 10)
    assert scene.names == ("cue", "red")
    assert (scene.table, scene.ball) == (known.table, known.ball)
    for name, xy in zip(scene.names, scene.position, strict=True):
        assert np.hypot(*(xy - known.clips[9].balls[name].xy[-1])) < 2e-3
    for clip in ("0010.csv", "clips/0010.csv", "10"):
        assert same(scene_from_clips(EXAMPLE, goal, clip)[0], scene)
    for clip, words in ((13, ("13", "1 to 12")), (0, ("0", "1 to 12")), ("clips/001.csv", ("did you mean",))):
        line = refusal(lambda clip=clip: scene_from_clips(EXAMPLE, goal, clip))  # type: ignore[misc]
        assert [word for word in words if word not in line] == []
    assert "name one of those found: 'cue'" in refusal(lambda: scene_from_clips(EXAMPLE, goal))


def test_balls_gone_before_the_end_of_a_clip(tmp_path: Path) -> None:
    """One drops into a pocket, one is hidden where it lies."""
    rolled = np.column_stack([np.linspace(0.0, 0.3, 60), np.zeros(60)])
    into = np.column_stack([np.linspace(0.2, 0.46, 20), np.linspace(0.05, 0.29, 20)])
    folder = clips(tmp_path / "set", {"cue": rolled, "red": into, "blue": np.tile([-0.2, 0.1], (30, 1))})
    scene, found = scene_from_clips(folder, {"object": "blue", "pocket": [-1, 1]})
    assert scene.names == ("cue", "blue")
    assert scene.position == pytest.approx(np.array([[0.3, 0.0], [-0.2, 0.1]]), abs=1e-6)
    told = " ".join(found.notes)
    assert "red was last seen at a pocket" in told
    assert "blue was last seen" in told
    assert "cue still moves" in told
    other = dataclasses.replace(found, names=("yellow", "blue"))
    assert "name the cue ball" in refusal(lambda: scene_of(other, {"object": "blue", "pocket": "any"}, "set"))
