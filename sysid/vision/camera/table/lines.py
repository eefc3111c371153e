"""The region of the cloth in a picture, and its straight sides.

In: a picture. Out: the mask of the cloth, then `Side` of each of its sides. What has the colour of most
saturated pixels in the middle of the picture is cloth, on the bed and on the cushions. A side is a
line, straight up to the distortion of the lens, that much of the outline of the region follows and hardly anything of
it exceeds: a hand, a cue or a pocket makes a dent, never a side. Where the picture is blurred, what lies beside the
cloth colours its rim, and the region ends some pixels inside it: the points of a side are moved to the edge there.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.vision.camera.projection import Array

Mask = NDArray[np.bool_]
NO_TABLE_REMEDY = "film the whole table, or give --corners or a board"
MIN_CORE_FRACTION = 0.25  # of the middle of the picture, that the cloth fills
MIN_CLOTH_FRACTION = 0.04  # of the whole picture
# Lengths below are in widths of the picture.
MAX_DENT_WIDTHS = 0.025  # that is closed: a cue, a projected line
MAX_BOW_WIDTHS = 0.01  # of a side, by the distortion of the lens
MIN_SIDE_WIDTHS = 0.12  # length of a side
MIN_SIDE_COVERAGE = 0.5  # fraction of its length that the outline follows
MAX_OUTSIDE_FRACTION = 0.04  # of the outline, beyond a side
DARK_GREY = 4.0  # added to the light, so that noise in the dark has no colour [grey levels]
COLOUR_ROUNDS = 6  # of fitting the colour of the cloth
COLOUR_OUTLIER_SD = 6.0  # robust standard deviations from which on a colour is not the cloth's
COLOUR_LIMITS = (0.15, 0.4)  # of that distance, in logarithms of ratios of light
TRIED_PAIRS = 800  # of outline points, as candidates of sides
RIM_PX = 5  # of the picture, in which the cloth meets its border,
MIN_CUT_FRACTION = 0.1  # along so much of it
RIM_LOST_PX = 4.0  # that the region may end inside the cloth's edge
EDGE_REACH_PX = (-1.0, 6.0)  # out of the region's outline, in which the cloth's edge is looked for
EDGE_STEP_PX = 0.25
MIN_NORMAL_ANGLE_RAD = np.radians(30)  # between the normals of two sides


@dataclass(frozen=True)
class Side:
    """One straight side of the cloth, in the picture."""

    normal: Array  # (2,) unit vector out of the cloth [pixels]
    offset: float  # of the line along it [pixels]
    points: Array  # (n, 2) of the outline that lie on it [pixels]

    @property
    def bearing(self) -> float:
        """Direction of its normal, counter-clockwise from the right of the picture [rad]."""
        return float(np.arctan2(-self.normal[1], self.normal[0]))

    def meets(self, other: Side) -> Array:
        """Intersection of two sides: (2,) [pixels]."""
        return np.asarray(np.linalg.solve(np.stack([self.normal, other.normal]), [self.offset, other.offset]))


def cloth(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The region of the cloth in a picture (height, width, 3): (height, width), 255 inside.

    Raises:
        BadInput: no colour prevails in the middle, or the region is small.
    """
    width = picture.shape[1]
    mask = np.where(cloth_coloured(picture), 255, 0).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * int(MAX_DENT_WIDTHS * width / 2) + 1,) * 2)
    mask = cv2.morphologyEx(cv2.medianBlur(mask, 5), cv2.MORPH_CLOSE, kernel)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(outlines, key=cv2.contourArea, default=None)
    if largest is None or cv2.contourArea(largest) < MIN_CLOTH_FRACTION * mask.size:
        raise BadInput(f"no table found: the largest area of the cloth's colour is too small; {NO_TABLE_REMEDY}")
    region = np.zeros_like(mask)
    cv2.drawContours(region, [largest], -1, 255, cv2.FILLED)
    return np.asarray(region)


def cloth_coloured(picture: NDArray[np.uint8]) -> Mask:
    """Which pixels of a picture (height, width, 3) have the colour that the cloth has there: (height, width).

    The hue of the cloth is that of most saturated pixels in the middle. The light of lamps and projectors colours it,
    here more than there: the shares of blue, green and red in its light are fitted by quadratic functions of the place,
    in rounds, first to the pixels of that hue. A pixel is compared with cloth of its own brightness by logarithms of
    blue and green over red: a cushion that leans away from the lamp is cloth as well.

    Raises:
        BadInput: no colour prevails in the middle.
    """
    height, width = picture.shape[:2]
    blurred = cv2.GaussianBlur(picture, (0, 0), 1.5)
    hue, saturation, value = (c.astype(float) for c in cv2.split(cv2.cvtColor(blurred, cv2.COLOR_BGR2HSV)))
    core = np.zeros(hue.shape, bool)
    core[height // 4 : height - height // 4, width // 4 : width - width // 4] = True
    vivid = core & (saturation > 50) & (value > 25)
    votes = np.bincount(hue[vivid].astype(int), saturation[vivid], 180)
    smooth = sum(np.roll(votes, k) * np.exp(-((k / 3) ** 2) / 2) for k in range(-8, 9))
    good = vivid & (np.abs((hue - np.argmax(smooth) + 90) % 180 - 90) < 12)
    if good.sum() < max(MIN_CORE_FRACTION * core.sum(), 1):
        raise BadInput(f"no table found: no saturated colour fills the middle of the picture; {NO_TABLE_REMEDY}")
    bright = value > 0.25 * np.median(value[good])
    light = blurred.astype(np.float32)
    whole = np.maximum(light.sum(axis=2, keepdims=True), 1.0)
    shares, ratios = light / whole, _ratios(light)
    u, v = np.meshgrid(np.linspace(-1, 1, width, dtype=np.float32), np.linspace(-1, 1, height, dtype=np.float32))
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    thin = (slice(None, None, 4),) * 2
    for _ in range(COLOUR_ROUNDS):
        fit = np.linalg.lstsq(terms[thin][good[thin]], shares[thin][good[thin]], rcond=None)[0]
        off = np.abs(ratios - _ratios(whole * np.maximum(terms @ fit, 0)))
        limit = np.clip(COLOUR_OUTLIER_SD * 1.4826 * np.median(off[good], axis=0), *COLOUR_LIMITS)
        good = (off < limit).all(axis=-1) & bright
    return np.asarray(good)


def _ratios(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Logarithms of blue and green over red in light (height, width, 3), from which noise in the dark is kept away."""
    above = np.log(light + np.float32(DARK_GREY))
    return np.asarray(above[..., :2] - above[..., 2:])


def sides(region: NDArray[np.uint8]) -> list[Side]:
    """The straight sides of the cloth's region (height, width), counter-clockwise as seen, from the picture's right."""
    height, width = region.shape
    outlines, _ = cv2.findContours(region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(outlines, key=cv2.contourArea).reshape(-1, 2).astype(float)
    outline = outline[:: max(1, len(outline) // 1600)]
    middle = outline.mean(axis=0)
    # The border of the picture is no side of the cloth.
    inside = ((outline > 4) & (outline < np.array([width, height]) - 5)).all(axis=1)
    points = outline[inside]
    bow, shortest = MAX_BOW_WIDTHS * width, MIN_SIDE_WIDTHS * width
    rng = np.random.default_rng(0)
    found: list[Side] = []
    while len(found) < 4 and len(points) > 20:
        best = _consensus_line(points, outline, middle, bow, shortest, [s.normal for s in found], rng)
        if best is None:
            break
        normal, offset = best
        on = np.abs(points @ normal - offset) < 2 * bow
        found.append(Side(normal, offset, points[on]))
        points = points[~on]
    return sorted(found, key=lambda side: side.bearing % (2 * np.pi))


def cut_off(region: NDArray[np.uint8]) -> list[str]:
    """Borders of the picture along which the cloth's region (height, width) goes on beyond it."""
    rows, columns = region > 0, (region > 0).T
    borders = {"left": columns[:RIM_PX], "right": columns[-RIM_PX:], "top": rows[:RIM_PX], "bottom": rows[-RIM_PX:]}
    return [name for name, rim in borders.items() if rim.any(axis=0).mean() > MIN_CUT_FRACTION]


def at_edges(sides: list[Side], picture: NDArray[np.uint8]) -> list[Side]:
    """The sides with their points where the colour of a picture (height, width, 3) changes fastest beside them."""
    light = cv2.GaussianBlur(picture, (0, 0), 1.0).astype(np.float32)
    steps = np.arange(EDGE_REACH_PX[0], EDGE_REACH_PX[1], EDGE_STEP_PX)
    found = []
    for side in sides:
        places = (side.points[:, None] + steps[:, None] * side.normal).astype(np.float32)
        seen = cv2.remap(light, places[..., 0], places[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
        steepest = np.argmax(np.linalg.norm(np.diff(seen, axis=1), axis=2), axis=1)
        away = steps[steepest] + EDGE_STEP_PX / 2
        offset = side.offset + float(np.median(away))
        found.append(Side(side.normal, offset, side.points + away[:, None] * side.normal))
    return found


def _consensus_line(
    points: Array, outline: Array, middle: Array, bow: float, shortest: float, taken: list[Array],
    rng: np.random.Generator,
) -> tuple[Array, float] | None:  # fmt: skip
    """The line that most points follow with the others inside (random sample consensus): normal (2,), offset."""
    first, second = points[rng.integers(len(points), size=(2, TRIED_PAIRS))]
    along = second - first
    distance = np.linalg.norm(along, axis=1)
    distant = distance > shortest / 2
    along = along[distant] / distance[distant, None]
    normals = np.column_stack([-along[:, 1], along[:, 0]])
    offsets = np.sum(normals * first[distant], axis=1)
    inner = np.sign(offsets - normals @ middle)[:, None]
    normals, offsets = normals * inner, offsets * inner[:, 0]
    beyond = (outline @ normals.T - offsets > bow).mean(axis=0)
    near = np.abs(points @ normals.T - offsets) < bow
    good = beyond < MAX_OUTSIDE_FRACTION
    for other in taken:
        good &= normals @ other < np.cos(MIN_NORMAL_ANGLE_RAD)
    order = np.argsort(-(near.sum(axis=0) * good), kind="stable")
    for k in order[:20]:
        if not good[k]:
            break
        inliers = points[near[:, k]]
        along_it = inliers @ np.array([-normals[k, 1], normals[k, 0]])
        covered = np.histogram(along_it, 24)[0] > 0
        if np.ptp(along_it) < shortest or covered.mean() < MIN_SIDE_COVERAGE:
            continue
        centre = inliers.mean(axis=0)
        refined = np.linalg.svd(inliers - centre, full_matrices=False)[2][1]
        refined = refined * np.sign(refined @ normals[k])
        return refined, float(refined @ centre)
    return None
