"""The colours of balls: which balls there are, and which colours measured in footage are of the same one.

In: a palette file, and colours of balls measured in one footage. Out: `Palette`, and groups of colours; names.py names
them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from models.errors import BadInput
from models.files import read_toml
from models.files.decode import Allowed
from models.files.faults import shown
from models.files.limits import MAX_BALLS, excess
from models.shot import Table
from models.table.presets import POOL_BALL
from sysid.vision.balls.view_geometry import Array
from sysid.vision.sources.pictures import Picture

BRIGHTNESS_WEIGHT = 0.5  # of brightness relative to tint when colours are compared
LINK_DISTANCE = 0.13  # between colours that are of the same ball
MERGE_DISTANCE = 0.2  # between groups of colours of the same ball, if they are not seen in the same frames
MAX_STRAY_FRACTION = 0.1  # of the frames of the rarer group, in which a stray outline may have the other's colour
CORE_FRACTION = 0.65  # of the radius, whose pixels give the colour of a ball
DIM_QUANTILE = 0.5  # of the brightness of these, above which pixels count
GLOSS_QUANTILE = 0.9  # above which they are highlights
POOL_BALL_TOLERANCE_M = 0.0004
TELEVISION_PINK = (0.93, 0.42, 0.55)  # of the balls 4 and 12 of sets for television, which have no purple
SPOT_SHARE, STRIPE_SHARE = 0.07, 0.45  # of the faces of pool balls, that number circles and the poles of stripes take


@dataclass(frozen=True)
class Palette:
    """Balls by name."""

    names: tuple[str, ...]
    colours: Array  # (n, 3) red, green, blue, 0 to 1, in white light
    counts: tuple[int, ...]  # how many there are of each
    white: tuple[float, ...] = ()  # share of the face of each that is white beside its colour; () for none of any
    variants: tuple[Palette, ...] = ()  # other sets that these may be of instead, as those of television

    @property
    def known(self) -> dict[str, int]:
        """How many balls of each name there may be, in any of the sets."""
        return {name: n for kind in (*self.variants, self) for name, n in zip(kind.names, kind.counts, strict=True)}

    @property
    def patterned(self) -> bool:
        """Whether balls have more than one colour."""
        return any(self.white)


def default_palette() -> Palette:
    """The balls of snooker, among which are those of carom."""
    known = {
        "white": (0.94, 0.92, 0.84), "red": (0.72, 0.05, 0.07), "yellow": (0.93, 0.78, 0.10),
        "green": (0.02, 0.38, 0.18), "brown": (0.42, 0.22, 0.10), "blue": (0.08, 0.20, 0.66),
        "pink": (0.93, 0.52, 0.62), "black": (0.05, 0.05, 0.06),
    }  # fmt: skip
    return Palette(tuple(known), np.array(list(known.values())), tuple(15 if name == "red" else 1 for name in known))


def pool_palette() -> Palette:
    """The balls of pool: the cue ball, seven plain ones, the black one and seven striped ones."""
    plain = {
        "yellow": (0.95, 0.68, 0.08), "blue": (0.06, 0.15, 0.45), "red": (0.80, 0.08, 0.12),
        "purple": (0.32, 0.20, 0.48), "orange": (0.95, 0.33, 0.08), "green": (0.03, 0.36, 0.24),
        "maroon": (0.55, 0.22, 0.10),
    }  # fmt: skip
    named = {"white": (0.94, 0.92, 0.84), **plain, "black": (0.05, 0.05, 0.06)}
    colours = np.array([*named.values(), *plain.values()])
    names = (*named, *(f"{name}_stripe" for name in plain))
    white = (0.0, *[SPOT_SHARE] * (len(named) - 1), *[STRIPE_SHARE] * len(plain))
    usual = Palette(names, colours, (1,) * len(names), white)
    shown = np.array(
        [TELEVISION_PINK if name.startswith("purple") else c for name, c in zip(names, colours, strict=True)]
    )
    pink = tuple(name.replace("purple", "pink") for name in names)
    return replace(usual, variants=(Palette(pink, shown, usual.counts, white),))


def palette_for(path: Path | str | None, table: Table, diameter: float) -> Palette:
    """The palette of a file; without one the balls usual on a table by their diameter [m]: of pool, else of snooker."""
    if path is not None:
        return read_palette(path)
    pool = bool(table.pockets) and abs(diameter - POOL_BALL.diameter) < POOL_BALL_TOLERANCE_M
    return pool_palette() if pool else default_palette()


@dataclass(frozen=True)
class PaletteBall:
    """The keys of a [[ball]] of a palette."""

    name: str
    rgb: Annotated[tuple[float, float, float], Allowed(0, 255, shape=(3,))]  # 0 to 1, or to 255
    count: Annotated[int, Allowed(1, 1000)] = 1
    white: Annotated[float, Allowed(0, 0.9)] = 0.0  # share of its face that is white, as of a striped ball


@dataclass(frozen=True)
class PaletteFile:
    """The keys of a palette."""

    ball: Annotated[tuple[PaletteBall, ...], Allowed(form="[[ball]] name, rgb for each ball")] = ()

    def __post_init__(self) -> None:
        """BadInput without balls, and for one that is there twice."""
        names = [ball.name.strip() for ball in self.ball]
        if not all(names) or not names:
            raise BadInput("names no ball, or one by blanks: write [[ball]] name, rgb for each ball")
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            raise BadInput(f"{shown(twice[0])} is listed twice: give its count instead")
        if problem := excess(sum(ball.count for ball in self.ball), MAX_BALLS, "balls", "name those on the table"):
            raise BadInput(problem)


def read_palette(path: Path | str) -> Palette:
    """Read a palette: `[[ball]]` with `name`, `rgb` (0 to 1, or to 255), `count` if there are more, and `white`."""
    balls = read_toml(path, PaletteFile, "", "name a TOML file with [[ball]] name, rgb", more=True).ball
    colours = [np.divide(ball.rgb, 255 if max(ball.rgb) > 1 else 1) for ball in balls]
    return Palette(
        tuple(ball.name.strip() for ball in balls),
        np.array(colours),
        tuple(ball.count for ball in balls),
        tuple(ball.white for ball in balls),
    )


def colour_distance(one: Array, other: Array) -> Array:
    """Distance between colours (..., 3), 0 to 1: Euclidean between their square roots, brightness weighted by half."""
    difference = np.sqrt(np.clip(one, 0, None)) - np.sqrt(np.clip(other, 0, None))
    brightness = difference.mean(axis=-1)
    return np.asarray(
        np.sqrt(((difference - brightness[..., None]) ** 2).sum(axis=-1) + BRIGHTNESS_WEIGHT * 3 * brightness**2)
    )


def ball_colour(picture: Picture, xy: Array, radius: float, light: Array) -> Array:
    """Colour of a ball centred at a pixel (2,), in white light: (3,) red, green, blue, 0 to 1, without marks and gloss.

    `light` (3,) is blue, green and red of the light there.
    """
    r = CORE_FRACTION * radius
    x0, y0 = (max(0, int(v - r)) for v in xy)
    patch = picture[y0 : int(xy[1] + r) + 2, x0 : int(xy[0] + r) + 2]
    y, x = np.ogrid[: patch.shape[0], : patch.shape[1]]
    disc = patch[(x + x0 - xy[0]) ** 2 + (y + y0 - xy[1]) ** 2 < r**2].astype(float)
    order = np.argsort(disc.sum(axis=1), kind="stable")
    low = int(DIM_QUANTILE * len(order))
    typical = disc[order[low : max(int(GLOSS_QUANTILE * len(order)), low + 1)]]
    return np.asarray(typical.mean(axis=0) / (255 * light))[::-1]


def group_colours(found: Sequence[tuple[int, Array]]) -> list[list[tuple[int, Array]]]:
    """Group colours (3,), given with the indices of their frames, into those of the same ball.

    Two balls are seen in the same frames; one that only changes its colour, as by the light where it lies, is not.
    """

    def median(group: list[tuple[int, Array]]) -> Array:
        return np.asarray(np.median([colour for _, colour in group], axis=0))

    groups: list[list[tuple[int, Array]]] = []
    for item in found:
        near = [float(colour_distance(item[1], median(group))) for group in groups]
        if near and min(near) < LINK_DISTANCE:
            groups[int(np.argmin(near))].append(item)
        else:
            groups.append([item])
    kept: list[list[tuple[int, Array]]] = []
    for group in sorted(groups, key=lambda g: -len(g)):
        frames = {frame for frame, _ in group}
        same = [
            k for k in kept
            if colour_distance(median(k), median(group)) < MERGE_DISTANCE and _apart(frames, {f for f, _ in k})
        ]  # fmt: skip
        if same:
            same[0].extend(group)
        else:
            kept.append(group)
    return kept


def _apart(one: set[int], other: set[int]) -> bool:
    """Whether two groups of colours are seen in different frames, but for a stray outline."""
    return len(one & other) <= MAX_STRAY_FRACTION * min(len(one), len(other))
