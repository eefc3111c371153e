"""How much of every pixel a ball of known colour covers, and discs swept along a path that are fitted to that.

In: a picture beside the background, and the colour of a ball. Out: cover, and `DiscFit`. A pixel is taken as
p T + a B, where T is the table there, B the colour of the ball, a the cover and p what of the table is seen: 1 - a,
and less in shadows, which darken the table without covering it. Both follow by least squares over the three colours,
with p + a = 1 as a prior. A ball that moves by m during the exposure covers
(1 / |m|) integral of D(x - c - s m) ds over s in [-1/2, 1/2], D the disc with a blurred rim, so that cover stays
linear in time where brightness is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sysid.vision.balls.background import View
from sysid.vision.balls.view_geometry import Array, Image

SHADE_SD = 0.3  # of p + a, by shadows and light
COLOUR_ERROR_GREY = 30.0  # of a ball's colour, by its shading and by the light of others [grey levels]
COVER_LIMITS = (-0.2, 1.1)
RIM_BLUR_PX = 1.0  # of the rim of a disc
SURROUND_PX = 6.0  # beyond the disc that take part in a fit
STEPS = 8  # of least squares, at most
SETTLED_PX = 0.02
RESIDUAL_LIMIT = 0.35  # of cover, from which on a pixel shows something else: the cue, a hand, a mark
MIN_RESIDUAL = 0.02
CORRELATED_PX = 12.0  # pixels of a compressed picture whose errors are common
SIZE_SD_FRACTION = 0.03  # of the radius, standard deviation
SECTORS = 24  # of the rim, of which each is seen or not
RING_RADII = (0.72, 1.32)  # within and beyond the rim where a sector is judged
MIN_CONTRAST = 0.4  # of cover across the rim, of a sector that is seen
MAX_SWEEP_PX = 3.0  # between two places of a disc on its path


@dataclass(frozen=True)
class DiscFit:
    """A disc fitted to the cover of a ball."""

    xy: Array  # (2,) centre, in the middle of the exposure [pixels]
    radius: float  # [pixels]
    motion: Array  # (2,) during the exposure [pixels]
    height: float  # cover in the disc, 1 for a ball that is wholly seen
    sd: float  # of the centre per axis [pixels]
    residual: float  # of cover, root of the mean square within the disc and at its rim
    rim: float  # fraction of the rim's sectors with contrast


def cover(window: Image, table: Image, colour: Array) -> Image:
    """Cover (rows, columns) of a picture beside the table (rows, columns, 3) by a ball of a `colour` (3,)."""
    ball = np.asarray(colour, np.float32)
    prior = (COLOUR_ERROR_GREY / SHADE_SD) ** 2
    tt = np.einsum("ijk,ijk->ij", table, table) + prior
    tb = table @ ball + prior
    bb = float(ball @ ball) + prior
    pt = np.einsum("ijk,ijk->ij", window, table) + prior
    pb = window @ ball + prior
    share = (tt * pb - tb * pt) / np.maximum(tt * bb - tb * tb, 1e-3 * bb)
    return np.asarray(share.clip(*COVER_LIMITS), np.float32)


def _swept(x: Array, y: Array, radius: float, motion: Array) -> tuple[Array, Array]:
    """Cover (n,) at offsets from the middle of a swept disc, and its derivatives by centre and radius (n, 3)."""
    count = 1 + 2 * math.ceil(math.hypot(*motion) / (2 * MAX_SWEEP_PX))
    total, slopes = np.zeros(x.shape, np.float32), np.zeros((x.size, 3), np.float32)
    for s in (np.arange(count) + 0.5) / count - 0.5:
        u, v = x - s * motion[0], y - s * motion[1]
        distance = np.sqrt(u * u + v * v) + np.float32(1e-6)
        disc = 0.5 - 0.5 * np.tanh((distance - radius) / RIM_BLUR_PX)
        steep = 2 * disc * (1 - disc) / RIM_BLUR_PX
        total += disc
        slopes += np.stack([steep * u / distance, steep * v / distance, steep], axis=1)
    return total / count, slopes / count


def swept_share(x: Array, y: Array, radius: float, motion: Array) -> Array:
    """Cover (n,) at offsets (n,) from the middle of a swept disc [pixels]."""
    return _swept(np.asarray(x, np.float32), np.asarray(y, np.float32), radius, motion)[0]


def fit_disc(view: View, colour: Array, start: Array, radius: float, motion: Array) -> DiscFit | None:
    """The disc of a ball near a pixel (2,) that moves by `motion` (2,) [pixels]; None where there is none."""
    reach = radius + SURROUND_PX
    half = np.abs(motion) / 2 + reach + 2
    h, w = view.picture.shape[:2]
    x0, y0 = (max(0, int(v)) for v in start - half)
    x1, y1 = min(w, int(start[0] + half[0]) + 2), min(h, int(start[1] + half[1]) + 2)
    if x1 - x0 < radius or y1 - y0 < radius:
        return None
    table = view.table[y0:y1, x0:x1] * view.gain.astype(np.float32)
    seen = cover(view.picture[y0:y1, x0:x1].astype(np.float32), table, colour).ravel()
    x, y = (v.ravel().astype(np.float32) for v in np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)))
    centre, grown = np.array(start, float), 0.0
    prior = 1.0 / (SIZE_SD_FRACTION * radius) ** 2
    scale = 0.1
    for _ in range(STEPS):
        model, slopes = _swept(x - centre[0], y - centre[1], radius + grown, motion)
        near = _near(x - centre[0], y - centre[1], motion) < reach
        residual = seen - model
        weight = near * np.maximum(0.0, 1 - (residual / max(RESIDUAL_LIMIT, 3 * scale)) ** 2) ** 2
        base = np.column_stack([slopes, model])
        weighted = base * weight[:, None]
        matrix = weighted.T @ base / MIN_RESIDUAL**2
        matrix[2, 2] += CORRELATED_PX * prior
        matrix[3, 3] += CORRELATED_PX / 0.1**2
        step = np.linalg.solve(
            matrix + 1e-3 * np.eye(4),
            weighted.T @ residual / MIN_RESIDUAL**2 - np.array([0, 0, CORRELATED_PX * prior * grown, 0]),
        )
        move = step[:2].clip(-0.5 * radius, 0.5 * radius)
        centre, grown = centre + move, float(np.clip(grown + step[2], -0.15 * radius, 0.15 * radius))
        if np.abs(centre - start).max() > 1.2 * radius + np.abs(motion).max():
            return None
        if np.abs(move).max() < SETTLED_PX:
            break
    inside = near & (model > 0.05)
    misfit = float(np.sqrt(np.mean(residual[inside] ** 2))) if inside.any() else math.inf
    noise = max(float(np.sqrt((weight * residual**2).sum() / max(weight.sum(), 1e-9))), MIN_RESIDUAL)
    covariance = np.linalg.inv(matrix * MIN_RESIDUAL**2 / (CORRELATED_PX * noise**2) + 1e-9 * np.eye(4))
    sd = math.sqrt((covariance[0, 0] + covariance[1, 1]) / 2)
    fit = DiscFit(centre, radius + grown, np.asarray(motion, float), 1.0 + float(step[3]), sd, misfit, 0.0)
    return replace(fit, rim=_rim(view, colour, fit))


def _near(x: Array, y: Array, motion: Array) -> Array:
    """Distance of offsets (n,) from the path of the centre."""
    length = math.hypot(*motion)
    if length < 1e-6:
        return np.asarray(np.sqrt(x * x + y * y))
    along = ((x * motion[0] + y * motion[1]) / length).clip(-length / 2, length / 2)
    return np.asarray(np.hypot(x - along * motion[0] / length, y - along * motion[1] / length))


def _rim(view: View, colour: Array, fit: DiscFit) -> float:
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
        values.append(cover(view.picture[row, column][None].astype(np.float32), table, colour)[0])
    swept = 1.0 / (1.0 + math.hypot(*fit.motion) / (2 * fit.radius))
    return float((values[0] - values[1] > MIN_CONTRAST * swept).mean())
