"""The cueing map on paper: one HTML file with its pictures inside, and the pictures alone as PNG.

Surfaces of ball speed and squirt over the tip's place at one string, as figures 9(b) and 9(c) of Robotic Billiards
(2015) show them; predicted against measured; errors by speed and place for both maps; the table of the comparison and
the map's constants. The same values give the same bytes.
"""

from __future__ import annotations

import base64
import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.analytic.cue_impulse import CONSTANT_NAMES
from models.errors import BadInput
from models.files import write_whole
from planner.launcher.cueing_map import CueingMap
from robot.cueing.campaign import CueShot
from robot.cueing.held_out import HeldOutErrors, MapComparison
from sysid.report.drawing import HELD_OUT, INK, MODEL, NOISE, png, svg
from sysid.report.html import CSS
from sysid.report.plots import number

Array = NDArray[np.float64]
UNITS = {"tip_restitution": "1", "cue_mass": "kg", "end_mass": "kg", "slate_friction": "1", "contact_time": "s",
         "side_zero": "m", "height_zero": "m", "aim_zero": "rad"}  # fmt: skip
SCORE_HEADS = ["map", "trained on", "speed [%]", "speed [mm/s]", "squirt [°]", "exact speed [%]", "exact squirt [°]"]
MAP_COLOURS = {"physical map": MODEL, "physical map, a tenth": HELD_OUT}
SURFACES = (
    "Surfaces: the map. Dots: mean of the repeats, with a line to the surface. The ball is fastest where it is struck "
    "in the centre and loses speed towards the rim, to spin; squirt grows with the side. A good map runs through its "
    "dots."
)
AGAINST = (
    "Shots held out, predicted against measured. With a good map the dots lie on the line, as wide as the repeats "
    "scatter."
)
WHERE = (
    "Root mean square errors on shots held out, by cue speed and by the offset of the tip. The dashed line is what "
    "repeats of the same stroke scatter by, which no map can beat. A line that stands above it says what a map lacks."
)
SCORES = (
    "Whole strokes held out with all their repeats. Exact: against the stroke without any error, which is known only "
    "where the launcher is emulated."
)


def write_report(
    path: Path | str,
    title: str,
    shots: Sequence[CueShot],
    contest: MapComparison,
    *,
    scores: Sequence[HeldOutErrors] | None = None,
    string: int | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write one HTML file, whole or not at all.

    Args:
        path: the file.
        title: its heading.
        shots: the whole campaign.
        contest: a comparison on held-out strokes; its map from all shots is drawn.
        scores: the table's rows, such as the means of several splits; those of the comparison without.
        string: whose surfaces are drawn; the one nearest to 2 m/s without.
        notes: shown on top.
    """
    rows = scores or contest.scores
    body = [
        f"<h1>{_text(title)}</h1>",
        f'<p class="sub">{len(shots)} shots, {sum(s.miscue for s in shots)} miscues.</p>',
    ]
    if notes:
        body.append('<ul class="notes">' + "".join(f"<li>{_text(note)}</li>" for note in notes) + "</ul>")
    body += ["<h2>Errors on strokes held out</h2>", _scores(rows), f"<p class=sub>{SCORES}</p>"]
    for name, (height, draw, caption) in _pictures(shots, contest, string).items():
        image = base64.b64encode(svg(name, height, draw).encode()).decode()
        picture = f'<img alt="{escape(name)}" src="data:image/svg+xml;base64,{image}">'
        body += [f"<h2>{_text(name)}</h2>", f"<figure>{picture}<figcaption>{caption}</figcaption></figure>"]
    body += ["<h2>Constants of the map</h2>", _constants(contest.whole, contest.tenth)]
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{_text(title)}</title>'
    page = f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}\n<style>{CSS}</style></head>\n<body>\n'
    write_whole(path, (page + "\n".join(body) + "\n</body>\n</html>\n").encode())


def write_picture(
    path: Path | str, shots: Sequence[CueShot], contest: MapComparison, *, string: int | None = None
) -> None:
    """Write all pictures below each other as one PNG, whole or not at all."""
    pictures = list(_pictures(shots, contest, string).values())
    heights = [height for height, _, _ in pictures]

    def below_each_other(fig: Any) -> None:
        parts = fig.subfigures(len(pictures), 1, height_ratios=heights)
        for part, (_, draw, _) in zip(parts, pictures, strict=True):
            draw(part)

    write_whole(path, png(sum(heights), below_each_other, dpi=110))


def score_cells(s: HeldOutErrors) -> list[str]:
    """A row of the table under SCORE_HEADS, without the map's name."""
    return [str(s.trained_on)] + [
        number(v) for v in (s.speed_percent, 1e3 * s.speed_m_s, s.squirt_deg, s.exact_speed_percent, s.exact_squirt_deg)
    ]


def _pictures(
    shots: Sequence[CueShot], contest: MapComparison, string: int | None
) -> dict[str, tuple[float, Callable[[Any], None], str]]:
    """Every picture: its height [inch], what draws it, its caption."""
    strings = {s.string: s.cue_speed for s in shots if not s.miscue}
    if not strings:
        raise BadInput("there are no shots without a miscue to draw; play a campaign first")
    chosen = min(strings, key=lambda k: abs(strings[k] - 2.0)) if string is None else string
    if chosen not in strings:
        raise BadInput(f"string {chosen} was not played; choose from {', '.join(map(str, sorted(strings)))}")
    here = [s for s in shots if s.string == chosen and not s.miscue]
    name = f"String '{chosen:03d}p', cue {strings[chosen]:.2f} m/s"
    return {
        name: (4.4, lambda fig: _surfaces(fig, here, contest.whole), SURFACES),
        "Predicted against measured": (3.6, lambda fig: _against(fig, contest), AGAINST),
        "Where the errors are": (3.4, lambda fig: _where(fig, contest), WHERE),
    }


def _surfaces(fig: Any, here: Sequence[CueShot], cueing_map: CueingMap) -> None:
    groups: defaultdict[tuple[float, float], list[tuple[float, float]]] = defaultdict(list)
    for s in here:
        groups[s.x0_mm, s.y0_mm].append((s.ball_speed, math.degrees(s.squirt_rad)))
    places = np.array(list(groups))
    means = np.array([np.mean(values, axis=0) for values in groups.values()])
    x, y = (np.linspace(places[:, k].min(), places[:, k].max(), 25) for k in (0, 1))
    gx, gy = np.meshgrid(x, y)
    told = cueing_map.predict(here[0].cue_speed, gx.ravel(), gy.ravel())
    at = cueing_map.predict(here[0].cue_speed, *places.T)
    parts = (
        ("ball speed [m/s]", told.ball_speed, at.ball_speed, means[:, 0]),
        ("squirt [°]", np.degrees(told.squirt), np.degrees(at.squirt), means[:, 1]),
    )
    for k, (label, surface, foot, dots) in enumerate(parts):
        ax = fig.add_subplot(1, 2, k + 1, projection="3d")
        ax.plot_surface(gx, gy, surface.reshape(gx.shape), cmap="viridis", alpha=0.75, lw=0, rcount=25, ccount=25)
        ax.plot(*places.T, dots, ".", color=HELD_OUT, ms=4)
        for (px, py), low, high in zip(places, foot, dots, strict=True):
            ax.plot([px, px], [py, py], [low, high], color=HELD_OUT, lw=0.8)
        ax.set(xlabel="x'₀ [mm]", ylabel="y'₀ [mm]", title=label)
        ax.view_init(28, -52 if k == 0 else -128)


def _against(fig: Any, contest: MapComparison) -> None:
    axes = fig.subplots(1, 2)
    measured = np.array([(s.ball_speed, math.degrees(s.squirt_rad)) for s in contest.held])
    names = list(contest.predicted)[:2]
    for k, (ax, label) in enumerate(zip(axes, ("ball speed [m/s]", "squirt [°]"), strict=True)):
        for name, mark in zip(names, ("x", "."), strict=True):
            told = contest.predicted[name][k] if k == 0 else np.degrees(contest.predicted[name][k])
            ax.plot(measured[:, k], told, mark, color=MAP_COLOURS.get(name, NOISE), ms=3.5, mew=0.7, ls="", label=name)
        ends = [measured[:, k].min(), measured[:, k].max()]
        ax.plot(ends, ends, color=INK, lw=0.9)
        ax.set(xlabel=f"measured {label}", ylabel=f"predicted {label}")
        ax.grid()
        ax.set_axisbelow(True)
    axes[0].legend(loc="upper left")


def _where(fig: Any, contest: MapComparison) -> None:
    axes = fig.subplots(1, 4)
    held = contest.held
    speed = np.array([s.cue_speed for s in held])
    offset = np.round(np.hypot([s.x0_mm for s in held], [s.y0_mm for s in held]) / 3.0) * 3.0
    right = np.array([(s.ball_speed, s.squirt_rad) for s in held])
    units = (np.array([100.0, math.degrees(1.0)]), ("ball speed, rms [%]", "squirt, rms [°]"))
    mean: defaultdict[tuple[int, float, float], list[int]] = defaultdict(list)
    for k, s in enumerate(held):
        mean[s.string, s.x0_mm, s.y0_mm].append(k)
    own = np.full(right.shape, np.nan)
    for rows in mean.values():
        if len(rows) > 1:  # the scatter about a mean that the shot itself is part of is too small by n / (n - 1)
            own[rows] = (right[rows] - right[rows].mean(axis=0)) * math.sqrt(len(rows) / (len(rows) - 1))
    sets = {name: np.stack(pair, axis=-1) - right for name, pair in contest.predicted.items()} | {"repeats": own}
    style = {name: (MAP_COLOURS.get(name, NOISE), "-") for name in sets} | {"repeats": (INK, "--")}
    for k, ax in enumerate(axes):
        figure, by, label = k // 2, (speed, offset)[k % 2], ("cue speed [m/s]", "tip off centre by [mm]")[k % 2]
        bins = np.unique(np.round(by, 6))
        for name, off in sets.items():
            scaled = off[:, figure] * units[0][figure] / (right[:, 0] if figure == 0 else 1.0)
            rms = [float(np.sqrt(np.nanmean(v**2))) if np.any(np.isfinite(v)) else math.nan
                   for v in (scaled[np.isclose(by, b)] for b in bins)]  # fmt: skip
            ax.plot(
                bins, rms, style[name][1], color=style[name][0], marker="." if style[name][1] == "-" else "", label=name
            )
        ax.set(xlabel=label, ylabel=units[1][figure], ylim=(0, None))
        ax.grid()
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper right", ncols=4)


def _scores(scores: Sequence[HeldOutErrors]) -> str:
    rows = [
        f"<tr><td>{_text(s.name)}</td>" + "".join(f'<td class="n">{c}</td>' for c in score_cells(s)) + "</tr>"
        for s in scores
    ]
    head = "<th>map</th>" + "".join(f'<th class="n">{h}</th>' for h in SCORE_HEADS[1:])
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _constants(whole: CueingMap, tenth: CueingMap) -> str:
    rows = []
    for k, name in enumerate(CONSTANT_NAMES):
        cells = []
        for m in (whole, tenth):
            cells += [number(getattr(m.constants, name)), number(math.sqrt(m.covariance[k, k]))]
        rows.append(
            f"<tr><td>{name}</td>" + "".join(f'<td class="n">{c}</td>' for c in cells) + f"<td>{UNITS[name]}</td></tr>"
        )
    for name, unit in (("speed_sd", "1"), ("azimuth_sd", "rad"), ("side_sd", "m"), ("height_sd", "m")):
        cell = f'<td class="n">{number(getattr(whole.execution, name))}</td>'
        rows.append(f"<tr><td>execution {name}</td>{cell}<td></td><td></td><td></td><td>{unit}</td></tr>")
    heads = ("all shots", "± sd", "a tenth", "± sd")
    head = "<th>constant</th>" + "".join(f'<th class="n">{h}</th>' for h in heads) + "<th>unit</th>"
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _text(text: object) -> str:
    """Any text, safe in HTML; characters that cannot be shown are spelt out."""
    return escape("".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in str(text)))
