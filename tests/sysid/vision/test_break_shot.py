"""A pack that flies apart within one frame, filmed with a long blur: every ball stays the one that it was."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from models.shot import Array, Table
from sysid.vision.balls.colours.palette import pool_palette
from sysid.vision.balls.detect import Detection
from sysid.vision.balls.discs import Expected
from sysid.vision.balls.learning import learn_detector
from sysid.vision.frames import Frame
from sysid.vision.tracks.following.follow import Follower
from sysid.vision.tracks.following.retrace import Retracer
from sysid.vision.tracks.track import track
from tests.footage.cameras import overhead
from tests.footage.film import BALLS, Look, Spot, film
from tests.footage.motion import Motion
from tests.footage.webcam import Webcam, webcam
from tests.support.drawn_balls import footage_of

DIAMETER, RATE, HIT = 0.0523, 25.0, 0.575  # when the cue ball touches the pack: 0.6 of a frame before the next
CAMERA = overhead(Table(1.2, 0.65), DIAMETER, (640, 380), 1.5, 1.36, (0.02, -0.02))
COLOURS = {name: BALLS[name] for name in ("yellow", "blue", "red", "pink", "brown", "black")} | {
    "orange": (0.95, 0.33, 0.08), "ivory": (0.9, 0.85, 0.7), "purple": (0.35, 0.15, 0.5)
}  # fmt: skip
SPEEDS = (0.4, 0.1, 0.6, 0.2, 0.3, 2.4, 1.0, 1.7, 0.8)  # after the break [m/s]; no two balls meet again,
HARDER = (0.4, 2.1, 1.6, 0.8, 0.2, 4.8, 0.6, 3.0, 1.2)  # nor with these
NUMBER = (Spot((0.3, 0.2, 1.0), 0.45, (0.95, 0.95, 0.95)), Spot((-0.5, 0.4, 0.8), 0.3))


def paths(times: Array, speeds: Sequence[float] = SPEEDS) -> Array:
    """Places (n, 10, 2) [m] of a cue ball that strikes a pack of nine, and of these; cushions reflect them."""
    rows = [(x, (k - (n - 1) / 2)) for x, n in enumerate((1, 2, 3, 2, 1)) for k in range(n)]
    pack = np.array(rows) * (np.sqrt(3) / 2, 1.0) * DIAMETER * 1.001
    outwards = pack - pack.mean(axis=0) + [0.3 * DIAMETER, 0.1 * DIAMETER]
    velocity = np.array(speeds)[:, None] * outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
    since = (times - HIT)[:, None]
    touching = np.array([-DIAMETER, 0.0])
    white = touching + np.where(since < 0, since.clip(-0.17) * [3.0, 0.3], since * [-0.4, 0.3])
    places = np.concatenate([white[:, None], pack + since.clip(0)[..., None] * velocity], axis=1)
    half = np.array([CAMERA.table.length, CAMERA.table.width]) / 2 - CAMERA.radius
    folded = np.mod(places + half + [0.02, 0.03], 4 * half)
    return np.asarray(np.minimum(folded, 4 * half - folded) - half)


@pytest.mark.parametrize("seed", range(5))
def test_balls_that_were_missed_and_exchanged_are_put_right(seed: int) -> None:
    """Of a pack just hit, what is blurred is seen where it is expected only, so that others take its place."""
    times, rng = np.arange(26) / RATE, np.random.default_rng(seed)
    true = paths(times, HARDER)
    pixels = CAMERA.outline(true.reshape(-1, 2)).reshape(*true.shape)
    step = np.linalg.norm(np.diff(pixels, axis=0, prepend=pixels[:1]), axis=2)
    radius = float(CAMERA.radius_px(np.zeros((1, 2)))[0])
    faces = np.array([BALLS["white"], *COLOURS.values()])

    def find(frame: Frame, expected: Sequence[Expected], full_search: bool) -> list[Detection]:
        k, seen = frame.index, []
        for ball, xy in enumerate(pixels[k]):
            blurred = HIT < frame.time < HIT + 2 / RATE and step[k, ball] > radius
            if not blurred or any(np.hypot(*(one.xy - xy)) < 1.5 * radius for one in expected):
                face = (faces[ball] + rng.normal(0, 0.02, 3)).clip(0, 1)
                seen.append(Detection("ball", xy + rng.normal(0, 0.1, 2), radius, 0.1, 1.0, 1.0, colour=face))
        return [seen[k] for k in rng.permutation(len(seen))]

    follower = Follower(CAMERA, {"ball": 10})
    retracer = Retracer(follower, find)
    for index, time in enumerate(times):
        frame = Frame(index, float(time), np.zeros((1, 1, 3), np.uint8))
        expected = follower.expected(frame.time, 1 / RATE)
        retracer.begin()
        follower.update(index, frame.time, find(frame, expected, follower.seeking))
        retracer.end(frame, 1 / RATE)
    retracer.finish(1 / RATE)
    whose = []
    for one in follower.tracks():
        off = np.linalg.norm(true[one.frame] - one.xy[:, None], axis=2)
        whose.append(set(off.argmin(axis=1).tolist()))
        assert len(one.frame) >= len(times) - 1
        assert (np.diff(one.time) > 0).all()
    assert sorted(map(sorted, whose)) == [[k] for k in range(10)]


@pytest.mark.slow
def test_balls_of_a_pack_that_flies_apart_stay_themselves(tmp_path: Path) -> None:
    fine = np.arange(0.0, 1.2, 1e-3)
    motion = Motion(("white", *COLOURS), fine, paths(fine), np.tile([0.0, 0, 0, 1], (len(fine), 10, 1)))
    times = np.arange(26) / RATE
    look = Look(
        exposure=0.016, noise=2.0, shadow=0.45, light=(0.05, 0.03, 1.0), colours=COLOURS,
        spots=dict.fromkeys(COLOURS, NUMBER),
    )  # fmt: skip
    footage = footage_of(tmp_path / "film", list(webcam(film(CAMERA, motion, times, look), Webcam(quality=60))), RATE)
    detector = learn_detector(CAMERA, footage, pool_palette())
    result = track(footage, CAMERA, detector, {"ball": 10})
    true = paths(times)
    whose = []
    for one in result.scene.tracks:
        off = np.linalg.norm(true[one.frame] - one.xy[:, None], axis=2)
        assert off.min(axis=1).max() < DIAMETER / 4
        whose.append(set(off.argmin(axis=1).tolist()))
        assert len(one.frame) >= len(times) - 2
    assert sorted(map(sorted, whose)) == [[k] for k in range(10)]
    assert [(shot.struck, len(shot.balls)) for shot in result.shots] == [("white", 10)]
