"""Balls that are followed without pictures: a recording made up, and what a detector would see of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np

from models.model_file import full_model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from sysid.vision.balls.detect import Detection
from sysid.vision.balls.discs import Expected, Shutter
from sysid.vision.camera.projection import Camera
from sysid.vision.frames import Frame
from sysid.vision.sources.pictures import Picture
from sysid.vision.tracks.following.follow import Follower
from sysid.vision.tracks.track import Tracked, tracked
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


def tracked_of(
    made: Recording, drop: float = 0.0, noise: float = NOISE, camera: Camera = CAMERA
) -> Tracked:  # fmt: skip
    """What is made of a recording."""
    follower = Follower(camera)
    position = np.concatenate(made.rows)
    for index, some in enumerate(
        sightings(position, NAMES, np.random.default_rng(0), drop=drop, noise=noise, camera=camera)
    ):
        follower.update(index, index / made.fps, some)
    frames = np.arange(len(position))
    return tracked(follower.tracks(), frames, frames / made.fps, camera)


class Drawn:
    """Footage of a recording: white discs on black, which a detector without doubts finds."""

    size, fps, assumed = CAMERA.size, FPS, ("frame times from the test",)

    def __init__(self, made: Recording) -> None:
        self.position = np.concatenate(made.rows)
        self.count = len(self.position)

    def __iter__(self) -> Iterator[Frame]:
        for index in range(self.count):
            picture = np.zeros((self.size[1] // 2, self.size[0] // 2, 3), np.uint8)
            picture[0, 0] = index // 256, index % 256, 0
            yield Frame(index, index / FPS, picture)


class Knowing:
    """A detector that looks up where balls are; those that are not expected only when all are asked for."""

    told, noise, palette = ("told by the test",), 1.0, None

    def __init__(self, made: Recording) -> None:
        position = np.concatenate(made.rows)
        self.seen = list(sightings(position, NAMES, np.random.default_rng(0)))
        self.asked = [0, 0]

    def find(
        self, picture: Picture, expected: Sequence[Expected] = (), shutter: Shutter | None = None,
        taken: Sequence[Detection] = (),
    ) -> list[Detection]:  # fmt: skip
        index = 256 * int(picture[0, 0, 0]) + int(picture[0, 0, 1])
        self.asked[bool(expected)] += 1
        if not expected:
            return [s for s in self.seen[index] if all(np.hypot(*(s.xy - one.xy)) > s.radius for one in taken)]
        near = [(s, one) for s in self.seen[index] for one in expected if s.name == one.name]
        return [s for s, one in near if np.hypot(*(s.xy - one.xy)) < 60]
