"""The marks on a ball in one picture, as directions from its centre in table axes.

A ball's pixels are mapped to the sphere. Its own colour is what most of them have, up to a shading that is linear in
the normal (Lambert's law and an ambient part), fitted robustly; pixels that depart from it are marks or highlights.
A mark is fitted as a circle on the sphere whose edge is as soft as the picture is, with only the pixels that are
surely on the ball: so a mark that the limb cuts off, or that has a highlight in it, still has its centre in its middle.
Left out: marks that cover most of a ball, and stripes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array, Camera

Picture = NDArray[np.uint8]

TRUSTED = float(np.cos(np.radians(65)))  # of the angle to the line of sight, beyond which a mark's place is a guess
RIM = 1.0  # pixels next to the limb that show the background, too
SOFT = 0.55  # half the width of a mark's edge in a picture [pixels]
DARK, LIGHT = 0.2, 0.8  # share of a mark's colour below which a pixel is the ball's, above which the mark's
LEAST_PIXELS = 4.0  # of a mark
SMALL_BALL = 4.0  # radius below which marks are not looked for [pixels]
SHY = 0.05  # error of a place that better pictures would not mend [pixels]
CUT = 0.25  # error of a place along the way to the limb, as a share of the width that the limb hides
NEAR = 0.25  # around a mark that its fit looks at [rad]
FITTED = float(np.cos(np.radians(72)))  # of the angle to the line of sight, up to which marks are fitted
STEPS = 6  # of a fit at most
SETTLED = 1e-3  # a step that ends it [rad]
WIDEST = 0.9  # half the width of a mark [rad]
BESIDE = 7  # frames before and after one that may tell its place better
GLARE = 0.1  # half the width of a highlight, and by how much it may wander [rad]
LAG = 5  # frames over which a mark moves and a highlight does not
MODEL = 0.02  # by which a mark may be elsewhere than its place on a rigid ball [rad]


@dataclass(frozen=True)
class Spots:
    """The marks that a picture shows of one ball."""

    time: float  # [s]
    xy: Array  # (2,) of the ball's centre [m]
    sight: Array  # (3,) from the ball to the camera, unit length
    place: Array  # (k, 3) middles of the marks, unit length, table axes
    sd: Array  # (k, 2) across the way to the middle of the visible face, and along it [rad]
    angle: Array  # (k,) half their width, seen from the ball's centre [rad]
    bright: NDArray[np.bool_]  # (k,) lighter than the ball in every colour: a mark, or a highlight
    shade: Array | None  # (4, 3) of the ball's colour: constant and along x, y, z of the normal; None if not seen

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Which marks face the camera enough: (k,)."""
        return np.asarray(self.place @ self.sight > TRUSTED)


@dataclass(frozen=True)
class Marks:
    """The marks of one ball that count."""

    time: float  # [s]
    xy: Array  # (2,) [m]
    sight: Array  # (3,)
    place: Array  # (k, 3)
    sd: Array  # (k, 2) across the way to the middle of the visible face, and along it [rad]
    glare: Array  # (m, 3) what was seen but is no mark that counts: others may be hidden there

    @property
    def weight(self) -> Array:
        """Of each mark's place: (k,)."""
        return np.asarray(1.0 / (np.mean(self.sd**2, axis=1) + MODEL**2))


@dataclass(frozen=True)
class _Disc:
    """The pixels of a ball that show nothing else."""

    colour: Array  # (p, 3) grey levels
    normal: Array  # (p, 3) table axes
    facing: Array  # (p,) cosine of the angle to the line of sight
    inside: NDArray[np.bool_]  # (h, w) which pixels of the patch these are
    radius: float  # [pixels]
    axes: Array  # (3, 3) rows: a picture's x and y across the line of sight, and the line of sight


def find_spots(picture: Picture, time: float, xy: Array, camera: Camera, before: Spots | None = None) -> Spots:
    """The marks of a ball.

    Args:
        picture: (height, width, 3), or (height, width) of a camera that sees no colours.
        time: of the picture [s].
        xy: (2,) the ball's centre on the table [m].
        camera: that took it.
        before: what the picture before showed of this ball: its colour is where the search for this one's begins.
    """
    xy = np.asarray(xy, float)
    disc = _disc(picture, xy, camera) if np.isfinite(xy).all() else None
    if disc is None or len(disc.colour) < 30:
        sight = camera.eye - np.array([*xy, camera.radius])
        return _none(time, xy, sight / np.linalg.norm(sight), None if before is None else before.shade)
    start = before.shade if before is not None else None
    shade, noise = _shading(disc, start)
    base = np.column_stack([np.ones(len(disc.normal)), disc.normal]) @ shade
    usual = np.median(base, axis=0)
    strength = usual @ usual
    lit = np.clip(base @ usual / (strength + 1.0), 0.3, 2.0)
    other = disc.colour / lit[:, None] - usual  # departure from the ball's colour, as if lit alike everywhere
    away = np.sqrt(np.sum(other**2, axis=1))
    limit = max(6.0 * noise, 0.1 * np.sqrt(strength), 12.0)
    label, count = _blobs(away > limit, disc.inside)
    found = [blob for k in range(1, count) if (blob := _blob(disc, other, label, k)) is not None]
    if not found:
        return _none(time, xy, disc.axes[2], shade)
    colour, middle, angle = (np.array(v) for v in zip(*[(b.colour, b.middle, b.angle) for b in found], strict=True))
    place, sd = middle, np.full((len(found), 2), 0.5)
    fit = middle @ disc.axes[2] > FITTED
    if fit.any():
        near = [_near(disc, other, label, blob, noise) for blob, good in zip(found, fit, strict=True) if good]
        place[fit], sd[fit], angle[fit] = _circles(disc, near, middle[fit], angle[fit], _typical(before))
    return Spots(time, xy, disc.axes[2], place, sd, angle, np.all(colour > 0, axis=1), shade)


def _none(time: float, xy: Array, sight: Array, shade: Array | None) -> Spots:
    return Spots(time, xy, sight, np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0), np.zeros(0, bool), shade)


def _disc(picture: Picture, xy: Array, camera: Camera) -> _Disc | None:
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
    reach = np.max([np.abs(p - middle) for p in rim], axis=0) + 2
    x0, y0 = np.maximum(np.floor(middle - reach), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(middle + reach) + 1, camera.size).astype(int)
    if size < SMALL_BALL or x1 - x0 < 3 or y1 - y0 < 3:
        return None
    rays, to = _rays(camera, np.arange(x0, x1), np.arange(y0, y1)), centre - camera.eye
    along = rays @ to
    apart = np.maximum(to @ to - along**2, 0)  # squared distance of a ray from the centre
    inside = np.sqrt(apart) < r * (1 - RIM / size)
    rays, along = rays[inside], along[inside]
    half = np.sqrt(r**2 - apart[inside])
    normal = ((along - half)[:, None] * rays - to) / r
    patch = picture[y0:y1, x0:x1]
    patch = (patch if patch.ndim == 3 else np.repeat(patch[..., None], 3, axis=2)).reshape(-1, 3)
    return _Disc(
        patch[inside].astype(float), normal, half / r, inside.reshape(y1 - y0, x1 - x0), size,
        np.stack([across, down, sight]),
    )  # fmt: skip


def _rays(camera: Camera, xs: NDArray[np.int64], ys: NDArray[np.int64]) -> Array:
    """Directions (h * w, 3) of the pixels of a patch, interpolated between nine: to 1e-4 of a ball's radius."""
    ends = [np.array([v[0], 0.5 * (v[0] + v[-1]), v[-1]]) for v in (xs, ys)]
    knots = camera.rays(np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 2)).reshape(3, 3, 3)
    u, v = ((2.0 * p - p[0] - p[-1]) / (p[-1] - p[0]) for p in (xs, ys))
    across, down = (np.stack([0.5 * w * (w - 1), 1 - w**2, 0.5 * w * (w + 1)]) for w in (u, v))
    return np.asarray(np.tensordot(down, np.tensordot(across, knots, (0, 1)), (0, 1)).reshape(-1, 3))


def _shading(disc: _Disc, start: Array | None) -> tuple[Array, float]:
    """The ball's colour over the normal (4, 3), and the noise about it [grey levels]."""
    basis = np.column_stack([np.ones(len(disc.normal)), disc.normal])
    shade = start
    if shade is None:
        shade = np.zeros((4, 3))
        shade[0] = np.median(disc.colour, axis=0)
    noise = 0.0
    for _ in range(12 if start is None else 3):
        away = np.sqrt(np.sum((disc.colour - basis @ shade) ** 2, axis=1))
        # Of three independent colours, half of the distances are within 1.54 standard deviations.
        noise = max(float(np.median(away)) / 1.54, 1.0)
        trust = 1.0 / (1.0 + (away / (4.0 * noise)) ** 2) ** 2
        weighted = basis * trust[:, None]
        normal = basis.T @ weighted
        normal[np.diag_indices(4)] += 1e-3 * trust.sum() * np.array([0.0, 1, 1, 1])
        shade = np.linalg.solve(normal, weighted.T @ disc.colour)
    return shade, noise


def _blobs(marked: NDArray[np.bool_], inside: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Number of the blob that each pixel of the disc belongs to (p,), 0 for none; one more than there are."""
    mask = np.zeros(inside.shape, np.uint8)
    mask[inside] = marked
    count, labels = cv2.connectedComponents(mask, connectivity=4)
    return np.asarray(labels)[inside].astype(np.int32), int(count)


def _typical(before: Spots | None) -> float | None:
    """Half the width of marks that faced the camera [rad]."""
    if before is None or len(before.angle) == 0:
        return None
    well = before.place @ before.sight > np.cos(np.radians(50))
    return float(np.median(before.angle[well])) if well.any() else None


@dataclass(frozen=True)
class _Blob:
    """Pixels next to each other that are not the ball's colour."""

    number: int
    colour: Array  # (3,) departure from the ball's, as if lit as the ball's middle is
    middle: Array  # (3,)
    angle: float  # half width [rad]


def _blob(disc: _Disc, other: Array, label: NDArray[np.int32], number: int) -> _Blob | None:
    """One blob; None for a speck."""
    own = np.flatnonzero(label == number)
    if len(own) < LEAST_PIXELS:
        return None
    colour = other[own]
    strength = np.sum(colour**2, axis=1)
    colour = np.mean(colour[strength >= np.median(strength)], axis=0)
    area = _share(other[own], colour) / disc.facing[own] / disc.radius**2
    total = float(area.sum())
    if total * disc.radius**2 < LEAST_PIXELS:
        return None
    middle = area @ disc.normal[own]
    angle = math.acos(max(1 - total / (2 * math.pi), -1.0))
    return _Blob(number, colour, middle / math.sqrt(middle @ middle), angle)


def _share(other: Array, colour: Array) -> Array:
    """The share of a mark's colour; what lies between is an edge, symmetric about a half."""
    share = (other @ colour / (colour @ colour) - DARK) / (LIGHT - DARK)
    return np.asarray(np.minimum(np.maximum(share, 0.0), 1.0))


def _near(
    disc: _Disc, other: Array, label: NDArray[np.int32], blob: _Blob, noise: float
) -> tuple[NDArray[np.int64], Array, float]:
    """Pixels about a blob that are no other's (q,), their shares of its colour (q,), and the noise of these."""
    reach = math.cos(min(blob.angle + NEAR, 1.5))
    near = np.flatnonzero((disc.normal @ blob.middle > reach) & ((label == 0) | (label == blob.number)))
    return near, _share(other[near], blob.colour), max(noise / math.sqrt(blob.colour @ blob.colour), 0.03)


def _circles(
    disc: _Disc, near: list[tuple[NDArray[np.int64], Array, float]], middle: Array, angle: Array, typical: float | None
) -> tuple[Array, Array, Array]:
    """Fit circles on the sphere to the shares of pixels: middles (k, 3), sds (k, 2), half widths (k,) [rad]."""
    count, most = len(near), max(len(index) for index, *_ in near)
    index, seen, believed = np.zeros((count, most), np.int64), np.zeros((count, most)), np.zeros((count, most))
    for k, (own, share, spread) in enumerate(near):
        index[k, : len(own)], seen[k, : len(own)], believed[k, : len(own)] = own, share, 1 / spread**2
    normal = disc.normal[index]  # (k, q, 3)
    flat = normal @ disc.axes[:2].T / disc.facing[index][..., None]  # (k, q, 2)
    # Half a width that cannot be seen well is taken from the other marks.
    guess, loose = (angle, 0.5) if typical is None else (np.full(count, typical), 0.1)
    x, y, sight = disc.axes
    change = np.empty((count, most, 3))
    for step in range(STEPS):
        first = x - (middle @ x)[:, None] * middle
        first /= np.sqrt(np.sum(first**2, axis=1))[:, None]
        second = y - (middle @ y)[:, None] * middle - (first @ y)[:, None] * first
        second /= np.sqrt(np.sum(second**2, axis=1))[:, None]
        turned = normal @ np.stack([middle, first, second], axis=2)  # (k, q, 3)
        # How fast n . m changes from pixel to pixel turns angles into distances in the picture.
        slope = (middle @ disc.axes[:2].T)[:, None] - flat * (middle @ sight)[:, None, None]
        steep = disc.radius / (2 * SOFT) / (np.sqrt(slope[..., 0] ** 2 + slope[..., 1] ** 2) + 1e-9)
        edge = (turned[..., 0] - np.cos(angle)[:, None]) * steep
        rest = seen - np.minimum(np.maximum(0.5 + edge, 0.0), 1.0)
        steep[np.abs(edge) > 0.75] = 0.0
        change[..., 0], change[..., 1] = turned[..., 1] * steep, turned[..., 2] * steep
        change[..., 2] = np.sin(angle)[:, None] * steep
        trust = believed if step < 2 else believed / (1.0 + (rest / 0.3) ** 2) ** 2
        weighted = (change * trust[..., None]).transpose(0, 2, 1)
        normal_equations = weighted @ change + np.diag([1.0, 1.0, 1.0 + 1 / loose**2])
        pull = (weighted @ rest[..., None])[..., 0]
        pull[:, 2] += (guess - angle) / loose**2
        inverse = np.linalg.inv(normal_equations)
        move = np.clip((inverse @ pull[..., None])[..., 0], -0.1, 0.1)
        middle = middle + move[:, :1] * first + move[:, 1:2] * second
        middle /= np.sqrt(np.sum(middle**2, axis=1))[:, None]
        angle = np.clip(angle + move[:, 2], 0.03, 1.5)
        if np.abs(move).max() < SETTLED:
            break
    cosine = np.clip(middle @ sight, 0.1, 1.0)
    outward = ways(middle, sight)[1]
    part = np.stack([np.sum(first * outward, axis=1), np.sum(second * outward, axis=1)], axis=1)
    both = inverse[:, :2, :2]
    along = np.einsum("ki,kij,kj->k", part, both, part)
    across = np.trace(both, axis1=1, axis2=2) - along
    shy = SHY / disc.radius
    hidden = np.maximum(np.arccos(cosine) + angle - math.asin(1 - RIM / disc.radius), 0.0)
    along = along + (shy / cosine) ** 2 + (CUT * hidden) ** 2
    return middle, np.sqrt(np.stack([across + shy**2, along], axis=1)), angle


def ways(place: Array, sight: Array) -> tuple[Array, Array]:
    """Directions (k, 3) on the sphere across the way to the middle of the visible face, and along it."""
    axis = sight + 1e-6 * np.array([0.3, 0.5, 0.8])
    x, y, z = place.T
    across = np.stack([axis[1] * z - axis[2] * y, axis[2] * x - axis[0] * z, axis[0] * y - axis[1] * x], axis=1)
    across /= np.sqrt(np.sum(across**2, axis=1))[:, None] + 1e-12
    along = axis - (place @ axis)[:, None] * place
    return across, along / (np.sqrt(np.sum(along**2, axis=1))[:, None] + 1e-12)


def triad(one: Array, two: Array) -> Array:
    """Axes (3, 3), columns, of a pair of directions, both treated alike."""
    first, second = one + two, one - two
    first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
    return np.column_stack([first, second, np.cross(first, second)])


def spacing(place: Array) -> float:
    """Smallest angle between directions (k, 3) [rad]; half a turn for a single one."""
    return math.acos(min(max(float((place @ place.T - 3 * np.eye(len(place))).max()), -1.0), 1.0))


def choose_marks(seen: Sequence[Spots], radius: float) -> list[Marks]:
    """The marks that count: without highlights, and for places of the ball that agree with their neighbours."""
    area: dict[bool, float] = {True: 0.0, False: 0.0}
    for s in seen:
        for kind in area:
            area[kind] += float(np.sum(s.angle[s.trusted & (s.bright == kind)] ** 2))
    light = area[False] < 0.3 * area[True]  # the marks are lighter than the ball
    lamps = _highlights(seen) if light else None
    frames: list[Marks] = []
    for s, xy in zip(seen, _smooth(seen), strict=True):
        use = s.trusted & (s.bright == light) & (s.angle < WIDEST)
        if light:
            use &= False if lamps is None else np.all(s.place @ lamps.T < np.cos(s.angle + GLARE)[:, None], axis=1)
        place = s.place[use]
        # The same pixels, on a ball elsewhere: along the line of sight, as far as the sphere asks.
        shift = np.array([*(xy - s.xy), 0.0])
        place = place - (shift - (place @ shift / (place @ s.sight))[:, None] * s.sight) / radius
        place /= np.linalg.norm(place, axis=1, keepdims=True)
        frames.append(Marks(s.time, xy, s.sight, place, s.sd[use], s.place[s.trusted & ~use]))
    return frames


def _highlights(seen: Sequence[Spots]) -> Array | None:
    """Where lamps are mirrored (m, 3): there is always something bright, while marks move; None if nothing moves."""
    bright = [s.bright & s.trusted for s in seen]
    place = [s.place[b] for s, b in zip(seen, bright, strict=True)]
    angle = [s.angle[b] for s, b in zip(seen, bright, strict=True)]
    near = math.cos(GLARE)
    moving = [
        k
        for k in range(LAG, len(seen))
        if len(place[k]) and (len(place[k - LAG]) == 0 or ((place[k] @ place[k - LAG].T).max(axis=1) < near).any())
    ]
    if len(moving) < LAG:
        return None
    candidates, size = np.concatenate([place[k] for k in moving]), np.concatenate([angle[k] for k in moving])
    small = size < 0.7 * np.median(size[size > 0.5 * size.max()])
    lamps = []
    while len(candidates):
        cosines = [place[k] @ candidates.T for k in moving]
        there = sum((c > near).any(axis=0) for c in cosines)
        # A mark that passes hides a highlight, or melts with it.
        filled = sum((c > np.cos(angle[k] + GLARE)[:, None]).any(axis=0) for k, c in zip(moving, cosines, strict=True))
        share = np.where(small & (there > 0.3 * len(moving)), 1.0, filled / len(moving)) * (there > 2)
        best = int(np.argmax(share + 1e-3 * there))
        if share[best] < 0.8:
            break
        lamps.append(candidates[best])
        other = candidates @ candidates[best] < near
        candidates, small = candidates[other], small[other]
    return np.array(lamps).reshape(-1, 3)


def _smooth(seen: Sequence[Spots]) -> Array:
    """Places of the ball (n, 2) [m], on a straight line through their neighbours where these agree with one."""
    time, xy = np.array([s.time for s in seen]), np.array([s.xy for s in seen]).reshape(-1, 2)
    n, out = len(seen), xy.copy()
    if n < 2 * BESIDE + 1:
        return out
    noise = float(np.nanmedian(np.abs(np.diff(xy, 3, axis=0)))) / 0.6745 / math.sqrt(20)
    for k in range(n):
        low = min(max(k - BESIDE, 0), n - 2 * BESIDE - 1)
        part = slice(low, low + 2 * BESIDE + 1)
        basis = np.column_stack([np.ones(2 * BESIDE + 1), time[part] - time[k]])
        if not np.isfinite(xy[part]).all():
            continue
        line = np.linalg.solve(basis.T @ basis, basis.T @ xy[part])
        off = float(np.sqrt(np.sum((xy[part] - basis @ line) ** 2) / (4 * BESIDE - 2)))
        if off < 1.5 * noise:
            out[k] = line[0]
    return out
