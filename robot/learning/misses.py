"""The main figure of a series of shots: by how much the cue ball missed, shot by shot and in blocks.

Notes above it name what the refits found, without overlap.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from models.errors import one_line
from models.report.axes import plain_log_ticks
from models.report.figure import (
    FIGURE_WIDTH_IN,
    HELD_OUT_COLOUR,
    INK_COLOUR,
    MODEL_COLOUR,
    NARROW_WIDTH_IN,
    NOISE_COLOUR,
    PAPER_COLOUR,
    Draw,
)
from models.report.numbers import number
from robot.learning.blocks import blocks, changes
from robot.learning.history import History
from robot.learning.pictures import SINGLE_SHOT_COLOUR, draw_steps, last_shot

LINE_HEIGHT_IN = 0.135  # height of a note's line above the figure
LETTER_WIDTH_IN = 0.056  # approximate width of a letter


def misses(story: History, narrow: bool = False) -> tuple[float, Draw]:
    """The main figure: miss of every shot, medians of blocks, the miss predicted, the launcher's repeatability.

    `narrow`: for the screen of a phone.
    """
    width = NARROW_WIDTH_IN if narrow else FIGURE_WIDTH_IN
    notes, rows = _placed_notes(story, width)
    height = 4.4 + 0.6 * narrow + LINE_HEIGHT_IN * rows

    def draw(fig: Any) -> None:
        fig.set_size_inches(width, height)
        ax = fig.subplots()
        _draw_shots(ax, story)
        curves = (
            ("median miss of a block", story.median_miss, {"color": MODEL_COLOUR, "lw": 2.6}),
            ("miss that the plans predicted", story.median_spread, {"color": HELD_OUT_COLOUR, "lw": 1.6}),
            ("launcher's repeatability (repeats)", story.floor, {"color": INK_COLOUR, "lw": 1.3, "ls": "--"}),
        )
        for label, of, style in curves:
            draw_steps(ax, story, of, label, style)
        _scale(ax, story)
        _write_medians(ax, story)
        for refit in story.refits:
            ax.axvline(refit.shots + 0.5, color=NOISE_COLOUR, lw=0.9, ls=":", zorder=0)
        for at, row, side, word in notes:
            place = {
                "xytext": (0, 4 + 72 * LINE_HEIGHT_IN * row),
                "textcoords": "offset points",
                "ha": side,
                "va": "bottom",
            }
            ax.annotate(word, (at, 1.0), xycoords=("data", "axes fraction"), **place, fontsize=8, parse_math=False)
        ax.grid(axis="y")
        ax.set_axisbelow(True)
        if ax.get_legend_handles_labels()[1]:
            fig.legend(loc="outside lower center", ncols=1 if narrow else 3)

    return height, draw


def _draw_shots(ax: Any, story: History) -> None:
    """Draw the miss of every shot, in mm, and above the axis those that have none."""
    shots = story.shots
    miss = 1e3 * np.array([shot.miss for shot in shots])
    for label, face, use in (
        ("one shot, potted", SINGLE_SHOT_COLOUR, [bool(shot.potted) and not shot.chosen for shot in shots]),
        ("one shot, not potted", PAPER_COLOUR, [not shot.potted and not shot.chosen for shot in shots]),
        ("one shot, chosen for learning", NOISE_COLOUR, [shot.chosen for shot in shots]),
    ):
        shown = np.array(use, bool) & (miss > 0)
        if shown.any():
            x = np.array([shot.number for shot in shots])[shown]
            ax.plot(x, miss[shown], "o", ms=5, mfc=face, mec=MODEL_COLOUR, mew=0.8, alpha=0.8, label=label)
    fallen = [shot.number for shot in shots if not shot.miss > 0]
    if fallen:
        mark = {"transform": ax.get_xaxis_transform(), "clip_on": False, "color": INK_COLOUR, "mew": 1.3}
        ax.plot(fallen, [0.975] * len(fallen), "x", ms=5.5, **mark, label="no miss: in a pocket, or not seen")


def _scale(ax: Any, story: History) -> None:
    """Set the axes to what is drawn: the misses logarithmic."""
    seen = [v for line in ax.get_lines() for v in line.get_ydata() if v > 0 and line.get_transform() == ax.transData]
    low, high = (min(seen) / 1.6, max(seen) * 2.2) if seen else (1.0, 1e3)
    ax.set(yscale="log", ylim=(low, high), xlim=(0.3, last_shot(story) + 0.7))
    ax.set(xlabel="shot", ylabel="cue ball, from its predicted position [mm]")
    plain_log_ticks(ax.yaxis, math.inf)
    ax.xaxis.get_major_locator().set_params(integer=True)


def _write_medians(ax: Any, story: History) -> None:
    """Write the median miss of every block, in mm, above it."""
    for first, last in blocks(story):
        value = 1e3 * story.median_miss(first, last)
        if value > 0:
            text = {"xytext": (0, 4), "textcoords": "offset points", "ha": "center", "weight": "bold"}
            box = {"fc": PAPER_COLOUR, "ec": "none", "pad": 0.2, "alpha": 0.65}
            ax.annotate(number(value), ((first + last) / 2, value), **text, color=MODEL_COLOUR, bbox=box, zorder=6)


def _placed_notes(story: History, width: float) -> tuple[list[tuple[float, int, str, str]], int]:
    """Notes on findings of refits above a figure [inch], without overlap: x, row, side, text; and number of rows."""
    inch = (width - 1.0) / last_shot(story)  # width of one shot
    taken: list[list[tuple[float, float]]] = []
    notes = []
    for change in changes(story):
        words = [f"+ {one_line(name)}" for name in change.added]
        words += [f"− {one_line(name)}" for name in change.dropped]
        if not words:
            continue
        x, wide = change.shots + 0.5, [(LETTER_WIDTH_IN * len(word) + 0.06) / inch for word in reversed(words)]
        side = "left" if x + max(wide) < last_shot(story) + 0.7 else "right"
        spans = [(x, x + w) if side == "left" else (x - w, x) for w in wide]
        row = next(
            r
            for r in range(len(taken) + 1)
            if all(
                span[1] <= low or high <= span[0]
                for span, held in zip(spans, taken[r : r + len(spans)], strict=False)
                for low, high in held
            )
        )
        taken += [[] for _ in range(row + len(words) - len(taken))]
        for k, (word, span) in enumerate(zip(reversed(words), spans, strict=True)):
            taken[row + k].append(span)
            notes.append((x, row + k, side, word))
    return notes, len(taken)
