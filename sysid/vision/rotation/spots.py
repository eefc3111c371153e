"""The spots on a ball in one picture, as directions from its centre in table axes.

In: a picture, its camera and the position of the ball. Out: `Spots`. The pixels of the ball are mapped to the sphere.
Its colour is that of most of them, up to a shading that is linear in the normal (Lambert's law and an ambient part),
fitted robustly; connected pixels that differ from it are marks or highlights. Left out: marks that cover most of a
ball, and stripes.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.rotation.spot_fit import RIM_PX, Disc, find_blob, fit_circles, fit_pixels
from sysid.vision.sources.pictures import Picture

MIN_TRUSTED_COSINE = float(np.cos(np.radians(65)))  # of the angle to the line of sight; beyond, a centre is inaccurate
MIN_FITTED_COSINE = float(np.cos(np.radians(72)))  # of that angle; beyond, spots are not fitted
MIN_BALL_RADIUS_PX = 4.0  # of balls on which spots are looked for


@dataclass(frozen=True)
class Spots:
    """The spots that a picture shows on one ball: marks and highlights."""

    time: float  # [s]
    xy: Array  # (2,) of the ball's centre [m]
    sight: Array  # (3,) unit vector from the ball to the camera
    place: Array  # (k, 3) centres of the spots, unit vectors from the centre of the ball, table axes
    sd: Array  # (k, 2) standard deviation across the direction to the centre of the visible face, and along it [rad]
    angle: Array  # (k,) angular radius [rad]
    bright: NDArray[np.bool_]  # (k,) lighter than the ball in every colour: a mark, or a highlight
    shade: Array | None  # (4, 3) colour of the ball: constant and linear in x, y, z of the normal; None if not seen

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Which spots face the camera enough for an accurate centre: (k,)."""
        return np.asarray(self.place @ self.sight > MIN_TRUSTED_COSINE)


def find_spots(picture: Picture, time: float, xy: Array, camera: Camera, previous: Spots | None = None) -> Spots:
    """Find the spots on a ball.

    Args:
        picture: (height, width, 3), or (height, width) of a monochrome camera.
        time: of the picture [s].
        xy: (2,) centre of the ball on the table [m].
        camera: that took it.
        before: the spots of this ball in the previous picture: the fit of its colour begins there.
    """
    xy = np.asarray(xy, float)
    disc = _disc(picture, xy, camera) if np.isfinite(xy).all() else None
    if disc is None or len(disc.colour) < 30:
        sight = camera.eye - np.array([*xy, camera.radius])
        return _no_spots(time, xy, sight / np.linalg.norm(sight), None if previous is None else previous.shade)
    start = previous.shade if previous is not None else None
    shade, noise = _shading(disc, start)
    base = np.column_stack([np.ones(len(disc.normal)), disc.normal]) @ shade
    typical = np.median(base, axis=0)
    strength = typical @ typical
    brightness = np.clip(base @ typical / (strength + 1.0), 0.3, 2.0)
    difference = disc.colour / brightness[:, None] - typical  # difference from the ball's colour, in uniform light
    distance = np.sqrt(np.sum(difference**2, axis=1))
    limit = max(6.0 * noise, 0.1 * np.sqrt(strength), 12.0)
    label, count = _blobs(distance > limit, disc.inside)
    found = [blob for k in range(1, count) if (blob := find_blob(disc, difference, label, k)) is not None]
    if not found:
        return _no_spots(time, xy, disc.axes[2], shade)
    colour, middle, angle = (np.array(v) for v in zip(*[(b.colour, b.middle, b.angle) for b in found], strict=True))
    place, sd = middle, np.full((len(found), 2), 0.5)
    fit = middle @ disc.axes[2] > MIN_FITTED_COSINE
    if fit.any():
        pixels = [
            fit_pixels(disc, difference, label, blob, noise) for blob, good in zip(found, fit, strict=True) if good
        ]
        place[fit], sd[fit], angle[fit] = fit_circles(disc, pixels, middle[fit], angle[fit], _typical(previous))
    return Spots(time, xy, disc.axes[2], place, sd, angle, np.all(colour > 0, axis=1), shade)


def _no_spots(time: float, xy: Array, sight: Array, shade: Array | None) -> Spots:
    return Spots(time, xy, sight, np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool), shade)


def _disc(picture: Picture, xy: Array, camera: Camera) -> Disc | None:
    centre, r = np.array([*xy, camera.radius]), camera.radius
    sight = camera.eye - centre
    sight /= np.linalg.norm(sight)
    axes = camera.axes
    across = axes[0] - (axes[0] @ sight) * sight
    across /= np.linalg.norm(across)
    down = axes[1] - (axes[1] @ sight) * sight - (axes[1] @ across) * across
    down /= np.linalg.norm(down)
    middle, *rim = camera.project(centre + r * np.array([0 * across, across, down, -across, -down]))
    size = float(np.mean([np.linalg.norm(p - middle) for p in rim]))
    extent = np.max([np.abs(p - middle) for p in rim], axis=0) + 2
    x0, y0 = np.maximum(np.floor(middle - extent), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(middle + extent) + 1, camera.size).astype(int)
    if size < MIN_BALL_RADIUS_PX or x1 - x0 < 3 or y1 - y0 < 3:
        return None
    rays, offset = _rays(camera, np.arange(x0, x1), np.arange(y0, y1)), centre - camera.eye
    along = rays @ offset
    distance_squared = np.maximum(offset @ offset - along**2, 0)  # squared distance of a ray from the centre
    inside = np.sqrt(distance_squared) < r * (1 - RIM_PX / size)
    rays, along = rays[inside], along[inside]
    half = np.sqrt(r**2 - distance_squared[inside])
    normal = ((along - half)[:, None] * rays - offset) / r
    patch = picture[y0:y1, x0:x1]
    patch = (patch if patch.ndim == 3 else np.repeat(patch[..., None], 3, axis=2)).reshape(-1, 3)
    return Disc(
        patch[inside].astype(float), normal, half / r, inside.reshape(y1 - y0, x1 - x0), size,
        np.stack([across, down, sight]),
    )  # fmt: skip


def _rays(camera: Camera, xs: NDArray[np.int64], ys: NDArray[np.int64]) -> Array:
    """Directions (h * w, 3) of the pixels of a patch, interpolated from nine to 1e-4 of a ball radius."""
    ends = [np.array([v[0], 0.5 * (v[0] + v[-1]), v[-1]]) for v in (xs, ys)]
    nodes = camera.rays(np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 2)).reshape(3, 3, 3)
    u, v = ((2.0 * p - p[0] - p[-1]) / (p[-1] - p[0]) for p in (xs, ys))
    across, down = (np.stack([0.5 * w * (w - 1), 1 - w**2, 0.5 * w * (w + 1)]) for w in (u, v))
    return np.asarray(np.tensordot(down, np.tensordot(across, nodes, (0, 1)), (0, 1)).reshape(-1, 3))


def _shading(disc: Disc, start: Array | None) -> tuple[Array, float]:
    """Colour of the ball as a function of the normal (4, 3), fitted robustly, and the noise about it [grey levels]."""
    basis = np.column_stack([np.ones(len(disc.normal)), disc.normal])
    shade = start
    if shade is None:
        shade = np.zeros((4, 3))
        shade[0] = np.median(disc.colour, axis=0)
    noise = 0.0
    for _ in range(12 if start is None else 3):
        distance = np.sqrt(np.sum((disc.colour - basis @ shade) ** 2, axis=1))
        # The median distance of three independent normal variables is 1.54 standard deviations.
        noise = max(float(np.median(distance)) / 1.54, 1.0)
        robust_weight = 1.0 / (1.0 + (distance / (4.0 * noise)) ** 2) ** 2
        weighted = basis * robust_weight[:, None]
        normal = basis.T @ weighted
        normal[np.diag_indices(4)] += 1e-3 * robust_weight.sum() * np.array([0.0, 1, 1, 1])
        shade = np.linalg.solve(normal, weighted.T @ disc.colour)
    return shade, noise


def _blobs(marked: NDArray[np.bool_], inside: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Label of the blob of each pixel of the disc (p,), 0 for none, and the number of labels."""
    mask = np.zeros(inside.shape, np.uint8)
    mask[inside] = marked
    count, labels = cv2.connectedComponents(mask, connectivity=4)
    return np.asarray(labels)[inside].astype(np.int32), int(count)


def _typical(previous: Spots | None) -> float | None:
    """Median angular radius of the spots that faced the camera [rad]."""
    if previous is None or len(previous.angle) == 0:
        return None
    facing = previous.place @ previous.sight > np.cos(np.radians(50))
    return float(np.median(previous.angle[facing])) if facing.any() else None
