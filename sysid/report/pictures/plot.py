"""Plots of tracks: all of a clip set over its table, and one shot with its speeds and the models' misses.

In: a clip set, or a clip and the models' tracks of it. Out: a PNG.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.report.axes import circle, draw_table, rgb
from models.report.figure import FIGURE_WIDTH_IN, PATH_COLOUR, Draw, png
from models.shot import Ball, Table, Track
from models.table.palette import ball_colour, ink
from sysid.clips import Clip, ClipSet

Array = NDArray[np.float64]

MAX_POINTS = 1000  # of one track over the table
MARGIN_M = 0.15  # around the table
MOVED_M = 0.01  # a ball with a smaller range of positions rested
SPEED_SAMPLES = 7  # over which a speed is taken
PNG_DPI = 100
MODEL_STYLES = ("--", ":", "-.")  # of their lines, in turn


def tracks_png(clip_set: ClipSet, title: str) -> bytes:
    """All tracks from above, a ring where each struck ball begins."""
    table = clip_set.table

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        draw_table(ax, table)
        for clip in clip_set.clips:
            for name, seen in clip.balls.items():
                few = seen.xy[:: max(1, len(seen.xy) // MAX_POINTS)]
                ax.plot(*few.T, "-", lw=0.7, color=rgb(ball_colour(name)), zorder=6)
            start = clip.balls[clip.struck].xy[0]
            ax.plot(*start, "o", ms=7, mfc="none", mec="white", zorder=7)
        places = np.concatenate([seen.xy for clip in clip_set.clips for seen in clip.balls.values()])
        far = np.maximum(np.abs(places).max(axis=0), [table.length / 2, table.width / 2]) + MARGIN_M
        ax.set(xlim=(-far[0], far[0]), ylim=(-far[1], far[1]))
        ax.set_title(title)

    return png(1.2 + 10.0 * table.width / table.length, draw, PNG_DPI)


def shot_png(clip: Clip, table: Table, ball: Ball, models: Sequence[tuple[str, Track]] = ()) -> bytes:
    """One shot from above, its balls' speeds over time, and each model's misses."""
    return png(*shot_figure(clip, table, ball, models), PNG_DPI)


def shot_figure(clip: Clip, table: Table, ball: Ball, models: Sequence[tuple[str, Track]] = ()) -> tuple[float, Draw]:
    """Height [inch] of the same as a figure, and what draws it."""
    moving = [name for name, seen in clip.balls.items() if np.ptp(seen.xy, axis=0).max() > MOVED_M]

    def draw(figure: Any) -> None:
        rows = figure.add_gridspec(2, 2 if models else 1, height_ratios=(2, 1))
        top = figure.add_subplot(rows[0, :])
        _from_above(top, clip, table, ball, models)
        speed = figure.add_subplot(rows[1, 0])
        for name in moving:
            time = clip.balls[name].time
            speed.plot(time, _speeds(time, clip.balls[name].xy), lw=1.2, color=rgb(ink(ball_colour(name))), label=name)
            for k, (_, track) in enumerate(models):
                speed.plot(
                    time,
                    _speeds(time, _at(track, name, time)),
                    MODEL_STYLES[k % len(MODEL_STYLES)],
                    lw=1.0,
                    color=rgb(ink(ball_colour(name))),
                )
        speed.set(xlabel="time [s]", ylabel="speed [m/s]")
        speed.set_title("Speed; lines broken: of the model" if models else "Speed")
        speed.legend()
        if models:
            _misses(figure.add_subplot(rows[1, 1]), clip, moving, models)
        for ax in figure.axes[1:]:
            ax.set_ylim(bottom=0)
            ax.grid(visible=True)

    return 3.4 + FIGURE_WIDTH_IN * (table.width + 0.3) / (table.length + 0.3), draw


def _from_above(ax: Any, clip: Clip, table: Table, ball: Ball, models: Sequence[tuple[str, Track]]) -> None:
    draw_table(ax, table)
    for name, seen in clip.balls.items():
        colour = rgb(ball_colour(name))
        ax.plot(*seen.xy.T, ".", ms=2.5, color=colour, zorder=5)
        ax.add_patch(circle(seen.xy[0], ball.radius, fc=colour, ec="black", lw=0.6, zorder=6))
        for k, (_, track) in enumerate(models):
            if name in track.names:
                place = track.position[:, track.names.index(name)]
                ax.plot(*place.T, MODEL_STYLES[k % len(MODEL_STYLES)], lw=1.1, color=PATH_COLOUR, zorder=7)
    lines = "; lines: " + ", ".join(label for label, _ in models) if models else ""
    ax.set_title(f"{clip.file}: dots were measured, discs are where balls start{lines}")


def _misses(ax: Any, clip: Clip, moving: Sequence[str], models: Sequence[tuple[str, Track]]) -> None:
    for k, (label, track) in enumerate(models):
        for name in moving:
            seen = clip.balls[name]
            miss = np.linalg.norm(_at(track, name, seen.time) - seen.xy, axis=1)
            style = MODEL_STYLES[k % len(MODEL_STYLES)] if len(models) > 1 else "-"
            ax.plot(seen.time, 1e3 * miss, style, lw=1.2, color=rgb(ink(ball_colour(name))), label=f"{name}, {label}")
    ax.set(xlabel="time [s]", ylabel="miss [mm]")
    ax.set_title("Distance from model to measurement")
    ax.legend()


def _at(track: Track, name: str, time: Array) -> Array:
    """Positions (n, 2) of a model's ball at times (n,); NaN where it has none."""
    if name not in track.names:
        return np.full((len(time), 2), np.nan)
    place = track.position[:, track.names.index(name)]
    return np.column_stack([np.interp(time, track.times, place[:, axis]) for axis in (0, 1)])


def _speeds(time: Array, xy: Array) -> Array:
    """Speeds (n,) of a track with positions (n, 2) at times (n,), by linear fits to a few samples each."""
    half = SPEED_SAMPLES // 2
    speed = np.full(len(time), np.nan)
    for k in range(half, len(time) - half):
        t = time[k - half : k + half + 1] - time[k]
        v = (t - t.mean()) @ xy[k - half : k + half + 1] / np.sum((t - t.mean()) ** 2)
        speed[k] = float(np.hypot(*v))
    return speed
