"""Pictures of what a model lacks: accelerations by place and by variable, and whether the rest is noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sysid.report.drawing import HELD_OUT, INK, MODEL, NOISE, WIDTH, svg
from sysid.report.plots import draw_table
from sysid.residuals.bins import TABLE_CELLS, Variable, variables
from sysid.residuals.comparison import Comparison
from sysid.residuals.significance import Departure

SHOWN = ("speed", "heading", "sidespin", "time", "time since event", "clip order")
PHASES = (("rolling balls", MODEL), ("sliding balls", HELD_OUT))
TOP = 8.0  # standard deviations at which the map's colours end


def _of(comparison: Comparison) -> dict[tuple[str, str, str], Departure]:
    """Groups by variable, words and quantity."""
    return {(d.variable, d.group, d.quantity): d for d in comparison.local.groups if d.of == "motion"}


def _variables(comparison: Comparison) -> tuple[Variable, ...]:
    return variables(comparison.segment_samples, comparison.clip_set.table, len(comparison.clips))


def missing_map_svg(comparison: Comparison) -> str | None:
    """Acceleration of rolling balls that the model lacks as arrows, its z as colour; None without a cell."""
    known, table = _of(comparison), comparison.clip_set.table
    place = next(v for v in _variables(comparison) if v.name == "place")
    size = np.array([table.length, table.width]) / TABLE_CELLS
    pull, z, at = [], np.full(TABLE_CELLS, np.nan), []
    for k, words in enumerate(place.words):
        own = [known.get(("place", f"rolling balls {words}", f"acceleration {axis}")) for axis in "xy"]
        if own[0] is not None and own[1] is not None:
            cell = divmod(k, TABLE_CELLS[1])
            z[cell] = max(abs(own[0].z), abs(own[1].z))
            pull.append([1e3 * own[0].value, 1e3 * own[1].value])
            at.append((np.array(cell) + 0.5) * size - [table.length / 2, table.width / 2])
    if not pull:
        return None
    sizes = np.hypot(*np.array(pull).T)
    typical = float(np.median(sizes)) or 1.0
    few = float(np.quantile(sizes, 0.9)) or 1.0
    key = float(f"{typical:.0e}")

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        draw_table(ax, table, dark=False)
        x, y = (
            np.linspace(-h, h, n + 1) for h, n in zip((table.length / 2, table.width / 2), TABLE_CELLS, strict=True)
        )
        mesh = ax.pcolormesh(x, y, z.T, cmap="YlOrRd", vmin=0, vmax=TOP, alpha=0.85, zorder=2)
        own = {"angles": "xy", "scale_units": "xy", "scale": few / (0.7 * size.min()), "width": 0.003}
        shown = np.array(pull) * np.minimum(1.0, 1.3 * few / np.maximum(sizes, 1e-12))[:, None]
        quiver = ax.quiver(*np.array(at).T, *shown.T, color=INK, zorder=5, pivot="mid", **own)
        ax.quiverkey(quiver, 0.84, 1.025, key, f"{key:g} mm/s²", labelpos="E", coordinates="axes", labelsep=0.08)
        ax.set_title("Rolling balls: acceleration that the model lacks")
        bar = fig.colorbar(mesh, ax=ax, extend="max", shrink=0.75, pad=0.01)
        bar.set_label("z, the larger of x and y [standard deviations]")

    return svg("missing map", 0.88 * WIDTH * (table.width + 0.5) / (table.length + 0.45) + 0.3, draw)


def missing_svg(comparison: Comparison) -> str | None:
    """Accelerations that the model lacks against each variable, with two standard deviations; None without any."""
    known = _of(comparison)
    shown = [v for name in SHOWN for v in _variables(comparison) if v.name == name]
    if not known or not shown:
        return None

    def draw(fig: Any) -> None:
        grid = fig.subplots(len(shown), 2, squeeze=False)
        for (left, right), v in zip(grid, shown, strict=True):
            for ax, quantity in ((left, "along"), (right, "across")):
                for shift, (who, colour) in zip((-0.08, 0.08), PHASES, strict=True):
                    rows = [
                        (k + shift, 1e3 * d.value, 2e3 * d.sd)
                        for k, words in enumerate(v.words)
                        for d in [known.get((v.name, f"{who} {words}", f"acceleration {quantity}"))]
                        if d is not None
                    ]
                    if rows:
                        at, value, sd = np.array(rows).T
                        ax.errorbar(at, value, sd, fmt="o", ms=3.5, lw=1.2, capsize=2.5, color=colour, label=who)
                ax.axhline(0, color=NOISE, lw=1, ls="--")
                ax.set_yscale("symlog", linthresh=10)
                ax.set_xticks(range(len(v.words)), [_tick(v, w) for w in v.words])
                ax.set_xlim(-0.5, len(v.words) - 0.5)
                ax.set(title=f"{v.name.capitalize()}: {quantity} the way", xlabel=f"{v.name} [{_unit(v)}]")
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


def white_svg(comparison: Comparison) -> str | None:
    """Autocorrelation of whole shots' residuals with white noise's band; None without samples."""
    white = comparison.white
    value = np.array(white.autocorrelation)
    if not white.samples or not math.isfinite(float(value[0])):
        return None

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        lag = np.arange(1, len(value) + 1)
        band = np.array(white.band)
        ax.fill_between(lag, -band, band, color="#d5dade", lw=0, label="white noise: 95 %")
        ax.bar(lag, value, 0.7, color=MODEL, label="this model")
        ax.axhline(0, color=INK, lw=0.8)
        ax.set(xlabel="lag [samples]", ylabel="autocorrelation [1]", xlim=(0, len(value) + 1))
        ax.set_ylim(min(-0.2, float(np.nanmin(value)) - 0.05), 1.05)
        ax.legend(loc="upper right", ncols=2)
        ax.grid(axis="y")
        ax.set_axisbelow(True)

    return svg("white", 2.6, draw)
