"""Pictures of a series of shots: how far the cue ball missed, what was learnt when, and what it came to on the table.

Shots are taken in blocks between refits, all of one block planned in the same model. A block's figure is the median of
its shots: the miss of a single shot is one draw of launcher and scene, and an in-off has none. The same series gives
the same bytes. Left out: how the films themselves fit, which is the discovery's own report.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.recording.palette import CLOTH_COLOUR
from models.shot import Table
from robot.learning.history import History, PlayedShot
from sysid.clips.faults import one_line
from sysid.report.drawing import HELD_OUT, INK, MODEL, NOISE, SHOWN, WIDTH
from sysid.report.plots import draw_table, number

Draw = Callable[[Any], None]
Block = tuple[int, int]  # first and last shot, counted from 1

PALE = "#9dbfe0"  # single shots, behind their medians
LINE = 0.135  # of text in a picture [inch]
LETTER = 0.056  # width of one, about [inch]
SHORT = 0.08  # miss that leaves no room for an arrow's head [m]
COLUMNS = 4  # of small pictures
EVERY = 10  # shots of a block where the series does not tell


@dataclass(frozen=True)
class Change:
    """What a refit did to the list of effects."""

    shots: int  # that it was fitted to
    added: tuple[str, ...]
    dropped: tuple[str, ...]


def every(story: History) -> int:
    """Shots between refits."""
    return max(int(story.course.get("every") or EVERY), 1)


def blocks(story: History) -> list[Block]:
    """The shots between one refit and the next; the last block may be cut short."""
    count, step = len(story.shots), every(story)
    return [(first, min(first + step - 1, count)) for first in range(1, count + 1, step)]


def ends(story: History) -> list[Block]:
    """The first block and the last that holds half of its shots or more; one of them, or none, in a short series."""
    all_blocks, step = blocks(story), every(story)
    whole = [(first, last) for first, last in all_blocks if 2 * (last - first + 1) >= step] or all_blocks[:1]
    return [whole[0], whole[-1]] if len(whole) > 1 else whole


def changes(story: History) -> list[Change]:
    """What every refit added to the effects of the one before, and what it dropped."""
    out, before = [], set[str]()
    for refit in story.refits:
        added = tuple(name for name in refit.verdict if name not in before)
        out.append(Change(refit.shots, added, tuple(sorted(before - set(refit.verdict)))))
        before = set(refit.verdict)
    return out


def of_block(story: History, block: Block) -> list[PlayedShot]:
    """Its shots."""
    return [shot for shot in story.shots if block[0] <= shot.number <= block[1]]


def misses(story: History) -> tuple[float, Draw]:
    """The main picture: miss of every shot and its blocks' medians, the plans' own forecast, the launcher's floor."""
    notes, rows = _placed_notes(story)

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        shots = story.shots
        miss = 1e3 * np.array([shot.miss for shot in shots])
        for label, face, use in (
            ("one shot, potted", PALE, [bool(shot.potted) for shot in shots]),
            ("one shot, not potted", "white", [not shot.potted for shot in shots]),
        ):
            own = np.array(use, bool) & (miss > 0)
            if own.any():
                x = np.array([shot.number for shot in shots])[own]
                ax.plot(x, miss[own], "o", ms=5, mfc=face, mec=MODEL, mew=0.8, alpha=0.8, label=label)
        fallen = [shot.number for shot in shots if not shot.miss > 0]
        if fallen:
            mark = {"transform": ax.get_xaxis_transform(), "clip_on": False, "color": INK, "mew": 1.3}
            ax.plot(fallen, [0.975] * len(fallen), "x", ms=5.5, **mark, label="no miss: in a pocket, or not seen")
        curves = (
            ("median miss of a block", story.median_miss, {"color": MODEL, "lw": 2.6}),
            ("what the plans foresaw", story.median_spread, {"color": HELD_OUT, "lw": 1.6}),
            ("the launcher's own scatter (repeats)", story.floor, {"color": INK, "lw": 1.3, "ls": "--"}),
        )
        for label, of, style in curves:
            _steps(ax, story, of, label, style)
        seen = [
            v for line in ax.get_lines() for v in line.get_ydata() if v > 0 and line.get_transform() == ax.transData
        ]
        low, high = (min(seen) / 1.6, max(seen) * 2.2) if seen else (1.0, 1e3)
        ax.set(yscale="log", ylim=(low, high), xlim=(0.3, _last(story) + 0.7))
        ax.set(xlabel="shot", ylabel="cue ball, from where it was told to stop [mm]")
        _plain_log(ax.yaxis)
        ax.xaxis.get_major_locator().set_params(integer=True)
        for first, last in blocks(story):
            value = 1e3 * story.median_miss(first, last)
            if value > 0:
                text = {"xytext": (0, 4), "textcoords": "offset points", "ha": "center", "weight": "bold"}
                box = {"fc": "white", "ec": "none", "pad": 0.2, "alpha": 0.65}
                ax.annotate(number(value), ((first + last) / 2, value), **text, color=MODEL, bbox=box, zorder=6)
        for refit in story.refits:
            ax.axvline(refit.shots + 0.5, color=NOISE, lw=0.9, ls=":", zorder=0)
        for at, row, side, word in notes:
            place = {"xytext": (0, 4 + 72 * LINE * row), "textcoords": "offset points", "ha": side, "va": "bottom"}
            ax.annotate(word, (at, 1.0), xycoords=("data", "axes fraction"), **place, fontsize=8, parse_math=False)
        ax.grid(axis="y")
        ax.set_axisbelow(True)
        if ax.get_legend_handles_labels()[1]:
            fig.legend(loc="outside lower center", ncols=3)

    return 4.4 + LINE * rows, draw


def constants(story: History) -> tuple[float, Draw] | None:
    """Every constant of table and launcher over the refits; None without a refit."""
    names = [(kind, name) for kind in ("values", "launcher") for name in _names(story, kind)]
    if not names:
        return None
    rows = math.ceil(len(names) / COLUMNS)

    def draw(fig: Any) -> None:
        axes = fig.subplots(rows, COLUMNS, squeeze=False).ravel()
        for ax, (kind, name) in zip(axes, names, strict=False):
            found = [(r.shots, *getattr(r, kind)[name]) for r in story.refits if name in getattr(r, kind)]
            at, value, sd = np.array(found, float).T
            colour = MODEL if kind == "values" else HELD_OUT
            known = np.isfinite(sd)
            ax.plot(at, value, "-", color=colour, lw=0.8, alpha=0.6)
            ax.errorbar(
                at[known], value[known], 2 * sd[known], fmt="o", ms=3.5, color=colour, elinewidth=1.1, capsize=2
            )
            ax.plot(at[~known], value[~known], "o", ms=3.5, mfc="white", color=colour)
            ax.set_title(one_line(name), fontsize=7.5, parse_math=False)
            ax.set_xlim(0, max(r.shots for r in story.refits) + every(story) / 2)
            ax.set_ylim(*_limits(value, np.where(known, 2 * sd, 0.0)))
            ax.ticklabel_format(axis="y", useOffset=False, style="sci", scilimits=(-3, 4))
            ax.locator_params(axis="y", nbins=4)
            ax.locator_params(axis="x", nbins=5, integer=True)
            ax.tick_params(labelsize=7, length=2)
            ax.yaxis.get_offset_text().set_fontsize(7)
            ax.grid(axis="y")
            ax.set_axisbelow(True)
        for ax in axes[len(names) :]:
            ax.set_axis_off()
        fig.supxlabel("shots that were fitted", fontsize=8.5)

    return 0.3 + 1.35 * rows, draw


def above(story: History) -> tuple[float, Draw] | None:
    """First and last block from above, told place to resting place; None without a shot."""
    shown = ends(story)
    if not shown:
        return None
    table = story.shots[0].scene.table
    wide = (WIDTH - 0.8) / 2
    height = 0.9 + wide * (table.width + 0.22) / (table.length + 0.22)

    def draw(fig: Any) -> None:
        axes = fig.subplots(1, 2)
        for ax, block in zip(axes, shown, strict=False):
            _arrows(ax, table, of_block(story, block))
            median = 1e3 * story.median_miss(*block)
            ax.set_title(f"Shots {block[0]} to {block[1]}: median miss {number(median)} mm")
        for ax in axes[len(shown) :]:
            ax.set_axis_off()
        handles: dict[str, Any] = {}
        for ax in axes:
            handles |= {label: handle for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        style = {"facecolor": _rgb(CLOTH_COLOUR), "edgecolor": "none", "labelcolor": "white", "framealpha": 1.0}
        fig.legend(handles.values(), handles, loc="outside lower center", ncols=4, frameon=True, **style)

    return height, draw


def pots(story: History) -> tuple[float, Draw] | None:
    """Pots promised and seen, and the distance from the wanted place, block by block; None without a shot."""
    all_blocks = blocks(story)
    if not all_blocks:
        return None

    def draw(fig: Any) -> None:
        left, right = fig.subplots(1, 2)
        middle = np.array([(first + last) / 2 for first, last in all_blocks])
        bar = 0.36 * every(story)
        tallest = 0.0
        for k, block in enumerate(all_blocks):
            promised, potted, seen = pot_count(story, block)
            if not seen:
                continue
            tall = 100 * np.array([promised, potted]) / seen
            tallest = max(tallest, *tall)
            first = k == 0 or not left.patches
            left.bar(middle[k] - bar / 2, tall[0], bar, color=PALE, label="promised" if first else None)
            left.bar(middle[k] + bar / 2, tall[1], bar, color=MODEL, label="seen" if first else None)
            text = {"ha": "center", "va": "bottom", "fontsize": 7}
            left.text(middle[k], max(tall) + 2, f"{potted} of {seen}", **text)
        names = [f"{first}–{last}" if last > first else f"{first}" for first, last in all_blocks]
        left.set(ylim=(0, max(105.0, tallest + 12)), ylabel="pots, of shots whose end was seen [%]", xlabel="shots")
        away = [(shot.number, 1e3 * shot.from_wanted) for shot in story.shots if math.isfinite(shot.from_wanted)]
        if away:
            right.plot(*np.array(away).T, "o", ms=4, mfc=PALE, mec="none", label="one shot")
        label = "median of a block"
        _steps(
            right,
            story,
            lambda a, b: _median([s.from_wanted for s in of_block(story, (a, b))]),
            label,
            {"color": MODEL, "lw": 2.4},
        )
        right.set(ylim=(0, None), ylabel="cue ball, from the wanted place [mm]", xlabel="shot")
        right.set_xlim(0.3, len(story.shots) + 0.7)
        right.xaxis.get_major_locator().set_params(integer=True)
        left.set_xlim(right.get_xlim())
        few = len(names) <= 12
        left.set_xticks(middle if few else middle[:: math.ceil(len(names) / 12)])
        left.set_xticklabels(names if few else names[:: math.ceil(len(names) / 12)])
        left.tick_params(axis="x", length=0)
        for ax in (left, right):
            ax.grid(axis="y")
            ax.set_axisbelow(True)
            handles, labels = ax.get_legend_handles_labels()
            if handles:
                ax.legend(handles, labels, loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0))

    return 3.3, draw


def pot_count(story: History, block: Block) -> tuple[float, int, int]:
    """Of the shots whose end was seen: pots that were promised, pots, shots."""
    seen = [shot for shot in of_block(story, block) if shot.potted is not None]
    return sum(shot.pot_probability for shot in seen), sum(bool(shot.potted) for shot in seen), len(seen)


def _median(values: list[float]) -> float:
    known = [v for v in values if math.isfinite(v)]
    return float(np.median(known)) if known else math.nan


def _steps(ax: Any, story: History, of: Callable[[int, int], float], label: str, style: dict[str, Any]) -> None:
    """A level line over every block, in mm."""
    for first, last in blocks(story):
        value = 1e3 * of(first, last)
        if value >= 0:
            ax.plot([first - 0.5, last + 0.5], [value, value], **style, label=label, zorder=4)
            label = ""


def _last(story: History) -> int:
    """The last shot on the axis."""
    return max([1, len(story.shots), *(refit.shots for refit in story.refits)])


def _placed_notes(story: History) -> tuple[list[tuple[float, int, str, str]], int]:
    """What refits found, set over the picture so that no two overlap: x, row from below, side, text; and the rows."""
    inch = (WIDTH - 1.0) / _last(story)  # of one shot
    taken: list[list[tuple[float, float]]] = []
    notes = []
    for change in changes(story):
        words = [f"+ {one_line(name)}" for name in change.added]
        words += [f"− {one_line(name)}" for name in change.dropped]
        if not words:
            continue
        x, wide = change.shots + 0.5, [(LETTER * len(word) + 0.06) / inch for word in reversed(words)]
        side = "left" if x + max(wide) < _last(story) + 0.7 else "right"
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


def _names(story: History, kind: str) -> list[str]:
    """Constants with a value in some refit, in order of appearance."""
    found = dict.fromkeys(
        name for refit in story.refits for name, (value, _) in getattr(refit, kind).items() if math.isfinite(value)
    )
    return list(found)


def _limits(value: Any, bar: Any) -> tuple[float, float]:
    """Of an axis: all values, and their bars as far as these leave the values apart."""
    value, bar = value[np.isfinite(value)], bar[np.isfinite(value)]
    span = float(np.ptp(value))
    typical = float(np.median(bar)) if len(bar) else 0.0
    reach = 1.25 * max(span / 2, typical) or 0.05 * abs(float(value[0])) or 1.0
    middle = (float(value.max()) + float(value.min())) / 2
    return middle - 1.2 * reach, middle + 1.2 * reach


def _arrows(ax: Any, table: Table, shots: list[PlayedShot]) -> None:
    """Told place, arrow, resting place of each shot on the cloth."""
    draw_table(ax, table, dark=True)
    known = [shot for shot in shots if np.isfinite(shot.planned_end).all()]
    stopped = [(shot, shot.cue_end) for shot in known if shot.cue_end is not None]
    lost = [shot for shot in known if shot.cue_end is None]
    for chosen, mark, label in (
        (
            [shot for shot, _ in stopped],
            {"marker": "o", "ms": 4, "mfc": "none", "mec": "white", "mew": 0.8},
            "told to stop here",
        ),
        (lost, {"marker": "x", "ms": 6, "mew": 1.6, "mec": "#ff9f1c"}, "told to stop here; fell, or not seen"),
    ):
        if chosen:
            ax.plot(*np.array([shot.planned_end for shot in chosen]).T, ls="none", **mark, zorder=6, label=label)
    for k, (shot, end) in enumerate(stopped):
        head = "-|>" if shot.miss > SHORT else "-"
        style = {"arrowstyle": head, "color": SHOWN, "lw": 1.3, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
        ax.annotate("", tuple(end), tuple(shot.planned_end), arrowprops=style, zorder=5)
        ax.plot(*end, ".", ms=4, color=SHOWN, zorder=5, label="" if k else "stopped here")
    for shot in known:
        text = {"xytext": (4, 4), "textcoords": "offset points", "fontsize": 6.5, "color": "white", "zorder": 7}
        ax.annotate(str(shot.number), shot.planned_end, **text)


def _plain_log(axis: Any) -> None:
    """Plain numbers at 1, 2 and 5 of every decade."""
    from matplotlib.ticker import LogLocator, NullLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(lambda value, _: f"{value:g}")


def _rgb(colour: tuple[int, int, int]) -> tuple[float, ...]:
    return tuple(c / 255 for c in colour)
