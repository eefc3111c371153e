"""Balls that moved far while the shutter was open: strips that lead away from where a ball was last seen.

In: a picture beside the background, and the place that a ball has left. Out: middles and motions of strips as wide as
a ball. A ball that was struck, or hit, moves straight on until its next impact, so its strip lies on a ray from there;
on a strip the ball hides the table for a part of the time, and beside it never. What other balls explain is taken
away first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from sysid.vision.balls.background import View
from sysid.vision.balls.cover import DiscFit, covered
from sysid.vision.balls.view_geometry import Array, Image

RAY_DIRECTIONS = 144  # of rays; what lies between two of them is half a radius from one at most at 23 radii
STEPS_PER_RADIUS = 3  # along a ray
ACROSS_RADII = (-0.55, 0.0, 0.55)  # on a strip,
BESIDE_RADII = (-1.5, 1.5)  # and beside it
NOISE_SDS = 5.0  # of what rays show more than what is beside them, that a strip shows,
EDGE_PART = 0.5  # and of the most that its ray shows: where a ball that is swept by more than itself begins and ends
TAKEN_RADII = 1.3  # about a ball that is explained
MAX_STRIPS = 4
SPREAD_RADII = 1.0  # between the middles of two different strips
MIN_LENGTH_RADII = 2.2  # of a strip where half of the most is shown; a ball that stays shows two


class SweptStrip(NamedTuple):
    """What a ball covers that moves far during the exposure."""

    xy: Array  # (2,) its middle [pixels]
    motion: Array  # (2,) [pixels]


def strips(
    view: View, colour: Array | None, origin: Array, radius: float, search_radius: float, taken: Sequence[DiscFit]
) -> list[SweptStrip]:  # fmt: skip
    """Strips of a colour (3,) from a pixel (2,) on, within `search_radius` [pixels] of it, the clearest first.

    None where that is wholly out of the picture.
    """
    shown, corner = _shown(view, colour, origin, search_radius + 2 * radius, radius, taken)
    if not shown.size:
        return []
    angles = np.arange(RAY_DIRECTIONS) * 2 * math.pi / RAY_DIRECTIONS
    along = np.arange(1, math.ceil(STEPS_PER_RADIUS * search_radius / radius) + 1) * radius / STEPS_PER_RADIUS
    score = _on(shown, origin - corner, angles, along, radius, ACROSS_RADII).min(axis=0)
    score -= _on(shown, origin - corner, angles, along, radius, BESIDE_RADII).max(axis=0)
    usual = float(np.median(score))  # most rays show the table
    noise = usual + NOISE_SDS * 1.4826 * float(np.median(np.abs(score - usual)))
    found = []
    for angle, row in zip(angles, score, strict=True):
        if row.max() <= noise:
            continue
        total, first, last = _best_run(row - max(noise, EDGE_PART * row.max()))
        way = np.array([math.cos(angle), math.sin(angle)])
        length = along[last] - along[first] + radius / STEPS_PER_RADIUS
        if length > MIN_LENGTH_RADII * radius:
            found.append((total, origin + (along[first] + along[last]) / 2 * way, length * way))
    kept: list[SweptStrip] = []
    for _, middle, motion in sorted(found, key=lambda one: -one[0]):
        if all(np.hypot(*(middle - other.xy)) > SPREAD_RADII * radius for other in kept):
            kept.append(SweptStrip(middle, motion))
    return kept[:MAX_STRIPS]


def _shown(
    view: View, colour: Array | None, origin: Array, search_radius: float, radius: float, taken: Sequence[DiscFit]
) -> tuple[Image, Array]:  # fmt: skip
    """Cover by a ball around a pixel (2,), and the first pixel of it (2,); none where other balls are known."""
    window, table, corner = view.window(origin, search_radius)
    x0, y0 = (int(v) for v in corner)
    on_table = view.geometry.ball_region[y0 : y0 + window.shape[0], x0 : x0 + window.shape[1]]
    shown = np.where(on_table, covered(window, table, colour), np.float32(0.0))
    for one in taken if shown.size else ():
        ends = [tuple(np.rint(one.xy - corner + part * one.motion).astype(int).tolist()) for part in (-0.5, 0.5)]
        cv2.line(shown, ends[0], ends[1], 0.0, max(1, round(2 * TAKEN_RADII * radius)))
    return shown, corner


def _on(shown: Image, origin: Array, angles: Array, along: Array, radius: float, across: Sequence[float]) -> Image:
    """What is shown at places (k, angles, along) beside rays from a pixel (2,)."""
    c, s = np.cos(angles)[None, :, None], np.sin(angles)[None, :, None]
    lateral = radius * np.array(across)[:, None, None]
    x, y = origin[0] + along * c - lateral * s, origin[1] + along * s + lateral * c
    shape = x.shape
    columns, rows = (np.asarray(v, np.float32).reshape(-1, shape[2]) for v in (x, y))
    seen = cv2.remap(shown, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.0)
    return np.asarray(seen).reshape(shape)


def _best_run(row: Array) -> tuple[float, int, int]:
    """The run of values (n,) with the greatest sum: its sum, first and last."""
    best, total, start = (0.0, 0, 0), 0.0, 0
    for k, value in enumerate(row.tolist()):
        if total <= 0:
            total, start = 0.0, k
        total += value
        if total > best[0]:
            best = (total, start, k)
    return best
