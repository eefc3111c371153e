"""Where the table is in a picture: the region of its cloth, and the straight sides of that region.

The cloth's colour is the one that most saturated pixels in the middle of the picture have; what has its hue is cloth,
bed and cushions alike. A side is a line, straight but for the bow of a lens, that a good part of the region's outline
follows and that hardly anything of it lies beyond: a hand, a cue or a pocket makes a dent, never a side.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.vision.camera.projection import Array

REMEDY = "film the whole table, or give --corners or a board"
SHARE = 0.25  # of the middle of the picture that the cloth must fill
LEAST = 0.04  # and of the whole picture
GAP = 0.025  # widest dent that is closed, of the picture's width: a cue, a projected line
BOW = 0.01  # how far a side may leave a straight line, of the picture's width
SHORTEST = 0.12  # side, of the picture's width
COVER = 0.5  # of its length that the outline must follow it
BEYOND = 0.04  # of the outline that may lie beyond a side
PAIRS = 800  # of outline points that are tried as sides
APART = np.radians(30)  # least angle between two sides' normals


@dataclass(frozen=True)
class Side:
    """One straight side of the cloth, in the picture."""

    normal: Array  # (2,) unit vector out of the cloth [pixels]
    offset: float  # of the line along it [pixels]
    points: Array  # (n, 2) of the outline that lie on it [pixels]

    @property
    def bearing(self) -> float:
        """Where it lies, counter-clockwise from the picture's right [rad]."""
        return float(np.arctan2(-self.normal[1], self.normal[0]))

    def meets(self, other: Side) -> Array:
        """Where two sides cross: (2,) [pixels]."""
        return np.asarray(np.linalg.solve(np.stack([self.normal, other.normal]), [self.offset, other.offset]))


def cloth(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The region of the cloth in a picture (height, width, 3): (height, width), 255 inside.

    Raises:
        BadInput: no colour prevails in the middle, or the region is small.
    """
    height, width = picture.shape[:2]
    colours = cv2.cvtColor(cv2.GaussianBlur(picture, (0, 0), 1.5), cv2.COLOR_BGR2HSV)
    hue, saturation, value = (channel.astype(float) for channel in cv2.split(colours))
    core = np.zeros(hue.shape, bool)
    core[height // 4 : height - height // 4, width // 4 : width - width // 4] = True
    vivid = core & (saturation > 50) & (value > 25)
    votes = np.bincount(hue[vivid].astype(int), saturation[vivid], 180)
    smooth = sum(np.roll(votes, k) * np.exp(-((k / 3) ** 2) / 2) for k in range(-8, 9))
    away = np.abs((hue - np.argmax(smooth) + 90) % 180 - 90)
    like = vivid & (away < 12)
    if like.sum() < SHARE * core.sum():
        raise BadInput(f"no table found: no saturated colour fills the middle of the picture; {REMEDY}")
    usual, bright = np.median(saturation[like]), np.median(value[like])
    spread = float(np.clip(6 * np.median(away[like]), 8, 18))
    mask = ((away < spread) & (saturation > 0.45 * usual) & (value > 0.25 * bright)).astype(np.uint8) * 255
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * int(GAP * width / 2) + 1,) * 2)
    mask = cv2.morphologyEx(cv2.medianBlur(mask, 5), cv2.MORPH_CLOSE, kernel)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(outlines, key=cv2.contourArea)
    if cv2.contourArea(largest) < LEAST * mask.size:
        raise BadInput(f"no table found: the largest region of the cloth's colour is small; {REMEDY}")
    region = np.zeros_like(mask)
    cv2.drawContours(region, [largest], -1, 255, cv2.FILLED)
    return np.asarray(region)


def sides(region: NDArray[np.uint8]) -> list[Side]:
    """The straight sides of the cloth's region (height, width), counter-clockwise as seen, from the picture's right."""
    height, width = region.shape
    outlines, _ = cv2.findContours(region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(outlines, key=cv2.contourArea).reshape(-1, 2).astype(float)
    outline = outline[:: max(1, len(outline) // 1600)]
    middle = outline.mean(axis=0)
    # Where the picture ends the cloth does not.
    inside = ((outline > 4) & (outline < np.array([width, height]) - 5)).all(axis=1)
    points = outline[inside]
    bow, shortest = BOW * width, SHORTEST * width
    rng = np.random.default_rng(0)
    found: list[Side] = []
    while len(found) < 4 and len(points) > 20:
        best = _line(points, outline, middle, bow, shortest, [s.normal for s in found], rng)
        if best is None:
            break
        normal, offset = best
        on = np.abs(points @ normal - offset) < 2 * bow
        found.append(Side(normal, offset, points[on]))
        points = points[~on]
    return sorted(found, key=lambda side: side.bearing % (2 * np.pi))


def _line(
    points: Array, outline: Array, middle: Array, bow: float, shortest: float, taken: list[Array],
    rng: np.random.Generator,
) -> tuple[Array, float] | None:  # fmt: skip
    """The line that most points follow, all else on its inner side: normal (2,) and offset."""
    first, second = points[rng.integers(len(points), size=(2, PAIRS))]
    along = second - first
    reach = np.linalg.norm(along, axis=1)
    far = reach > shortest / 2
    along = along[far] / reach[far, None]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    offsets = np.sum(normals * first[far], axis=1)
    inner = np.sign(offsets - normals @ middle)[:, None]
    normals, offsets = normals * inner, offsets * inner[:, 0]
    beyond = (outline @ normals.T - offsets > bow).mean(axis=0)
    on = np.abs(points @ normals.T - offsets) < bow
    good = beyond < BEYOND
    for other in taken:
        good &= normals @ other < np.cos(APART)
    order = np.argsort(-(on.sum(axis=0) * good), kind="stable")
    for k in order[:20]:
        if not good[k]:
            break
        own = points[on[:, k]]
        along_it = own @ np.array([-normals[k, 1], normals[k, 0]])
        covered = np.histogram(along_it, 24)[0] > 0
        if np.ptp(along_it) < shortest or covered.mean() < COVER:
            continue
        centre = own.mean(axis=0)
        refined = np.linalg.svd(own - centre, full_matrices=False)[2][1]
        refined = refined * np.sign(refined @ normals[k])
        return refined, float(refined @ centre)
    return None
