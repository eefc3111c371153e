"""The table from above with what a model lacks: pushes as arrows, friction as colour, rails as bars.

In: `Lacking` of one model, or of two on one scale. Out: `ClothPicture`s, shapes that templates/cloth.svg.j2 draws.

Only what exceeds its uncertainty of 95 % is drawn in full: an arrow where the push leaves the circle that holds 95 % of
its posterior, a colour and a bar where the interval leaves zero. Cells are hatched that no ball crossed, and those
where a push or a change of speed as large as the legend's could hide; arrows in them are pale.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.report.axes import round_down
from models.report.numbers import SDS_OF_95_PERCENT, value_with_sd
from models.shot import GRAVITY, Table
from sysid.report.typical import FITTERS_SLOPE_RAD, TYPICAL_RANGES
from sysid.residuals.functions.cloth_field import ClothField
from sysid.residuals.functions.curves import Rails
from sysid.residuals.functions.lacking import Lacking

Array = NDArray[np.float64]

WIDTH_PX, RIM_PX = 400, 24  # of the picture, and of the rails in it
CIRCLE_95 = math.sqrt(-2.0 * math.log(0.05))  # radius that holds 95 % of a normal of two dimensions [sd]
CELLS_AN_ARROW = 2  # along and across
MIN_ARROW_PX = 4.0  # a shorter arrow would be a dot
LEGEND_ARROW = 0.55  # of the side of an arrow's square
MAX_OPACITY, FAINT_OPACITY = 0.85, 0.35
BAR_PX, MAX_BAR_PX = 38.0, 46.0  # of a rail's bar at full scale, and of a whisker at most: then come words
ROLLING_SHARE = 5.0 / 7.0  # of a force on a rolling ball that accelerates it
MINUS_SIGN = "\N{MINUS SIGN}"
RAIL_TURNS = {"+x": 90, "-x": -90, "+y": 0, "-y": 0}  # of its words [degrees]


@dataclass(frozen=True)
class Scale:
    """What full marks stand for, the same in pictures to compare."""

    acceleration: float  # of the legend's arrow, and of full colour [m/s^2]
    rail: float  # of a bar of full length [1]


@dataclass(frozen=True)
class ClothPicture:
    """Shapes in pixels, y downwards."""

    name: str  # unique in a page
    title: str
    width: float
    height: float  # of the table, without the legend
    cloth: tuple[float, float, float, float]  # x, y, width, height
    pockets: tuple[tuple[float, float], ...]
    colours: tuple[dict[str, Any], ...]  # x, y, width, height, slower, opacity, words
    hatched: tuple[tuple[float, float, float, float], ...]
    arrows: tuple[dict[str, Any], ...]  # x1, y1, x2, y2, head, opacity, words
    bars: tuple[dict[str, Any], ...]  # of the rails
    legend_arrow: float  # its length
    legend: tuple[tuple[str, str], ...] = ()  # what of, with words


def cloth_pictures(models: Sequence[tuple[str, Lacking]], table: Table) -> list[ClothPicture]:
    """Pictures of models on one scale, that of the first; none where no ball rolled."""
    drawn = [
        (title, seen.cloth.found, seen.rails.found if seen.rails else None)
        for title, seen in models
        if seen.cloth is not None
    ]
    if not drawn:
        return []
    scale = _scale(*drawn[0][1:])
    found = [_picture(f"{k}", *one, scale, table) for k, one in enumerate(drawn)]
    colours, bars = any(one.colours for one in found), any(bar["kind"] != "same" for one in found for bar in one.bars)
    size = 1e3 * scale.acceleration
    rows = [
        ("arrows", f"{size:g} mm/s², as on a slope of {size / ROLLING_SHARE / GRAVITY:.2g} mm in a metre"),
        *([("colours", f"{size:g} mm/s²")] if colours else []), *([("bars", "")] if bars else []), ("hatched", ""),
    ]  # fmt: skip
    legends = [[*rows, *_everywhere(field)] for _, field, _ in drawn]
    most = max(len(legend) for legend in legends)  # as many lines in each, so that pictures to compare are as large
    filled = [(*legend, *[("words", "")] * (most - len(legend))) for legend in legends]
    return [replace(one, legend=legend) for one, legend in zip(found, filled, strict=True)]


def _everywhere(field: ClothField) -> list[tuple[str, str]]:
    """What is alike all over the cloth, in words; none where it is less than its uncertainty."""
    value, sd = field.everywhere
    if abs(value) <= SDS_OF_95_PERCENT * sd:
        return []
    return [("words", f"everywhere: slows by {_mm(abs(value), sd)} {'more' if value < 0 else 'less'} than modelled")]


def _scale(field: ClothField, rails: Rails | None) -> Scale:
    """A round number up to the largest that is known, but not below what a good table may have.

    One number is of arrows and of colours, so that what hardly counts beside the other looks small. A good table slopes
    as fitters leave it, and its cushions are as published ones.
    """
    usual = TYPICAL_RANGES["cushion_impact.restitution"]
    push, push_sd = _arrow_cells(field)
    size, change = np.hypot(push[..., 0], push[..., 1]), np.abs(field.change)
    known = [size[size > CIRCLE_95 * push_sd], change[change > SDS_OF_95_PERCENT * field.change_sd]]
    largest = max([ROLLING_SHARE * GRAVITY * FITTERS_SLOPE_RAD, *np.concatenate(known).tolist()])
    bars = np.abs(rails.value)[np.abs(rails.value) > SDS_OF_95_PERCENT * rails.sd].tolist() if rails else []
    return Scale(round_down(largest), max([(usual.high - usual.low) / 2, *bars]))


def _arrow_cells(field: ClothField) -> tuple[Array, Array]:
    """The push in the squares of arrows (nx, ny, 2), and its standard deviation (nx, ny)."""
    nx, ny = (n // CELLS_AN_ARROW for n in field.change.shape)
    push = field.push.reshape(nx, CELLS_AN_ARROW, ny, CELLS_AN_ARROW, 2).mean(axis=(1, 3))
    return push, field.push_sd.reshape(nx, CELLS_AN_ARROW, ny, CELLS_AN_ARROW).mean(axis=(1, 3))


def _picture(name: str, title: str, field: ClothField, rails: Rails | None, scale: Scale, table: Table) -> ClothPicture:
    width = WIDTH_PX - 2 * RIM_PX
    height = width * table.width / table.length
    nx, ny = field.change.shape
    cell = (width / nx, height / ny)

    def corner(i: int, j: int) -> tuple[float, float]:
        return RIM_PX + i * cell[0], RIM_PX + (ny - 1 - j) * cell[1]

    hides = (CIRCLE_95 * field.push_sd > scale.acceleration) | (
        SDS_OF_95_PERCENT * field.change_sd > scale.acceleration
    )
    unknown = ~field.crossed | hides
    colours, hatched = [], []
    for i, j in np.ndindex(nx, ny):
        value, sd, (x, y) = float(field.change[i, j]), float(field.change_sd[i, j]), corner(i, j)
        if unknown[i, j]:
            hatched.append((x, y, *cell))
        if abs(value) > SDS_OF_95_PERCENT * sd:
            opacity = MAX_OPACITY * min(1.0, abs(value) / scale.acceleration)
            colours.append({
                "x": x, "y": y, "width": cell[0], "height": cell[1], "slower": value < 0,
                "opacity": opacity,
                "words": f"slows {_mm(abs(value), sd)} {'more' if value < 0 else 'less'} than elsewhere",
            })  # fmt: skip
    return ClothPicture(
        name, title, WIDTH_PX, height + 2 * RIM_PX, (RIM_PX, RIM_PX, width, height), _pockets(table, width, height),
        tuple(colours), tuple(hatched), tuple(_arrows(field, scale, unknown, width, height)),
        tuple(_bars(rails, scale.rail, width, height)), LEGEND_ARROW * width * CELLS_AN_ARROW / nx,
    )  # fmt: skip


def _arrows(
    field: ClothField, scale: Scale, unknown: NDArray[np.bool_], width: float, height: float
) -> list[dict[str, Any]]:
    push, push_sd = _arrow_cells(field)
    nx, ny = push_sd.shape
    doubtful = unknown.reshape(nx, CELLS_AN_ARROW, ny, CELLS_AN_ARROW).mean(axis=(1, 3)) > 0.5
    side = width / nx
    found = []
    for i, j in np.ndindex(nx, ny):
        (px, py), sd = push[i, j], float(push_sd[i, j])
        size = math.hypot(px, py)
        length = LEGEND_ARROW * side / scale.acceleration
        if size <= CIRCLE_95 * sd or length * size < MIN_ARROW_PX:
            continue
        x, y = RIM_PX + (i + 0.5) * side, RIM_PX + (ny - j - 0.5) * height / ny
        dx, dy = length * px, -length * py
        found.append({
            "x1": x - dx / 2, "y1": y - dy / 2, "x2": x + dx / 2, "y2": y + dy / 2,
            "opacity": FAINT_OPACITY if doubtful[i, j] else 1.0, "words": f"push of {_mm(size, sd)}",
        })  # fmt: skip
    return found


def _bars(rails: Rails | None, full: float, width: float, height: float) -> list[dict[str, Any]]:
    """A bar along each rail from its middle: to one side where balls leave it faster, to the other where slower."""
    if rails is None:
        return []
    middles = {
        "+x": (1.5 * RIM_PX + width, RIM_PX + height / 2), "-x": (0.5 * RIM_PX, RIM_PX + height / 2),
        "+y": (RIM_PX + width / 2, 0.5 * RIM_PX), "-y": (RIM_PX + width / 2, 1.5 * RIM_PX + height),
    }  # fmt: skip
    found = []
    for name, value, sd in zip(rails.names, rails.value.tolist(), rails.sd.tolist(), strict=True):
        unit = BAR_PX / full
        known = abs(value) > SDS_OF_95_PERCENT * sd
        found.append({
            "x": middles[name][0], "y": middles[name][1], "turn": RAIL_TURNS[name],
            "length": float(np.clip(unit * value, -MAX_BAR_PX, MAX_BAR_PX)),
            "low": max(-MAX_BAR_PX, unit * (value - SDS_OF_95_PERCENT * sd)),
            "high": min(MAX_BAR_PX, unit * (value + SDS_OF_95_PERCENT * sd)),
            "kind": ("slower" if value < 0 else "faster") if known else "same",
            "words": f"{MINUS_SIGN if value < 0 else '+'}{value_with_sd(100 * abs(value), 100 * sd)} %",
        })  # fmt: skip
    return found


def _pockets(table: Table, width: float, height: float) -> tuple[tuple[float, float], ...]:
    if not table.pockets:
        return ()
    return tuple((RIM_PX + a * width, RIM_PX + b * height) for a in (0, 0.5, 1) for b in (0, 1))


def _mm(value: float, sd: float) -> str:
    return f"{value_with_sd(1e3 * value, 1e3 * sd)} mm/s²"
