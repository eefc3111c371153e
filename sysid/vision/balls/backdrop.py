"""The table without its balls, the outlines balls would have on it, and where a picture differs from it as balls do.

The bed's colour is a smooth surface over the picture, fitted to what most pixels show; the backdrop is what every pixel
shows most of the time, mended with that surface (on a cushion with the cushion beside it) where a ball rests all along.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from models.shot import NOSE_HEIGHT
from sysid.vision.camera.projection import OUTLINE, Camera
from sysid.vision.frames import Picture

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

RAYS = 64  # directions in which an outline is looked at
COARSE = 8  # pixels between the nodes of what is smooth over the picture
STEP = 32  # pixels between places whose outlines are known
DEGREE = 4  # of the surface that is the bed's colour
MENDED, AROUND = 1.35, 2.2  # radii up to which a ball is painted over, and to which the cloth beside it is looked at
ASIDE = 3.0  # ball radii to the part of a cushion that stands in for a hidden one
PROBES = 600  # pixels that tell the light of a frame
QUIETEST = 0.5  # noise of a picture, at least [grey levels]
CELLS = 5.0  # radius of the smallest outline in the coarse picture [cells]
PEAK, MOST = 0.2, 48  # part of the votes for a clean outline that makes a candidate; candidates in a picture
NOISY, OFF = (
    2.5,
    0.06,
)  # departures that count: above so many times the noise, and so great a part of the table's colour
SPAN, DARK = 3.0, 0.55  # window about a smeared ball [radii]; what a shadow leaves of the light
SHORTEST, LONGEST = 0.15, 3.0  # smears [radii]
UNLIKE, ALIKE = 0.25, 0.2  # parts by which a smeared ball's variances may differ from a stadium's, and their ratio


@dataclass(frozen=True)
class Scene:
    """What the camera's geometry says of the picture."""

    camera: Camera
    bed: Mask  # (h, w) pixels that show the bed
    beyond: Mask  # (h, w) pixels whose line of sight passes over the nose line at its height
    region: Mask  # (h, w) pixels that a ball on the table can cover
    home: Mask  # (h, w) pixels where the centre of a ball's outline can be
    box: tuple[int, int, int, int]  # columns and rows x0, x1, y0, y1 that hold the region
    outlines: Array  # (rows, columns, RAYS, 5): from a centre to its outline, normal to it [pixels], height [m]

    def outline(self, pixel: Array) -> tuple[Array, Array, Array]:
        """Outline of a ball centred at a pixel (2,): offsets (RAYS, 2), normals (RAYS, 2), heights (RAYS,) [m]."""
        rows, columns = self.outlines.shape[:2]
        u, v = np.clip(pixel[0] / STEP, 0, columns - 1.001), np.clip(pixel[1] / STEP, 0, rows - 1.001)
        i, j = int(u), int(v)
        u, v = u - i, v - j
        near = self.outlines[j : j + 2, i : i + 2]
        shape = (1 - v) * ((1 - u) * near[0, 0] + u * near[0, 1]) + v * ((1 - u) * near[1, 0] + u * near[1, 1])
        return shape[:, :2], shape[:, 2:4], shape[:, 4]

    def radius(self, pixel: Array) -> float:
        """Mean radius of the outline of a ball centred at a pixel (2,) [pixels]."""
        return float(np.linalg.norm(self.outline(pixel)[0], axis=1).mean())


@dataclass(frozen=True)
class Grid:
    """The coarse picture in which outlines are looked for."""

    cell: int  # pixels along the side of a cell
    corner: Array  # (2,) column and row of its first pixel
    table: Image  # (rows, columns, 3) the empty table
    region: Mask  # (rows, columns, 1) where balls can be
    home: Mask  # (rows, columns) where their centres can be
    radius: Image  # (rows, columns) of outlines [cells]
    full: float  # votes for a clean outline


@dataclass(frozen=True)
class View:
    """A picture against the empty table."""

    scene: Scene
    picture: Picture  # (h, w, 3)
    table: Image  # (h, w, 3) the empty table
    gain: Array  # (3,) brightness of the picture over the table's
    noise: float  # one standard deviation [grey levels]
    grid: Grid

    def part(self, middle: Array, reach: float) -> tuple[Image, Image, Array]:
        """Picture and table (rows, columns, 3) within a reach of a pixel (2,), and column and row of the first (2,)."""
        x0, y0 = (max(0, int(v - reach)) for v in middle)
        x1, y1 = (max(0, int(v + reach) + 2) for v in middle)
        part = self.picture[y0:y1, x0:x1].astype(np.float32)
        return part, self.table[y0:y1, x0:x1] * self.gain.astype(np.float32), np.array([x0, y0])

    def filled(self, middle: Array, radius: float) -> float:
        """Part of a disc about a pixel (2,) that is not as the empty table is."""
        part, table, corner = self.part(middle, radius)
        y, x = np.ogrid[: part.shape[0], : part.shape[1]]
        disc = (x + corner[0] - middle[0]) ** 2 + (y + corner[1] - middle[1]) ** 2 < radius**2
        return float(_differs(np.abs(part - table), table, self.noise)[disc].mean()) if disc.any() else 0.0


@dataclass(frozen=True)
class Backdrop:
    """The empty table, its light, and the noise of pictures of it."""

    scene: Scene
    picture: Image  # (h, w, 3) blue, green, red [grey levels]
    light: Image  # (h, w, 3) brightness of the light, 1 in the middle
    probes: tuple[NDArray[np.intp], NDArray[np.intp]]  # rows and columns of pixels that tell the light of a frame
    grid: Grid
    noise: float = QUIETEST  # one standard deviation [grey levels]

    def view(self, picture: Picture) -> View:
        """A picture against this table, in its own light."""
        ratio = picture[self.probes] / np.maximum(self.picture[self.probes], 1.0)
        return View(
            self.scene, picture, self.picture, np.asarray(np.median(ratio, axis=0), float), self.noise, self.grid
        )

    def lamp(self, view: View, pixel: Array) -> Array:
        """Blue, green, red of the light of a picture at a pixel (2,), 1 in the middle of the table: (3,)."""
        h, w = self.light.shape[:2]
        return np.asarray(self.light[min(max(int(pixel[1]), 0), h - 1), min(max(int(pixel[0]), 0), w - 1)] * view.gain)


def scene_of(camera: Camera) -> Scene:
    """Where bed, cushions and balls can be in the picture."""
    nose, radius = NOSE_HEIGHT * camera.radius, camera.radius
    half = np.array([camera.table.length, camera.table.width], np.float32) / 2
    low, high, middle = (_plane(camera, z) for z in (0.0, nose, radius))
    beyond = np.asarray((np.abs(high) > half).any(axis=2))
    bed = np.asarray((np.abs(low) < half).all(axis=2) & ~beyond)
    region = np.asarray((np.abs(middle) < half + radius).all(axis=2))
    home = np.asarray((np.abs(middle) < half - radius / 2).all(axis=2))
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    box = (int(columns[0]), int(columns[-1]) + 1, int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 0, 0, 0)
    return Scene(camera, bed, beyond, region, home, box, _outlines(camera))


def _plane(camera: Camera, height: float) -> Image:
    """Where every pixel meets a plane: (h, w, 2) [m]; far away where it does not."""
    w, h = camera.size
    columns, rows = np.arange(0, w + COARSE, COARSE), np.arange(0, h + COARSE, COARSE)
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(float)
    far = np.nan_to_num(camera.on_plane(nodes, height), nan=1e3).clip(-1e3, 1e3)
    grid = far.reshape(len(rows), len(columns), 2).astype(np.float32)
    x, y = np.meshgrid(np.arange(w, dtype=np.float32) / COARSE, np.arange(h, dtype=np.float32) / COARSE)
    return np.asarray(cv2.remap(grid, x, y, cv2.INTER_LINEAR))


def _outlines(camera: Camera) -> Array:
    w, h = camera.size
    columns, rows = np.arange(0, w + 2 * STEP, STEP), np.arange(0, h + 2 * STEP, STEP)
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(float)
    reach = 2.0 * np.array([camera.table.length, camera.table.width])
    places = np.clip(np.nan_to_num(camera.centres(nodes), nan=1e3), -reach, reach)
    rims = camera.rims(places)
    ray, centre = camera.rays(rims.reshape(-1, 2)), np.column_stack([places, np.full(len(places), camera.radius)])
    sight = np.repeat(centre - camera.eye, OUTLINE, axis=0)
    heights = (camera.eye[2] + np.sum(ray * sight, axis=1) * ray[:, 2]).reshape(-1, OUTLINE)
    # Fourier series through the points, which lie evenly on the circle where the sphere is touched.
    order = np.fft.fftfreq(OUTLINE, 1 / OUTLINE)
    turn = np.exp(2j * np.pi * np.outer(np.arange(RAYS) / RAYS, order))
    apart = np.exp(-2j * np.pi * np.outer(order, np.arange(OUTLINE) / OUTLINE)) / OUTLINE
    at, along = (turn @ apart).real, ((turn * (1j * order * (np.abs(order) < OUTLINE / 2))) @ apart).real
    rims = rims - rims.mean(axis=1, keepdims=True)
    offsets, tangents = at @ rims, along @ rims
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals *= np.sign(np.sum(normals * offsets, axis=-1, keepdims=True))
    shape = np.concatenate([offsets, normals, (at @ heights[..., None])], axis=-1)
    return np.asarray(shape.reshape(len(rows), len(columns), RAYS, 5))


def _usual(pictures: Sequence[Picture], box: tuple[int, int, int, int]) -> Image:
    """What every pixel shows most of the time: (h, w, 3); the mean of what lies near its median, 0 outside the box."""
    x0, x1, y0, y1 = box
    out = np.zeros(pictures[0].shape, np.float32)
    strip = max(1, 4_000_000 // max(1, len(pictures) * (x1 - x0) * 3))
    for y in range(y0, y1, strip):
        stack = np.stack([p[y : min(y + strip, y1), x0:x1] for p in pictures], axis=-1)
        middle = np.partition(stack, len(pictures) // 2, axis=-1)[..., len(pictures) // 2, None].astype(np.int16)
        spread = np.abs(stack.astype(np.int16) - middle)
        near = spread <= 3 * np.maximum(np.median(spread, axis=(0, 1, 2)).max(), 2)
        out[y : y + stack.shape[0], x0:x1] = (stack * near).sum(axis=-1, dtype=np.float32) / near.sum(axis=-1)
    return out


def _bed_colour(scene: Scene, picture: Image) -> Image:
    """The smooth surface (h, w, 3) that is the bed's colour, fitted to most of its pixels."""
    h, w = scene.bed.shape
    rows, columns = (v[:: max(1, len(v) // 20000)] for v in np.nonzero(scene.bed))
    terms, seen = _terms(columns, rows, (w, h)), picture[rows, columns].astype(float)
    weight = np.ones(len(rows))
    start = np.median(seen, axis=0)
    off = np.abs(seen - start).max(axis=1)
    weight = (off < 4 * np.median(off)).astype(float)
    for _ in range(8):
        factors = np.linalg.lstsq(terms * weight[:, None], seen * weight[:, None], rcond=None)[0]
        off = np.abs(seen - terms @ factors).max(axis=1)
        weight = np.maximum(0.0, 1 - (off / (6 * max(float(np.median(off)), 0.5))) ** 2)
    nodes_x, nodes_y = np.arange(0, w + COARSE, COARSE), np.arange(0, h + COARSE, COARSE)
    across, down = np.meshgrid(nodes_x, nodes_y)
    grid = (_terms(across.ravel(), down.ravel(), (w, h)) @ factors).reshape(len(nodes_y), len(nodes_x), 3)
    x, y = np.meshgrid(np.arange(w, dtype=np.float32) / COARSE, np.arange(h, dtype=np.float32) / COARSE)
    return np.asarray(cv2.remap(np.maximum(grid, 1.0).astype(np.float32), x, y, cv2.INTER_LINEAR))


def _terms(columns: NDArray[np.intp], rows: NDArray[np.intp], size: tuple[int, int]) -> Array:
    u, v = 2 * columns / size[0] - 1, 2 * rows / size[1] - 1
    return np.stack([u**i * v**j for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)], axis=1)


def _mended(scene: Scene, picture: Image, smooth: Image, balls: Sequence[Array]) -> Image:
    """The picture with balls centred at these pixels painted over: the bed's colour, or the cushion beside."""
    out = picture.copy()
    h, w = scene.bed.shape
    for centre in balls:
        radius = scene.radius(centre)
        far = AROUND * radius
        x0, y0 = (max(0, int(v - far)) for v in centre)
        x1, y1 = min(w, int(centre[0] + far) + 2), min(h, int(centre[1] + far) + 2)
        across, down = np.meshgrid(np.arange(x0, x1), np.arange(y0, y1))
        away = np.hypot(across - centre[0], down - centre[1]) / radius
        bed = scene.bed[y0:y1, x0:x1]
        beside = bed & (away > MENDED)
        patch, model = out[y0:y1, x0:x1], smooth[y0:y1, x0:x1]
        offset = np.median((patch - model)[beside], axis=0) if beside.sum() > 20 else np.zeros(3)
        under = away < MENDED
        patch[under & bed] = (model + offset)[under & bed]
        rows, columns = np.nonzero(under & ~bed)
        if len(rows):
            patch[rows, columns] = _cushion(scene, picture, smooth, columns + x0, rows + y0)
    return out


def _cushion(
    scene: Scene, picture: Image, smooth: Image, columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[np.float32]:
    """What cushions show at pixels (n,), by the same cushion to either side, in the light of the place: (n, 3)."""
    camera = scene.camera
    nose, half = NOSE_HEIGHT * camera.radius, np.array([camera.table.length, camera.table.width]) / 2
    place = camera.on_plane(np.stack([columns, rows], axis=1).astype(float), nose)
    along = np.where((np.abs(place) - half)[:, 0] > (np.abs(place) - half)[:, 1], 1, 0)
    total, count = np.zeros((len(rows), 3)), np.zeros((len(rows), 1))
    h, w = scene.bed.shape
    for side in (-1.0, 1.0):
        other = place.copy()
        other[np.arange(len(other)), along] += side * ASIDE * camera.radius
        on = np.abs(other[np.arange(len(other)), along]) < half[along]
        at = np.rint(camera.project(np.column_stack([other, np.full(len(other), nose)]))).astype(int)
        on &= (at >= 0).all(axis=1) & (at[:, 0] < w) & (at[:, 1] < h)
        at[~on] = 0
        light = smooth[rows, columns] / smooth[at[:, 1], at[:, 0]]
        total += np.where(on[:, None], picture[at[:, 1], at[:, 0]] * light, 0.0)
        count += on[:, None]
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), picture[rows, columns]), np.float32)


def _backdrop(scene: Scene, picture: Image, smooth: Image, pictures: Sequence[Picture]) -> Backdrop:
    """The backdrop that this picture of the empty table is, in the light that the bed's colour shows."""
    rows, columns = np.nonzero(scene.bed)
    step = max(1, len(rows) // PROBES)
    light = np.clip(smooth / np.median(smooth[scene.bed], axis=0), 0.2, 5.0).astype(np.float32)
    bare = Backdrop(scene, picture, light, (rows[::step], columns[::step]), _grid(scene, picture))
    off = [p[bare.probes] - picture[bare.probes] * bare.view(p).gain for p in pictures]
    # The mean of n pictures goes along with each of them.
    spread = 1.4826 * float(np.median(np.abs(off))) * (len(off) / max(len(off) - 1, 1)) ** 0.5
    return replace(bare, noise=max(spread, QUIETEST))


def empty_table(
    scene: Scene, pictures: Sequence[Picture], find: Callable[[View], Sequence[Array]]
) -> tuple[Backdrop, int]:
    """The empty table by pictures with balls on it, and how many of these rest all along.

    `find` gives the pixels (2,) on which balls are centred.
    """
    middle = _usual(pictures, scene.box)
    smooth = _bed_colour(scene, middle)
    noise = _backdrop(scene, middle, smooth, pictures).noise / len(pictures) ** 0.5
    # What rests all along shows against the bed's own colour.
    bed = np.where(scene.bed[..., None], smooth, middle).astype(np.float32)
    still = np.rint(middle).clip(0, 255).astype(np.uint8)
    resting = find(View(scene, still, bed, np.ones(3), max(noise, QUIETEST), _grid(scene, bed)))
    return _backdrop(scene, _mended(scene, middle, smooth, resting), smooth, pictures), len(resting)


def _differs(off: Image, table: Image, noise: float) -> Mask:
    """Where departures (rows, columns, 3) from the table are neither noise nor unevenness."""
    return np.asarray(off.max(axis=2) > np.maximum(NOISY * noise, OFF * table.max(axis=2)))


def smeared(view: View, place: Array) -> tuple[Array, Array, bool] | None:
    """What lies about a pixel (2,) as a ball that moves: its middle (2,) and its way during the exposure (2,) [pixels].

    Also whether it is as long for its width as that makes it; None if it is no disc drawn out in a line.
    """
    radius = view.scene.radius(place)
    part, table, corner = view.part(place, SPAN * radius)
    if min(part.shape[:2]) < 3:
        return None
    # Shadows apart: they are the table's colour, darker.
    share = ((part * table).sum(axis=2) / np.maximum((table * table).sum(axis=2), 1.0)).clip(DARK, 1.1)
    off = np.abs(cv2.GaussianBlur(part - share[..., None] * table, (0, 0), 0.7))
    some = _differs(off, table, view.noise).astype(np.uint8)
    _, labels, stats, middles = cv2.connectedComponentsWithStats(some)
    near = [k for k in range(1, len(stats)) if stats[k, cv2.CC_STAT_AREA] > 0.8 * np.pi * radius**2]
    if not near:
        return None
    k = min(near, key=lambda k: float(np.hypot(*(middles[k] + corner - place))))
    y, x = np.nonzero(labels == k)
    disc = np.pi * radius**2
    long = (len(x) - disc) / (2 * radius)
    (thin, wide), axes = np.linalg.eigh(np.cov(x, y))
    box, ends = 2 * radius * long, 4 * radius**3 * long / 3
    across = (disc * radius**2 / 4 + box * radius**2 / 3) / len(x)
    along = (disc * (radius**2 + long**2) / 4 + box * long**2 / 12 + ends) / len(x)
    if not SHORTEST < long / radius < LONGEST or max(abs(thin / across - 1), abs(wide / along - 1)) > UNLIKE:
        return None
    alike = bool(abs(wide / thin * across / along - 1) < ALIKE)
    return np.asarray(middles[k] + corner), np.asarray(long * axes[:, 1]), alike


def _grid(scene: Scene, table: Image) -> Grid:
    """A grid in which the smallest outline still has a few cells' radius."""
    x0, x1, y0, y1 = scene.box
    sizes = [scene.radius(np.array([x, y])) for x in np.linspace(x0, x1, 9) for y in np.linspace(y0, y1, 9)]
    cell = max(1, int(min(sizes) / CELLS))
    size = columns, rows = (x1 - x0) // cell, (y1 - y0) // cell

    def coarse(picture: NDArray[np.generic]) -> Image:
        part = picture[y0 : y0 + rows * cell, x0 : x0 + columns * cell].astype(np.float32)
        return np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA))

    few = np.array(sizes, np.float32).reshape(9, 9).T / cell
    radius = np.asarray(cv2.resize(few, size, interpolation=cv2.INTER_LINEAR))
    region, home = (coarse(mask) > 0.5 for mask in (scene.region, scene.home))
    r = float(np.median(radius))
    down, across = np.mgrid[: int(6 * r) + 4, : int(6 * r) + 4] - (3 * r + 2)
    disc = 100 * np.clip(r - np.hypot(across, down) + 0.5, 0, 1).astype(np.float32)[..., None].repeat(3, axis=2)
    full = float(_votes(disc, np.full(disc.shape[:2], r, np.float32), 1.0).max())
    return Grid(cell, np.array([x0, y0]), coarse(table), region[..., None], home, radius, full)


def _votes(off: Image, radius: Image, noise: float) -> Image:
    """Votes for centres: every edge of what is `off` the table (rows, columns, 3) votes a radius to either side."""
    gx, gy = (cv2.Sobel(off, cv2.CV_32F, i, 1 - i, ksize=3, scale=0.125) for i in (1, 0))
    steep = gx * gx + gy * gy
    which = steep.argmax(axis=2)
    best = np.take_along_axis(steep, which[..., None], axis=2)[..., 0]
    least = 1.5 + 1.5 * noise
    rows, columns = np.nonzero(best > least**2)
    which, height = which[rows, columns], np.sqrt(best[rows, columns])
    ux, uy = gx[rows, columns, which] / height, gy[rows, columns, which] / height
    weight, r = np.minimum(height / (3 * least), 1.0), radius[rows, columns]
    h, w = radius.shape
    total = np.zeros(h * w)
    for side in (-1, 1):
        x, y = np.rint(columns + side * r * ux).astype(int), np.rint(rows + side * r * uy).astype(int)
        inside = (x >= 0) & (x < w) & (y >= 0) & (y < h)
        total += np.bincount((y * w + x)[inside], weight[inside], h * w)
    return np.asarray(cv2.GaussianBlur(total.reshape(h, w).astype(np.float32), (0, 0), 1.0))


def candidates(view: View, middle: Array | None = None, reach: float = 0.0) -> list[Array]:
    """Where centres of outlines may be (2,) [pixels], the best first: anywhere, or within a reach of a pixel (2,)."""
    grid = view.grid
    rows, columns = grid.radius.shape
    cell, corner = grid.cell, grid.corner
    i0, i1, j0, j1 = 0, columns, 0, rows
    if middle is not None:
        low, high = (middle - corner - reach) / cell, (middle - corner + reach) / cell
        i0, j0 = (max(0, int(v)) for v in low)
        i1, j1 = min(columns, int(high[0]) + 2), min(rows, int(high[1]) + 2)
    if i1 - i0 < 3 or j1 - j0 < 3:
        return []
    x, y = corner
    part = view.picture[y + j0 * cell : y + j1 * cell, x + i0 * cell : x + i1 * cell]
    small = cv2.resize(part, (i1 - i0, j1 - j0), interpolation=cv2.INTER_AREA)
    off = (small - grid.table[j0:j1, i0:i1] * view.gain.astype(np.float32)) * grid.region[j0:j1, i0:i1]
    votes = _votes(off, grid.radius[j0:j1, i0:i1], view.noise / cell)
    peak = (votes == cv2.dilate(votes, np.ones((5, 5), np.uint8))) & (votes > PEAK * grid.full)
    down, across = np.nonzero(peak & grid.home[j0:j1, i0:i1])
    order = np.argsort(-votes[down, across], kind="stable")[:MOST]
    found = []
    for j, i in zip(down[order].tolist(), across[order].tolist(), strict=True):
        a, b = max(j - 1, 0), max(i - 1, 0)
        near = votes[a : j + 2, b : i + 2]
        v, u = np.mgrid[: near.shape[0], : near.shape[1]]
        at = np.array([b + i0 + (near * u).sum() / near.sum(), a + j0 + (near * v).sum() / near.sum()])
        found.append(corner + cell * (at + 0.5) - 0.5)
    return found
