"""Figures of a comparison as SVG, the same bytes for the same values: whole shots, and how far the model misses.

A sample's miss is the distance between model and measurement. With independent normal noise of standard deviation
sigma per axis and nothing else, miss / sigma follows the Rayleigh distribution: its root mean square is sqrt(2), its
quantile at p is sqrt(-2 ln(1 - p)). The figures show that as the expectation of a perfect model. Left out: samples of
a clip share its fitted initial state, which makes a perfect model's misses a little smaller still.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.files.faults import one_line
from models.recording.palette import ball_colour
from models.report.axes import circle, draw_table, plain_log_ticks, rgb
from models.report.figure import (
    FIGURE_WIDTH_IN,
    HELD_OUT_COLOUR,
    INK_COLOUR,
    MODEL_COLOUR,
    NOISE_COLOUR,
    PATH_COLOUR,
    PERFECT_COLOUR,
    svg,
)
from models.report.numbers import number
from sysid.residuals.comparison import Comparison
from sysid.residuals.samples import Samples

Array = NDArray[np.float64]

MISS_OVER_NOISE = math.sqrt(2.0)  # rms miss of a perfect model over the noise per axis
RAYLEIGH_QUANTILES = tuple(math.sqrt(-2.0 * math.log(1.0 - p)) for p in (0.1, 0.5, 0.9))
MAX_DOTS = 140  # of one ball in the figure of shots
MIN_STEP_M = 5e-4  # a ball that moved less since the sample before gets no new dot
MIN_BIN_SAMPLES = 5
MAX_BINS = 14  # of a curve
LOG_BARS_FROM = 30  # worst over median clip from which the bars' axis is logarithmic


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
    floor = 1e3 * MISS_OVER_NOISE * noise_m
    low = min(values[good].min(), floor if floor > 0 else math.inf) / 2

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        rows, plain = np.arange(len(rungs)), {"fc": "white", "ec": "none", "pad": 0.8}
        ax.barh(
            rows,
            np.where(good[:, 0], values[:, 0] - low, 0.0),
            left=low,
            height=0.52,
            color=MODEL_COLOUR,
            label="clips used for the constants",
        )
        if good[:, 1].any():
            ax.plot(values[good[:, 1], 1], rows[good[:, 1]], "D", ms=5.5, mfc="white", mec=HELD_OUT_COLOUR, mew=1.6,
                    ls="", label="held-out clips")  # fmt: skip
        if floor > 0:
            ax.axvline(floor, color=INK_COLOUR, ls="--", lw=1.1, label=f"noise floor {number(floor)} mm")
        for row, value in enumerate(values):
            if good[row, 0]:
                right = max(value[good[row]])
                text = f"{number(value[0])} mm" + (f", held out {number(value[1])}" if good[row, 1] else "")
                ax.annotate(text, (right, row), (8, 0), textcoords="offset points", va="center", bbox=plain)
        ax.set(xscale="log", xlim=(low, 5 * values[good].max()), xlabel="rms distance, model to measurement [mm]")
        ax.set_yticks(rows, [_short(r.label, 44) for r in rungs], parse_math=False)
        ax.set_ylim(len(rungs) - 0.4, -0.6)
        plain_log_ticks(ax.xaxis)
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
            colour = rgb(ball_colour(name))
            xy = seen.xy[np.isfinite(seen.xy).all(axis=1)]
            moved = xy[np.concatenate([[True], np.hypot(*np.diff(xy, axis=0).T) > MIN_STEP_M])] if len(xy) else xy
            few = moved[:: max(1, math.ceil(len(moved) / MAX_DOTS))]
            ax.plot(*few.T, ".", ms=3.4, mec="none", color=colour, zorder=6)
            for place in xy[-1:]:
                ax.add_patch(circle(place, ball.radius, fc=colour, ec="black", lw=0.4, zorder=4))
        for i in range(len(track.names)):
            path = track.position[np.isfinite(track.position[:, i]).all(axis=1), i]
            if len(path):
                ax.plot(*path.T, color=PATH_COLOUR, lw=0.9, zorder=5)
                ax.add_patch(circle(path[-1], 1.15 * ball.radius, fc="none", ec=PATH_COLOUR, lw=1.1, zorder=7))
        title = f"{_short(PurePosixPath(shot.file).stem, 24)}: struck ball {number(1e3 * row.struck_rms_m)} mm rms"
        title = f"{kind.capitalize()} · {title}" if kind else title
        ax.set_title(title + (" · held out" if row.held_out else ""), parse_math=False)

    def draw(fig: Any) -> None:
        grid = fig.subplots(lines, 2, squeeze=False).ravel()
        for ax, (k, kind) in zip(grid, chosen, strict=False):
            panel(ax, k, kind)
        for ax in grid[len(chosen) :]:
            ax.set_axis_off()

    height = FIGURE_WIDTH_IN / 2 * (table.width + 0.55) / (table.length + 0.45)
    return svg("tracks", lines * min(height, 6.0) + 0.1, draw)


def dependence_svg(comparison: Comparison) -> str | None:
    """Miss over noise against time, speed, heading, sidespin, impacts so far; None without samples or noise."""
    s, noise = comparison.samples, comparison.noise_m
    if not noise > 0 or not len(s.time):
        return None
    ratio, moving = np.hypot(*s.residual.T) / noise, is_moving(s)
    everywhere = np.ones_like(moving)
    panels: tuple[tuple[str, str, Array, NDArray[np.bool_]], ...] = (
        ("Time since the start", "time [s]", s.time, everywhere),
        ("Speed", "speed [m/s]", s.speed, moving),
        ("Heading", "heading from +x [degrees]", (np.degrees(s.heading) + 180) % 360 - 180, moving),
        ("Sidespin", "sidespin [rad/s], + is right", s.spin, moving),
        ("Impacts so far", "impacts [count]", s.events.astype(float), everywhere),
    )
    low, middle, high = RAYLEIGH_QUANTILES

    def draw(fig: Any) -> None:
        grid = fig.subplots(2, 3).ravel()
        bands = [_binned(x[use], ratio[use]) for _, _, x, use in panels]
        ends = np.concatenate([band[:, 1:].ravel() for band in bands] + [np.array([0.35, 3.0])])
        for ax, (title, label, _, _), band in zip(grid, panels, bands, strict=False):
            ax.axhspan(low, high, color=PERFECT_COLOUR, lw=0, label="perfect model: 10–90 %")
            ax.axhline(middle, color=NOISE_COLOUR, lw=1, ls="--", label="perfect model: median")
            ax.fill_between(*band[:, [0, 1, 3]].T, color=MODEL_COLOUR, alpha=0.25, lw=0, label="this model: 10–90 %")
            ax.plot(*band[:, [0, 2]].T, "-o", color=MODEL_COLOUR, ms=3, lw=1.3, label="this model: median")
            ax.set(title=title, xlabel=label, yscale="log", ylim=(0.8 * ends[ends > 0].min(), 1.25 * ends.max()))
            plain_log_ticks(ax.yaxis)
            ax.grid(axis="y")
        for ax in grid[[0, 3]]:
            ax.set_ylabel("miss / noise [1]")
        grid[2].set_xticks([-180, -90, 0, 90, 180])
        grid[4].locator_params(axis="x", integer=True)
        fig.legend(*grid[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
        _draw_signed(grid[5], s, moving & np.isfinite(s.heading))

    return svg("dependence", 5.7, draw)


def _draw_signed(ax: Any, s: Samples, use: NDArray[np.bool_]) -> None:
    """Miss along and across the ball's direction of motion against time."""
    (x, y), cos, sin = s.residual[use].T, np.cos(s.heading[use]), np.sin(s.heading[use])
    for label, colour, value in (
        ("along: + model ahead", "#17806d", x * cos + y * sin),
        ("across: + model left", "#9c3f8f", y * cos - x * sin),
    ):
        band = _binned(s.time[use], 1e3 * value)
        ax.fill_between(*band[:, [0, 1, 3]].T, color=colour, alpha=0.2, lw=0)
        ax.plot(*band[:, [0, 2]].T, color=colour, lw=1.3, label=label)
    ax.axhline(0, color=NOISE_COLOUR, lw=1, ls="--")
    ax.set(title="Along and across the motion", xlabel="time [s]", ylabel="miss [mm]")
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
            left.hist(ratios, np.geomspace(0.99 * low, 1.01 * high, 36), color=MODEL_COLOUR, ec="white", lw=0.4)
            middle = float(np.median(ratios))
            left.axvline(middle, color=MODEL_COLOUR, lw=1.4, label=f"median {number(middle)}")
        left.axvline(1.0, color=INK_COLOUR, lw=1.2, ls="--", label="noise alone")
        left.set(xscale="log", xlabel="rms residual / noise [1]", ylabel="segments [count]")
        left.set_title(f"{len(ratios)} segments between impacts")
        plain_log_ticks(left.xaxis)
        left.legend()
        right.set_title(f"{len(clips)} clips, the struck ball over the whole shot")
        right.set(xlabel="clips, best to worst [count]", ylabel="rms distance [mm]")
        if clips:
            values, held = np.array([c[0] for c in clips]), np.array([c[1] for c in clips])
            rank, middle = np.arange(1, len(clips) + 1), float(np.median(values))
            for label, colour, use in (
                ("used for the constants", MODEL_COLOUR, ~held),
                ("held out", HELD_OUT_COLOUR, held),
            ):
                if use.any():
                    right.bar(rank[use], values[use], 0.82, color=colour, label=label)
            right.axhline(middle, color=INK_COLOUR, lw=1.2, label=f"median {number(middle)} mm")
            if values.max() > LOG_BARS_FROM * middle > 0:
                right.set_yscale("log")
                plain_log_ticks(right.yaxis)
            else:
                right.set_ylim(0, 1.4 * values.max() or 1.0)
            right.legend(loc="upper left")
        for ax in (left, right):
            ax.grid(axis="y")
            ax.set_axisbelow(True)

    return svg("spread", 3.2, draw)


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
        ax.fill_between(lag, -band, band, color=PERFECT_COLOUR, lw=0, label="white noise: 95 %")
        ax.bar(lag, value, 0.7, color=MODEL_COLOUR, label="this model")
        ax.axhline(0, color=INK_COLOUR, lw=0.8)
        ax.set(xlabel="lag [samples]", ylabel="autocorrelation [1]", xlim=(0, len(value) + 1))
        ax.set_ylim(min(-0.2, float(np.nanmin(value)) - 0.05), 1.05)
        ax.legend(loc="upper right", ncols=2)
        ax.grid(axis="y")
        ax.set_axisbelow(True)

    return svg("white", 2.6, draw)


def is_moving(samples: Samples) -> NDArray[np.bool_]:
    """Which samples are of moving balls: (n,)."""
    return np.array([motion != "rest" for motion in samples.motion], dtype=bool)


def _binned(x: Array, y: Array, most: int = MAX_BINS) -> Array:
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
    rows = [[np.median(x[g]), *np.quantile(y[g], [0.1, 0.5, 0.9])] for g in groups if g.sum() >= MIN_BIN_SAMPLES]
    return np.array(rows, dtype=float).reshape(-1, 4)


def _short(text: str, most: int) -> str:
    """A printable label of at most so many characters."""
    line = one_line(text)
    return line if len(line) <= most else line[: most - 1] + "…"
