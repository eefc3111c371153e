"""Which ball is which: names by the colours and faces that balls show, and how likely each name is.

In: colours measured in one footage, the colour of its cloth, and a palette. Out: `Naming`. What a ball looks like is
measured; the nominal colours of the palette only name it. Balls are named all at once, together with what they share:
the colour and brightness of the light, how much of the cloth's colour falls on them, and the set that they are of.
Lights are compared by the density of the same picture: marks, gloss and shading vary the reflectance that a face shows,
which a brighter light spreads over more of the picture. Balls of pool are white in part. How white the side is that a
ball turns to the camera follows from its geometry, two white caps about opposite poles, over all the ways that it may
lie.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from sysid.vision.balls.colours.palette import Palette, colour_distance
from sysid.vision.balls.view_geometry import Array

STRAY_LIGHT = 0.05  # added to colours, whose dark channels compression falsifies
COLOUR_SPREAD = 0.1  # usual distance between colours of the same ball: gloss, marks, shading
LIGHT_LOG_SD = 0.5  # of the brightness of a light, standard deviation of its logarithm
TINT_LOG_SD = 0.25  # of its colour, standard deviation of the logarithm
VEIL_SD = 0.15  # of what the cloth throws on balls, as a part of its own colour
TRIED_VEILS = (0.0, 0.1, 0.2, 0.3)  # of it, that are tried
MAX_SHARED_COST = 9.0  # of a light or a veil, beyond which it is none
NO_WHITE_COST = 8.0  # of naming no ball as the whitest of the palette: there is nearly always a cue ball
UNNAMED_COST = 100.0  # of a colour without a name
MIN_SURE_PROBABILITY = 0.9  # probability of a name, below which it is doubtful
FACE_RADII = 0.92  # of a disc that shows the face, clear of the rim
PLACE_COST_LIMIT = 9.0  # of one place on a face, that may show a number, a dot or a highlight, and of its white share
FACE_PLACES = 4.0  # independent ones on a face, whose light differs
WHITE_SHARE_SD = 0.07  # of the part of a view that is white, by highlights, numbers and blur
FACE_VIEWS = 4  # of a ball as it rolls, beyond which more add no information
COLOUR_LEVELS = 16  # of the roots of colours, in which places of a face are counted


@dataclass(frozen=True)
class Naming:
    """Names given to colours that were found."""

    names: tuple[str | None, ...]  # None where the palette has no name left
    light: Array  # (3,) red, green, blue of the light, 1 for white
    odds: tuple[float, ...] = ()  # probability of each name beside the likeliest other
    others: tuple[str | None, ...] = ()  # what each may be instead
    found: tuple[str, ...] = ()  # colours for which there is no name

    @property
    def doubts(self) -> tuple[str, ...]:
        """Messages for the user."""
        unsure = [
            f"the ball named {name} may be {other} ({100 * (1 - odds):.0f} %)"
            for name, other, odds in zip(self.names, self.others, self.odds, strict=True)
            if name is not None and other is not None and odds < MIN_SURE_PROBABILITY
        ]
        return (*unsure, *(f"the palette has no name for a ball of colour {one}" for one in self.found))


Costs = Callable[[Palette, Array, Array], Array]  # of every name (m, n) of a palette, in a light (3,) and veil (3,)


def name_colours(colours: Array, palette: Palette, cloth: Array | None = None) -> Naming:
    """Name colours (m, 3), red, green, blue, 0 to 1, seen in one unknown light on a cloth of a colour (3,)."""
    colours = np.asarray(colours, float).reshape(-1, 3)

    def costs(palette: Palette, light: Array, veil: Array) -> Array:
        off = _squared(colours[:, None], palette.colours, light, veil) - 2 * math.log(_density(light))
        return np.asarray(np.minimum(off, UNNAMED_COST))

    return _named(colours, palette, cloth, costs)


def name_faces(faces: Sequence[Sequence[Array]], palette: Palette, cloth: Array | None = None) -> Naming:
    """Name balls by the colours (n, 3) of places on their faces, in one view of each or more, as in `name_colours`."""
    means = np.array([np.mean(np.concatenate(views), axis=0) for views in faces]).reshape(-1, 3)
    counted = [[_counted(view) for view in views] for views in faces]

    def costs(palette: Palette, light: Array, veil: Array) -> Array:
        return np.array([_face_costs(views, palette, light, veil) for views in counted])

    return _named(means, palette, cloth, costs)


def names_by_faces(
    faces: Mapping[str, Sequence[Array]], palette: Palette, cloth: Array | None = None
) -> tuple[dict[str, str | None], Naming]:
    """Names of balls by their faces (n, 3) as each lay in one way or more; None for one without."""
    seen = {ball: views for ball, views in faces.items() if views}
    naming = name_faces(list(seen.values()), palette, cloth)
    return dict(zip(seen, naming.names, strict=True)), naming


@cache
def white_shares(white: float) -> tuple[Array, Array]:
    """How white a ball looks that is white in two caps of a share of its surface, and how likely that is: (k,) each.

    The side that it turns to the camera is any: the cosine between its axis and the line of sight is even.
    """
    if white == 0:
        return np.zeros(1), np.ones(1)
    cosines = (np.arange(16) + 0.5) / 16
    x, y = np.meshgrid(*[np.linspace(-FACE_RADII, FACE_RADII, 61)] * 2)
    inside = x * x + y * y < FACE_RADII**2
    x, z = x[inside], np.sqrt(1 - x[inside] ** 2 - y[inside] ** 2)
    along = np.sqrt(1 - cosines[:, None] ** 2) * x + cosines[:, None] * z
    return (np.abs(along) > 1 - white).mean(axis=1), np.full(16, 1 / 16)


def _squared(colours: Array, nominal: Array, light: Array, veil: Array) -> Array:
    """Squared distances (...) between colours (..., 3) and nominal ones as they look, in usual spreads."""
    seen = np.clip(colours - veil, 0, None) / light
    return np.asarray((colour_distance(seen + STRAY_LIGHT, nominal + STRAY_LIGHT) / COLOUR_SPREAD) ** 2)


def _density(light: Array) -> float:
    """Density of a picture's root of a colour over that of the root of the reflectance behind it, in a light (3,).

    In each channel the one is sqrt(light) times the other. Without this factor a dark ball in a bright light, in which
    all differences of reflectance are small, would explain any marks and shading best.
    """
    return float(np.prod(light) ** -0.5)


def _counted(view: Array) -> tuple[Array, Array]:
    """Different colours (k, 3) of a view (n, 3), and the share of each (k,)."""
    level = np.rint(COLOUR_LEVELS * np.sqrt(np.clip(view, 0, None))).astype(int)
    _, first, count = np.unique(level, axis=0, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(first.ravel(), view[:, k]) for k in range(3)], axis=1) / count[:, None]
    return means, count / len(view)


def _face_costs(views: Sequence[tuple[Array, Array]], palette: Palette, light: Array, veil: Array) -> Array:
    """Cost of every name (n,): each view shows the ball's own colour and white, in a share that its geometry allows.

    Colours are off alike all over a face, so that few of its places count; how much of it is white is known better.
    """
    whitest = palette.colours[palette.colours.min(axis=1).argmax()]
    cost, spare, density = np.zeros(len(palette.names)), math.exp(-PLACE_COST_LIMIT / 2), _density(light)
    for colours, share in views:
        own = density * np.exp(-_squared(colours[:, None], palette.colours, light, veil) / 2)  # (k, n)
        white = density * np.exp(-_squared(colours, whitest, light, veil) / 2)
        for n, of in enumerate(palette.white or (0.0,) * len(palette.names)):
            part, likely = white_shares(of)
            shown = (1 - part) * own[:, n, None] + part * white[:, None] + spare  # (k, parts)
            log = FACE_PLACES * share @ np.log(shown)
            if of:
                seen = share @ (white / (white + own[:, n] + spare))
                log -= np.minimum(((seen - part) / WHITE_SHARE_SD) ** 2, PLACE_COST_LIMIT) / 2
            cost[n] -= 2 * (log.max() + math.log(likely @ np.exp(log - log.max())))
    return cost / len(views) * min(len(views), FACE_VIEWS)


def _named(colours: Array, palette: Palette, cloth: Array | None, cost_in: Costs) -> Naming:
    """Names of balls of mean colours (m, 3), by the costs of every name."""
    if len(colours) == 0:
        return Naming((), np.ones(3))
    tried: list[tuple[Palette, Array, Array, float]] = []  # set, light, costs (m, n), and the cost of what is shared
    for kind in (palette, *palette.variants):
        for part in TRIED_VEILS if cloth is not None else TRIED_VEILS[:1]:
            veil = part * (np.zeros(3) if cloth is None else cloth)
            shown = np.clip(colours - veil, 0.01, None)
            pairs = [np.ones(3), *(c / n for c in shown for n in np.maximum(kind.colours, 0.01))]
            shared = [(light, _light_cost(light) + (part / VEIL_SD) ** 2) for light in pairs]
            tried += [(kind, light, cost_in(kind, light, veil), cost) for light, cost in shared
                      if cost < MAX_SHARED_COST]  # fmt: skip
    best, chosen, total = _cheapest(tried)
    kind, light = tried[best][:2]
    names: list[str | None] = []
    odds: list[float] = []
    others: list[str | None] = []
    for i, k in enumerate(chosen):
        names.append(None if k < 0 else kind.names[k])
        if k < 0:
            odds.append(0.0)
            others.append(None)
            continue
        barred = [
            (of, lit, _without(cost, i, [j for j, name in enumerate(of.names) if name == names[i]]), extra)
            for of, lit, cost, extra in tried
        ]
        again, other, second = _cheapest(barred)
        odds.append(1 / (1 + math.exp(-min(second - total, 100.0) / 2)))
        others.append(None if other[i] < 0 else tried[again][0].names[other[i]])
    found = tuple(_hex(colours[i]) for i, name in enumerate(names) if name is None)
    return Naming(tuple(names), light, tuple(odds), tuple(others), found)


def _without(cost: Array, row: int, columns: Sequence[int]) -> Array:
    """Costs (m, n) with some names barred to one ball."""
    out = cost.copy()
    out[row, columns] = UNNAMED_COST
    return out


def _cheapest(tried: Sequence[tuple[Palette, Array, Array, float]]) -> tuple[int, NDArray[np.intp], float]:
    """Which of what is shared is cheapest, the names (m,) with it as indices into its set, -1 for none; their cost."""
    found = []
    for k, (kind, _, costs, shared) in enumerate(tried):
        # A name is available at most as often as there are balls.
        columns = np.repeat(np.arange(len(kind.names)), np.minimum(kind.counts, len(costs)))
        chosen, cost = _assigned(costs[:, columns])
        names = np.where(chosen >= 0, columns[chosen], -1)
        missed = int(kind.colours.min(axis=1).argmax()) not in names
        found.append((cost + shared + NO_WHITE_COST * missed, k, names))
    total, k, names = min(found, key=lambda one: one[:2])
    return k, names, total


def _light_cost(light: Array) -> float:
    """How unusual a light is: squared departures from white in standard deviations, summed."""
    log = np.log(light)
    return float((log.mean() / LIGHT_LOG_SD) ** 2 + ((log - log.mean()) ** 2).sum() / TINT_LOG_SD**2)


def _assigned(cost: Array) -> tuple[NDArray[np.intp], float]:
    """The cheapest assignment of columns to rows, -1 for none, and its cost."""
    chosen = np.full(len(cost), -1)
    rows, columns = linear_sum_assignment(cost)
    keep = cost[rows, columns] < UNNAMED_COST
    chosen[rows[keep]] = columns[keep]
    return chosen, float(cost[rows[keep], columns[keep]].sum()) + UNNAMED_COST * int((chosen < 0).sum())


def _hex(colour: Array) -> str:
    return "#" + "".join(f"{int(np.clip(255 * v, 0, 255)):02x}" for v in colour)
