"""Least squares of a camera on edge points of the sides of a table: pose, and optionally intrinsic parameters.

In: a camera near the truth, edge points, and the rail of each. Out: `CameraFit`. The line of sight of an edge point
meets the plane of the noses at some distance from its nose line. These distances, in pixels, are minimised: robustly
at first (soft L1), then without outliers. Their rms is the reprojection error.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from models.shot import NOSE_HEIGHT
from sysid.vision.camera.projection import Array, Camera

Rails = NDArray[np.intp]  # places in models.shot.RAILS
Mask = NDArray[np.bool_]
TABLE_SIZE_SD = 1e-3  # of the length and width of a table as given, relative
PRINCIPAL_POINT_SD = 5e-3  # of the principal point from the middle of the picture [picture widths]
OUTLIER_SD = 4.0  # robust standard deviations from which on a point is an outlier
OUTLIER_ROUNDS = 3  # of removing outliers
DIFFERENCE_STEP = 1e-5  # of central differences


@dataclass(frozen=True)
class CameraFit:
    """A camera fitted to points on the sides of a table."""

    camera: Camera
    margin: float  # of the lines outside the noses [m]
    pixels: Array  # (n, 2) the points
    rails: Rails  # (n,) and the rail each lies on
    away: Array  # (n,) distance of the points out of their lines [m]
    kept: Mask  # (n,) inliers
    reprojection_error: float  # rms of the inliers [pixels]
    sd: Mapping[str, float]  # of the free parameters beside the pose, from the scatter of the points
    total_sd: Mapping[str, float]  # including the uncertainty of the table size and of the principal point
    covariance: Array  # (6 + free, 6 + free) of the parameters as in `moved`, from the scatter
    free: tuple[str, ...]

    @property
    def rms(self) -> float:
        """Of the inliers, on the table [m]."""
        return float(np.sqrt(np.mean(self.away[self.kept] ** 2)))

    def rms_of(self, rail: int) -> float:
        """Of the inliers of one rail [m]; NaN where there are none."""
        own = self.away[self.kept & (self.rails == rail)]
        return float(np.sqrt(np.mean(own**2))) if own.size else float("nan")


def distances(camera: Camera, pixels: Array, rails: Rails, margin: float = 0.0) -> Array:
    """Distances of pixels (n, 2) out of the nose lines of rails (n,), on the plane of the noses: (n,) [m]."""
    xy = camera.on_plane(pixels, NOSE_HEIGHT * camera.radius)
    half = np.array([camera.table.length, camera.table.width]) / 2
    axis, sign = rails // 2, 1.0 - 2.0 * (rails % 2)
    away = sign * xy[np.arange(len(xy)), axis] - half[axis] - margin
    return np.clip(np.nan_to_num(away, nan=1e2), -1e2, 1e2)


def moved(camera: Camera, change: Array, free: tuple[str, ...]) -> Camera:
    """The camera turned by change[:3] [rad], shifted by change[3:6] [m], then log focal length, k1, k2 as `free`."""
    extra = dict(zip(free, change[6:], strict=True))
    rotation = cv2.Rodrigues(cv2.Rodrigues(np.asarray(change[:3], float))[0] @ camera.axes)[0].ravel()
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= np.exp(np.clip(extra.get("focal", 0.0), -3, 3))
    distortion = camera.distortion + np.array([extra.get("k1", 0.0), extra.get("k2", 0.0), 0.0, 0.0, 0.0])
    return dataclasses.replace(
        camera, matrix=matrix, distortion=distortion, rotation=rotation, translation=camera.translation + change[3:6]
    )


def fit_camera(
    start: Camera, pixels: Array, rails: Rails, free: tuple[str, ...] = (), *, margin: float = 0.0,
    prior: Mapping[str, tuple[float, float]] | None = None, max_evaluations: int = 60, sure: Mask | None = None,
) -> CameraFit:  # fmt: skip
    """Fit a camera to edge points.

    Args:
        start: near the truth.
        pixels: (n, 2) edge points.
        rails: (n,) the rail each lies on.
        free: parameters beside the pose: "focal", "k1", "k2", "margin".
        margin: of the lines outside the noses, initially [m].
        prior: expected value and standard deviation of free parameters (of "focal", change of the logarithm).
        max_evaluations: evaluations per round, at most.
        sure: (n,) points that are never outliers.
    """
    begin = {"focal": 0.0, "k1": float(start.distortion[0]), "k2": float(start.distortion[1]), "margin": margin}
    priors = [(6 + free.index(name), *known) for name, known in (prior or {}).items() if name in free]
    pixel = _pixel_sizes(start, pixels)

    def line_margin(change: Array) -> float:
        return margin + float(change[6 + free.index("margin")]) if "margin" in free else margin

    def offsets(change: Array) -> Array:
        return distances(moved(start, change, free), pixels, rails, line_margin(change)) / pixel

    change, kept, noise = np.zeros(6 + len(free)), np.ones(len(pixels), bool), 1.0
    for k in range(OUTLIER_ROUNDS + 1):

        def residuals(change: Array, mask: Mask = kept, unit: float = noise) -> Array:
            prior_residuals = [(begin[free[at - 6]] + change[at] - mean) / sd for at, mean, sd in priors]
            return np.concatenate([offsets(change)[mask] / unit, prior_residuals])

        change = least_squares(
            residuals, change, lambda c, r=residuals: jacobian(r, c), x_scale=0.01, max_nfev=max_evaluations,
            loss="linear" if k else "soft_l1", f_scale=1.0 if k else 2.0,
        ).x  # fmt: skip
        out = offsets(change)
        kept = np.abs(out) < OUTLIER_SD * max(1.4826 * float(np.median(np.abs(out))), 0.1)
        kept = kept if sure is None else kept | sure
        noise = max(float(np.sqrt(np.mean(out[kept] ** 2))), 1e-3)
    camera, outside = moved(start, change, free), line_margin(change)
    covariance, total = _uncertainty(camera, pixels[kept], rails[kept], free, outside, noise, priors)
    away = distances(camera, pixels, rails, outside)
    sd, total_sd = (dict(zip(free, np.sqrt(v[6:]).tolist(), strict=True)) for v in (np.diag(covariance), total))
    return CameraFit(camera, outside, pixels, rails, away, kept, noise, sd, total_sd, covariance, free)


def jacobian(function: Callable[[Array], Array], at: Array) -> Array:
    """Jacobian (m, n) of a function (m,) at unknowns (n,), by central differences."""
    return np.stack(
        [(function(at + s) - function(at - s)) / (2 * DIFFERENCE_STEP) for s in DIFFERENCE_STEP * np.eye(len(at))],
        axis=1,
    )


def _pixel_sizes(camera: Camera, pixels: Array) -> Array:
    """Sizes of pixels (n, 2) on the cloth: (n,) [m]."""
    sideways = np.linalg.norm(np.nan_to_num(camera.on_plane(pixels, 0.0)) - camera.eye[:2], axis=1)
    return np.asarray(np.hypot(sideways, camera.eye[2]) / camera.matrix[0, 0])


def _uncertainty(
    camera: Camera, pixels: Array, rails: Rails, free: tuple[str, ...], margin: float, noise: float,
    priors: list[tuple[int, float, float]],
) -> tuple[Array, Array]:  # fmt: skip
    """Covariance (n, n) of the parameters from the points; variances (n,) with table size and principal point."""
    unit = _pixel_sizes(camera, pixels) * noise

    def offsets(change: Array) -> Array:
        outside = margin + float(change[6 + free.index("margin")]) if "margin" in free else margin
        return distances(moved(camera, change, free), pixels, rails, outside) / unit

    zero = np.zeros(6 + len(free))
    prior_rows = np.zeros((len(priors), len(zero)))
    for row, (at, _, sd) in zip(prior_rows, priors, strict=True):
        row[at] = 1.0 / sd
    inverse = np.linalg.pinv(np.concatenate([jacobian(offsets, zero), prior_rows]), rcond=1e-12)
    covariance = inverse @ inverse.T
    total = np.diag(covariance).copy()
    table = camera.table
    others = [
        dataclasses.replace(camera, table=dataclasses.replace(table, length=table.length * (1 + TABLE_SIZE_SD))),
        dataclasses.replace(camera, table=dataclasses.replace(table, width=table.width * (1 + TABLE_SIZE_SD))),
    ]
    for axis in (0, 1):
        matrix = camera.matrix.copy()
        matrix[axis, 2] += PRINCIPAL_POINT_SD * camera.size[0]
        others.append(dataclasses.replace(camera, matrix=matrix))
    for other in others:
        shift = distances(other, pixels, rails, margin) / unit - offsets(zero)
        total += (inverse[:, : len(pixels)] @ shift) ** 2
    return covariance, total
