"""The background model of a footage: the empty table, its light and its noise, and what in a picture differs from it.

In: pictures with balls on the table. Out: `Background`, and `View`, a picture beside it. The colour of the bed is a
smooth surface over the picture, fitted to most of its pixels. The background is what every pixel shows most of the
time; where an arm is seen most of the time, what the pictures show that are nearest to that surface; and where a ball
rests all the time it is mended with that surface, on a cushion with the cushion beside.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from models.shot import NOSE_HEIGHT
from sysid.vision.balls.circle_votes import CoarseGrid, coarse_grid
from sysid.vision.balls.view_geometry import NODE_SPACING_PX, Array, Image, Mask, ViewGeometry
from sysid.vision.sources.pictures import Picture

BED_COLOUR_DEGREE = 4  # of the polynomial that is the colour of the bed
MENDED_RADII = 1.35  # about the centre of a resting ball that are painted over
SURROUND_RADII = 2.2  # about it that show the colour of the cloth
MIN_BED_FRACTION = 0.1  # of the pictures, that show the bed where an arm hides it in the others
CUSHION_OFFSET_RADII = 3.0  # along a cushion to the part that replaces a hidden one
LIGHT_PROBE_PIXELS = 600  # of the bed, that give the light of a frame
MIN_NOISE_GREY = 0.5  # of a picture [grey levels]: rounding alone makes 0.3
NOISE_FACTOR = 2.5  # standard deviations of the noise, and
TINT_CHANGE = 0.05  # of the light's colour, over the picture and from frame to frame, relative standard deviation
CHANNELS_MIXED = 0.02  # of the brightest channel, that cameras and compression add to others or take from them
CONTRAST_FRACTION = 0.06  # fraction of the background's colour, above which a difference is foreground
HOLLOW_INNER_RADII, HOLLOW_RIM_RADII = 0.5, 0.8  # within which a ring shows the table, and from where on itself
HOLLOW_RATIO = 0.35  # of the difference from the table within, to that at the rim, below which it is a ring


@dataclass(frozen=True)
class View:
    """A picture and the background that it is compared with."""

    geometry: ViewGeometry
    picture: Picture  # (h, w, 3)
    table: Image  # (h, w, 3) the empty table
    gain: Array  # (3,) brightness of the picture relative to the background
    noise: float  # standard deviation [grey levels]
    grid: CoarseGrid

    def window(self, centre: Array, radius: float) -> tuple[Image, Image, Array]:
        """Picture and background (rows, columns, 3) in a window about a pixel (2,), and its corner (2,)."""
        x0, y0 = (max(0, int(v - radius)) for v in centre)
        x1, y1 = (max(0, int(v + radius) + 2) for v in centre)
        window = self.picture[y0:y1, x0:x1].astype(np.float32)
        return window, self.table[y0:y1, x0:x1] * self.gain.astype(np.float32), np.array([x0, y0])

    def foreground_fraction(self, centre: Array, radius: float) -> float:
        """Fraction of a disc about a pixel (2,) that is foreground."""
        off, table, share = self._about(centre, radius)
        disc = share < 1.0
        return float(is_foreground(off, table, self.noise)[disc].mean()) if disc.any() else 0.0

    def hollow(self, centre: Array, radius: float) -> bool:
        """Whether a disc about a pixel (2,) shows the table within a rim, as a circle does that light draws on it."""
        off, _, share = self._about(centre, radius)
        bands = share < HOLLOW_INNER_RADII, (share > HOLLOW_RIM_RADII) & (share < 1.0)
        inner, rim = (off[band].sum(axis=1) for band in bands)
        return bool(inner.size and rim.size and np.median(inner) < HOLLOW_RATIO * np.median(rim))

    def _about(self, centre: Array, radius: float) -> tuple[Image, Image, Array]:
        """Differences from the table and the table (rows, columns, 3), and distances from a pixel over the radius."""
        window, table, corner = self.window(centre, radius)
        y, x = np.ogrid[: window.shape[0], : window.shape[1]]
        return np.abs(window - table), table, np.hypot(x + corner[0] - centre[0], y + corner[1] - centre[1]) / radius


@dataclass(frozen=True)
class Background:
    """The background model: the empty table, its light, and the noise of pictures of it."""

    geometry: ViewGeometry
    picture: Image  # (h, w, 3) blue, green, red [grey levels]
    light: Image  # (h, w, 3) brightness of the light, 1 in the middle
    probes: tuple[NDArray[np.intp], NDArray[np.intp]]  # rows and columns of pixels that give the light of a frame
    grid: CoarseGrid
    noise: float = MIN_NOISE_GREY  # standard deviation [grey levels]

    def view(self, picture: Picture) -> View:
        """A picture beside this background, the gain fitted to its light."""
        shown = self.picture[self.probes]
        ratio = np.median(picture[self.probes] / np.maximum(shown, 1.0), axis=0)
        gain = lit_alike(ratio, np.median(shown, axis=0))
        return View(self.geometry, picture, self.picture, gain, self.noise, self.grid)

    @cached_property
    def bed_colour(self) -> Array:
        """Usual colour of the bed (3,) red, green, blue, 0 to 1."""
        return np.asarray(np.median(self.picture[self.geometry.bed], axis=0)[::-1] / 255, float)

    def light_at(self, view: View, pixel: Array) -> Array:
        """Light of a picture at a pixel (2,) relative to the median of the bed: (3,) blue, green, red."""
        h, w = self.light.shape[:2]
        return np.asarray(self.light[min(max(int(pixel[1]), 0), h - 1), min(max(int(pixel[0]), 0), w - 1)] * view.gain)


def lit_alike(ratio: NDArray[np.floating], grey: NDArray[np.floating]) -> Array:
    """Brightness of a light (..., 3) from that of each channel (..., 3), which show a colour (3,) [grey levels].

    A channel in which the cloth is dark hardly determines the light, and one in which it is 0 not at all: there it is
    taken to change as in the others. The weighted mean of both, by their precision.
    """
    known = (np.maximum(grey, 0.0) / (CHANNELS_MIXED * max(float(grey.max()), 1.0))) ** 2 + 1e-9
    mean = (ratio * known).sum(axis=-1, keepdims=True) / known.sum()
    return np.asarray((ratio * known + mean / TINT_CHANGE**2) / (known + TINT_CHANGE**-2), float)


def _median_picture(pictures: Sequence[Picture], box: tuple[int, int, int, int]) -> Image:
    """What every pixel shows most of the time: (h, w, 3), the mean of the values near its median; 0 outside the box."""
    x0, x1, y0, y1 = box
    out = np.zeros(pictures[0].shape, np.float32)
    strip = max(1, 4_000_000 // max(1, len(pictures) * (x1 - x0) * 3))
    for y in range(y0, y1, strip):
        stack = np.stack([p[y : min(y + strip, y1), x0:x1] for p in pictures], axis=-1)
        median = np.partition(stack, len(pictures) // 2, axis=-1)[..., len(pictures) // 2, None].astype(np.int16)
        spread = np.abs(stack.astype(np.int16) - median)
        typical = spread <= 3 * np.maximum(np.median(spread, axis=(0, 1, 2)).max(), 2)
        out[y : y + stack.shape[0], x0:x1] = (stack * typical).sum(axis=-1, dtype=np.float32) / typical.sum(axis=-1)
    return out


def _bed_colour(geometry: ViewGeometry, picture: Image) -> Image:
    """The polynomial surface (h, w, 3) of the bed's colour, fitted robustly to its pixels."""
    h, w = geometry.bed.shape
    rows, columns = (v[:: max(1, len(v) // 20000)] for v in np.nonzero(geometry.bed))
    terms, colours = _monomials(columns, rows, (w, h)), picture[rows, columns].astype(float)
    weight = np.ones(len(rows))
    start = np.median(colours, axis=0)
    residual = np.abs(colours - start).max(axis=1)
    weight = (residual < 4 * np.median(residual)).astype(float)
    for _ in range(8):
        factors = np.linalg.lstsq(terms * weight[:, None], colours * weight[:, None], rcond=None)[0]
        residual = np.abs(colours - terms @ factors).max(axis=1)
        weight = np.maximum(0.0, 1 - (residual / (6 * max(float(np.median(residual)), 0.5))) ** 2)
    nodes_x, nodes_y = (
        np.arange(0, w + NODE_SPACING_PX, NODE_SPACING_PX),
        np.arange(0, h + NODE_SPACING_PX, NODE_SPACING_PX),
    )
    across, down = np.meshgrid(nodes_x, nodes_y)
    grid = (_monomials(across.ravel(), down.ravel(), (w, h)) @ factors).reshape(len(nodes_y), len(nodes_x), 3)
    x, y = np.meshgrid(
        np.arange(w, dtype=np.float32) / NODE_SPACING_PX, np.arange(h, dtype=np.float32) / NODE_SPACING_PX
    )
    return np.asarray(cv2.remap(np.maximum(grid, 1.0).astype(np.float32), x, y, cv2.INTER_LINEAR))


def _monomials(columns: NDArray[np.intp], rows: NDArray[np.intp], size: tuple[int, int]) -> Array:
    u, v = 2 * columns / size[0] - 1, 2 * rows / size[1] - 1
    return np.stack(
        [u**i * v**j for i in range(BED_COLOUR_DEGREE + 1) for j in range(BED_COLOUR_DEGREE + 1 - i)], axis=1
    )


def _mended(geometry: ViewGeometry, picture: Image, smooth: Image, balls: Sequence[Array]) -> Image:
    """The picture with balls centred at these pixels painted over by the bed's colour or the cushion beside them."""
    out = picture.copy()
    h, w = geometry.bed.shape
    for centre in balls:
        radius = geometry.radius(centre)
        limit = SURROUND_RADII * radius
        x0, y0 = (max(0, int(v - limit)) for v in centre)
        x1, y1 = min(w, int(centre[0] + limit) + 2), min(h, int(centre[1] + limit) + 2)
        across, down = np.meshgrid(np.arange(x0, x1), np.arange(y0, y1))
        distance = np.hypot(across - centre[0], down - centre[1]) / radius
        bed = geometry.bed[y0:y1, x0:x1]
        beside = bed & (distance > MENDED_RADII)
        target, bed_colour = out[y0:y1, x0:x1], smooth[y0:y1, x0:x1]
        offset = np.median((target - bed_colour)[beside], axis=0) if beside.sum() > 20 else np.zeros(3)
        covered = distance < MENDED_RADII
        target[covered & bed] = (bed_colour + offset)[covered & bed]
        rows, columns = np.nonzero(covered & ~bed)
        if len(rows):
            target[rows, columns] = _cushion(geometry, picture, smooth, columns + x0, rows + y0)
    return out


def _cushion(
    geometry: ViewGeometry, picture: Image, smooth: Image, columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Colours (n, 3) of cushions at pixels (n,), from the same cushion on either side, in the light there."""
    camera = geometry.camera
    nose, half = NOSE_HEIGHT * camera.radius, np.array([camera.table.length, camera.table.width]) / 2
    points = camera.on_plane(np.stack([columns, rows], axis=1).astype(float), nose)
    axis = np.where((np.abs(points) - half)[:, 0] > (np.abs(points) - half)[:, 1], 1, 0)
    total, count = np.zeros((len(rows), 3)), np.zeros((len(rows), 1))
    h, w = geometry.bed.shape
    for side in (-1.0, 1.0):
        shifted = points.copy()
        shifted[np.arange(len(shifted)), axis] += side * CUSHION_OFFSET_RADII * camera.radius
        on_cushion = np.abs(shifted[np.arange(len(shifted)), axis]) < half[axis]
        pixels = np.rint(camera.project(np.column_stack([shifted, np.full(len(shifted), nose)]))).astype(int)
        on_cushion &= (pixels >= 0).all(axis=1) & (pixels[:, 0] < w) & (pixels[:, 1] < h)
        pixels[~on_cushion] = 0
        light = smooth[rows, columns] / smooth[pixels[:, 1], pixels[:, 0]]
        total += np.where(on_cushion[:, None], picture[pixels[:, 1], pixels[:, 0]] * light, 0.0)
        count += on_cushion[:, None]
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), picture[rows, columns]), np.float32)


def _background_of(geometry: ViewGeometry, picture: Image, smooth: Image, pictures: Sequence[Picture]) -> Background:
    """The background model of a picture of the empty table; `smooth` is the colour of its bed."""
    rows, columns = np.nonzero(geometry.bed)
    step = max(1, len(rows) // LIGHT_PROBE_PIXELS)
    usual = np.median(smooth[geometry.bed], axis=0)
    light = np.clip(lit_alike(smooth / usual, usual), 0.2, 5.0).astype(np.float32)
    plain = Background(geometry, picture, light, (rows[::step], columns[::step]), coarse_grid(geometry, picture))
    residual = [p[plain.probes] - picture[plain.probes] * plain.view(p).gain for p in pictures]
    # The mean of n pictures is correlated with each of them: n / (n - 1) undoes the bias.
    noise = 1.4826 * float(np.median(np.abs(residual))) * (len(residual) / max(len(residual) - 1, 1)) ** 0.5
    return replace(plain, noise=max(noise, MIN_NOISE_GREY))


def _uncovered(geometry: ViewGeometry, picture: Image, smooth: Image, pictures: Sequence[Picture], arms: Mask) -> Image:
    """The picture (h, w, 3) with the bed where arms (h, w) hide it most of the time, from pictures that show it."""
    margin = math.ceil(geometry.radius(np.array(arms.shape[::-1]) / 2))  # an arm that moves has a blurred outline
    near = cv2.dilate(arms.astype(np.uint8), np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)) > 0
    rows, columns = np.nonzero(near & geometry.bed)
    seen = np.stack([p[rows, columns] for p in pictures])
    off = np.array([np.abs(one - smooth[rows, columns]).max(axis=1) for one in seen])
    nearest = np.argsort(off, axis=0, kind="stable")[: math.ceil(MIN_BED_FRACTION * len(pictures))]
    out = picture.copy()
    out[rows, columns] = np.take_along_axis(seen, nearest[..., None], axis=0).mean(axis=0)
    return out


def learn_background(
    geometry: ViewGeometry, pictures: Sequence[Picture], find: Callable[[View], Sequence[Array]],
    arms: Callable[[View], Mask],
) -> tuple[Background, int]:  # fmt: skip
    """The background from pictures with balls on the table, and how many balls are at rest in most of them.

    `find` gives the pixels (2,) at which balls are centred, `arms` those (h, w) of the bed that something hides.
    """
    median = _median_picture(pictures, geometry.box)
    smooth = _bed_colour(geometry, median)
    noise = _background_of(geometry, median, smooth, pictures).noise / len(pictures) ** 0.5
    # Balls at rest all the time, and arms, stand out against the fitted colour of the bed.
    bed = np.where(geometry.bed[..., None], smooth, median).astype(np.float32)
    grid = coarse_grid(geometry, bed)

    def view(picture: Image) -> View:
        still = np.rint(picture).clip(0, 255).astype(np.uint8)
        return View(geometry, still, bed, np.ones(3), max(noise, MIN_NOISE_GREY), grid)

    median = _uncovered(geometry, median, smooth, pictures, arms(view(median)))
    resting = find(view(median))
    return _background_of(geometry, _mended(geometry, median, smooth, resting), smooth, pictures), len(resting)


def is_foreground(off: Image, table: Image, noise: float) -> Mask:
    """Foreground: where differences (rows, columns, 3) from the background exceed noise and unevenness."""
    return np.asarray(off.max(axis=2) > np.maximum(NOISE_FACTOR * noise, CONTRAST_FRACTION * table.max(axis=2)))
