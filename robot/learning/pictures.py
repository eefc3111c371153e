"""Figures of a series of shots: findings over time, misses on the table, pots. The main one is in misses.py.

Shots are grouped in blocks (robot/learning/blocks.py), shown by their medians: the miss of a single shot is one sample
of launcher and scene, and an in-off has none. The same series gives the same bytes. Left out: the quality of the fits
to films, which is in the report of the discovery.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from models.errors import one_line
from models.report.axes import TABLE_MARGIN_M, draw_table, legend_on_cloth
from models.report.figure import (
    FIGURE_WIDTH_IN,
    HELD_OUT_COLOUR,
    MODEL_COLOUR,
    PAPER_COLOUR,
    PATH_COLOUR,
    Draw,
)
from models.report.numbers import number
from models.shot import Table
from robot.learning.blocks import block_size, blocks, ends, pot_count
from robot.learning.history import History, PlayedShot

SINGLE_SHOT_COLOUR = "#9dbfe0"  # behind the medians
LOST_SHOT_COLOUR = "#ff9f1c"  # for a cue ball that fell or was not seen

MIN_ARROW_M = 0.08  # a shorter miss leaves no room for an arrow's head
PANELS_ACROSS = 4  # columns of the figure of constants
MAX_BLOCK_LABELS = 12  # most labels below the bars of pots


def constants(story: History) -> tuple[float, Draw] | None:
    """Every constant of table and launcher over the refits; None without a refit."""
    names = [(kind, name) for kind in ("values", "launcher") for name in _names(story, kind)]
    if not names:
        return None
    rows = math.ceil(len(names) / PANELS_ACROSS)

    def draw(fig: Any) -> None:
        axes = fig.subplots(rows, PANELS_ACROSS, squeeze=False).ravel()
        for ax, (kind, name) in zip(axes, names, strict=False):
            found = [(r.shots, *getattr(r, kind)[name]) for r in story.refits if name in getattr(r, kind)]
            at, value, sd = np.array(found, float).T
            colour = MODEL_COLOUR if kind == "values" else HELD_OUT_COLOUR
            known = np.isfinite(sd)
            ax.plot(at, value, "-", color=colour, lw=0.8, alpha=0.6)
            ax.errorbar(
                at[known], value[known], 2 * sd[known], fmt="o", ms=3.5, color=colour, elinewidth=1.1, capsize=2
            )
            ax.plot(at[~known], value[~known], "o", ms=3.5, mfc=PAPER_COLOUR, color=colour)
            ax.set_title(one_line(name), fontsize=7.5, parse_math=False)
            ax.set_xlim(0, max(r.shots for r in story.refits) + block_size(story) / 2)
            ax.set_ylim(*_limits(value, np.where(known, 2 * sd, 0.0)))
            ax.yaxis.set_major_formatter("{x:.5g}")
            ax.locator_params(axis="y", nbins=4)
            ax.locator_params(axis="x", nbins=5, integer=True)
            ax.tick_params(labelsize=7, length=2)
            ax.grid(axis="y")
            ax.set_axisbelow(True)
        for ax in axes[len(names) :]:
            ax.set_axis_off()
        fig.supxlabel("shots that were fitted", fontsize=8.5)

    return 0.3 + 1.35 * rows, draw


def above(story: History) -> tuple[float, Draw] | None:
    """First and last block from above, predicted to actual resting position; None without a shot."""
    shown = ends(story)
    if not shown:
        return None
    table = story.shots[0].scene.table
    wide = (FIGURE_WIDTH_IN - 0.8) / 2
    height = 0.9 + wide * (table.width + 2 * TABLE_MARGIN_M) / (table.length + 2 * TABLE_MARGIN_M)

    def draw(fig: Any) -> None:
        axes = fig.subplots(1, 2)
        for ax, block in zip(axes, shown, strict=False):
            _arrows(ax, table, story.played_to_pot(*block))
            median = 1e3 * story.median_miss(*block)
            ax.set_title(f"Shots {block[0]} to {block[1]}: median miss {number(median)} mm")
        for ax in axes[len(shown) :]:
            ax.set_axis_off()
        handles: dict[str, Any] = {}
        for ax in axes:
            handles |= {label: handle for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        legend_on_cloth(fig, list(handles.values()), list(handles), 4)

    return height, draw


def pots(story: History) -> tuple[float, Draw] | None:
    """Pots predicted and seen, and the distance from the wanted position, by block; None without a shot."""
    all_blocks = blocks(story)
    if not all_blocks:
        return None

    def draw(fig: Any) -> None:
        left, right = fig.subplots(1, 2)
        middle = np.array([(first + last) / 2 for first, last in all_blocks])
        bar = 0.36 * block_size(story)
        tallest = 0.0
        for k, block in enumerate(all_blocks):
            predicted, potted, seen = pot_count(story, block)
            if not seen:
                continue
            tall = 100 * np.array([predicted, potted]) / seen
            tallest = max(tallest, *tall)
            first = k == 0 or not left.patches
            left.bar(middle[k] - bar / 2, tall[0], bar, color=SINGLE_SHOT_COLOUR, label="predicted" if first else None)
            left.bar(middle[k] + bar / 2, tall[1], bar, color=MODEL_COLOUR, label="seen" if first else None)
            text = {"ha": "center", "va": "bottom", "fontsize": 7}
            left.text(middle[k], max(tall) + 2, f"{potted} of {seen}", **text)
        names = [f"{first}–{last}" if last > first else f"{first}" for first, last in all_blocks]
        left.set(ylim=(0, max(105.0, tallest + 12)), ylabel="pots, of shots whose end was seen [%]", xlabel="shots")
        away = [(shot.number, 1e3 * shot.from_wanted) for shot in story.shots if math.isfinite(shot.from_wanted)]
        if away:
            right.plot(*np.array(away).T, "o", ms=4, mfc=SINGLE_SHOT_COLOUR, mec="none", label="one shot")
        draw_steps(right, story, partial(_median_away, story), "median of a block", {"color": MODEL_COLOUR, "lw": 2.4})
        right.set(ylim=(0, None), ylabel="cue ball, from the wanted position [mm]", xlabel="shot")
        right.set_xlim(0.3, len(story.shots) + 0.7)
        right.xaxis.get_major_locator().set_params(integer=True)
        left.set_xlim(right.get_xlim())
        step = math.ceil(len(names) / MAX_BLOCK_LABELS)
        left.set_xticks(middle[::step], names[::step])
        left.tick_params(axis="x", length=0)
        for ax in (left, right):
            ax.grid(axis="y")
            ax.set_axisbelow(True)
            handles, labels = ax.get_legend_handles_labels()
            if handles:
                ax.legend(handles, labels, loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0))

    return 3.3, draw


def _median_away(story: History, first: int, last: int) -> float:
    """Median distance from the wanted position over shots first to last [m]; nan without any."""
    known = [shot.from_wanted for shot in story.played_to_pot(first, last) if math.isfinite(shot.from_wanted)]
    return float(np.median(known)) if known else math.nan


def draw_steps(ax: Any, story: History, of: Callable[[int, int], float], label: str, style: dict[str, Any]) -> None:
    """Draw a horizontal line for every block, in mm."""
    for first, last in blocks(story):
        value = 1e3 * of(first, last)
        if value >= 0:
            ax.plot([first - 0.5, last + 0.5], [value, value], **style, label=label, zorder=4)
            label = ""


def last_shot(story: History) -> int:
    """The last shot of the axis."""
    return max([1, len(story.shots), *(refit.shots for refit in story.refits)])


def _names(story: History, kind: str) -> list[str]:
    """Constants with a value in some refit, in order of appearance."""
    found = dict.fromkeys(
        name for refit in story.refits for name, (value, _) in getattr(refit, kind).items() if math.isfinite(value)
    )
    return list(found)


def _limits(value: Any, bar: Any) -> tuple[float, float]:
    """Limits of an axis: all values, and error bars as far as the values remain distinguishable."""
    value, bar = value[np.isfinite(value)], bar[np.isfinite(value)]
    span = float(np.ptp(value))
    typical = float(np.median(bar)) if len(bar) else 0.0
    half = 1.25 * max(span / 2, typical) or 0.05 * abs(float(value[0])) or 1.0
    middle = (float(value.max()) + float(value.min())) / 2
    return middle - 1.2 * half, middle + 1.2 * half


def _arrows(ax: Any, table: Table, shots: list[PlayedShot]) -> None:
    """Draw predicted position, arrow and resting position of each shot on the table."""
    draw_table(ax, table)
    known = [shot for shot in shots if np.isfinite(shot.planned_end).all()]
    stopped = [(shot, shot.cue_end) for shot in known if shot.cue_end is not None]
    lost = [shot for shot in known if shot.cue_end is None]
    for chosen, mark, label in (
        (
            [shot for shot, _ in stopped],
            {"marker": "o", "ms": 4, "mfc": "none", "mec": "white", "mew": 0.8},
            "predicted to stop here",
        ),
        (
            lost,
            {"marker": "x", "ms": 6, "mew": 1.6, "mec": LOST_SHOT_COLOUR},
            "predicted to stop here; fell, or not seen",
        ),
    ):
        if chosen:
            ax.plot(*np.array([shot.planned_end for shot in chosen]).T, ls="none", **mark, zorder=6, label=label)
    for k, (shot, end) in enumerate(stopped):
        head = "-|>" if shot.miss > MIN_ARROW_M else "-"
        style = {"arrowstyle": head, "color": PATH_COLOUR, "lw": 1.3, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
        ax.annotate("", tuple(end), tuple(shot.planned_end), arrowprops=style, zorder=5)
        ax.plot(*end, ".", ms=4, color=PATH_COLOUR, zorder=5, label="" if k else "stopped here")
    for shot in known:
        text = {"xytext": (4, 4), "textcoords": "offset points", "fontsize": 6.5, "color": "white", "zorder": 7}
        ax.annotate(str(shot.number), shot.planned_end, **text)
