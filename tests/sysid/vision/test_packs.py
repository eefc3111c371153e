"""Balls that touch each other, as racked ones do, in compressed pictures: each of them is found, and none beside."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest

from models.shot import Array, Table
from sysid.vision.balls.colours.palette import default_palette, pool_palette
from sysid.vision.balls.detect import Detection, Detector
from sysid.vision.balls.discs import Expected
from sysid.vision.balls.learning import learn_detector
from sysid.vision.sources.pictures import Picture
from tests.footage.cameras import overhead
from tests.footage.film import BALLS, Look, Spot, film
from tests.footage.motion import Motion
from tests.footage.webcam import Webcam, webcam
from tests.support.drawn_balls import footage_of

DIAMETER = 0.0523
CAMERA = overhead(Table(1.2, 0.65), DIAMETER, (640, 380), 1.5, 1.36, (0.02, -0.02))
PIXEL_M = 1.36 / 640 * 1.02  # on the table, at the height of the balls less
SEVERAL = ("yellow", "blue", "red", "pink", "white", "red", "brown", "black", "yellow")
RACK = (*SEVERAL[:4], "red", "white", "brown", "black", "yellow", "pink", "brown", "blue", "pink", "red", "yellow")
NUMBER = (Spot((0.3, 0.2, 1.0), 0.45, (0.95, 0.95, 0.95)), Spot((-0.5, 0.4, 0.8), 0.3))


def rack(rows: tuple[int, ...], at: tuple[float, float]) -> Array:
    """Places (n, 2) [m] of balls that touch, in rows across the table of so many."""
    along = np.sqrt(3) / 2 * DIAMETER * np.arange(len(rows))
    each = [(x, (k - (n - 1) / 2) * DIAMETER) for x, n in zip(along, rows, strict=True) for k in range(n)]
    return np.array(each) * 1.001 + at


def filmed(colours: Mapping[str, str], racked: Array, *, numbers: bool) -> list[Picture]:
    """A cue ball that rolls while the other balls rest in a rack."""
    times = np.arange(0.0, 1.0, 0.1)
    white = np.column_stack([-0.45 + 0.1 * times, -0.2 + 0.2 * times])
    places = np.concatenate([white[:, None], np.broadcast_to(racked, (len(times), *racked.shape))], axis=1)
    turned = np.tile([0.0, 0, 0, 1], (*places.shape[:2], 1))
    look = Look(
        noise=2.0, shadow=0.45, light=(0.05, 0.03, 1.0), colours={n: BALLS[c] for n, c in colours.items()},
        spots=dict.fromkeys(colours, NUMBER) if numbers else {},
    )  # fmt: skip
    motion = Motion(("white", *colours), times, places, turned)
    return list(webcam(film(CAMERA, motion, times[:8], look), Webcam(quality=45)))


def missed(seen: list[Detection], racked: Array) -> tuple[Array, int]:
    """How far each ball of a rack is from the nearest detection [m]: (n,), and how many detections are of none."""
    found = CAMERA.centres(np.array([one.xy for one in seen]))
    apart = np.linalg.norm(found[:, None] - racked, axis=2)
    return apart.min(axis=0), int((apart.min(axis=1) > DIAMETER / 4).sum())


TRIANGLE, RHOMBUS = (1, 2, 3, 4, 5), (1, 2, 3, 2, 1)


@cache
def learnt_rack(
    rows: tuple[int, ...], colours: tuple[str, ...], *, pool: bool
) -> tuple[Array, list[Picture], Detector]:
    """Places (n, 2) [m] of a rack's balls, its film, and what is learnt of it."""
    racked = rack(rows, (0.1, 0.03))
    pictures = filmed({f"{c}_{k}": c for k, c in enumerate(colours)}, racked, numbers=pool)
    with TemporaryDirectory() as folder:
        footage = footage_of(Path(folder), pictures)
        return racked, pictures, learn_detector(CAMERA, footage, pool_palette() if pool else default_palette())


@pytest.mark.parametrize(
    ("rows", "colours", "pool"),
    [
        (TRIANGLE, ("red",) * 15, False),
        (RHOMBUS, SEVERAL, True),
        pytest.param(TRIANGLE, RACK, True, marks=pytest.mark.slow),
        pytest.param(RHOMBUS, SEVERAL, False, marks=pytest.mark.slow),
    ],
)
def test_every_ball_of_a_rack_is_found(rows: tuple[int, ...], colours: tuple[str, ...], pool: bool) -> None:
    racked, pictures, detector = learnt_rack(rows, colours, pool=pool)
    for picture in pictures[::4]:
        seen = detector.find(picture)
        for _ in range(4):  # found anew, then followed from where they were found
            off, beside = missed(seen, racked)
            assert off.max() < 1.5 * PIXEL_M and np.sqrt((off**2).mean()) < 1.5e-3
            assert beside == 1  # the cue ball
            seen = detector.find(picture, [Expected(one.name, one.xy + 0.5) for one in seen])


def test_pieces_of_an_arm_are_no_rack() -> None:
    """A sleeve comes in over the lower cushion, and ends in a fist whose knuckles are round."""
    racked, pictures, detector = learnt_rack(RHOMBUS, SEVERAL, pool=True)
    with_arm, skin, r = pictures[0].copy(), (120, 150, 200), 12
    cv2.line(with_arm, (200, 379), (200, 300), skin, 2 * r, cv2.LINE_AA)
    for knuckle in ((188, 290), (212, 290), (176, 270), (200, 269), (224, 270)):
        cv2.circle(with_arm, knuckle, r, (108, 135, 180), -1, cv2.LINE_AA)
    off, beside = missed(detector.find(with_arm), racked)
    assert off.max() < 1.5 * PIXEL_M
    assert beside == 1  # the cue ball
