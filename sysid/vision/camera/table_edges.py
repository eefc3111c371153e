"""The edges along a table's sides: which of them is the cushions' nose, and where it runs to a fraction of a pixel.

The noses hide what lies behind them, so the end of the visible bed is the image of the nose line, at the height of the
noses. Beside it there may be the cushion's outer edge (cloth against wood, about 5 cm on), the shadow of a cushion on
the bed, a dark gap under the nose, lines projected on the cloth. Each side is looked at in a strip laid along it in
table coordinates, in which what is parallel to the side stands upright; averages along it then show weak edges too.
Projected light only adds: an opening across the strip takes thin bright lines away and leaves steps where they are.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, grey_opening
from scipy.signal import find_peaks

from models.shot import NOSE_HEIGHT, POCKET_MOUTH
from sysid.vision.camera.projection import Array, Camera

Picture = NDArray[np.float32]
INWARD, OUTWARD = 0.11, 0.05  # how far from the cloth's outline edges are looked for [m]
THIN = 0.012  # bright lines narrower than that are taken away [m]
BAND = 0.025  # widest dark gap under a nose [m]
BLOCKS = 60  # along a side, for telling edges apart
PARTS = 6  # of a side, in each of which an edge may be brighter or darker
LAST = 0.008  # edges nearer to the cloth's outline than that are its own [m]
SURE = 6.0  # standard errors an edge must stand out by
FAINT = 1.0  # and grey levels
LONGEST = 8000  # strip [pixels]
MOST = 300  # edge points of a side
FINE = 0.25  # of a pixel across an edge
CLEAR = 8.0  # step of an edge point, in standard errors
CORNER, MIDDLE, BARE = 1.4, 1.0, 0.03  # left out at pockets [pocket mouths], and at corners without [m]


@dataclass(frozen=True)
class Strip:
    """The picture along one side of the table."""

    colours: Array  # (n, m, 3) along the side, across it
    along: Array  # (n,) place along the side [m]
    across: Array  # (m,) out of the table from where the nose should be [m]
    pixel: float  # size of a pixel there [m]


@dataclass(frozen=True)
class Edge:
    """A step that runs along a side."""

    offset: float  # out of the table from where the nose should be [m]
    places: Array  # (PARTS,) middles of the parts of the side [m]
    steps: Array  # (PARTS, 3) from inside to outside in each of them [grey levels]

    @property
    def strength(self) -> float:
        """Usual size of the step [grey levels]."""
        return float(np.median(np.linalg.norm(self.steps, axis=1)))

    @property
    def rises(self) -> bool:
        """Whether it is brighter outside."""
        return bool(self.steps.sum() > 0)


def nose_points(camera: Camera, rail: int, along: Array, across: Array) -> Array:
    """Points at the height of the noses, place (n,) along a rail and (n,) [m] outwards of its nose: (n, 3) [m]."""
    axis, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    half = (camera.table.length, camera.table.width)[axis] / 2
    out = np.empty((len(along), 3))
    out[:, axis], out[:, 1 - axis], out[:, 2] = sign * (half + across), along, NOSE_HEIGHT * camera.radius
    return out


def strip(picture: Picture, camera: Camera, rail: int, low: float, high: float, fine: float = 0.5) -> Strip | None:
    """The picture along a rail, from low to high [m] out of its nose, every `fine` pixels across; None if not in view.

    Pockets are left out, as is what lies outside the picture.
    """
    half = (camera.table.length, camera.table.width)[1 - rail // 2] / 2
    ends = half - (CORNER * POCKET_MOUTH if camera.table.pockets else BARE)
    coarse = np.linspace(-ends, ends, 400)
    coarse = coarse[_visible(camera, rail, coarse, low, high)]
    if len(coarse) < 20:
        return None
    pixels = camera.project(nose_points(camera, rail, coarse, np.zeros(len(coarse))))
    size = float(np.median(np.diff(coarse)) / np.median(np.linalg.norm(np.diff(pixels, axis=0), axis=1)))
    if not max(coarse[-1] - coarse[0], (high - low) / fine) < LONGEST * size:  # no camera over a table sees it so
        return None
    along = np.arange(coarse[0], coarse[-1], size)
    along = along[_visible(camera, rail, along, low, high)]
    if camera.table.pockets and rail >= 2:
        along = along[np.abs(along) > MIDDLE * POCKET_MOUTH]
    if len(along) < 4 * PARTS:
        return None
    across = np.arange(low, high, fine * size)
    a, u = (v.ravel() for v in np.meshgrid(along, across, indexing="ij"))
    places = camera.project(nose_points(camera, rail, a, u)).astype(np.float32)
    shape = (len(along), len(across))
    seen = cv2.remap(
        picture, places[:, 0].reshape(shape), places[:, 1].reshape(shape), cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE
    )
    return Strip(np.asarray(seen, float), along, across, size)


def _visible(camera: Camera, rail: int, along: Array, low: float, high: float) -> NDArray[np.bool_]:
    """Which places (n,) along a rail lie in the picture, with the strip around them."""
    good = np.ones(len(along), bool)
    for across in (low, high):
        points = nose_points(camera, rail, along, np.full(len(along), across))
        pixels = camera.project(points)
        good &= ((pixels > 1) & (pixels < np.array(camera.size) - 2)).all(axis=1)
        # Far outside the picture the distortion's polynomial folds back into it.
        back = camera.on_plane(np.where(good[:, None], pixels, 0.0), float(points[0, 2]) if len(points) else 0.0)
        good &= np.linalg.norm(np.nan_to_num(back, nan=1e3) - points[:, :2], axis=1) < 1e-3
    return good


def edges(seen: Strip) -> list[Edge]:
    """Steps that run along a whole side, from the inside out; they may be brighter here and darker there."""
    blocks = np.array_split(seen.colours, min(BLOCKS, max(PARTS * 2, len(seen.along) // 4)))
    step = float(seen.across[1] - seen.across[0])
    rows = gaussian_filter1d(np.stack([b.mean(axis=0) for b in blocks]), 0.7 * seen.pixel / step, axis=1)
    thin = max(3, int(np.clip(8 * seen.pixel, THIN, 2 * THIN) / step))
    rows = grey_opening(rows, (1, thin, 1))
    half = max(2, int(np.ceil(0.003 / step)))
    rise = rows[:, 2 * half :] - rows[:, : -2 * half]
    parts = np.array_split(rise, PARTS)
    usual = np.stack([np.median(part, axis=0) for part in parts])  # (parts, m, 3)
    size = np.linalg.norm(usual, axis=2)
    strength = np.median(size, axis=0)
    scatter = 1.4826 * np.median(np.abs(rise - np.repeat(usual, [len(p) for p in parts], axis=0)), axis=0)
    error = np.maximum(np.linalg.norm(scatter, axis=1) / np.sqrt(len(blocks) / PARTS), 0.02)
    seen_in = (size > 3 * error).mean(axis=0)
    peaks, _ = find_peaks(strength, height=FAINT, prominence=0.5 * FAINT)
    places = np.array([part.mean() for part in np.array_split(seen.along, PARTS)])
    return [
        Edge(float(seen.across[k + half]), places, usual[:, k])
        for k in peaks
        if strength[k] > SURE / np.sqrt(PARTS) * error[k] and seen_in[k] > 0.5
    ]


def choose(
    found: Mapping[int, Sequence[Edge]], outline: float, lengths: tuple[float, float], aspect_sd: float
) -> dict[int, Edge]:
    """The noses among the edges of each rail; a rail is left out where only its other edges are seen.

    The cushions of a table are alike, so noses lie equally far inside the cloth's outline; the bed between them has
    the known aspect; the outline itself is the last to be taken; and where a dark gap lies under the nose, the nose is
    its outer edge, since it hides what is behind.

    Args:
        found: edges by rail.
        outline: of the cloth, where it lies out of the nominal noses [m].
        lengths: of the table, nose to nose: along x and y [m].
        aspect_sd: how well the aspect of what the picture shows is known [fraction].
    """
    options: list[list[tuple[Edge | None, float]]] = []
    for rail in found:
        strongest = max((e.strength for e in found[rail] if e.offset < outline - LAST), default=0.0)
        rated: list[tuple[Edge | None, float]] = []
        for edge in found[rail]:
            last = edge.offset > outline - LAST
            gap = any(e.rises and 0 < e.offset - edge.offset < BAND and e.offset < outline - LAST for e in found[rail])
            weak = 0.0 if last else 1.0 - edge.strength / strongest
            rated.append((edge, weak + 4.0 * (gap and not edge.rises) + 1.5 * (last and strongest > 0)))
        rated = sorted(rated, key=lambda pair: pair[1])[:4]
        options.append([*rated, (None, 9.0 if len(found) == 4 else 30.0)])
    rails, best, least = list(found), {}, np.inf
    for combination in itertools.product(*options):
        taken = {rail: edge for rail, (edge, _) in zip(rails, combination, strict=True) if edge is not None}
        if len(taken) < 3:
            continue
        inward = np.array([outline - edge.offset for edge in taken.values()])
        if len(taken) < len(found) and inward.mean() < LAST:
            continue
        cost = sum(c for _, c in combination) + float(np.sum((inward - inward.mean()) ** 2)) / 0.004**2
        if len(taken) == 4:
            x = lengths[0] + taken[0].offset + taken[1].offset
            y = lengths[1] + taken[2].offset + taken[3].offset
            cost += (np.log((x / y) / (lengths[0] / lengths[1])) / aspect_sd) ** 2
        if cost < least:
            best, least = taken, cost
    return best


def edge_points(picture: Picture, camera: Camera, rail: int, edge: Edge, reach: float) -> Array:
    """Points of an edge along a rail, within `reach` pixels of its offset from the nose: (n, 2) [pixels].

    Where the colour changes fastest, in blocks long enough for the step to stand out of the noise. What lies beside the
    edge, a dark gap or the light falling off, does not shift that place, as it would a threshold halfway.
    """
    rough = strip(picture, camera, rail, edge.offset - 1e-3, edge.offset + 1e-3)
    if rough is None:
        return np.zeros((0, 2))
    margin = (reach + 4) * rough.pixel
    seen = strip(picture, camera, rail, edge.offset - margin, edge.offset + margin, FINE)
    if seen is None:
        return np.zeros((0, 2))
    part = np.argmin(np.abs(seen.along[:, None] - edge.places), axis=1)
    sizes = np.linalg.norm(edge.steps, axis=1)
    ways = edge.steps / np.maximum(sizes, 1e-9)[:, None]
    level = np.einsum("nmc,nc->nm", seen.colours, ways[part])  # rising outwards
    noise = 1.4826 * float(np.median(np.abs(np.diff(level, axis=0)))) / np.sqrt(2)
    block = int(np.clip((CLEAR * noise / edge.strength) ** 2, 4, max(4, len(seen.along) // 12)))
    count = int(np.clip(len(seen.along) // block, 1, MOST))
    rows = np.stack([v.mean(axis=0) for v in np.array_split(level, count)])
    places, size = (np.array([v.mean() for v in np.array_split(w, count)]) for w in (seen.along, sizes[part]))
    slope = gaussian_filter1d(rows, 1.0 / FINE, axis=1, order=1) / FINE  # [grey levels per pixel]
    across = (seen.across - edge.offset) / seen.pixel
    within = np.where(np.abs(across) <= reach, slope, -np.inf)
    at, k = np.argmax(within, axis=1), np.arange(count)
    at = np.clip(at, 1, len(across) - 2)
    before, here, after = slope[k, at - 1], slope[k, at], slope[k, at + 1]
    # A peak, not the flank of something outside, and as steep as the step that is expected, blurred; where that is far
    # stronger than elsewhere, balls lie along the side.
    usual = (size > 0.3 * edge.strength) & (size < 3.0 * edge.strength)
    good = (here >= before) & (here >= after) & (here > 0.12 * size) & usual
    bend = np.where(good, before - 2 * here + after, -1.0)
    where = across[at] + np.where(good, 0.5 * (before - after) / np.minimum(bend, -1e-12), 0.0) * FINE
    return camera.project(nose_points(camera, rail, places[good], edge.offset + where[good] * seen.pixel))
