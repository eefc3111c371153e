"""What webcams and players make of pictures: compression, a hand over the table, projected rings, doubled frames.

In: pictures, in order. Out: the same pictures, with these difficulties, seen by a camera that is bumped if wanted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from tests.footage.film import Picture

SKIN = (150, 170, 215)  # blue, green, red
SLEEVE = (60, 30, 45)
RING_LIGHT = (120, 110, 10)
FINGERS = ((0.0, 0.06), (0.03, 0.045), (-0.03, 0.045), (0.05, 0.02), (-0.055, 0.01))  # across, along; of the width


@dataclass(frozen=True)
class Webcam:
    """Difficulties of one recording."""

    quality: int = 60  # of JPEG, 1 to 100
    hand: tuple[float, float] | None = None  # where a hand comes in, in widths and heights of the picture
    ring: tuple[float, float] | None = None  # of projected light, from the middle, in widths and heights
    doubled: tuple[int, ...] = ()  # frames that are stored twice
    dropped: tuple[int, ...] = ()  # frames that are not stored
    bumped: tuple[int, tuple[float, float]] | None = None  # from which picture on all is seen elsewhere [pixels]
    seed: int = 0  # of the hand's trembling


def webcam(pictures: Iterable[Picture], how: Webcam) -> Iterator[Picture]:
    """The pictures with these difficulties."""
    rng = np.random.default_rng(how.seed)
    for k, picture in enumerate(pictures):
        if k in how.dropped:
            continue
        out = picture.copy()
        h, w = out.shape[:2]
        if how.bumped is not None and k >= how.bumped[0]:
            aside = np.array([[1.0, 0.0, how.bumped[1][0]], [0.0, 1.0, how.bumped[1][1]]])
            out = np.asarray(cv2.warpAffine(out, aside, (w, h), borderMode=cv2.BORDER_REPLICATE), np.uint8)
        if how.ring is not None:
            light = np.zeros_like(out)
            at = round(w * (0.5 + how.ring[0])), round(h * (0.5 + how.ring[1]))
            cv2.circle(light, at, round(0.022 * w), RING_LIGHT, 2, cv2.LINE_AA)
            out = cv2.add(out, light)
        if how.hand is not None:
            _draw_hand(out, np.array(how.hand) * [w, h] + rng.normal(0, 0.6, 2), w)
        _, code = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, how.quality])
        shown = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)
        yield from [shown] * (1 + (k in how.doubled))


def _draw_hand(out: Picture, at: np.ndarray, width: int) -> None:
    """A fist with fingers, at the end of an arm from the picture's lower edge."""
    x, y = (int(v) for v in at)
    cv2.line(out, (x, y), (x, out.shape[0] + 10), SLEEVE, round(0.05 * width), cv2.LINE_AA)
    cv2.ellipse(out, (x, y), (round(0.035 * width), round(0.028 * width)), 0, 0, 360, SKIN, -1, cv2.LINE_AA)
    for across, along in FINGERS:
        tip = (x + round(across * width), y - round(along * width))
        cv2.line(out, (x, y), tip, SKIN, round(0.014 * width), cv2.LINE_AA)
