"""Pictures of a comparison as SVG, the same bytes for the same values.

A sample's miss is the distance between model and measurement. With independent normal noise of standard deviation
sigma per axis and nothing else, miss / sigma follows the Rayleigh distribution: its root mean square is sqrt(2), its
quantile at p is sqrt(-2 ln(1 - p)). The pictures show that as the look of a perfect model. Left out: that neighbouring
samples of a clip share its fitted unknowns, which makes a perfect model's misses a little smaller still.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.recording.palette import CLOTH_COLOUR, CUSHION_COLOUR, POCKET_COLOUR, RAIL_COLOUR, ball_colour
from models.shot import POCKET_MOUTH, Table
from sysid.clips.faults import one_line
from sysid.report.drawing import HELD_OUT, INK, MODEL, NOISE, SHOWN, WIDTH, svg
from sysid.residuals.comparison import Comparison
from sysid.residuals.samples import Samples

Array = NDArray[np.float64]

FLOOR = math.sqrt(2.0)  # rms miss of a perfect model over the noise per axis
RAYLEIGH = tuple(math.sqrt(-2.0 * math.log(1.0 - p)) for p in (0.1, 0.5, 0.9))
DOTS = 140  # most dots of one ball in a track picture
FEWEST = 5  # samples that a bin needs


@dataclass(frozen=True)
class Rung:
    """One model of the error ladder; distances are roots of mean squares over moving balls and clips."""

    label: str
    rms_m: float  # over the clips used for the model's constants; over all where none is held out
    held_out_rms_m: float = math.nan  # over the others
    chi2_reduced: float = math.nan
    note: str = ""


def ladder_svg(rungs: Sequence[Rung], noise_m: float) -> str | None:
    """The models' rms miss on a logarithmic axis against the noise floor; None without a number."""
    values = 1e3 * np.array([[r.rms_m, r.held_out_rms_m] for r in rungs], dtype=float).reshape(-1, 2)
    good = np.isfinite(values) & (values > 0)
    if not good.any():
        return None
    floor = 1e3 * FLOOR * noise_m
    low = min(values[good].min(), floor if floor > 0 else math.inf) / 2

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        rows, plain = np.arange(len(rungs)), {"fc": "white", "ec": "none", "pad": 0.8}
        ax.barh(
            rows,
            np.where(good[:, 0], values[:, 0] - low, 0.0),
            left=low,
            height=0.52,
            color=MODEL,
            label="clips used for the constants",
        )
        if good[:, 1].any():
            ax.plot(values[good[:, 1], 1], rows[good[:, 1]], "D", ms=5.5, mfc="white", mec=HELD_OUT, mew=1.6,
                    ls="", label="held-out clips")  # fmt: skip
        if floor > 0:
            ax.axvline(floor, color=INK, ls="--", lw=1.1, label=f"noise floor {number(floor)} mm")
        for row, value in enumerate(values):
            if good[row, 0]:
                right = max(value[good[row]])
                text = f"{number(value[0])} mm" + (f", held out {number(value[1])}" if good[row, 1] else "")
                ax.annotate(text, (right, row), (8, 0), textcoords="offset points", va="center", bbox=plain)
        ax.set(xscale="log", xlim=(low, 5 * values[good].max()), xlabel="rms distance, model to measurement [mm]")
        ax.set_yticks(rows, [_short(r.label, 44) for r in rungs], parse_math=False)
        ax.set_ylim(len(rungs) - 0.4, -0.6)
        _log_ticks(ax.xaxis)
        ax.tick_params(axis="y", length=0)
        ax.grid(axis="x")
        ax.set_axisbelow(True)
        fig.legend(loc="outside upper right", ncols=3)

    return svg("ladder", 1.1 + 0.34 * len(rungs), draw)


def tracks_svg(comparison: Comparison, count: int = 6) -> str | None:
    """The worst clips and the most typical ones from above: measured dots, modelled lines; None without a track."""
    rows = {row.file: row for row in comparison.clips}
    ranked = [k for k, shot in enumerate(comparison.shots) if shot.file in rows and k < len(comparison.tracks)]
    ranked = [k for k in ranked if math.isfinite(rows[comparison.shots[k].file].struck_rms_m)]
    ranked.sort(key=lambda k: -rows[comparison.shots[k].file].struck_rms_m)
    if not ranked:
        return None
    chosen = [(k, "") for k in ranked]
    if len(ranked) > count:
        worst, middle = (count + 1) // 2, len(ranked) // 2
        start = max(worst, middle - (count - worst) // 2)
        chosen = [(k, "worst") for k in ranked[:worst]] + [
            (k, "typical") for k in ranked[start : start + count - worst]
        ]
    table, ball = comparison.clip_set.table, comparison.clip_set.ball
    lines = (len(chosen) + 1) // 2

    def panel(ax: Any, k: int, kind: str) -> None:
        shot, track = comparison.shots[k], comparison.tracks[k]
        row = rows[shot.file]
        draw_table(ax, table, dark=True)
        for name, seen in shot.balls.items():
            colour = [c / 255 for c in ball_colour(name)]
            xy = seen.xy[np.isfinite(seen.xy).all(axis=1)]
            moved = xy[np.concatenate([[True], np.hypot(*np.diff(xy, axis=0).T) > 5e-4])] if len(xy) else xy
            few = moved[:: max(1, math.ceil(len(moved) / DOTS))]
            ax.plot(*few.T, ".", ms=3.4, mec="none", color=colour, zorder=6)
            for place in xy[-1:]:
                ax.add_patch(_circle(place, ball.radius, fc=colour, ec="black", lw=0.4, zorder=4))
        for i in range(len(track.names)):
            path = track.position[np.isfinite(track.position[:, i]).all(axis=1), i]
            if len(path):
                ax.plot(*path.T, color=SHOWN, lw=0.9, zorder=5)
                ax.add_patch(_circle(path[-1], 1.15 * ball.radius, fc="none", ec=SHOWN, lw=1.1, zorder=7))
        title = f"{_short(PurePosixPath(shot.file).stem, 24)}: struck ball {number(1e3 * row.struck_rms_m)} mm rms"
        title = f"{kind.capitalize()} · {title}" if kind else title
        ax.set_title(title + (" · held out" if row.held_out else ""), parse_math=False)

    def draw(fig: Any) -> None:
        grid = fig.subplots(lines, 2, squeeze=False).ravel()
        for ax, (k, kind) in zip(grid, chosen, strict=False):
            panel(ax, k, kind)
        for ax in grid[len(chosen) :]:
            ax.set_axis_off()

    height = WIDTH / 2 * (table.width + 0.55) / (table.length + 0.45)
    return svg("tracks", lines * min(height, 6.0) + 0.1, draw)


def map_svg(comparison: Comparison) -> str | None:
    """Rms miss of moving balls as colour and mean miss as arrows, cell by cell; None without a sample."""
    samples, table = comparison.samples, comparison.clip_set.table
    moving = _moving(samples) & np.isfinite(samples.xy).all(axis=1) & np.isfinite(samples.residual).all(axis=1)
    half, side = np.array([table.length, table.width]) / 2, max(table.length, table.width) / 20
    cells = np.maximum(1, np.round(2 * half / side).astype(int))
    place = np.clip(((samples.xy[moving] + half) / (2 * half) * cells).astype(int), 0, cells - 1)
    flat = place[:, 0] * cells[1] + place[:, 1]
    counts = np.bincount(flat, minlength=int(cells.prod()))
    used = counts >= FEWEST
    if not used.any():
        return None

    def mean(values: Array) -> Array:
        return np.bincount(flat, values, used.size) / np.where(used, counts, 1)

    miss = 1e3 * samples.residual[moving]
    rms = np.where(used, np.sqrt(mean((miss**2).sum(axis=1))), np.nan)
    arrows = np.column_stack([mean(miss[:, 0]), mean(miss[:, 1])])[used]
    typical = float(np.quantile(np.hypot(*arrows.T), 0.9)) or 1.0
    magnify = _round_down(0.9e3 * side / typical)
    key = _round_down(typical)

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        draw_table(ax, table, dark=False)
        x, y = (np.linspace(-h, h, n + 1) for h, n in zip(half, cells, strict=True))
        top = max(
            float(np.nanquantile(rms, 0.95)), 4e3 * FLOOR * comparison.noise_m if comparison.noise_m > 0 else 0.0, 1e-9
        )
        mesh = ax.pcolormesh(x, y, rms.reshape(cells).T, cmap="YlOrRd", vmin=0, vmax=top, alpha=0.85, zorder=2, lw=0.3)
        tails = np.stack(np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2, indexing="ij"), axis=-1)
        own = {"angles": "xy", "scale_units": "xy", "scale": 1e3 / magnify, "width": 0.0022, "color": INK, "zorder": 5}
        quiver = ax.quiver(*tails.reshape(-1, 2)[used].T, *arrows.T, **own)
        ax.set_title(f"Arrows: mean miss of the cell, drawn ×{magnify:g}")
        ax.quiverkey(quiver, 0.86, 1.025, key, f"{key:g} mm", labelpos="E", coordinates="axes", labelsep=0.08)
        bar = fig.colorbar(mesh, ax=ax, extend="max", shrink=0.75, pad=0.01)
        bar.set_label("rms miss in the cell [mm]")
        if 0 < 1e3 * FLOOR * comparison.noise_m < top:
            bar.ax.axhline(1e3 * FLOOR * comparison.noise_m, color=INK, lw=1.3)

    return svg("map", 0.88 * WIDTH * (table.width + 0.5) / (table.length + 0.45) + 0.3, draw)


def dependence_svg(comparison: Comparison) -> str | None:
    """Miss over noise against time, speed, heading, sidespin, events so far; None without samples or noise."""
    s, noise = comparison.samples, comparison.noise_m
    if not noise > 0 or not len(s.time):
        return None
    ratio, moving = np.hypot(*s.residual.T) / noise, _moving(s)
    everywhere = np.ones_like(moving)
    panels: tuple[tuple[str, str, Array, NDArray[np.bool_]], ...] = (
        ("Time since the start", "time [s]", s.time, everywhere),
        ("Speed", "speed [m/s]", s.speed, moving),
        ("Heading", "heading from +x [degrees]", (np.degrees(s.heading) + 180) % 360 - 180, moving),
        ("Sidespin", "sidespin [rad/s], + is right", s.spin, moving),
        ("Events so far", "events [count]", s.events.astype(float), everywhere),
    )

    def draw(fig: Any) -> None:
        grid = fig.subplots(2, 3).ravel()
        bands = [_binned(x[use], ratio[use]) for _, _, x, use in panels]
        ends = np.concatenate([band[:, 1:].ravel() for band in bands] + [np.array([0.35, 3.0])])
        for ax, (title, label, _, _), band in zip(grid, panels, bands, strict=False):
            ax.axhspan(RAYLEIGH[0], RAYLEIGH[2], color="#d5dade", lw=0, label="perfect model: 10–90 %")
            ax.axhline(RAYLEIGH[1], color=NOISE, lw=1, ls="--", label="perfect model: median")
            ax.fill_between(*band[:, [0, 1, 3]].T, color=MODEL, alpha=0.25, lw=0, label="this model: 10–90 %")
            ax.plot(*band[:, [0, 2]].T, "-o", color=MODEL, ms=3, lw=1.3, label="this model: median")
            ax.set(title=title, xlabel=label, yscale="log", ylim=(0.8 * ends[ends > 0].min(), 1.25 * ends.max()))
            _log_ticks(ax.yaxis)
            ax.grid(axis="y")
        for ax in grid[[0, 3]]:
            ax.set_ylabel("miss / noise [1]")
        grid[2].set_xticks([-180, -90, 0, 90, 180])
        grid[4].locator_params(axis="x", integer=True)
        fig.legend(*grid[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
        _draw_signed(grid[5], s, moving & np.isfinite(s.heading))

    return svg("dependence", 5.7, draw)


def _draw_signed(ax: Any, s: Samples, use: NDArray[np.bool_]) -> None:
    """Miss along and across the way of the ball against time."""
    (x, y), cos, sin = s.residual[use].T, np.cos(s.heading[use]), np.sin(s.heading[use])
    for label, colour, value in (
        ("along: + model ahead", "#17806d", x * cos + y * sin),
        ("across: + model left", "#9c3f8f", y * cos - x * sin),
    ):
        band = _binned(s.time[use], 1e3 * value)
        ax.fill_between(*band[:, [0, 1, 3]].T, color=colour, alpha=0.2, lw=0)
        ax.plot(*band[:, [0, 2]].T, color=colour, lw=1.3, label=label)
    ax.axhline(0, color=NOISE, lw=1, ls="--")
    ax.set(title="Along and across the ball's way", xlabel="time [s]", ylabel="miss [mm]")
    ax.grid(axis="y")
    ax.margins(y=0.3)
    ax.legend(loc="upper left", fontsize=7.5)


def spread_svg(comparison: Comparison) -> str | None:
    """Segments' residual over noise as a histogram, clips' struck-ball rms as sorted bars; None without either."""
    ratios = np.array([s.ratio for s in comparison.segments], dtype=float)
    ratios = ratios[np.isfinite(ratios) & (ratios > 0)]
    clips = sorted((1e3 * c.struck_rms_m, c.held_out) for c in comparison.clips if math.isfinite(c.struck_rms_m))
    if not len(ratios) and not clips:
        return None

    def draw(fig: Any) -> None:
        left, right = fig.subplots(1, 2, width_ratios=[2, 3])
        if len(ratios):
            low, high = min(0.4, ratios.min()), max(4.0, ratios.max())
            left.hist(ratios, np.geomspace(0.99 * low, 1.01 * high, 36), color=MODEL, ec="white", lw=0.4)
            middle = float(np.median(ratios))
            left.axvline(middle, color=MODEL, lw=1.4, label=f"median {number(middle)}")
        left.axvline(1.0, color=INK, lw=1.2, ls="--", label="noise alone")
        left.set(xscale="log", xlabel="rms residual / noise [1]", ylabel="segments [count]")
        left.set_title(f"{len(ratios)} segments between events")
        _log_ticks(left.xaxis)
        left.legend()
        right.set_title(f"{len(clips)} clips, the struck ball over the whole shot")
        right.set(xlabel="clips, best to worst [count]", ylabel="rms distance [mm]")
        if clips:
            values, held = np.array([c[0] for c in clips]), np.array([c[1] for c in clips])
            rank, middle = np.arange(1, len(clips) + 1), float(np.median(values))
            for label, colour, use in (("used for the constants", MODEL, ~held), ("held out", HELD_OUT, held)):
                if use.any():
                    right.bar(rank[use], values[use], 0.82, color=colour, label=label)
            right.axhline(middle, color=INK, lw=1.2, label=f"median {number(middle)} mm")
            if values.max() > 30 * middle > 0:
                right.set_yscale("log")
                _log_ticks(right.yaxis)
            else:
                right.set_ylim(0, 1.4 * values.max() or 1.0)
            right.legend(loc="upper left")
        for ax in (left, right):
            ax.grid(axis="y")
            ax.set_axisbelow(True)

    return svg("spread", 3.2, draw)


def number(value: float) -> str:
    """Three digits, a count whole, thousands apart; – where there is no number."""
    if not math.isfinite(value):
        return "–"
    if abs(value) >= 100 or isinstance(value, int):
        return f"{value:,.0f}".replace(",", "\u202f") if abs(value) >= 9999.5 else f"{value:.0f}"
    return f"{value:#.3g}" if abs(value) >= 0.01 else f"{value:.3g}"


def _moving(samples: Samples) -> NDArray[np.bool_]:
    return np.array([motion != "rest" for motion in samples.motion], dtype=bool)


def _binned(x: Array, y: Array, most: int = 14) -> Array:
    """Bins of about equal count: (n, 4) median x, then the 10, 50 and 90 % quantiles of y."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if not len(x):
        return np.empty((0, 4))
    values = np.unique(x)
    edges = values
    if len(values) > most:
        ends = np.quantile(x, np.linspace(0, 1, most + 1))
        place = np.floor((ends - ends[0]) / (ends[-1] - ends[0]) * 4 * most)
        edges = ends[:-1][np.diff(place, prepend=-1.0)[:-1] > 0]  # one bin where many would crowd
    index = np.searchsorted(edges, x, side="right") - 1
    groups = [index == k for k in range(len(edges))]
    rows = [[np.median(x[g]), *np.quantile(y[g], [0.1, 0.5, 0.9])] for g in groups if g.sum() >= FEWEST]
    return np.array(rows, dtype=float).reshape(-1, 4)


def draw_table(ax: Any, table: Table, *, dark: bool) -> None:
    """Rail, cushion, bed and pockets, with axes in metres; on a light bed the pockets alone are dark."""
    from matplotlib.patches import Rectangle

    colours = [tuple(c / 255 for c in colour) for colour in (RAIL_COLOUR, CUSHION_COLOUR, CLOTH_COLOUR)]
    light = ("#d9cfc6", "#c3d2c8", "#f3f6f4")
    half = np.array([table.length, table.width]) / 2
    for margin, colour in zip((0.11, 0.05, 0.0), colours if dark else light, strict=True):
        low, size = -half - margin, 2 * (half + margin)
        ax.add_patch(Rectangle(tuple(low), *size, fc=colour, ec="none", zorder=1))
    if table.pockets:
        centres = [(sx * half[0], sy * half[1]) for sx in (-1, 0, 1) for sy in (-1, 1)]
        for x, y in centres:
            deeper = (x + 0.015 * np.sign(x), y + (0.015 if x else 0.03) * np.sign(y))
            ax.add_patch(
                _circle(deeper, POCKET_MOUTH / 2, fc=tuple(c / 255 for c in POCKET_COLOUR), ec="none", zorder=3)
            )
    reach = half + 0.11
    ax.set(xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(length=2, labelsize=7.5)


def _log_ticks(axis: Any) -> None:
    """Plain numbers on a logarithmic axis: every decade, or 1, 2 and 5 of it where it spans few."""
    from matplotlib.ticker import LogLocator, NullLocator

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0,) if high > 300 * low else (1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(lambda value, _: f"{value:g}")


def _circle(centre: Any, radius: float, **style: Any) -> Any:
    from matplotlib.patches import Circle

    return Circle(tuple(centre), radius, **style)


def _round_down(value: float) -> float:
    """The largest 1, 2 or 5 times a power of ten up to a value."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-9)) * power:.0e}")


def _short(text: str, most: int) -> str:
    """A printable label of at most so many characters."""
    line = one_line(text)
    return line if len(line) <= most else line[: most - 1] + "…"
