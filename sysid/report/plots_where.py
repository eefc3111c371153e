"""Figures of where a model misses and what it lacks: maps of the table, and accelerations by variable."""

from __future__ import annotations

from typing import Any

import numpy as np

from models.report.axes import draw_table, round_down
from models.report.figure import FIGURE_WIDTH_IN, HELD_OUT_COLOUR, INK_COLOUR, MODEL_COLOUR, NOISE_COLOUR, svg
from models.shot import Table
from sysid.report.plots import MIN_BIN_SAMPLES, MISS_OVER_NOISE, Array, is_moving
from sysid.residuals.bins import TABLE_CELLS, Variable, variables
from sysid.residuals.comparison import Comparison
from sysid.residuals.significance import Departure

CELLS_ALONG = 20  # of the map of misses, along the longer side of the table
PLOTTED_VARIABLES = ("speed", "heading", "sidespin", "time", "time since event", "clip order")
PHASE_COLOURS = (("rolling balls", MODEL_COLOUR), ("sliding balls", HELD_OUT_COLOUR))
MAX_Z = 8.0  # at which the map's colours end [standard deviations]
LINEAR_TO_MM_S2 = 10  # an axis of accelerations is linear up to this and logarithmic beyond


def map_svg(comparison: Comparison) -> str | None:
    """Rms miss of moving balls as colour and mean miss as arrows, cell by cell; None without a sample."""
    samples, table = comparison.samples, comparison.clip_set.table
    use = is_moving(samples) & np.isfinite(samples.xy).all(axis=1) & np.isfinite(samples.residual).all(axis=1)
    half, side = np.array([table.length, table.width]) / 2, max(table.length, table.width) / CELLS_ALONG
    cells = np.maximum(1, np.round(2 * half / side).astype(int))
    place = np.clip(((samples.xy[use] + half) / (2 * half) * cells).astype(int), 0, cells - 1)
    flat = place[:, 0] * cells[1] + place[:, 1]
    counts = np.bincount(flat, minlength=int(cells.prod()))
    filled = counts >= MIN_BIN_SAMPLES
    if not filled.any():
        return None

    def mean(values: Array) -> Array:
        return np.bincount(flat, values, filled.size) / np.where(filled, counts, 1)

    miss = 1e3 * samples.residual[use]
    rms = np.where(filled, np.sqrt(mean((miss**2).sum(axis=1))), np.nan)
    arrows = np.column_stack([mean(miss[:, 0]), mean(miss[:, 1])])[filled]
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 2)
    tails = ((corners + 0.5) / cells * 2 - 1)[filled] * half
    typical = float(np.quantile(np.hypot(*arrows.T), 0.9)) or 1.0
    magnify = round_down(0.9e3 * side / typical)
    key = round_down(typical)
    floor = 1e3 * MISS_OVER_NOISE * comparison.noise_m if comparison.noise_m > 0 else 0.0
    top = max(float(np.nanquantile(rms, 0.95)), 4 * floor, 1e-9)

    def draw(fig: Any) -> None:
        ax, bar = _draw_cells(fig, table, rms.reshape(cells), top, "rms miss in the cell [mm]")
        style = {"angles": "xy", "scale_units": "xy", "scale": 1e3 / magnify, "width": 0.0022, "color": INK_COLOUR}
        quiver = ax.quiver(*tails.T, *arrows.T, **style, zorder=5)
        ax.set_title(f"Arrows: mean miss of the cell, drawn ×{magnify:g}")
        ax.quiverkey(quiver, 0.86, 1.025, key, f"{key:g} mm", labelpos="E", coordinates="axes", labelsep=0.08)
        if 0 < floor < top:
            bar.ax.axhline(floor, color=INK_COLOUR, lw=1.3)

    return svg("map", _map_height(table), draw)


def _draw_cells(fig: Any, table: Table, values: Array, top: float, label: str) -> tuple[Any, Any]:
    """Axes with the table, cells (nx, ny) coloured from 0 to `top`, and the colour bar."""
    ax = fig.subplots()
    draw_table(ax, table, dark=False)
    sizes = zip((table.length, table.width), values.shape, strict=True)
    x, y = (np.linspace(-size / 2, size / 2, n + 1) for size, n in sizes)
    mesh = ax.pcolormesh(x, y, values.T, cmap="YlOrRd", vmin=0, vmax=top, alpha=0.85, zorder=2, lw=0.3)
    bar = fig.colorbar(mesh, ax=ax, extend="max", shrink=0.75, pad=0.01)
    bar.set_label(label)
    return ax, bar


def _map_height(table: Table) -> float:
    """Of a figure with one table and a colour bar [inch]."""
    return 0.88 * FIGURE_WIDTH_IN * (table.width + 0.5) / (table.length + 0.45) + 0.3


def _by_group(comparison: Comparison) -> dict[tuple[str, str, str], Departure]:
    """Departures between impacts, by variable, group and quantity."""
    return {(d.variable, d.group, d.quantity): d for d in comparison.local.groups if d.of == "motion"}


def _variables(comparison: Comparison) -> tuple[Variable, ...]:
    return variables(comparison.segment_samples, comparison.clip_set.table, len(comparison.clips))


def missing_map_svg(comparison: Comparison) -> str | None:
    """Acceleration of rolling balls that the model lacks as arrows, its z as colour; None without a cell."""
    known, table = _by_group(comparison), comparison.clip_set.table
    place = next(v for v in _variables(comparison) if v.name == "place")
    size = np.array([table.length, table.width]) / TABLE_CELLS
    lacking, z, centres = [], np.full(TABLE_CELLS, np.nan), []
    for k, words in enumerate(place.words):
        x, y = (known.get(("place", f"rolling balls {words}", f"acceleration {axis}")) for axis in "xy")
        if x is not None and y is not None:
            cell = divmod(k, TABLE_CELLS[1])
            z[cell] = max(abs(x.z), abs(y.z))
            lacking.append([1e3 * x.value, 1e3 * y.value])
            centres.append((np.array(cell) + 0.5) * size - [table.length / 2, table.width / 2])
    if not lacking:
        return None
    sizes = np.hypot(*np.array(lacking).T)
    typical = float(np.median(sizes)) or 1.0
    large = float(np.quantile(sizes, 0.9)) or 1.0
    key = float(f"{typical:.0e}")

    def draw(fig: Any) -> None:
        ax, _ = _draw_cells(fig, table, z, MAX_Z, "z, the larger of x and y [standard deviations]")
        style = {"angles": "xy", "scale_units": "xy", "scale": large / (0.7 * size.min()), "width": 0.003}
        shown = np.array(lacking) * np.minimum(1.0, 1.3 * large / np.maximum(sizes, 1e-12))[:, None]
        quiver = ax.quiver(*np.array(centres).T, *shown.T, color=INK_COLOUR, zorder=5, pivot="mid", **style)
        ax.quiverkey(quiver, 0.84, 1.025, key, f"{key:g} mm/s²", labelpos="E", coordinates="axes", labelsep=0.08)
        ax.set_title("Rolling balls: acceleration that the model lacks")

    return svg("missing map", _map_height(table), draw)


def missing_svg(comparison: Comparison) -> str | None:
    """Accelerations that the model lacks against each variable, with two standard deviations; None without any."""
    known = _by_group(comparison)
    shown = [v for name in PLOTTED_VARIABLES for v in _variables(comparison) if v.name == name]
    if not known or not shown:
        return None

    def draw(fig: Any) -> None:
        grid = fig.subplots(len(shown), 2, squeeze=False)
        for (left, right), v in zip(grid, shown, strict=True):
            for ax, quantity in ((left, "along"), (right, "across")):
                for shift, (who, colour) in zip((-0.08, 0.08), PHASE_COLOURS, strict=True):
                    rows = [
                        (k + shift, 1e3 * d.value, 2e3 * d.sd)
                        for k, words in enumerate(v.words)
                        for d in [known.get((v.name, f"{who} {words}", f"acceleration {quantity}"))]
                        if d is not None
                    ]
                    if rows:
                        at, value, sd = np.array(rows).T
                        ax.errorbar(at, value, sd, fmt="o", ms=3.5, lw=1.2, capsize=2.5, color=colour, label=who)
                ax.axhline(0, color=NOISE_COLOUR, lw=1, ls="--")
                if np.abs(ax.get_ylim()).max() > LINEAR_TO_MM_S2:
                    ax.set_yscale("symlog", linthresh=LINEAR_TO_MM_S2)
                ax.set_xticks(range(len(v.words)), [_tick(v, w) for w in v.words])
                ax.set_xlim(-0.5, len(v.words) - 0.5)
                ax.set(title=f"{v.name.capitalize()}: {quantity} the motion", xlabel=f"{v.name} [{_unit(v)}]")
                ax.set_ylabel("missing [mm/s²]")
                ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
                ax.grid(axis="y")
        found = {label: h for ax in grid.ravel() for h, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        if found:
            fig.legend(list(found.values()), list(found), loc="outside upper center", ncols=2)

    return svg("missing", 1.75 * len(shown) + 0.4, draw)


def _unit(v: Variable) -> str:
    return {"heading": "direction on the table", "clip order": "clips"}.get(v.name, v.unit)


def _tick(v: Variable, words: str) -> str:
    """A group's label under the axis."""
    for start in ("at ", "with sidespin ", "heading ", "in clips "):
        words = words.removeprefix(start)
    words = words.split(" s after")[0].removesuffix(f" {v.unit}")
    words = words if "-" in words else words.replace(" to ", "–")
    return words.replace("over ", ">").replace("below ", "<")
