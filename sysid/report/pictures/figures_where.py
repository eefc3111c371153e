"""Figures of where a model misses and what it lacks: maps of the table, and accelerations by variable."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from models.report.axes import round_down
from models.report.chart import HELD_OUT, MODEL, Chart, axis, line_at, table_map
from models.report.numbers import SDS_OF_95_PERCENT
from sysid.estimation.fitted import MISS_OVER_AXIS
from sysid.report.pictures.figures import MIN_BIN_SAMPLES, Array, band_of, is_moving
from sysid.residuals.bins import Variable, variables
from sysid.residuals.comparison import Comparison
from sysid.residuals.functions.curves import Curve
from sysid.residuals.significance import Departure

CELLS_ALONG = 20  # of the map of misses, along the longer side of the table
PLOTTED_VARIABLES = ("speed", "heading", "sidespin", "time", "time since event", "clip order")
PHASE_COLOURS = (("rolling balls", MODEL), ("sliding balls", HELD_OUT))
LACKING_COLOURS = (HELD_OUT, MODEL)  # of the first model and the last


def misses_map(comparison: Comparison) -> Chart | None:
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
    magnify = round_down(0.9e3 * side / (float(np.quantile(np.hypot(*arrows.T), 0.9)) or 1.0))
    floor = 1e3 * MISS_OVER_AXIS * comparison.noise_m if comparison.noise_m > 0 else 0.0
    top = max(float(np.nanquantile(rms, 0.95)), 4 * floor, 1e-9)
    texts = [f"mean miss {dx:+.3g} mm along x, {dy:+.3g} mm along y" for dx, dy in arrows]
    found = {"tails": tails, "heads": tails + 1e-3 * magnify * arrows, "texts": texts}
    title = f"Misses; arrows: mean of the cell, drawn ×{magnify:g}"
    return table_map("misses", title, table, rms.reshape(cells), top, "rms miss in the cell [mm]", found)


def _by_group(comparison: Comparison) -> dict[tuple[str, str, str], Departure]:
    """Departures between impacts, by variable, group and quantity."""
    return {(d.variable, d.group, d.quantity): d for d in comparison.local.groups if d.of == "motion"}


def _variables(comparison: Comparison) -> tuple[Variable, ...]:
    return variables(comparison.segment_samples, comparison.clip_set.table, len(comparison.clips))


def lacking_curve_chart(curves: Sequence[tuple[str, Curve]]) -> Chart:
    """What one model lacks over a variable, or what several do, the first of them with its groups of residuals.

    Args:
        curves: (label, curve) of the same residuals, from the poorest model to the best.
    """
    one = curves[0][1]
    unit, times = ("mm/s²", 1e3) if one.of == "motion" else ("% of the approach", 100.0)
    data: list[dict[str, Any]] = []
    for (name, curve), colour in zip(curves, LACKING_COLOURS[-len(curves) :], strict=True):
        low, high = (
            times * (curve.value - SDS_OF_95_PERCENT * curve.sd),
            times * (curve.value + SDS_OF_95_PERCENT * curve.sd),
        )
        band = np.column_stack([curve.at, low, times * curve.value, high])
        data += [
            {**trace, "showlegend": "name" in trace and trace["name"] == name}
            for trace in band_of(band, "95 %", name, colour, marked=False)
        ]
        at, value, sd = curve.data.T
        bars = SDS_OF_95_PERCENT * times * sd
        data.append({
            "type": "scatter", "mode": "markers", "showlegend": False, "x": at, "y": times * value,
            "error_y": {"type": "data", "array": bars, "color": colour, "thickness": 1.4, "width": 3},
            "marker": {"color": colour, "size": 7}, "hovertemplate": "%{y:.3g}<extra></extra>",
        })  # fmt: skip
    what = "acceleration" if one.of == "motion" else "velocity"
    sense = "to the left" if "across" in one.quantity else "faster"
    title = f"{one.name[0].upper()}{one.name[1:]}: missing {one.quantity}, by {one.variable}"
    layout = {
        "xaxis": axis(f"{one.variable} [{one.unit}]", zeroline=False),
        "yaxis": axis(f"missing {what}, + is {sense} [{unit}]", zeroline=True),
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "traceorder": "normal"},
    }
    return Chart("lacking-most-" + one.of, title, tuple(data), layout, 360)


def lacking_charts(comparison: Comparison) -> list[Chart]:
    """Accelerations that the model lacks against each variable, with two standard deviations; none without any."""
    known = _by_group(comparison)
    by_name = {v.name: v for v in _variables(comparison)}
    found: list[Chart] = []
    for name in PLOTTED_VARIABLES:
        if name in by_name and known:
            chart = _lacking_chart(known, by_name[name], len(found) == 0)
            found += [chart] if chart else []
    return found


def _lacking_chart(known: dict[tuple[str, str, str], Departure], v: Variable, legend: bool) -> Chart | None:
    """One variable: along and across the motion, of rolling and of sliding balls."""
    data: list[dict[str, Any]] = []
    ticks = [_tick(v, words) for words in v.words]
    shifts = iter((-0.18, -0.06, 0.06, 0.18))
    for who, colour in PHASE_COLOURS:
        for quantity, symbol in (("along", "circle"), ("across", "square-open")):
            shift = next(shifts)
            rows = [
                (k + shift, 1e3 * d.value, 2e3 * d.sd)
                for k, words in enumerate(v.words)
                for d in [known.get((v.name, f"{who} {words}", f"acceleration {quantity}"))]
                if d is not None and math.isfinite(d.sd)
            ]
            if rows:
                at, value, bar = (list(column) for column in zip(*rows, strict=True))
                data.append({
                    "type": "scatter", "mode": "markers", "name": f"{who}, {quantity}", "x": at, "y": value,
                    "error_y": {"type": "data", "array": bar, "color": colour, "thickness": 1.4, "width": 3},
                    "marker": {"color": colour, "symbol": symbol, "size": 7},
                    "hovertemplate": "%{y:.3g} mm/s²<extra></extra>",
                })  # fmt: skip
    if not data:
        return None
    data.append(line_at(0.0, "a good model", (-0.5, len(ticks) - 0.5)))
    layout = {
        "xaxis": axis(f"{v.name} [{_unit(v)}]", tickvals=list(range(len(ticks))), ticktext=ticks, zeroline=False,
                      range=[-0.5, len(ticks) - 0.5]),
        "yaxis": axis("missing acceleration [mm/s²]"), "showlegend": legend,
    }  # fmt: skip
    return Chart(f"lacking-{v.name.replace(' ', '-')}", f"By {v.name}", tuple(data), layout, 300)


def _unit(v: Variable) -> str:
    return {"heading": "direction on the table", "clip order": "clips"}.get(v.name, v.unit)


def _tick(v: Variable, words: str) -> str:
    """A group's label under the axis."""
    for start in ("at ", "with sidespin ", "heading ", "in clips "):
        words = words.removeprefix(start)
    words = words.split(" s after")[0].removesuffix(f" {v.unit}")
    words = words if "-" in words else words.replace(" to ", "–")
    return words.replace("over ", "> ").replace("below ", "< ")
