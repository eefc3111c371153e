"""How much of every pixel a ball covers, and discs swept along a path that are fitted to that.

In: a picture beside the background, and the colour of a ball, or None for one of several colours. Out: cover, and
`DiscFit`. A pixel is taken as p T + a B, where T is the table there, B the colour of the ball, a the cover and p what
of the table is seen: 1 - a, and less in shadows, which darken the table without covering it. Both follow by least
squares over the three colours, with p + a = 1 as a prior. A ball of several colours is first fitted to what is not the
table, then to its cover by the colours that it shows just within its rim, where it is all through the exposure. A ball
that moves by m meanwhile covers (1 / |m|) integral of D(x - c - s m) ds over s in [-1/2, 1/2], D the disc with a
blurred rim, so that cover stays linear in time where brightness is. A ball brighter by a gain g than the picture can
show covers g times as much, at most all: its sweep is as clear as a ball at rest. Light from the side makes one half of
a ball brighter, as if more of it were covered there: cover in the disc rises linearly across it, by as much as fits
best. A white ball that is clipped shows no such shading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from models.compiled import compiled
from sysid.vision.balls import swept_disc
from sysid.vision.balls.background import View
from sysid.vision.balls.view_geometry import Array, Image

SHADE_SD = 0.3  # of p + a, by shadows and light
COLOUR_ERROR_GREY = 30.0  # of a ball's colour, by its shading and by the light of others [grey levels]
COVER_LIMITS = (-0.2, 1.1)
DEEPEST_SHADE = 0.65  # of the table's light, that a shadow leaves; what is darker is no table
NO_TABLE_GREY = 40.0  # from the colour of the shaded table, from which on a pixel is no table at all [grey levels]
SKIN_PX = 1.5  # below the rim, where a ball of several colours shows those of the rim
MIN_SHARE = 0.2  # of a pixel that shows a ball's colour: noise is that of the picture over it
SURROUND_PX = 6.0  # beyond the disc that take part in a fit
MAX_FIT_STEPS = 60  # of least squares, at most: far from the ball only its rim pulls a disc, by half a pixel a step
MAX_FITS = 6  # of a disc, each with the window around the place that the last one found,
SAME_PLACE_PX = 0.3  # until it stays there
RESIDUAL_LIMIT = 0.6  # of cover, from which on a pixel shows something else: the cue, a hand, a mark
MIN_RESIDUAL = 0.02
HEIGHT_SD = 0.1  # of the cover of a ball that is wholly seen
SHADING_SD = 0.3  # of how much it rises from the middle of a disc to its rim, along an axis, by light from the side;
UNSHADED_SD = 1e-6  # of a ball that is clipped
CORRELATED_PX = 12.0  # pixels of a compressed picture whose errors are common
SIZE_SD_FRACTION = 0.03  # of the radius, standard deviation
RIM_SECTORS = 24  # of the rim, of which each is seen or not
RING_RADII = (0.72, 1.32)  # within and beyond the rim where a sector is judged
MIN_CONTRAST = 0.4  # of cover across the rim, relative to that of the disc, of a sector that is seen
MIN_RIM = {"new": 0.75, "small": 0.75, "known": 0.5, "swept": 0.5}  # a small ball of any colours, one that moved far
MIN_HEIGHT = {"new": 0.6, "small": 0.6, "known": 0.6, "swept": 0.3}  # an impact divides the exposure of a swept one
MAX_RESIDUAL = {"new": 0.3, "small": 0.2, "known": 0.4, "swept": 0.4}  # of cover
CLIPPED_GREY = 250  # from which on a channel is clipped; where all are, a ball may be overexposed


def is_white(colour: Array | None) -> bool:
    """Whether all channels of a colour (3,) blue, green, red are clipped [grey levels]."""
    return colour is not None and bool((colour >= CLIPPED_GREY).all())


@dataclass(frozen=True)
class DiscFit:
    """A disc fitted to the cover of a ball."""

    xy: Array  # (2,) centre, in the middle of the exposure [pixels]
    radius: float  # [pixels]
    motion: Array  # (2,) during the exposure [pixels]
    height: float  # cover in the disc, 1 for a ball that is wholly seen
    sd: float  # of the centre per axis [pixels]
    residual: float  # of cover, root of the mean square within the disc and at its rim
    misfit: float  # the same with the surroundings, of each pixel at most `RESIDUAL_LIMIT`, to compare fits
    gain: float  # by which the ball is overexposed
    rim: float  # fraction of the rim's sectors with contrast


def cover(window: Image, table: Image, colour: Array | Image) -> Image:
    """Cover (rows, columns) of a picture beside the table (rows, columns, 3) by a ball.

    Its `colour` is (3,), or (rows, columns, 3) if it has several.
    """
    several = np.ndim(colour) == 3
    ball = np.asarray(colour if several else np.reshape(colour, (1, 1, 3)), np.float32)
    return np.asarray(_cover(np.asarray(window, np.float32), np.asarray(table, np.float32), ball, several))


def cover_sd(view: View, colour: Array, pixel: Array) -> float:
    """How wrong cover may be by the error of a ball's colour (3,), the more so the more it looks like shaded table."""
    height, width = view.table.shape[:2]
    row, column = (min(max(round(float(v)), 0), size - 1) for v, size in zip(pixel[::-1], (height, width), strict=True))
    table, prior = view.table[row, column] * view.gain, (COLOUR_ERROR_GREY / SHADE_SD) ** 2
    tt, tb, bb = prior + table @ table, prior + table @ colour, prior + colour @ colour
    return COLOUR_ERROR_GREY * math.sqrt(tt / max(tt * bb - tb * tb, 1e-3 * bb * tt))


@compiled
def _cover(window: Image, table: Image, ball: Image, several: bool) -> Image:
    """As `cover`, by a ball of one colour (1, 1, 3) or of several (rows, columns, 3)."""
    rows, columns = window.shape[:2]
    prior = (COLOUR_ERROR_GREY / SHADE_SD) ** 2
    out = np.empty((rows, columns), np.float32)
    for j in range(rows):
        for i in range(columns):
            y, x = (j, i) if several else (0, 0)
            tt = tb = bb = pt = pb = prior
            for k in range(3):
                p, t, b = float(window[j, i, k]), float(table[j, i, k]), float(ball[y, x, k])
                tt += t * t
                tb += t * b
                bb += b * b
                pt += p * t
                pb += p * b
            share = (tt * pb - tb * pt) / max(tt * bb - tb * tb, 1e-3 * bb)
            out[j, i] = min(max(share, COVER_LIMITS[0]), COVER_LIMITS[1])
    return out


def not_table(window: Image, table: Image) -> Image:
    """How far every pixel (rows, columns) is from showing the table, lit or shaded: 0 to 1."""
    shade = np.einsum("ijk,ijk->ij", window, table) / np.maximum(np.einsum("ijk,ijk->ij", table, table), 1.0)
    off = np.abs(window - shade.clip(DEEPEST_SHADE, None)[..., None] * table).max(axis=2)
    return np.asarray((off / NO_TABLE_GREY).clip(0, 1), np.float32)


def covered(window: Image, table: Image, colour: Array | None) -> Image:
    """Cover (rows, columns) by a ball of this colour (3,), or by one of unknown colours."""
    return not_table(window, table) if colour is None else cover(window, table, colour)


def _own_colours(window: Image, table: Image, centre: Array, radius: float, motion: Array) -> Image:
    """Colours (rows, columns, 3) of a ball around a pixel (2,): those that it shows, and beyond its rim those of it.

    Of a moving ball those of pixels that it covers throughout the exposure, or the longest, less the table there.
    """
    rows, columns = window.shape[:2]
    y, x = np.mgrid[:rows, :columns].astype(np.float32)
    u, v = x - centre[0], y - centre[1]
    length, inner = math.hypot(*motion), max(radius - SKIN_PX, 1.0)
    way = np.asarray(motion) / length if length else np.array([1.0, 0.0])
    along, across = u * way[0] + v * way[1], v * way[0] - u * way[1]
    # Within the discs at both ends of its motion.
    beyond = np.abs(along) + length / 2
    pull = np.minimum(1.0, inner / np.maximum(np.hypot(beyond, across), 1e-6))
    along, across = np.sign(along) * np.maximum(pull * beyond - length / 2, 0.0), pull * across
    x = (centre[0] + along * way[0] - across * way[1]).astype(np.float32)
    y = (centre[1] + along * way[1] + across * way[0]).astype(np.float32)
    shown, bed = (cv2.remap(v, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for v in (window, table))
    if length < 2 * inner:
        return np.asarray(shown)
    share = swept_share((x - centre[0]).ravel(), (y - centre[1]).ravel(), radius, motion).reshape(rows, columns)
    return np.asarray(without_table(shown, bed, share), np.float32)


def without_table(shown: Array | Image, table: Array | Image, share: Array) -> Array:
    """Colours (..., 3) of a ball that covers a share (...) of what is shown (..., 3), beside the table (..., 3)."""
    share = share.clip(MIN_SHARE, 1.0)[..., None]
    return np.asarray((shown - (1 - share) * table) / share)


def swept_share(x: Array, y: Array, radius: float, motion: Array) -> Array:
    """Cover (n,) at offsets (n,) from the middle of a swept disc [pixels]."""
    return np.asarray(swept_disc.share(x, y, radius, motion, swept_disc.places(motion)))


def _left(seen: Image, taken: Image | None) -> Image:
    """Cover (rows, columns) by a ball, where others cover as much as is taken."""
    return seen if taken is None else np.maximum(seen - taken, 0.0).astype(np.float32)


def cover_by(discs: Sequence[DiscFit], columns: Array, rows: Array) -> Image:
    """Cover of pixels in columns (n,) and rows (m,) by any of these discs: (m, n)."""
    free = np.ones((len(rows), len(columns)), np.float32)
    for disc in discs:
        half = np.abs(disc.motion) / 2 + disc.radius + swept_disc.RIM_REACH * swept_disc.RIM_BLUR_PX
        i, j = (np.flatnonzero(np.abs(v - at) < r) for v, at, r in zip((columns, rows), disc.xy, half, strict=True))
        x, y = np.meshgrid(columns[i] - disc.xy[0], rows[j] - disc.xy[1])
        free[np.ix_(j, i)] *= 1 - _cover_at(disc, x.ravel(), y.ravel()).reshape(x.shape)
    return np.asarray(1 - free)


def _cover_at(disc: DiscFit, x: Array, y: Array) -> Image:
    """Cover by a disc at offsets (n,) from its middle [pixels]: (n,), at most all of a pixel."""
    return np.minimum(disc.gain * swept_share(x, y, disc.radius, disc.motion), 1.0).astype(np.float32)


def fit_disc(
    view: View, colour: Array | None, start: Array, radius: float, motion: Array, gain: float = 1.0,
    steps: int = MAX_FIT_STEPS, others: Sequence[DiscFit] = (),
) -> DiscFit | None:  # fmt: skip
    """The disc of a ball near a pixel (2,) that moves by `motion` (2,) [pixels]; None where there is none.

    With fewer `steps` it is not fitted to its end: enough to compare it with others. What `others` cover is none of it.
    """
    motion, centre = np.asarray(motion, float), np.asarray(start, float)
    fit = None
    for _ in range(MAX_FITS if steps == MAX_FIT_STEPS else 1):
        fit = _fit_around(view, colour, centre, radius, motion, gain, steps, others)
        if fit is None or math.hypot(*(fit.xy - centre)) < SAME_PLACE_PX:
            break
        centre = fit.xy
    return None if fit is None else replace(fit, rim=_rim(view, colour, fit, others))


def _fit_around(
    view: View, colour: Array | None, start: Array, radius: float, motion: Array, gain: float, steps: int,
    others: Sequence[DiscFit] = (),
) -> DiscFit | None:  # fmt: skip
    """The disc that fits the window around a pixel (2,) best, its rim not judged yet; None where there is none."""
    half = np.abs(motion) / 2 + radius + SURROUND_PX + 2
    h, w = view.picture.shape[:2]
    x0, y0 = (max(0, int(v)) for v in start - half)
    x1, y1 = min(w, int(start[0] + half[0]) + 2), min(h, int(start[1] + half[1]) + 2)
    if x1 - x0 < radius or y1 - y0 < radius:
        return None
    corner, table = np.array([x0, y0]), view.table[y0:y1, x0:x1] * view.gain.astype(np.float32)
    window = view.picture[y0:y1, x0:x1].astype(np.float32)
    shading_sd = UNSHADED_SD if is_white(colour) else SHADING_SD
    taken = cover_by(others, np.arange(x0, x1), np.arange(y0, y1)) if others else None
    seen = _left(covered(window, table, colour), taken)
    fit = _settled(seen, corner, start, radius, motion, gain, shading_sd, steps)
    if fit is not None and colour is None:
        own = _own_colours(window, table, fit.xy - corner, min(radius, fit.radius), motion)
        seen = _left(cover(window, table, own), taken)
        fit = _settled(seen, corner, fit.xy, radius, motion, gain, shading_sd, steps)
    return fit


def _settled(
    seen: Image, corner: Array, start: Array, radius: float, motion: Array, gain: float, shading_sd: float, steps: int
) -> DiscFit | None:  # fmt: skip
    """The disc that fits cover (rows, columns) best, whose first pixel is `corner` (2,); None where it runs away."""
    sd = np.array([math.inf, math.inf, SIZE_SD_FRACTION * radius, HEIGHT_SD, shading_sd, shading_sd])
    prior = CORRELATED_PX * MIN_RESIDUAL**2 / sd**2
    matrix, sums = np.zeros((len(sd), len(sd))), np.zeros(6)
    window = swept_disc.Window(
        np.ascontiguousarray(seen), corner.astype(float), radius + SURROUND_PX, RESIDUAL_LIMIT
    )  # fmt: skip
    disc = swept_disc.SweptDisc(radius, motion, swept_disc.places(motion), gain)
    into = swept_disc.StepEquations(matrix, np.zeros(len(sd)), sums)
    stayed, x, y, grown, height = swept_disc.settled(window, disc, np.array(start, float), prior, steps, into)
    if not stayed:
        return None
    noise = max(math.sqrt(sums[0] / max(sums[1], 1e-9)), MIN_RESIDUAL)
    covariance = np.linalg.inv(matrix) * CORRELATED_PX * noise**2
    centre_sd = math.sqrt((covariance[0, 0] + covariance[1, 1]) / 2)
    residual, misfit = (math.sqrt(sums[k] / sums[k + 1]) if sums[k + 1] else math.inf for k in (2, 4))
    return DiscFit(np.array([x, y]), radius + grown, motion, height, centre_sd, residual, misfit, gain, 0.0)


def acceptable(fit: DiscFit | None, kind: str, error: float = 0.0) -> bool:
    """Whether a fit to cover of a standard error shows a ball, which is `new`, `small`, `known` or `swept`."""
    return (
        fit is not None
        and fit.rim >= MIN_RIM[kind]
        and fit.height > MIN_HEIGHT[kind]
        and fit.residual < math.hypot(MAX_RESIDUAL[kind], error)
    )


def _rim(view: View, colour: Array | None, fit: DiscFit, others: Sequence[DiscFit] = ()) -> float:
    """Fraction of the sectors of a rim where cover falls outwards, or other balls are around."""
    angles = np.arange(RIM_SECTORS) * 2 * math.pi / RIM_SECTORS
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    ends = np.sign(ways @ fit.motion)[:, None] * fit.motion / 2
    h, w = view.picture.shape[:2]
    values, others_there = [], np.zeros(RIM_SECTORS, bool)
    for part in RING_RADII:
        # A swept disc covers its two ends less; the flanks of its path are as sharp as at rest.
        places = np.rint(fit.xy + (ends if part > 1 else 0.5 * ends) + part * fit.radius * ways).astype(int)
        column, row = places[:, 0].clip(0, w - 1), places[:, 1].clip(0, h - 1)
        table = view.table[row, column][None] * view.gain.astype(np.float32)
        values.append(covered(view.picture[row, column][None].astype(np.float32), table, colour)[0])
    for one in others:
        around = replace(one, radius=RING_RADII[1] * one.radius)
        others_there |= _cover_at(around, *(places - one.xy).T.astype(float)) > 0.5
    swept = 1.0 / (1.0 + math.hypot(*fit.motion) / (2 * fit.radius))
    # In dim light, or turned from the lamp, all of a ball seems to cover less.
    contrast = values[0] - values[1] > MIN_CONTRAST * swept * min(fit.height, 1.0)
    return float((contrast | others_there).mean())
