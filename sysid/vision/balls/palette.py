"""Which balls there are, what they are called by their colours, and how they look across their outline.

What a ball looks like is measured in the footage; the nominal colours only serve to name what was found. Light has a
colour and a brightness of its own, so names are given to all balls at once, with the light that suits them best.

Along a normal to the outline, d outwards from it, a channel of the picture is modelled as
S(d) (a + b h(d)) + (1 - S(d)) (T(d) + c): S the step from ball to table and h the height of the sphere over its widest
circle, both blurred, T the empty table, and a, b, c free. A shift of the outline adds its derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from models.errors import BadInput
from models.files import read_toml
from models.shot import NOSE_HEIGHT
from sysid.vision.balls.backdrop import RAYS, Array, View
from sysid.vision.frames import Picture

DULL = 0.5  # weight of brightness against colour when colours are compared
SAME = 0.1  # distance between colours that is no surprise: gloss, marks, shading
LAMP, TINGE = 0.5, 0.25  # how far light is off in brightness and in colour, one standard deviation of the logarithm
DOUBT = 4.0  # by which the next best naming must be worse, in squares of SAME, to be ruled out
WRONG = 100.0  # cost of a colour that stays without a name
MISSED = 8.0  # cost of naming none of the balls as the palette's whitest: there is nearly always a cue ball
LINK, MERGE = 0.13, 0.2  # distance of colours that are the same ball's; and if they are never seen together
CORE, DIM, GLOSSY = 0.65, 0.5, 0.9  # part of the radius whose colour counts, and the brighter part of it that does

INNER, OUTER, EVERY = 3.0, 4.0, 0.5  # what is looked at along a normal: within, without, how finely [pixels]
ALONG = np.arange(-INNER, OUTER + EVERY / 2, EVERY)
RIM = int(INNER / EVERY)  # the sample on the outline
WITHIN = RIM - 1  # so many samples that lie within, clear of the edge
SHADINGS, MARKED, LEAN = 3, (3.0, 0.1), 1e-6  # of finding marks: steps, standard deviations and parts of the brightness
SMOOTH = 0.3  # noise of a picture, at least: that of rounding [grey levels]
FINE = 0.05  # how finely the model is computed [pixels]

SHARP = 0.85  # blur from which on normals are stretched [pixels]
FINER = 4  # steps of stretches and of smears in a factor of two
DEEPEST = 0.45  # part of the radius within which a ball is looked at
BOX = 12**0.5  # width of a smear over its standard deviation
LEFT = (11, 24)  # degrees of freedom along a normal in brightness and in colour
TINT, DARKEST, BRIGHTEST = 0.22, -0.7, 0.3  # by which the table beside a ball may differ from the empty one, in parts


@dataclass(frozen=True)
class Palette:
    """Balls by name."""

    names: tuple[str, ...]
    colours: Array  # (n, 3) red, green, blue, 0 to 1, in white light
    counts: tuple[int, ...]  # how many there are of each


@dataclass(frozen=True)
class Naming:
    """Names of colours that were found."""

    names: tuple[str | None, ...]  # None for what no name is left for
    light: Array  # (3,) red, green, blue of the light, 1 for white
    doubts: tuple[str, ...]  # in plain words


def default_palette() -> Palette:
    """The balls of snooker; those of carom are among them."""
    known = {
        "white": (0.94, 0.92, 0.84), "red": (0.72, 0.05, 0.07), "yellow": (0.93, 0.78, 0.10),
        "green": (0.02, 0.38, 0.18), "brown": (0.42, 0.22, 0.10), "blue": (0.08, 0.20, 0.66),
        "pink": (0.93, 0.52, 0.62), "black": (0.05, 0.05, 0.06),
    }  # fmt: skip
    return Palette(tuple(known), np.array(list(known.values())), tuple(15 if name == "red" else 1 for name in known))


def read_palette(path: Path | str) -> Palette:
    """Read a palette: `[[ball]]` with `name`, `rgb` (0 to 1, or to 255) and, if there are more than one, `count`."""
    form = "[[ball]] name, rgb"
    data = read_toml(path, f"name a TOML file with {form}", f"write {form} for each ball")
    balls = data.get("ball")
    if not isinstance(balls, list) or not balls:
        raise BadInput(f"{path}: names no ball; write [[ball]] name, rgb for each ball")
    names, colours, counts = [], [], []
    for number, ball in enumerate(balls, 1):
        name, colour, count = _ball(path, number, ball)
        if name in names:
            raise BadInput(f"{path}: ball {number}: {name!r} is there twice; give its count instead")
        names.append(name)
        colours.append(colour)
        counts.append(count)
    return Palette(tuple(names), np.array(colours), tuple(counts))


def _ball(path: Path | str, number: int, ball: Any) -> tuple[str, list[float], int]:
    where = f"{path}: ball {number}"
    if not isinstance(ball, dict) or not isinstance(ball.get("name"), str) or not ball["name"].strip():
        raise BadInput(f'{where}: has no name; write name = "..."')
    unknown = set(ball) - {"name", "rgb", "count"}
    if unknown:
        raise BadInput(f"{where}: {sorted(unknown)[0]!r} is unknown; a ball has name, rgb and count")
    rgb, count = ball.get("rgb"), ball.get("count", 1)
    if not isinstance(rgb, list) or len(rgb) != 3 or not all(type(v) in (int, float) and 0 <= v <= 255 for v in rgb):
        raise BadInput(f"{where}: rgb = {rgb!r} must be three numbers, 0 to 1 or 0 to 255")
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise BadInput(f"{where}: count = {count!r} must be a whole number above 0")
    return ball["name"].strip(), [v / (255 if max(rgb) > 1 else 1) for v in rgb], count


def apart(one: Array, other: Array) -> Array:
    """Distance between colours (..., 3), 0 to 1: that between their square roots, brightness counting half."""
    off = np.sqrt(np.clip(one, 0, None)) - np.sqrt(np.clip(other, 0, None))
    dull = off.mean(axis=-1)
    return np.asarray(np.sqrt(((off - dull[..., None]) ** 2).sum(axis=-1) + DULL * 3 * dull**2))


def name_colours(colours: Array, palette: Palette) -> Naming:
    """Name colours (m, 3), red, green, blue, 0 to 1, as seen in one unknown light."""
    colours = np.asarray(colours, float).reshape(-1, 3)
    if len(colours) == 0:
        return Naming((), np.ones(3), ())
    # No more of each name than there are colours to take it.
    who = np.array([k for k, count in enumerate(palette.counts) for _ in range(min(count, len(colours)))])
    pairs = [c / n for c in np.maximum(colours, 0.01) for n in np.maximum(palette.colours, 0.01)]
    lights = [np.ones(3), *(light for light in pairs if _strange(light) < 9)]
    prices = [_prices(colours, palette, light) for light in lights]
    strange = [_strange(light) for light in lights]
    best, chosen, total = _best(prices, strange, who, palette)
    names = [palette.names[who[k]] if k >= 0 else None for k in chosen]
    doubts = []
    for i, name in enumerate(names):
        if name is None:
            doubts.append(f"a ball of colour {_hex(colours[i])} has no name in the palette")
            continue
        barred = [price.copy() for price in prices]
        for price in barred:
            price[i, palette.names.index(name)] = WRONG
        _, other, worse = _best(barred, strange, who, palette)
        if other[i] >= 0 and worse - total < DOUBT:
            doubts.append(f"the ball named {name} may be {palette.names[who[other[i]]]}")
    return Naming(tuple(names), lights[best], tuple(doubts))


def _best(
    prices: Sequence[Array], strange: Sequence[float], who: NDArray[np.intp], palette: Palette
) -> tuple[int, NDArray[np.intp], float]:
    """The light that suits best, by its number, the names in it (m,) as places in `who`, and what they cost."""
    whitest = int(palette.colours.min(axis=1).argmax())
    found = []
    for k, (price, odd) in enumerate(zip(prices, strange, strict=True)):
        chosen, cost = _assign(price[:, who])
        missed = not any(who[c] == whitest for c in chosen if c >= 0)
        found.append((cost + odd + MISSED * missed, k, chosen))
    total, k, chosen = min(found, key=lambda f: f[:2])
    return k, chosen, total


def _prices(colours: Array, palette: Palette, light: Array) -> Array:
    """Cost of every name (m, n) in this light."""
    return np.minimum((apart(colours[:, None] / light, palette.colours) / SAME) ** 2, WRONG)


def _strange(light: Array) -> float:
    """How unusual a light is: the sum of squares of its departures."""
    log = np.log(light)
    return float((log.mean() / LAMP) ** 2 + ((log - log.mean()) ** 2).sum() / TINGE**2)


def _assign(price: Array) -> tuple[NDArray[np.intp], float]:
    """The cheapest name for each, -1 for none, and what it costs."""
    chosen = np.full(len(price), -1)
    one, other = linear_sum_assignment(price)
    keep = price[one, other] < WRONG
    chosen[one[keep]] = other[keep]
    return chosen, float(price[one[keep], other[keep]].sum()) + WRONG * int((chosen < 0).sum())


def _hex(colour: Array) -> str:
    return "#" + "".join(f"{int(np.clip(255 * v, 0, 255)):02x}" for v in colour)


def ball_colour(picture: Picture, xy: Array, radius: float, light: Array) -> Array:
    """Colour of a ball centred at a pixel (2,), in white light: (3,) red, green, blue, 0 to 1; but for marks and gloss.

    `light` (3,) is blue, green and red of the light there.
    """
    r = CORE * radius
    x0, y0 = (max(0, int(v - r)) for v in xy)
    part = picture[y0 : int(xy[1] + r) + 2, x0 : int(xy[0] + r) + 2]
    y, x = np.ogrid[: part.shape[0], : part.shape[1]]
    skin = part[(x + x0 - xy[0]) ** 2 + (y + y0 - xy[1]) ** 2 < r**2].astype(float)
    order = np.argsort(skin.sum(axis=1), kind="stable")
    some = skin[order[int(DIM * len(order)) : max(int(GLOSSY * len(order)), int(DIM * len(order)) + 1)]]
    return np.asarray(some.mean(axis=0) / (255 * light))[::-1]


def grouped(found: Sequence[tuple[int, Array]]) -> list[list[tuple[int, Array]]]:
    """Colours (3,) with the numbers of the frames they were seen in, by the balls they are of."""

    def middle(group: list[tuple[int, Array]]) -> Array:
        return np.asarray(np.median([colour for _, colour in group], axis=0))

    groups: list[list[tuple[int, Array]]] = []
    for item in found:
        near = [float(apart(item[1], middle(group))) for group in groups]
        if near and min(near) < LINK:
            groups[int(np.argmin(near))].append(item)
        else:
            groups.append([item])
    kept: list[list[tuple[int, Array]]] = []
    for group in sorted(groups, key=lambda g: -len(g)):
        frames = {frame for frame, _ in group}
        same = [k for k in kept if apart(middle(k), middle(group)) < MERGE and not frames & {f for f, _ in k}]
        if same:
            same[0].extend(group)
        else:
            kept.append(group)
    return kept


@dataclass(frozen=True)
class Optics:
    """What lens and sensor make of an outline."""

    rough: tuple[float, float]  # what disturbs edges in brightness and in colour, as noise of so many grey levels
    blur: tuple[float, float] = (0.85, 0.85)  # of these edges, one standard deviation [pixels]
    size: float = 0.0  # radius beyond the expected [pixels]
    give: float = 0.12  # by which single outlines differ from that, one standard deviation [pixels]
    stretch: float = 0.0  # of the way along normals that is looked at; 0 for as much as edges are soft


Profile = tuple[Array, Array, Array]


@lru_cache(maxsize=4096)
def _profile(radius: float, blur: float, shadow: bool) -> Profile:
    """Of n samples along a normal: the part that is ball (n,), what to multiply them with (n, k), and products (3,).

    The columns: the two shapes that a shift has, clear of what the colours of ball and table may do (`products` are
    theirs with each other); what gives a, b and c; and an orthonormal basis of what those colours may do.
    """
    fine = np.arange(-INNER - 5 * blur, OUTER + 5 * blur, FINE)
    kernel = np.exp(-0.5 * (np.arange(-4 * blur, 4 * blur + FINE / 2, FINE) / blur) ** 2)
    within = (fine < 0).astype(float)
    height = np.sqrt(np.maximum(0.0, 1 - np.maximum(0.0, 1 + fine / radius) ** 2)) * within
    step, dome = (np.convolve(f, kernel / kernel.sum(), "same") for f in (within, height))
    edge, slope = (np.interp(ALONG, fine, -np.gradient(f, FINE)) for f in (step, dome))
    cover, dome = np.interp(ALONG, fine, step), np.interp(ALONG, fine, dome)
    # A shadow has no colour of its own, and may begin or end beside the ball.
    free = [cover, dome, 1 - cover, *([(1 - cover) * np.maximum(ALONG, -1)] if shadow else [])]
    basis = np.stack(free, axis=1)
    q = np.linalg.qr(basis)[0]
    clear = np.stack([edge, slope], axis=1)
    clear = clear - q @ (q.T @ clear)
    products = np.array([clear[:, 0] @ clear[:, 0], clear[:, 0] @ clear[:, 1], clear[:, 1] @ clear[:, 1]])
    return cover, np.concatenate([clear, np.linalg.pinv(basis).T[:, :3], q], axis=1), products


def _edge_shift(samples: Array, table: Array, kinds: NDArray[np.intp], profiles: Sequence[Profile]) -> Array:
    """Pull, hold, rest and the table's change (4, rows), of samples and table (rows, n) by the profile each row is of.

    The shift is pull / hold, its variance at a noise of one grey level 1 / hold, `rest` what is left without a shift.
    """
    out = np.empty((4, len(samples)))
    for kind, (cover, columns, (ee, es, ss)) in enumerate(profiles):
        rows = slice(None) if len(profiles) == 1 else np.flatnonzero(kinds == kind)
        behind = table[rows]
        y = samples[rows] - (1 - cover) * behind
        z = y @ columns
        jump, growth = z[:, 2] - z[:, 4] - behind[:, RIM], z[:, 3]
        out[0, rows] = jump * z[:, 0] + growth * z[:, 1]
        out[1, rows] = jump**2 * ee + 2 * jump * growth * es + growth**2 * ss
        out[2, rows] = np.einsum("rn,rn->r", y, y) - np.einsum("rn,rn->r", z[:, 5:], z[:, 5:])
        out[3, rows] = z[:, 4]
    return out


def _kinds(
    optics: Optics, radii: Array, smear: Array
) -> tuple[Array, NDArray[np.intp], list[tuple[float, float, float]]]:
    """How much normals (m, r) are stretched, the kind of each, and radius and blurs of the kinds [stretched pixels]."""
    # In steps, so that there are few kinds.
    width = np.where(smear > 0, 2 ** (np.round(FINER * np.log2(np.maximum(smear, 0.25))) / FINER), 0.0) / BOX
    steps = np.ceil(FINER * np.log2(np.maximum(np.hypot(max(optics.blur), width) / SHARP, 1.0)) - 1e-9)
    deepest = np.maximum(np.floor(FINER * np.log2(DEEPEST * radii[:, None] / INNER)), 0)
    stretch = np.full(smear.shape, optics.stretch) if optics.stretch else 2 ** (np.minimum(steps, deepest) / FINER)
    sort = np.stack([np.broadcast_to(np.round(2 * radii)[:, None] / 2, smear.shape), width, stretch], axis=-1)
    if not smear.any():  # then all normals of a ball are alike, which is found out sooner
        kinds, which = np.unique(sort[:, 0], axis=0, return_inverse=True)
        which = np.repeat(which, smear.shape[1])
    else:
        kinds, which = np.unique(sort.reshape(-1, 3), axis=0, return_inverse=True)
    light, tint = optics.blur
    known = [(r / s, float(np.hypot(light, w) / s), float(np.hypot(tint, w) / s)) for r, w, s in kinds.tolist()]
    return stretch, which.reshape(-1), known


def _axes(own: Array) -> Array:
    """Axes of colour (m, 3, 3), in columns: the table's own (m, 3), along which shadows work, and two across it."""
    b, g, r = own.T
    # A table that is black, as in a pocket, has no axes, and tells nothing.
    flat = np.stack([-g, b + r, -g], axis=1) / np.maximum(np.hypot(np.sqrt(2) * g, b + r), 1e-9)[:, None]
    x, y, z = flat.T
    return np.stack([own, flat, np.stack([g * z - r * y, r * x - b * z, b * y - g * x], axis=1)], axis=2)


@dataclass(frozen=True)
class Edges:
    """What the normals of m outlines say, (m, RAYS) each."""

    move: Array  # how far out the edge lies [pixels]
    hold: Array  # one over its variance [1/pixel^2]
    each: list[tuple[Array, Array]]  # the two of brightness and of colour alone, at a noise of one grey level
    rest: list[Array]  # mean squares of what is left of brightness and of colour [grey levels squared]
    clear: NDArray[np.bool_]  # whether the table lies beyond, in sight
    bright: Array  # (m, 1) of the table [grey levels]


def _plain(within: Array, normals: Array) -> NDArray[np.bool_]:
    """Which normals (m, RAYS, 2) begin on the ball's own colour, by how bright they begin (m, RAYS, k): not on a mark.

    A ball's shading is linear in the normal (Lambert's law and an ambient part).
    """
    level = within.transpose(0, 2, 1)
    x = np.concatenate([np.ones((*normals.shape[:2], 1)), normals], axis=2)[:, None]
    model = np.median(level, axis=2, keepdims=True)
    for _ in range(SHADINGS):
        off = np.abs(level - model)
        spread = np.maximum(1.48 * np.median(off, axis=2, keepdims=True), SMOOTH)
        limit = np.maximum(MARKED[0] * spread, MARKED[1] * np.abs(model))
        pull = (x * np.maximum(0.0, 1 - (off / limit) ** 2)[..., None]).transpose(0, 1, 3, 2)
        model = (x @ np.linalg.solve(pull @ x + LEAN * np.eye(3), pull @ level[..., None]))[..., 0]
    plain = (np.abs(level - model) < limit).all(axis=1)
    return np.asarray(plain & np.roll(plain, 1, axis=1) & np.roll(plain, -1, axis=1))


def edges_of(view: View, optics: Optics, rim: Array, normals: Array, heights: Array, smears: Array) -> Edges:
    """Look along the normals of outlines (m, RAYS, 2) that move by smears (m, 2) during the exposure."""
    h, w = view.picture.shape[:2]
    m, n = len(rim), len(ALONG)
    radii = np.linalg.norm(rim - rim.mean(axis=1, keepdims=True), axis=2).mean(axis=1)
    stretch, which, kinds = _kinds(optics, radii, np.abs(normals @ smears[:, :, None])[..., 0])
    points = (rim[:, :, None] + (stretch[..., None] * ALONG)[..., None] * normals[:, :, None]).astype(np.float32)
    at = points.reshape(m * RAYS, n, 2)
    seen, table = (
        cv2.remap(v, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for v in (view.picture, view.table)
    )
    seen, table = seen.reshape(m, -1, 3).astype(np.float32), (table * view.gain.astype(np.float32)).reshape(m, -1, 3)
    plain = _plain(seen.reshape(m, RAYS, n, 3)[:, :, :WITHIN:2].mean(axis=3), normals)
    own = table.reshape(m, RAYS, n, 3)[:, :, RIM].mean(axis=1)
    bright = np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1.0)
    seen, table = ((v @ _axes(own / bright)).transpose(2, 0, 1).reshape(3, m * RAYS, n) for v in (seen, table))
    light = _edge_shift(seen[0], table[0], which, [_profile(r, b, True) for r, b, _ in kinds])
    sides = [_profile(r, b, False) for r, _, b in kinds]
    tint = _edge_shift(seen[1:].reshape(-1, n), table[1:].reshape(-1, n), np.tile(which, 2), sides)
    light, tint = light.reshape(4, m, RAYS), tint.reshape(4, 2, m, RAYS)
    parts = (light[:3], tint[:3].sum(axis=1))
    hold = np.maximum(sum(h / v**2 for (_, h, _), v in zip(parts, optics.rough, strict=True)), 1e-9)
    move = sum(p / v**2 for (p, _, _), v in zip(parts, optics.rough, strict=True)) / hold
    rest = [(r - 2 * move * p + move**2 * h) / free for (p, h, r), free in zip(parts, LEFT, strict=True)]
    each = [(stretch * p / np.maximum(h, 1e-9), h / stretch**2) for p, h, _ in parts]
    stain, shade = np.abs(tint[3]).max(axis=0) / bright, light[3] / bright
    clear = plain & (stain < TINT) & (shade > DARKEST) & (shade < BRIGHTEST)
    column, row = rim[..., 0].round().astype(int).clip(0, w - 1), rim[..., 1].round().astype(int).clip(0, h - 1)
    clear &= ~(view.scene.beyond[row, column] & (heights < NOSE_HEIGHT * view.scene.camera.radius))
    x, y = points[:, :, -1, 0], points[:, :, -1, 1]
    clear &= (x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1)
    return Edges(stretch * move, hold / stretch**2, each, rest, clear, bright)
