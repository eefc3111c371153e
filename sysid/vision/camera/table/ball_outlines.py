"""The outlines of balls at rest in single pictures: their sizes, and how long they are.

In: pictures and a rough camera. Out: `BallOutlines`. The sizes say how large the table is without regard to its noses.
The outline of a sphere is an ellipse, the longer the farther it lies from the middle of the picture, and the wider the
lens is: an elongation of 1 / cos(angle from the axis). So outlines show the focal length where a view from straight
above, in which the sides of the table do not, leaves it open.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.lines import cloth_coloured

BALL_RAYS = 64  # along which the outline of a ball is looked for
BALL_RADII = np.arange(0.75, 1.35, 0.01)  # [expected radii]
CLEAR_EDGE = 0.6  # of the steepest along a ray
MAX_BALL_SCATTER = 0.08  # of the radius over the rays, relative: rounder than a hand
OUTLINE_LOSS_PX = 0.5  # of the radius of an outline: balls are dark at their rims, unless overexposed
OUTLINE_SD_PX = 0.4  # of that loss, common to all
BALL_RATIOS = (0.8, 1.25)  # of outlines to those expected; others are not of balls
MIN_BALLS = 2  # whose size counts
OUTLINE_SCATTER = 0.03  # relative, of each
MIN_BALL_RAYS = 0.7  # fraction of the rays that end on such a circle
RIM_REACH_PX = 4.0  # on either side of a circle, in which the edge of a ball is followed,
RIM_SEARCH_PX = 2.0  # and first looked for
RIM_WINDOW_PX = 1.0  # about that edge, whose slope's middle is its place: standard deviation
RIM_ROUNDS = 6  # of finding that middle about the one before
RIM_STEP_PX = 0.1
LENGTH_SD_PX = 0.04  # of half the difference of an outline's axes, beside its scatter, which the light makes,
LAMPS_SD_PX = 0.06  # and what the lamps do to all balls
MAX_RIM_SCATTER_PX = 0.3  # of the edge of a ball about its ellipse
RIM_SCATTER_PX = 0.1  # of a rim about its ellipse


@dataclass(frozen=True)
class BallOutlines:
    """Outlines of balls at rest."""

    pixels: Array  # (n, 2) their centres
    radius: Array  # (n,) [pixels]
    elongation: Array  # (n,) half of its length along the line to the middle of the picture less its width [pixels]
    scatter: Array  # (n,) of its edge about that ellipse [pixels]

    def ratio(self, camera: Camera) -> tuple[float, float]:
        """Size seen over that expected by a camera, and its standard deviation; NaN with fewer than two.

        The light on a ball shifts its outline by some tenths of a pixel, on white balls and dark ones differently.
        """
        if len(self.radius) < MIN_BALLS:
            return np.nan, np.nan
        expected = camera.radius_px(camera.centres(self.pixels))
        ratios = (self.radius + OUTLINE_LOSS_PX) / expected
        common = OUTLINE_SD_PX / float(np.median(expected))
        return float(np.median(ratios)), float(np.hypot(common, OUTLINE_SCATTER / np.sqrt(len(ratios))))

    def elongation_errors(self, camera: Camera) -> Array:
        """Elongations seen less those expected by a camera, in standard deviations and independent of each other: (n,).

        A ball at rest is lit alike in all pictures, and all balls by the same lamps: what that does to their outlines
        is common to them.
        """
        if not len(self.radius):
            return np.zeros(0)
        rims = camera.rims(camera.centres(self.pixels))
        rims = rims - rims.mean(axis=1, keepdims=True)
        outwards = _outwards(self.pixels, camera)
        sideways = outwards[:, ::-1] * [-1, 1]
        # The points of a rim are evenly spaced about the ellipse: their mean square along an axis is half its square.
        length, width = (
            np.sqrt(2 * np.mean(np.sum(rims * d[:, None], axis=2) ** 2, axis=1)) for d in (outwards, sideways)
        )
        apart = np.linalg.norm(self.pixels[:, None] - self.pixels, axis=2)
        covariance = np.exp(-((apart / np.median(self.radius)) ** 2)) * np.outer(self.scatter, self.scatter)
        covariance += LAMPS_SD_PX**2 + LENGTH_SD_PX**2 * np.eye(len(apart))
        return np.linalg.solve(np.linalg.cholesky(covariance), self.elongation - (length - width) / 2)


NO_BALLS = BallOutlines(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0))


def find_balls(pictures: Iterable[NDArray[np.uint8]], camera: Camera) -> BallOutlines:
    """Outlines of balls on the bed in pictures (height, width, 3), as a rough camera expects them."""
    centres: list[Array] = []
    figures: list[tuple[float, float, float]] = []  # radius, elongation, scatter
    for picture in pictures:
        other = np.where(cloth_coloured(picture), 0, 1).astype(np.uint8)
        count, _, stats, middles = cv2.connectedComponentsWithStats(other)
        places = camera.on_plane(middles, camera.radius)
        half = np.array([camera.table.length, camera.table.width]) / 2 - camera.diameter
        on_bed = np.all(np.abs(np.nan_to_num(places, nan=9.0)) < half, axis=1)
        for k in np.flatnonzero(on_bed[1:count]) + 1:
            expected = float(camera.radius_px(places[k : k + 1])[0])
            wide, high, area = stats[k, cv2.CC_STAT_WIDTH], stats[k, cv2.CC_STAT_HEIGHT], stats[k, cv2.CC_STAT_AREA]
            if not (0.4 < area / (np.pi * expected**2) < 2.6 and 0.7 < wide / high < 1.4):
                continue
            found = _outline(picture, middles[k], expected)
            if found is None:
                continue
            elongation, scatter = _elongation(picture, *found, _outwards(found[0][None], camera)[0])
            if scatter < MAX_RIM_SCATTER_PX:
                centres.append(found[0])
                figures.append((found[1], elongation, scatter))
    return BallOutlines(np.array(centres).reshape(-1, 2), *np.array(figures).reshape(-1, 3).T)


def _outwards(pixels: Array, camera: Camera) -> Array:
    """Unit vectors (n, 2) from the middle of a lens's picture to pixels (n, 2)."""
    away = pixels - camera.matrix[:2, 2]
    return np.asarray(away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9))


def _elongation(picture: NDArray[np.uint8], centre: Array, radius: float, outwards: Array) -> tuple[float, float]:
    """Half of the length of an outline less its width, where its edge is steepest, and its scatter [pixels]."""
    ways = _ways()
    steps = np.arange(-min(RIM_REACH_PX, radius / 2), RIM_REACH_PX, RIM_STEP_PX)
    seen = _along(cv2.GaussianBlur(picture, (0, 0), 1.0), centre, ways, radius + steps)
    slope, middle = np.linalg.norm(np.diff(seen, axis=1), axis=2), steps[:-1] + RIM_STEP_PX / 2
    edge = middle[np.argmax(slope * (np.abs(middle) < RIM_SEARCH_PX), axis=1)]
    for _ in range(RIM_ROUNDS):
        weight = slope * np.exp(-0.5 * ((middle - edge[:, None]) / RIM_WINDOW_PX) ** 2)
        edge = (weight @ middle) / np.maximum(weight.sum(axis=1), 1e-9)
    terms = np.column_stack([ways, np.ones(len(ways)), 2 * (ways @ outwards) ** 2 - 1])
    fit = least_squares(lambda p: terms @ p - edge, np.zeros(4), lambda p: terms, loss="cauchy", f_scale=RIM_SCATTER_PX)
    return float(fit.x[3]), 1.4826 * float(np.median(np.abs(fit.fun)))


def _ways() -> Array:
    """Unit vectors (BALL_RAYS, 2) all around."""
    angle = np.linspace(0, 2 * np.pi, BALL_RAYS, endpoint=False)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _along(light: NDArray[np.generic], centre: Array, ways: Array, away: Array) -> Array:
    """The picture at distances (k,) [pixels] from a centre (2,) along unit vectors (n, 2): (n, k, 3)."""
    points = (centre + ways[:, None] * away[:, None]).astype(np.float32)
    return cv2.remap(light.astype(np.float32), points[..., 0], points[..., 1], cv2.INTER_LINEAR).astype(float)


def _outline(picture: NDArray[np.uint8], middle: Array, expected: float) -> tuple[Array, float] | None:
    """Centre (2,) and radius of a ball [pixels], where its colour changes fastest to the cloth's; None if none."""
    ways = _ways()
    centre, radius = np.asarray(middle, float), expected
    light = cv2.GaussianBlur(picture, (0, 0), 1.0).astype(np.float32)
    for _ in range(3):
        seen = _along(light, centre, ways, expected * BALL_RADII)
        slope = np.linalg.norm(np.diff(seen, axis=1), axis=2)
        # The outermost clear edge: inside a ball there are its shades, highlights and marks.
        peak = (slope[:, 1:-1] >= slope[:, :-2]) & (slope[:, 1:-1] >= slope[:, 2:])
        clear = peak & (slope[:, 1:-1] > CLEAR_EDGE * slope.max(axis=1, keepdims=True))
        last = clear.shape[1] - np.argmax(clear[:, ::-1], axis=1)
        away = expected * (BALL_RADII[:-1] + 0.005)[np.clip(last, 0, slope.shape[1] - 1)]
        good = np.abs(away - np.median(away)) < 0.15 * expected
        if good.mean() < MIN_BALL_RAYS:
            return None
        rim = away[good, None] * ways[good]
        # A circle about c: |x|^2 = 2 c x + (r^2 - |c|^2), which is linear.
        fit = np.linalg.lstsq(np.column_stack([2 * rim, np.ones(len(rim))]), np.sum(rim**2, axis=1), rcond=None)[0]
        shift = fit[:2]
        radius = float(np.sqrt(max(fit[2] + shift @ shift, 0.0)))
        centre = centre + shift
    scatter = np.linalg.norm(rim - shift, axis=1) / max(radius, 1e-6) - 1
    round_enough = 1.4826 * np.median(np.abs(scatter)) < MAX_BALL_SCATTER
    if not (round_enough and BALL_RATIOS[0] < radius / expected < BALL_RATIOS[1]):
        return None
    return centre, radius
