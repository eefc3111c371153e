"""Least squares of a camera on the sides of a table: where it stands, how it turns, its focal length and distortion.

The ray of every edge point meets the plane of the noses at some distance from the nose line that the point belongs to.
Those distances, in pixels, are made small: robustly at first, then without the points that lie far off.
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
KNOWN_LENGTH = 1e-3  # how well a table's length and width are told [fraction]
KNOWN_CENTRE = 5e-3  # how near the picture's middle the principal point lies [picture widths]
FAR = 4.0  # standard deviations from which a point is set aside
ROUNDS = 3  # of setting points aside
STEP = 1e-5  # of central differences


@dataclass(frozen=True)
class Fit:
    """A camera fitted to points on a table's sides."""

    camera: Camera
    margin: float  # by which the lines lie outside the noses [m]
    pixels: Array  # (n, 2) the points
    rails: Rails  # (n,) and the rail each lies on
    away: Array  # (n,) of the points out of their lines [m]
    kept: Mask  # (n,) those not set aside
    noise: float  # rms of the kept ones [pixels]
    sd: Mapping[str, float]  # of what was free beside the pose, from the points' scatter
    wide: Mapping[str, float]  # and with what is not known of the table and the principal point
    covariance: Array  # (6 + free, 6 + free) of turn, shift and what is free, as `moved` takes them, from the scatter
    free: tuple[str, ...]

    @property
    def rms(self) -> float:
        """Of the kept points, on the table [m]."""
        return float(np.sqrt(np.mean(self.away[self.kept] ** 2)))

    def rms_of(self, rail: int) -> float:
        """Of the kept points of one rail [m]; NaN where there are none."""
        own = self.away[self.kept & (self.rails == rail)]
        return float(np.sqrt(np.mean(own**2))) if own.size else float("nan")


def distances(camera: Camera, pixels: Array, rails: Rails, margin: float = 0.0) -> Array:
    """How far pixels (n, 2) lie out of the nose lines of rails (n,), on the plane of the noses: (n,) [m]."""
    xy = camera.on_plane(pixels, NOSE_HEIGHT * camera.radius)
    half = np.array([camera.table.length, camera.table.width]) / 2
    axis, sign = rails // 2, 1.0 - 2.0 * (rails % 2)
    away = sign * xy[np.arange(len(xy)), axis] - half[axis] - margin
    return np.clip(np.nan_to_num(away, nan=1e2), -1e2, 1e2)


def moved(camera: Camera, change: Array, free: tuple[str, ...]) -> Camera:
    """The camera turned by change[:3] [rad] and shifted by change[3:6] [m]; then come log focal length, k1, k2."""
    extra = dict(zip(free, change[6:], strict=True))
    rotation = cv2.Rodrigues(cv2.Rodrigues(np.asarray(change[:3], float))[0] @ camera.axes)[0].ravel()
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= np.exp(np.clip(extra.get("focal", 0.0), -3, 3))
    distortion = camera.distortion + np.array([extra.get("k1", 0.0), extra.get("k2", 0.0), 0.0, 0.0, 0.0])
    return dataclasses.replace(
        camera, matrix=matrix, distortion=distortion, rotation=rotation, translation=camera.translation + change[3:6]
    )


def fit(
    start: Camera, pixels: Array, rails: Rails, free: tuple[str, ...] = (), *, margin: float = 0.0,
    prior: Mapping[str, tuple[float, float]] | None = None, patience: int = 60,
) -> Fit:  # fmt: skip
    """Fit a camera to edge points.

    Args:
        start: near the truth.
        pixels: (n, 2) edge points.
        rails: (n,) the rail each lies on.
        free: what to fit beside the pose: "focal", "k1", "k2", "margin".
        margin: by which the lines lie outside the noses, to start with [m].
        prior: expected value and standard deviation of what is free (of "focal", the logarithm's change).
        patience: evaluations of a round, at most.
    """
    begin = {"focal": 0.0, "k1": float(start.distortion[0]), "k2": float(start.distortion[1]), "margin": margin}
    beliefs = [(6 + free.index(name), *known) for name, known in (prior or {}).items() if name in free]
    pixel = _pixel_sizes(start, pixels)

    def lines(change: Array) -> float:
        return margin + float(change[6 + free.index("margin")]) if "margin" in free else margin

    def offsets(change: Array) -> Array:
        return distances(moved(start, change, free), pixels, rails, lines(change)) / pixel

    change, kept, noise = np.zeros(6 + len(free)), np.ones(len(pixels), bool), 1.0
    for k in range(ROUNDS + 1):

        def residuals(change: Array, mask: Mask = kept, unit: float = noise) -> Array:
            held = [(begin[free[at - 6]] + change[at] - mean) / sd for at, mean, sd in beliefs]
            return np.concatenate([offsets(change)[mask] / unit, held])

        change = least_squares(
            residuals, change, lambda c, r=residuals: slopes(r, c), x_scale=0.01, max_nfev=patience,
            loss="linear" if k else "soft_l1", f_scale=1.0 if k else 2.0,
        ).x  # fmt: skip
        out = offsets(change)
        kept = np.abs(out) < FAR * max(1.4826 * float(np.median(np.abs(out))), 0.1)
        noise = max(float(np.sqrt(np.mean(out[kept] ** 2))), 1e-3)
    camera, outside = moved(start, change, free), lines(change)
    covariance, total = _uncertainty(camera, pixels[kept], rails[kept], free, outside, noise, beliefs)
    away = distances(camera, pixels, rails, outside)
    sd, wide = (dict(zip(free, np.sqrt(v[6:]).tolist(), strict=True)) for v in (np.diag(covariance), total))
    return Fit(camera, outside, pixels, rails, away, kept, noise, sd, wide, covariance, free)


def slopes(function: Callable[[Array], Array], at: Array) -> Array:
    """Central differences of a function's values (m,) by its unknowns (n,): (m, n)."""
    return np.stack([(function(at + s) - function(at - s)) / (2 * STEP) for s in STEP * np.eye(len(at))], axis=1)


def _pixel_sizes(camera: Camera, pixels: Array) -> Array:
    """How large pixels (n, 2) are on the cloth: (n,) [m]."""
    sideways = np.linalg.norm(np.nan_to_num(camera.on_plane(pixels, 0.0)) - camera.eye[:2], axis=1)
    return np.asarray(np.hypot(sideways, camera.eye[2]) / camera.matrix[0, 0])


def _uncertainty(
    camera: Camera, pixels: Array, rails: Rails, free: tuple[str, ...], margin: float, noise: float,
    beliefs: list[tuple[int, float, float]],
) -> tuple[Array, Array]:  # fmt: skip
    """Covariance of the unknowns (n, n) from the points alone; variances (n,) with the table's and the centre's own."""
    unit = _pixel_sizes(camera, pixels) * noise

    def offsets(change: Array) -> Array:
        outside = margin + float(change[6 + free.index("margin")]) if "margin" in free else margin
        return distances(moved(camera, change, free), pixels, rails, outside) / unit

    here = np.zeros(6 + len(free))
    held = np.zeros((len(beliefs), len(here)))
    for row, (at, _, sd) in zip(held, beliefs, strict=True):
        row[at] = 1.0 / sd
    inverse = np.linalg.pinv(np.concatenate([slopes(offsets, here), held]), rcond=1e-12)
    covariance = inverse @ inverse.T
    total = np.diag(covariance).copy()
    table = camera.table
    others = [
        dataclasses.replace(camera, table=dataclasses.replace(table, length=table.length * (1 + KNOWN_LENGTH))),
        dataclasses.replace(camera, table=dataclasses.replace(table, width=table.width * (1 + KNOWN_LENGTH))),
    ]
    for axis in (0, 1):
        matrix = camera.matrix.copy()
        matrix[axis, 2] += KNOWN_CENTRE * camera.size[0]
        others.append(dataclasses.replace(camera, matrix=matrix))
    for other in others:
        shift = distances(other, pixels, rails, margin) / unit - offsets(here)
        total += (inverse[:, : len(pixels)] @ shift) ** 2
    return covariance, total
