"""The report of a cueing map: one HTML file with embedded figures, and the figures alone as PNG.

Surfaces of ball speed and squirt over the tip's offset at one string, like figures 9(b) and 9(c) of Robotic Billiards
(2015); predicted against measured values; errors by speed and offset for both maps; the scores of the comparison and
the map's constants. templates/cueing_map.html.j2 holds headings and captions. The same values give the same bytes.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.analytic.cue_impulse import CONSTANT_NAMES
from models.errors import BadInput
from models.files import write_whole
from models.report.figure import HELD_OUT_COLOUR, INK_COLOUR, MODEL_COLOUR, NOISE_COLOUR, Draw, png, svg
from models.report.numbers import number
from models.report.page import write_page
from planner.launcher.cueing_map import CueingMap
from robot.cueing.campaign import CueShot
from robot.cueing.held_out import HeldOutErrors, MapComparison

Array = NDArray[np.float64]
REPORT_TEMPLATE = Path(__file__).with_name("templates") / "cueing_map.html.j2"
CONSTANT_UNITS = {"tip_restitution": "1", "cue_mass": "kg", "end_mass": "kg", "slate_friction": "1",
                  "contact_time": "s", "side_zero": "m", "height_zero": "m", "aim_zero": "rad"}  # fmt: skip
EXECUTION_UNITS = {"speed_sd": "1", "azimuth_sd": "rad", "side_sd": "m", "height_sd": "m"}
SCORE_HEADS = ["map", "trained on", "speed [%]", "speed [mm/s]", "squirt [°]"]
USUAL_CUE_SPEED_M_S = 2.0  # the string nearest to it is drawn
MAP_COLOURS = {"physical map": MODEL_COLOUR, "physical map, a tenth": HELD_OUT_COLOUR, "repeats": INK_COLOUR}
OFFSET_BIN_MM = 3.0  # width of a bin in the figure of errors


def write_report(path: Path | str, title: str, shots: Sequence[CueShot], contest: MapComparison) -> None:
    """Write one HTML file, completely or not at all.

    Args:
        path: the file.
        title: its heading.
        shots: the whole campaign.
        contest: the comparison, whose map from all shots is drawn.
    """
    figures = [(name, svg(name, height, draw)) for name, height, draw in _figures(shots, contest)]
    write_page(
        path,
        REPORT_TEMPLATE,
        title=title,
        count=len(shots),
        miscues=sum(s.miscue for s in shots),
        score_heads=SCORE_HEADS,
        scores=[[s.name, *score_cells(s)] for s in contest.scores],
        figures=figures,
        constants=_constants(contest.whole, contest.tenth),
    )


def write_picture(path: Path | str, shots: Sequence[CueShot], contest: MapComparison) -> None:
    """Write all figures below each other as one PNG, completely or not at all."""
    figures = _figures(shots, contest)
    heights = [height for _, height, _ in figures]

    def below_each_other(fig: Any) -> None:
        parts = fig.subfigures(len(figures), 1, height_ratios=heights)
        for part, (_, _, draw) in zip(parts, figures, strict=True):
            draw(part)

    write_whole(path, png(sum(heights), below_each_other, dpi=110))


def score_cells(s: HeldOutErrors) -> list[str]:
    return [str(s.trained_on), *(number(v) for v in (s.speed_percent, 1e3 * s.speed_m_s, s.squirt_deg))]


def _figures(shots: Sequence[CueShot], contest: MapComparison) -> list[tuple[str, float, Draw]]:
    """Every figure: its title, its height [inch], and the function that draws it."""
    cue_speeds = {s.string: s.cue_speed for s in shots if not s.miscue}
    if not cue_speeds:
        raise BadInput("every shot is a miscue, or there are none; play a campaign first")
    chosen = min(cue_speeds, key=lambda k: abs(cue_speeds[k] - USUAL_CUE_SPEED_M_S))
    shown = [s for s in shots if s.string == chosen and not s.miscue]
    return [
        (f"String '{chosen:03d}p', cue {cue_speeds[chosen]:.2f} m/s", 4.4, partial(_surfaces, shown, contest.whole)),
        ("Predicted against measured", 3.6, partial(_predicted_against_measured, contest)),
        ("Where the errors are", 3.4, partial(_errors, contest)),
    ]


def _surfaces(shown: Sequence[CueShot], cueing_map: CueingMap, fig: Any) -> None:
    groups: defaultdict[tuple[float, float], list[tuple[float, float]]] = defaultdict(list)
    for s in shown:
        groups[s.x0_mm, s.y0_mm].append((s.ball_speed, math.degrees(s.squirt_rad)))
    offsets = np.array(list(groups))
    means = np.array([np.mean(values, axis=0) for values in groups.values()])
    x, y = (np.linspace(offsets[:, k].min(), offsets[:, k].max(), 25) for k in (0, 1))
    gx, gy = np.meshgrid(x, y)
    surface = cueing_map.predict(shown[0].cue_speed, gx.ravel(), gy.ravel())
    at_dots = cueing_map.predict(shown[0].cue_speed, *offsets.T)
    parts = (
        ("ball speed [m/s]", surface.ball_speed, at_dots.ball_speed, means[:, 0]),
        ("squirt [°]", np.degrees(surface.squirt), np.degrees(at_dots.squirt), means[:, 1]),
    )
    for k, (label, heights, foot, dots) in enumerate(parts):
        ax = fig.add_subplot(1, 2, k + 1, projection="3d")
        ax.plot_surface(gx, gy, heights.reshape(gx.shape), cmap="viridis", alpha=0.75, lw=0, rcount=25, ccount=25)
        ax.plot(*offsets.T, dots, ".", color=HELD_OUT_COLOUR, ms=4)
        for (px, py), low, high in zip(offsets, foot, dots, strict=True):
            ax.plot([px, px], [py, py], [low, high], color=HELD_OUT_COLOUR, lw=0.8)
        ax.set(xlabel="x'₀ [mm]", ylabel="y'₀ [mm]", title=label)
        ax.view_init(28, -52 if k == 0 else -128)


def _predicted_against_measured(contest: MapComparison, fig: Any) -> None:
    axes = fig.subplots(1, 2)
    measured = np.array([(s.ball_speed, math.degrees(s.squirt_rad)) for s in contest.held])
    names = list(contest.predicted)[:2]
    for k, (ax, label) in enumerate(zip(axes, ("ball speed [m/s]", "squirt [°]"), strict=True)):
        for name, mark in zip(names, ("x", "."), strict=True):
            colour = MAP_COLOURS.get(name, NOISE_COLOUR)
            predicted = contest.predicted[name][k] if k == 0 else np.degrees(contest.predicted[name][k])
            ax.plot(measured[:, k], predicted, mark, color=colour, ms=3.5, mew=0.7, ls="", label=name)
        ends = [measured[:, k].min(), measured[:, k].max()]
        ax.plot(ends, ends, color=INK_COLOUR, lw=0.9)
        ax.set(xlabel=f"measured {label}", ylabel=f"predicted {label}")
        ax.grid()
        ax.set_axisbelow(True)
    axes[0].legend(loc="upper left")


def _repeat_scatter(held: Sequence[CueShot], measured: Array) -> Array:
    """Unbiased deviation of each shot from the mean of its repeats: (n, 2); nan for strokes without repeats.

    The squared scatter about a mean that includes the shot itself is too small by a factor of n / (n - 1).
    """
    repeats: defaultdict[tuple[int, float, float], list[int]] = defaultdict(list)
    for k, s in enumerate(held):
        repeats[s.string, s.x0_mm, s.y0_mm].append(k)
    scatter = np.full(measured.shape, np.nan)
    for rows in repeats.values():
        if len(rows) > 1:
            scatter[rows] = (measured[rows] - measured[rows].mean(axis=0)) * math.sqrt(len(rows) / (len(rows) - 1))
    return scatter


def _errors(contest: MapComparison, fig: Any) -> None:
    axes = fig.subplots(1, 4)
    held = contest.held
    speed = np.array([s.cue_speed for s in held])
    offset = np.round(np.hypot([s.x0_mm for s in held], [s.y0_mm for s in held]) / OFFSET_BIN_MM) * OFFSET_BIN_MM
    measured = np.array([(s.ball_speed, s.squirt_rad) for s in held])
    scales, units = (100.0, math.degrees(1.0)), ("ball speed, rms [%]", "squirt, rms [°]")
    errors = {name: np.stack(pair, axis=-1) - measured for name, pair in contest.predicted.items()}
    errors["repeats"] = _repeat_scatter(held, measured)
    for k, ax in enumerate(axes):
        quantity, by, label = k // 2, (speed, offset)[k % 2], ("cue speed [m/s]", "tip off centre by [mm]")[k % 2]
        bins = np.unique(np.round(by, 6))
        for name, error in errors.items():
            colour = MAP_COLOURS.get(name, NOISE_COLOUR)
            scaled = error[:, quantity] * scales[quantity] / (measured[:, 0] if quantity == 0 else 1.0)
            rms = [float(np.sqrt(np.nanmean(v**2))) if np.any(np.isfinite(v)) else math.nan
                   for v in (scaled[np.isclose(by, b)] for b in bins)]  # fmt: skip
            ls, marker = ("--", "") if name == "repeats" else ("-", ".")
            ax.plot(bins, rms, ls, color=colour, marker=marker, label=name)
        ax.set(xlabel=label, ylabel=units[quantity], ylim=(0, None))
        ax.grid()
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper right", ncols=4)


def _constants(whole: CueingMap, tenth: CueingMap) -> list[list[str]]:
    """Name, value and sd from all shots, value and sd from a tenth of them, and unit of every constant."""
    rows = []
    for k, name in enumerate(CONSTANT_NAMES):
        values = [(getattr(m.constants, name), math.sqrt(m.covariance[k, k])) for m in (whole, tenth)]
        rows.append([name, *(number(v) for pair in values for v in pair), CONSTANT_UNITS[name]])
    for name, unit in EXECUTION_UNITS.items():
        rows.append([f"execution {name}", number(getattr(whole.execution, name)), "", "", "", unit])
    return rows
