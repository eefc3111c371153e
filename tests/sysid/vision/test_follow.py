"""Who is who among the balls of single frames: no ball lost, none swapped, none made of what is not there."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
import pytest

from models.model_file import full_model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from sysid.vision.balls.detect import Detection
from sysid.vision.camera.projection import Camera
from sysid.vision.tracks.follow import BallTrack, Follower
from sysid.vision.tracks.prediction import State, predict_impacts
from tests.footage.cameras import overhead

TABLE, BALL = Table(2.0, 1.0), Ball(0.0525, 0.1406)
FLAT = overhead(TABLE, BALL.diameter, (1280, 960), 2.6, 2.5, (0.02, -0.05))
CAMERA = dataclasses.replace(FLAT, distortion=np.array([-0.1, 0.02, 0.0005, -0.0005, 0.0]))
NOISE = 0.1  # of a sighting [pixels]
FPS = 120.0


def random_shot(rng: np.random.Generator, fastest: float, seconds: float, fps: float) -> Shot:
    """Three balls; the first is sent at the second."""
    while True:
        places = rng.uniform(-1, 1, (3, 2)) * [0.9, 0.42]
        if min(np.linalg.norm(places[i] - places[j]) for i, j in ((0, 1), (0, 2), (1, 2))) > 1.1 * BALL.diameter:
            break
    way = places[1] - places[0]
    way /= np.linalg.norm(way)
    way = places[1] + rng.uniform(-0.9, 0.9) * BALL.diameter * np.array([-way[1], way[0]]) - places[0]
    way /= np.linalg.norm(way)
    speed, top = rng.uniform(0.5, fastest), rng.uniform(-1, 1)
    velocity, spin = np.zeros((3, 2)), np.zeros((3, 3))
    velocity[0] = speed * way
    spin[0] = np.array([-top * way[1], top * way[0], rng.uniform(-1, 1)]) * speed / BALL.radius
    return Shot(("a", "b", "c"), places, velocity, spin, np.arange(0, seconds, 1 / fps))


@cache
def random_tracks(seed: int, count: int, fastest: float, fps: float = FPS) -> tuple[Track, ...]:
    rng = np.random.default_rng(seed)
    shots = [random_shot(rng, fastest, 1.2, fps) for _ in range(count)]
    return tuple(simulate(full_model(TABLE, BALL), shots, threads=1))


NAMES = ("white", "red", "yellow")
HOME = np.array([[-0.6, -0.2], [0.1, 0.05], [0.5, -0.3]])


class Recording:
    """Places of three balls over frames, put together bit by bit."""

    def __init__(self, start: Array = HOME, fps: float = FPS) -> None:
        self.fps = fps
        self.now = np.array(start, float)
        self.rows: list[Array] = []
        self.struck: list[float] = []  # when [s]

    @property
    def time(self) -> float:
        """Of the next frame [s]."""
        return sum(map(len, self.rows)) / self.fps

    def wait(self, seconds: float) -> Recording:
        """Nothing happens."""
        self.rows.append(np.repeat(self.now[None], round(seconds * self.fps), axis=0))
        return self

    def shot(self, velocity: Sequence[float], ball: int = 0, seconds: float = 8.0, late: float = 0.4) -> Recording:
        """A ball is struck, some part of a frame before the next frame."""
        here = np.flatnonzero(np.isfinite(self.now[:, 0]))
        order = np.concatenate([[ball], here[here != ball]])
        v, spin = np.zeros((len(order), 2)), np.zeros((len(order), 3))
        v[0] = velocity
        times = np.concatenate([[0.0], (np.arange(int(seconds * self.fps)) + late) / self.fps])
        shot = Shot(tuple(NAMES[k] for k in order), self.now[order], v, spin, times)
        track = simulate(full_model(TABLE, BALL), [shot], threads=1)[0]
        speed = np.nan_to_num(np.linalg.norm(track.velocity, axis=2)).max(axis=1)
        moving = int(np.flatnonzero(speed > 1e-4)[-1])
        rows = np.repeat(self.now[None], moving, axis=0)
        rows[:, order] = track.position[1 : moving + 1]
        self.struck.append(self.time - late / self.fps)
        self.rows.append(rows)
        self.now = rows[-1]
        return self

    def push(self, ball: int, to: Sequence[float], seconds: float = 0.8) -> Recording:
        """A hand moves a ball in sight, smoothly."""
        s = np.linspace(0, 1, round(seconds * self.fps))[1:]
        rows = np.repeat(self.now[None], len(s), axis=0)
        rows[:, ball] += (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None] * (np.array(to) - self.now[ball])
        self.rows.append(rows)
        self.now = rows[-1]
        return self

    def put(self, ball: int, to: Sequence[float], seconds: float = 0.4) -> Recording:
        """A hand covers a ball, and it is elsewhere."""
        self.now = self.now.copy()
        self.now[ball] = np.nan
        self.wait(seconds)
        self.now = self.now.copy()
        self.now[ball] = to
        return self


def at_rest_first(position: Array, frames: int) -> Array:
    return np.concatenate([np.repeat(position[:1], frames, axis=0), position])


def sightings(
    position: Array, names: Sequence[str], rng: np.random.Generator, *, drop: float = 0.0, false: float = 0.0,
    camera: Camera = CAMERA, noise: float = NOISE,
) -> Iterator[list[Detection]]:  # fmt: skip
    """What a detector would see of places (m, n, 2), NaN where there is no ball, in any order."""
    m, n, _ = position.shape
    outlines = camera.outline(np.nan_to_num(position).reshape(-1, 2)).reshape(m, n, 2)
    for xy, pixels in zip(position, outlines, strict=True):
        seen = [
            Detection(name, px + noise * rng.standard_normal(2), 13.0, noise, 1.0, 1.0)
            for name, px, there in zip(names, pixels, np.isfinite(xy).all(axis=1), strict=True)
            if there and rng.random() >= drop
        ]
        if rng.random() < false:
            name = names[int(rng.integers(len(names)))]
            seen.append(Detection(name, rng.uniform((100, 100), (1180, 860)), 13.0, noise, 1.0, 1.0))
        yield [seen[k] for k in rng.permutation(len(seen))]


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
