"""Who is who among the balls of single frames: no ball lost, none swapped, none made of what is not there."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator

import numpy as np
import pytest

from models.shot import Array
from sysid.vision.balls.detect import Detection
from sysid.vision.camera.projection import Camera
from sysid.vision.tracks.following.follow import BallTrack, Follower
from sysid.vision.tracks.following.prediction import State, predict_impacts
from tests.support.followed_balls import CAMERA, FPS, random_tracks, sightings


def at_rest_first(position: Array, frames: int) -> Array:
    return np.concatenate([np.repeat(position[:1], frames, axis=0), position])


def followed(seen: Iterator[list[Detection]], fps: float = FPS, camera: Camera = CAMERA) -> tuple[BallTrack, ...]:
    follower = Follower(camera)
    for index, some in enumerate(seen):
        follower.expected(index / fps, 1 / fps)
        follower.update(index, index / fps, some)
    return follower.tracks()


def whose(path: BallTrack, position: Array) -> tuple[set[int], float]:
    """The true balls that a path follows, and how far from them it gets [m]."""
    off = np.linalg.norm(position[path.frame] - path.xy[:, None], axis=2)
    off = np.where(np.isfinite(off), off, np.inf)
    return set(off.argmin(axis=1).tolist()), float(off.min(axis=1).max())


@pytest.mark.parametrize(
    ("fps", "names", "fastest", "drop", "false"),
    [
        (120.0, ("white", "red", "yellow"), 4.0, 0.0, 0.0),
        (120.0, ("white", "red", "red"), 4.0, 0.05, 0.05),
        (60.0, ("red", "red", "red"), 3.0, 0.03, 0.03),
        (30.0, ("white", "red", "red"), 2.0, 0.02, 0.0),
    ],
)
def test_fifty_shots_with_none_lost_or_swapped(
    fps: float, names: tuple[str, ...], fastest: float, drop: float, false: float
) -> None:
    rng = np.random.default_rng(7)
    for track in random_tracks(int(fps), 50, fastest, fps):
        position = at_rest_first(track.position, 10)
        paths = followed(sightings(position, names, rng, drop=drop, false=false), fps)
        assert len(paths) == 3
        assert sorted(p.name.split("_")[0] for p in paths) == sorted(names)
        owners = []
        for path in paths:
            own, off = whose(path, position)
            assert len(own) == 1, track.events
            assert off < 0.003
            owners += own
            there = np.isfinite(position[:, owners[-1], 0]).sum()
            assert there - len(path.frame) <= 2 * drop * there + 5
        assert sorted(owners) == [0, 1, 2]


def test_the_quickest_path_costs_little() -> None:
    position = at_rest_first(random_tracks(120, 50, 4.0)[0].position, 30)
    seen = list(sightings(position, ("white", "red", "yellow"), np.random.default_rng(0)))
    begun = time.process_time()
    followed(iter(seen))
    each = (time.process_time() - begun) / len(seen)
    print(f"{1e3 * each:.2f} ms a frame")
    assert each < 2e-3  # 0.35 ms on a core of its own


def test_balls_of_one_name_are_numbered_from_left_to_right() -> None:
    position = np.tile([[0.5, 0.1], [-0.4, 0.2], [0.1, -0.2], [0.0, 0.3]], (20, 1, 1)).astype(float)
    paths = followed(sightings(position, ("red", "red", "red", "blue"), np.random.default_rng(0)))
    place = {path.name: path.xy.mean(axis=0) for path in paths}
    assert set(place) == {"red_1", "red_2", "red_3", "blue"}
    assert place["red_1"][0] < place["red_2"][0] < place["red_3"][0]
    assert place["red_2"] == pytest.approx([0.1, -0.2], abs=1e-3)


def test_places_are_where_the_balls_are() -> None:
    position = np.tile([[0.8, 0.4], [-0.8, -0.4]], (400, 1, 1)).astype(float)
    for path in followed(sightings(position, ("red", "blue"), np.random.default_rng(0))):
        true = [0.8, 0.4] if path.name == "red" else [-0.8, -0.4]
        assert path.xy.mean(axis=0) == pytest.approx(true, abs=6e-5)


def test_a_ball_hidden_for_a_while_is_found_again_and_nothing_is_put_between() -> None:
    position = np.tile([[0.5, 0.1], [0.51, 0.2]], (200, 1, 1)).astype(float)
    position[50:150, 0] = np.nan
    paths = followed(sightings(position, ("red", "red"), np.random.default_rng(0)))
    assert sorted(len(path.frame) for path in paths) == [100, 200]
    short = min(paths, key=lambda p: len(p.frame))
    assert whose(short, position)[0] == {0}
    assert not ((short.frame >= 50) & (short.frame < 150)).any()


def test_a_ball_put_elsewhere_by_hand_stays_itself() -> None:
    position = np.tile([[0.5, 0.1], [-0.3, 0.2]], (200, 1, 1)).astype(float)
    position[80:120, 0] = np.nan
    position[120:, 0] = [-0.6, -0.3]
    (white,) = [
        p for p in followed(sightings(position, ("white", "red"), np.random.default_rng(0))) if p.name == "white"
    ]
    assert len(white.frame) == 160
    assert white.xy[-1] == pytest.approx([-0.6, -0.3], abs=1e-3)


def test_false_sightings_make_no_ball() -> None:
    position = np.tile([[0.5, 0.1], [-0.3, 0.2]], (600, 1, 1)).astype(float)
    paths = followed(sightings(position, ("white", "red"), np.random.default_rng(3), drop=0.1, false=0.5))
    assert [path.name for path in paths] == ["white", "red"] or [path.name for path in paths] == ["red", "white"]
    assert max(whose(path, position)[1] for path in paths) < 0.002


def test_a_ball_within_another_is_not_one() -> None:
    """A detector may take the same outline for two balls."""
    rng = np.random.default_rng(0)
    position = np.tile([[0.5, 0.1]], (60, 1, 1)).astype(float)
    seen = []
    for some in sightings(position, ("pink",), rng):
        seen.append([dataclasses.replace(some[0], name="white", xy=some[0].xy + 3.0, score=0.5), *some])
    (pink,) = followed(iter(seen))
    assert pink.name == "pink"


def test_no_more_balls_of_a_name_than_there_are() -> None:
    position = np.tile([[0.5, 0.1], [-0.5, 0.1]], (60, 1, 1)).astype(float)
    position[:10, 1] = np.nan
    follower = Follower(CAMERA, {"white": 1})
    for index, some in enumerate(sightings(position, ("white", "white"), np.random.default_rng(0))):
        follower.update(index, index / FPS, some)
    (white,) = follower.tracks()
    assert white.xy[:, 0] == pytest.approx(0.5, abs=2e-3)


def test_missing_frames_are_gaps_in_time() -> None:
    track = random_tracks(120, 50, 4.0)[3]
    position = at_rest_first(track.position, 30)
    follower = Follower(CAMERA)
    rng = np.random.default_rng(1)
    for index, some in enumerate(sightings(position, ("white", "red", "yellow"), rng)):
        if rng.random() > 0.2:
            follower.update(index, index / FPS, some)
    for path in follower.tracks():
        assert len(whose(path, position)[0]) == 1
        assert path.time == pytest.approx(path.frame / FPS)


def test_rows_read_late_are_late() -> None:
    camera = dataclasses.replace(CAMERA, readout=0.01)
    position = np.tile([[0.3, 0.45], [0.3, -0.45]], (30, 1, 1)).astype(float)
    up, down = sorted(followed(sightings(position, ("red", "red"), np.random.default_rng(0)), camera=camera),
                      key=lambda p: p.pixels[0, 1])  # fmt: skip
    late = (down.time - down.frame / FPS)[0]
    assert late == pytest.approx(0.01 * (down.pixels[0, 1] / 959 - 0.5))
    assert down.time[0] - up.time[0] > 0.003


def test_impacts_are_foreseen() -> None:
    def ball(x: float, y: float, u: float) -> State:
        return State(0.0, x, y, u, 0.0, 1e-8, 0.0, 1e-6)

    reach = np.array([1.0, 0.5])
    one, two, three = predict_impacts([ball(0, 0, 2.0), ball(0.1, 0, 0.0), ball(0.99, 0.3, 1.0)], 0.1, reach, 0.05)
    assert one is not None
    assert two is not None
    assert three is not None
    assert (one.u, two.u) == (pytest.approx(0.05), pytest.approx(1.95))
    assert two.x == pytest.approx(0.1 + 1.95 * 0.075)
    assert three.x == pytest.approx(1.0 - 0.8 * 0.09)
    assert predict_impacts([ball(0, 0, 1.0), ball(0.1, 0.06, 0.0)], 0.04, reach, 0.05) == [None, None]


def test_an_impact_goes_on_through_balls_that_touch() -> None:
    """Which way they go is not known: places in a pack are known too coarsely to follow the impact through it."""
    places = ((0.0, 0.0), (0.1, 0.0), (0.101, 0.0505), (0.102, 0.101), (0.4, 0.0))
    balls = [State(0.0, x, y, 0.0 if x else 2.0, 0.0, 1e-8, 0.0, 1e-6) for x, y in places]
    found = predict_impacts(balls, 0.04, np.array([1.0, 0.5]), 0.05)
    assert [state is not None for state in found] == [True, True, True, True, False]
    assert found[3] is not None and found[3].pp > 0.005**2
