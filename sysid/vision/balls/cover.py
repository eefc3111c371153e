"""How much of every pixel a ball covers, and discs swept along a path that are fitted to that.

In: a picture beside the background, and the colour of a ball, or None for one of several colours. Out: cover, and
`DiscFit`. A pixel is taken as p T + a B, where T is the table there, B the colour of the ball, a the cover and p what
of the table is seen: 1 - a, and less in shadows, which darken the table without covering it. Both follow by least
squares over the three colours, with p + a = 1 as a prior. A ball of several colours is first fitted to what is not the
table, then to its cover by the colours that it shows just within its rim. A ball that moves by m during the exposure
covers (1 / |m|) integral of D(x - c - s m) ds over s in [-1/2, 1/2], D the disc with a blurred rim, so that cover
stays linear in time where brightness is. A ball brighter by a gain g than the picture can show covers g times as much,
at most all: its sweep is as clear as a ball at rest. Light from aside makes one side of a ball brighter, as if more of
it were covered there: cover in the disc rises linearly across it, by as much as fits best. A white ball that is clipped
shows no such shading.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from models.compiled import compiled
from sysid.vision.balls.background import View
from sysid.vision.balls.view_geometry import Array, Image

SHADE_SD = 0.3  # of p + a, by shadows and light
COLOUR_ERROR_GREY = 30.0  # of a ball's colour, by its shading and by the light of others [grey levels]
COVER_LIMITS = (-0.2, 1.1)
DEEPEST_SHADE = 0.65  # of the table's light, that a shadow leaves; what is darker is no table
NO_TABLE_GREY = 40.0  # from the colour of the shaded table, from which on a pixel is no table at all [grey levels]
SKIN_PX = 1.5  # below the rim, where a ball of several colours shows those of the rim
RIM_BLUR_PX = 1.0  # of the rim of a disc
SURROUND_PX = 6.0  # beyond the disc that take part in a fit
STEPS = 60  # of least squares, at most: far from the ball only its rim pulls a disc, by half a pixel a step
SETTLED_PX = 0.01
STRETCH = 1.5  # of every step: reweighted least squares fall short, and would stop on the way
MAX_FITS = 6  # of a disc, each with the window around the place that the last one found,
SAME_PLACE_PX = 0.3  # until it stays there
RESIDUAL_LIMIT = 0.6  # of cover, from which on a pixel shows something else: the cue, a hand, a mark
MIN_RESIDUAL = 0.02
RIM_REACH = 3.5  # blurs from the rim, beyond which a disc covers all or nothing
HEIGHT_SD = 0.1  # of the cover of a ball that is wholly seen
SHADING_SD = 0.3  # of how much it rises from the middle of a disc to its rim, along an axis, by light from aside;
UNSHADED_SD = 1e-6  # of a ball that is clipped
RIDGE = 1e-6  # keeps the least squares solvable where the picture shows nothing
CORRELATED_PX = 12.0  # pixels of a compressed picture whose errors are common
SIZE_SD_FRACTION = 0.03  # of the radius, standard deviation
SECTORS = 24  # of the rim, of which each is seen or not
RING_RADII = (0.72, 1.32)  # within and beyond the rim where a sector is judged
MIN_CONTRAST = 0.4  # of cover across the rim, of a sector that is seen
CLIPPED_GREY = 250  # from which on a channel is clipped; where all are, a ball may be overexposed
MAX_SWEEP_PX = 4.0  # between two places of a disc on its path


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
    ball = np.broadcast_to(np.asarray(colour, np.float32), window.shape)
    prior = (COLOUR_ERROR_GREY / SHADE_SD) ** 2
    tt, tb, bb, pt, pb = (
        np.einsum("ijk,ijk->ij", one, other) + prior
        for one, other in ((table, table), (table, ball), (ball, ball), (window, table), (window, ball))
    )
    share = (tt * pb - tb * pt) / np.maximum(tt * bb - tb * tb, 1e-3 * bb)
    return np.asarray(share.clip(*COVER_LIMITS), np.float32)


def not_table(window: Image, table: Image) -> Image:
    """How far every pixel (rows, columns) is from showing the table, lit or shaded: 0 to 1."""
    shade = np.einsum("ijk,ijk->ij", window, table) / np.maximum(np.einsum("ijk,ijk->ij", table, table), 1.0)
    off = np.abs(window - shade.clip(DEEPEST_SHADE, None)[..., None] * table).max(axis=2)
    return np.asarray((off / NO_TABLE_GREY).clip(0, 1), np.float32)


def covered(window: Image, table: Image, colour: Array | None) -> Image:
    """Cover (rows, columns) by a ball of this colour (3,), or by one of unknown colours."""
    return not_table(window, table) if colour is None else cover(window, table, colour)


def _own_colours(window: Image, centre: Array, radius: float, motion: Array) -> Image:
    """Colours (rows, columns, 3) of a ball around a pixel (2,): those that it shows, and beyond its rim those of it."""
    rows, columns = window.shape[:2]
    y, x = np.mgrid[:rows, :columns].astype(np.float32)
    u, v = x - centre[0], y - centre[1]
    length = math.hypot(*motion) + 1e-9
    along = ((u * motion[0] + v * motion[1]) / length).clip(-length / 2, length / 2) / length
    u, v = u - along * motion[0], v - along * motion[1]
    pull = 1.0 - np.minimum(1.0, max(radius - SKIN_PX, 1.0) / np.maximum(np.hypot(u, v), 1e-6))
    x, y = (x - pull * u).astype(np.float32), (y - pull * v).astype(np.float32)
    return np.asarray(cv2.remap(window, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


@compiled
def _swept(
    u: float, v: float, radius: float, du: float, dv: float, count: int
) -> tuple[float, float, float, float, float, float]:
    """Cover at an offset from the middle of a disc swept by (du, dv); derivatives by centre, radius and shading."""
    total = by_u = by_v = by_radius = across = down = 0.0
    for k in range(count):
        s = (k + 0.5) / count - 0.5
        x, y = u - s * du, v - s * dv
        distance = math.sqrt(x * x + y * y) + 1e-6
        depth = (radius - distance) / RIM_BLUR_PX
        if depth < -RIM_REACH:
            continue
        if depth > RIM_REACH:
            total += 1.0
            across += x
            down += y
            continue
        disc = 0.5 + 0.5 * math.tanh(depth)
        steep = 2 * disc * (1 - disc) / RIM_BLUR_PX
        total += disc
        across += disc * x
        down += disc * y
        by_u += steep * x / distance
        by_v += steep * y / distance
        by_radius += steep
    rim = count * radius
    return total / count, by_u / count, by_v / count, by_radius / count, across / rim, down / rim


@compiled
def _normal_equations(
    seen: Image, x0: float, y0: float, radius: float, motion: Array, gain: float, shading: Array, reach: float,
    count: int, limit: float,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Least squares of a swept disc against cover (rows, columns), whose first pixel lies at (x0, y0) from its middle.

    `shading` (2,) is how much its cover rises from the middle to the rim, along both axes. Returns the matrix (6, 6)
    and right side (6,) for steps of centre, radius, height and shading, with Tukey's biweight, and the weighted squares
    and weights of all residuals, the squares and number of those that the disc covers, and the squares and number of
    all, each at most at the limit (6,).
    """
    matrix, right, sums, row = np.zeros((6, 6)), np.zeros(6), np.zeros(6), np.zeros(6)
    du, dv = motion[0], motion[1]
    length = math.sqrt(du * du + dv * dv)
    for j in range(seen.shape[0]):
        for i in range(seen.shape[1]):
            u, v = i + x0, j + y0
            along = min(max((u * du + v * dv) / (length + 1e-9), -length / 2), length / 2)
            a, b = u - along * du / (length + 1e-9), v - along * dv / (length + 1e-9)
            if a * a + b * b >= reach * reach:
                continue
            model, row[0], row[1], row[2], row[4], row[5] = _swept(u, v, radius, du, dv, count)
            if gain * model > 1.0:
                model, row[:] = 1.0, 0.0
            elif gain != 1.0:
                model *= gain
                row *= gain
            row[3] = model
            residual = seen[j, i] - model - shading[0] * row[4] - shading[1] * row[5]
            sums[4] += min(residual * residual, limit * limit)
            sums[5] += 1.0
            if model > 0.05:
                sums[2] += residual * residual
                sums[3] += 1.0
            if abs(residual) >= limit:
                continue
            weight = (1 - (residual / limit) ** 2) ** 2
            sums[0] += weight * residual * residual
            sums[1] += weight
            for m in range(6):
                right[m] += weight * row[m] * residual
                for n in range(m + 1):
                    matrix[m, n] += weight * row[m] * row[n]
    for m in range(6):
        for n in range(m):
            matrix[n, m] = matrix[m, n]
    return matrix, right, sums


@compiled
def _share(x: Array, y: Array, radius: float, motion: Array, count: int) -> Array:
    out = np.empty(len(x))
    for k in range(len(x)):
        out[k] = _swept(x[k], y[k], radius, motion[0], motion[1], count)[0]
    return out


def swept_share(x: Array, y: Array, radius: float, motion: Array) -> Array:
    """Cover (n,) at offsets (n,) from the middle of a swept disc [pixels]."""
    return np.asarray(_share(x, y, radius, motion, _places(motion)))


def _places(motion: Array) -> int:
    """Number of places of a disc on its path."""
    return 1 + 2 * math.ceil(math.hypot(*motion) / (2 * MAX_SWEEP_PX))


def fit_disc(
    view: View, colour: Array | None, start: Array, radius: float, motion: Array, gain: float = 1.0, steps: int = STEPS
) -> DiscFit | None:
    """The disc of a ball near a pixel (2,) that moves by `motion` (2,) [pixels]; None where there is none.

    With fewer `steps` it is not fitted to its end: enough to compare it with others.
    """
    motion, centre = np.asarray(motion, float), np.asarray(start, float)
    fit = None
    for _ in range(MAX_FITS if steps == STEPS else 1):
        fit = _fit_around(view, colour, centre, radius, motion, gain, steps)
        if fit is None or math.hypot(*(fit.xy - centre)) < SAME_PLACE_PX:
            break
        centre = fit.xy
    return None if fit is None else replace(fit, rim=_rim(view, colour, fit))


def _fit_around(
    view: View, colour: Array | None, start: Array, radius: float, motion: Array, gain: float, steps: int
) -> DiscFit | None:
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
    fit = _settled(covered(window, table, colour), corner, start, radius, motion, gain, shading_sd, steps)
    if fit is not None and colour is None:
        own = _own_colours(window, fit.xy - corner, fit.radius, motion)
        fit = _settled(cover(window, table, own), corner, fit.xy, radius, motion, gain, shading_sd, steps)
    return fit


def _settled(
    seen: Image, corner: Array, start: Array, radius: float, motion: Array, gain: float, shading_sd: float, steps: int
) -> DiscFit | None:  # fmt: skip
    """The disc that fits cover (rows, columns) best, whose first pixel is `corner` (2,); None where it runs away."""
    reach = radius + SURROUND_PX
    centre, grown, shading, count = np.array(start, float), 0.0, np.zeros(2), _places(motion)
    sd = np.array([math.inf, math.inf, SIZE_SD_FRACTION * radius, HEIGHT_SD, shading_sd, shading_sd])
    prior = CORRELATED_PX * MIN_RESIDUAL**2 / sd**2
    for _ in range(steps):
        x0, y0 = corner - centre
        matrix, right, sums = _normal_equations(
            seen, x0, y0, radius + grown, motion, gain, shading, reach, count, RESIDUAL_LIMIT
        )
        matrix += np.diag(prior + RIDGE)
        step = np.linalg.solve(matrix, right - prior * np.array([0, 0, grown, 0, *shading]))
        height, step = 1.0 + float(step[3]), STRETCH * step
        move = step[:2].clip(-0.5 * radius, 0.5 * radius)
        centre, grown = centre + move, float(np.clip(grown + step[2], -0.15 * radius, 0.15 * radius))
        shading = shading + step[4:]
        if np.abs(centre - start).max() > 1.2 * radius + np.abs(motion).max():
            return None
        if np.abs(move).max() < SETTLED_PX:
            break
    noise = max(math.sqrt(sums[0] / max(sums[1], 1e-9)), MIN_RESIDUAL)
    covariance = np.linalg.inv(matrix) * CORRELATED_PX * noise**2
    centre_sd = math.sqrt((covariance[0, 0] + covariance[1, 1]) / 2)
    residual, misfit = (math.sqrt(sums[k] / sums[k + 1]) if sums[k + 1] else math.inf for k in (2, 4))
    return DiscFit(centre, radius + grown, motion, height, centre_sd, residual, misfit, gain, 0.0)


def _rim(view: View, colour: Array | None, fit: DiscFit) -> float:
    """Fraction of the sectors of a rim where cover falls outwards, weighed by how still the rim is there."""
    angles = np.arange(SECTORS) * 2 * math.pi / SECTORS
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    ends = np.sign(ways @ fit.motion)[:, None] * fit.motion / 2
    h, w = view.picture.shape[:2]
    values = []
    for part in RING_RADII:
        # A swept disc covers its two ends less; the flanks of its path are as sharp as at rest.
        places = np.rint(fit.xy + (ends if part > 1 else 0.5 * ends) + part * fit.radius * ways).astype(int)
        column, row = places[:, 0].clip(0, w - 1), places[:, 1].clip(0, h - 1)
        table = view.table[row, column][None] * view.gain.astype(np.float32)
        values.append(covered(view.picture[row, column][None].astype(np.float32), table, colour)[0])
    swept = 1.0 / (1.0 + math.hypot(*fit.motion) / (2 * fit.radius))
    return float((values[0] - values[1] > MIN_CONTRAST * swept).mean())
