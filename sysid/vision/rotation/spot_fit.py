"""Circles on a sphere fitted to the pixels of spots, by least squares on the fraction of the spot's colour.

In: the pixels of a ball and the blobs on it. Out: centre, standard deviations and angular radius of every spot. The
edge of a spot is as soft as the picture, and only pixels certainly on the ball are used: a spot that the limb cuts off,
or that has a highlight in it, still has its centre in its middle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array
from sysid.vision.rotation.geometry import tangents

RIM_PX = 1.0  # next to the limb, that show the background, too
EDGE_HALF_WIDTH_PX = 0.55  # of a spot in a picture
MIN_SHARE = 0.2  # fraction of a spot's colour below which a pixel is the ball's
MAX_SHARE = 0.8  # and above which it is the spot's
MIN_SPOT_PIXELS = 4.0
PLACE_ERROR_PX = 0.05  # of a centre, that better pictures would not reduce
LIMB_ERROR_FRACTION = 0.25  # error of a centre towards the limb, relative to the width that the limb hides
FIT_MARGIN_RAD = 0.25  # about a spot, whose pixels its fit uses
FIT_STEPS = 6  # of Gauss and Newton at most
SETTLED_RAD = 1e-3  # a step below this ends the fit


@dataclass(frozen=True)
class Disc:
    """The pixels that show only the ball."""

    colour: Array  # (p, 3) grey levels
    normal: Array  # (p, 3) table axes
    facing: Array  # (p,) cosine of the angle to the line of sight
    inside: NDArray[np.bool_]  # (h, w) which pixels of the patch they are
    radius: float  # [pixels]
    axes: Array  # (3, 3) rows: a picture's x and y across the line of sight, and the line of sight


@dataclass(frozen=True)
class Blob:
    """Connected pixels that differ from the colour of the ball."""

    number: int
    colour: Array  # (3,) difference from the colour of the ball, in uniform light
    middle: Array  # (3,) unit vector
    angle: float  # angular radius [rad]


def find_blob(disc: Disc, difference: Array, label: NDArray[np.int32], number: int) -> Blob | None:
    """One blob; None if it is too small."""
    pixels = np.flatnonzero(label == number)
    if len(pixels) < MIN_SPOT_PIXELS:
        return None
    colour = difference[pixels]
    strength = np.sum(colour**2, axis=1)
    colour = np.mean(colour[strength >= np.median(strength)], axis=0)
    area = _colour_fraction(difference[pixels], colour) / disc.facing[pixels] / disc.radius**2
    total = float(area.sum())
    if total * disc.radius**2 < MIN_SPOT_PIXELS:
        return None
    middle = area @ disc.normal[pixels]
    angle = math.acos(max(1 - total / (2 * math.pi), -1.0))
    return Blob(number, colour, middle / math.sqrt(middle @ middle), angle)


def _colour_fraction(difference: Array, colour: Array) -> Array:
    """Fraction of a mark's colour in pixels, 0 to 1; pixels of the edge lie between, symmetric about a half."""
    share = (difference @ colour / (colour @ colour) - MIN_SHARE) / (MAX_SHARE - MIN_SHARE)
    return np.asarray(np.minimum(np.maximum(share, 0.0), 1.0))


def fit_pixels(
    disc: Disc, difference: Array, label: NDArray[np.int32], blob: Blob, noise: float
) -> tuple[NDArray[np.int64], Array, float]:
    """Pixels about a blob that belong to no other (q,), the fractions of its colour (q,), and the noise of these."""
    min_cosine = math.cos(min(blob.angle + FIT_MARGIN_RAD, 1.5))
    near = np.flatnonzero((disc.normal @ blob.middle > min_cosine) & ((label == 0) | (label == blob.number)))
    return (
        near,
        _colour_fraction(difference[near], blob.colour),
        max(noise / math.sqrt(blob.colour @ blob.colour), 0.03),
    )


def fit_circles(
    disc: Disc, blobs: list[tuple[NDArray[np.int64], Array, float]], middle: Array, angle: Array, typical: float | None
) -> tuple[Array, Array, Array]:
    """Fit circles on the sphere to fractions of colour: centres (k, 3), sds (k, 2), angular radii (k,) [rad]."""
    count, largest = len(blobs), max(len(index) for index, *_ in blobs)
    index, fraction, information = (
        np.zeros((count, largest), np.int64),
        np.zeros((count, largest)),
        np.zeros((count, largest)),
    )
    for k, (pixels, share, spread) in enumerate(blobs):
        index[k, : len(pixels)], fraction[k, : len(pixels)], information[k, : len(pixels)] = (
            pixels,
            share,
            1 / spread**2,
        )
    normal = disc.normal[index]  # (k, q, 3)
    flat = normal @ disc.axes[:2].T / disc.facing[index][..., None]  # (k, q, 2)
    # Prior of the angular radius: that of the other marks.
    prior_angle, angle_sd = (angle, 0.5) if typical is None else (np.full(count, typical), 0.1)
    x, y, sight = disc.axes
    change = np.empty((count, largest, 3))
    for step in range(FIT_STEPS):
        first = x - (middle @ x)[:, None] * middle
        first /= np.sqrt(np.sum(first**2, axis=1))[:, None]
        second = y - (middle @ y)[:, None] * middle - (first @ y)[:, None] * first
        second /= np.sqrt(np.sum(second**2, axis=1))[:, None]
        rotated = normal @ np.stack([middle, first, second], axis=2)  # (k, q, 3)
        # The gradient of n . m over pixels converts angles into distances in the picture.
        slope = (middle @ disc.axes[:2].T)[:, None] - flat * (middle @ sight)[:, None, None]
        steep = disc.radius / (2 * EDGE_HALF_WIDTH_PX) / (np.sqrt(slope[..., 0] ** 2 + slope[..., 1] ** 2) + 1e-9)
        edge = (rotated[..., 0] - np.cos(angle)[:, None]) * steep
        residual = fraction - np.minimum(np.maximum(0.5 + edge, 0.0), 1.0)
        steep[np.abs(edge) > 0.75] = 0.0
        change[..., 0], change[..., 1] = rotated[..., 1] * steep, rotated[..., 2] * steep
        change[..., 2] = np.sin(angle)[:, None] * steep
        robust_weight = information if step < 2 else information / (1.0 + (residual / 0.3) ** 2) ** 2
        weighted = (change * robust_weight[..., None]).transpose(0, 2, 1)
        normal_equations = weighted @ change + np.diag([1.0, 1.0, 1.0 + 1 / angle_sd**2])
        gradient = (weighted @ residual[..., None])[..., 0]
        gradient[:, 2] += (prior_angle - angle) / angle_sd**2
        inverse = np.linalg.inv(normal_equations)
        move = np.clip((inverse @ gradient[..., None])[..., 0], -0.1, 0.1)
        middle = middle + move[:, :1] * first + move[:, 1:2] * second
        middle /= np.sqrt(np.sum(middle**2, axis=1))[:, None]
        angle = np.clip(angle + move[:, 2], 0.03, 1.5)
        if np.abs(move).max() < SETTLED_RAD:
            break
    cosine = np.clip(middle @ sight, 0.1, 1.0)
    outward = tangents(middle, sight)[1]
    components = np.stack([np.sum(first * outward, axis=1), np.sum(second * outward, axis=1)], axis=1)
    covariance = inverse[:, :2, :2]
    along = np.einsum("ki,kij,kj->k", components, covariance, components)
    across = np.trace(covariance, axis1=1, axis2=2) - along
    error = PLACE_ERROR_PX / disc.radius
    hidden = np.maximum(np.arccos(cosine) + angle - math.asin(1 - RIM_PX / disc.radius), 0.0)
    along = along + (error / cosine) ** 2 + (LIMB_ERROR_FRACTION * hidden) ** 2
    return middle, np.sqrt(np.stack([across + error**2, along], axis=1)), angle
