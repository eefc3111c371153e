"""The last fit of a camera: a side counts as its points keep to a line, and the cloth ends parallel to the nose.

In: a fit to points of the noses, and points where the cloth ends behind them. Out: the same fit, weighed. The points of
a side do not err independently of each other: compression, cloth and lamps shift an edge over sections of it. So the
means of sections count, by their scatter about a line: a weak edge wanders by millimetres where a clear one keeps to
tenths. How far behind a nose the cloth ends may differ from side to side; there, only its direction counts.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sysid.vision.camera.pose import CameraFit, Mask, distances, jacobian, moved
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.trust import K1_PRIOR

SIDE_SECTIONS = 8  # of a side, which err independently
MIN_SECTION_POINTS = 3  # fewer points make fewer sections
MIN_SECTION_SD_PX = 0.03  # of the mean of one
SHIFT_SD = 0.5  # of a shift that was taken off, relative
OUTLIER_SD = 4.0  # of points at the end of the cloth


@dataclass(frozen=True)
class _Line:
    """Points of one line along a rail."""

    pixels: Array  # (n, 2)
    rail: int
    sd: float  # of each, if they erred independently, so that their mean errs as it does [m]
    parallel: bool  # at an unknown distance from the nose
    shift: float  # that was taken off all of them [m]


def weighed(lines: CameraFit, ends: Mapping[int, Array], shifts: Mapping[int, float]) -> CameraFit:
    """The fit, weighed.

    Args:
        lines: to points of noses.
        ends: points where the cloth ends, (n, 2) by rail [pixels].
        shifts: of the noses by blur, which were taken off, by rail [m]: what is left of them is alike at all sides.
    """
    pixel = float(lines.camera.eye[2]) / lines.camera.matrix[0, 0]
    noses = {rail: lines.pixels[lines.kept & (lines.rails == rail)] for rail in dict.fromkeys(lines.rails.tolist())}
    groups = [_line(lines.camera, noses[rail], rail, False, pixel, shifts.get(rail, 0.0)) for rail in noses]
    groups += [_line(lines.camera, ends[rail], rail, True, pixel, 0.0) for rail in ends]
    free = tuple(name for name in lines.free if name != "margin")
    k1, prior = lines.camera.distortion[0], K1_PRIOR["k1"]

    def residuals(change: Array) -> Array:
        camera = moved(lines.camera, change, free)
        parts = [_away(camera, group) / group.sd for group in groups if len(group.pixels)]
        own = [(k1 + change[6 + free.index("k1")] - prior[0]) / prior[1]] if "k1" in free else []
        return np.concatenate([*parts, own])

    fit = least_squares(residuals, np.zeros(6 + len(free)), lambda c: jacobian(residuals, c), x_scale=0.01)
    inverse = np.linalg.pinv(fit.jac, rcond=1e-12)
    off = np.concatenate([np.full(len(group.pixels), SHIFT_SD * group.shift / group.sd) for group in groups])
    together = inverse[:, : len(off)] @ off
    covariance = inverse @ inverse.T + np.outer(together, together)
    camera = moved(lines.camera, fit.x, free)
    return dataclasses.replace(
        lines, camera=camera, away=distances(camera, lines.pixels, lines.rails), covariance=covariance, free=free,
        sd=dict(zip(free, np.sqrt(np.diag(covariance)[6:]).tolist(), strict=True)),
    )  # fmt: skip


def _away(camera: Camera, group: _Line) -> Array:
    """Distances of the points of a line from where they should be (n,) [m]."""
    away = distances(camera, group.pixels, np.full(len(group.pixels), group.rail))
    return away - away.mean() if group.parallel else away


def _line(camera: Camera, pixels: Array, rail: int, parallel: bool, pixel: float, shift: float) -> _Line:
    """The points of a line, weighed; outliers of those at the end of the cloth are left out."""
    if parallel:
        pixels = pixels[_inliers(distances(camera, pixels, np.full(len(pixels), rail)), 0.1 * pixel)]
    away = distances(camera, pixels, np.full(len(pixels), rail))
    order = np.argsort(pixels[:, int(np.argmax(np.ptp(pixels, axis=0)))]) if len(pixels) else np.zeros(0, int)
    count = min(SIDE_SECTIONS, len(pixels) // MIN_SECTION_POINTS)
    if count < MIN_SECTION_POINTS:
        return _Line(pixels, rail, pixel, parallel, shift)
    means = np.array([part.mean() for part in np.array_split(away[order], count)])
    along = np.linspace(-1, 1, count)
    bent = means - np.polyval(np.polyfit(along, means, 1), along)
    sd = max(float(np.sqrt(np.sum(bent**2) / (count - 2))), MIN_SECTION_SD_PX * pixel)
    return _Line(pixels, rail, sd * float(np.sqrt(len(pixels) / count)), parallel, shift)


def _inliers(away: Array, least: float) -> Mask:
    """Which of some distances (n,) are near the middle one."""
    off = np.abs(away - np.median(away)) if len(away) else away
    return off < OUTLIER_SD * max(1.4826 * float(np.median(off)), least) if len(off) else np.zeros(0, bool)
