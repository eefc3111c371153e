"""Figures of a comparison: the ladder of models, the error shot by shot, and what the error depends on.

In: `Comparison`s. Out: `Chart`s, None or none where there is nothing to draw. The maps and the accelerations that a
model lacks are in figures_where.py, the shots that are played back in player.py.

A sample's miss is the distance between model and measurement. With independent normal noise of standard deviation
sigma per axis and nothing else, miss / sigma follows the Rayleigh distribution: its root mean square is sqrt(2), its
quantile at p is sqrt(-2 ln(1 - p)). The figures show that as the expectation of a perfect model. Left out: samples of
a clip share its fitted initial state, which makes a perfect model's misses a little smaller still.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.report.chart import BEFORE, HELD_OUT, INK, MODEL, PERFECT, Chart, axis, label, line_at, log_axis
from models.report.numbers import number
from sysid.estimation.fitted import MISS_OVER_AXIS
from sysid.residuals.comparison import Comparison
from sysid.residuals.samples import Samples

Array = NDArray[np.float64]

MAX_LINEAR_RATIO = 30.0  # of the largest miss over the least, on an axis from zero
RAYLEIGH_QUANTILES = tuple(math.sqrt(-2.0 * math.log(1.0 - p)) for p in (0.1, 0.5, 0.9))
MIN_BIN_SAMPLES = 5
MAX_BINS = 14  # of a curve
RUNG_PX = 46  # height of one model on the ladder [pixels]
ALONG_COLOUR, ACROSS_COLOUR = "#17908a", "#b04fa2"


@dataclass(frozen=True)
class Rung:
    """One model of the error ladder; distances are roots of mean squares over moving balls and clips."""

    label: str
    rms_m: float  # over the clips used for the model's constants; over all where none is held out
    held_out_rms_m: float = math.nan  # over the others
    chi2_reduced: float = math.nan
    note: str = ""


def ladder_chart(rungs: Sequence[Rung], noise_m: float) -> Chart | None:
    """The models' rms miss against the noise floor; None without a number.

    From zero, so that lengths compare; where the largest is MAX_LINEAR_RATIO times the least, on a logarithmic axis.
    """
    values = 1e3 * np.array([[r.rms_m, r.held_out_rms_m] for r in rungs], dtype=float).reshape(-1, 2)
    good = np.isfinite(values) & (values > 0)
    if not good.any():
        return None
    floor = 1e3 * MISS_OVER_AXIS * noise_m
    low, high = min([values[good].min(), *([floor] if floor > 0 else [])]), values[good].max()
    words = "rms miss, model to measurement [mm]"
    if high > MAX_LINEAR_RATIO * low:
        scale = log_axis(f"{words}, logarithmic", low / 1.6, high * 1.6)
    else:
        scale = axis(words, range=[0, 1.08 * max(high, floor)])
    rows = list(range(len(rungs)))
    data: list[dict[str, Any]] = [
        {"type": "bar", "orientation": "h", "name": "clips used for the constants", "marker": {"color": MODEL},
         "y": rows, "x": np.where(good[:, 0], values[:, 0], np.nan), "width": 0.36,
         "hovertemplate": "%{x:.4g} mm<extra>clips used</extra>"},
    ]  # fmt: skip
    if good[:, 1].any():
        data.append({
            "type": "scatter", "mode": "markers", "name": "held-out clips", "y": rows, "x": values[:, 1],
            "marker": {"symbol": "diamond", "size": 10, "color": HELD_OUT, "line": {"color": INK, "width": 1}},
            "hovertemplate": "%{x:.4g} mm<extra>held out</extra>",
        })  # fmt: skip
    if floor > 0:
        data.append(line_at(floor, f"noise alone {number(floor)} mm", (-0.8, len(rungs) - 0.4), vertical=True))
    notes = [
        {"text": f"{_amounts(v, g)}: {label(r.label)}", "x": 0, "xref": "paper", "xanchor": "left", "y": k,
         "yanchor": "bottom", "yshift": 14, "showarrow": False, "align": "left"}
        for k, (r, v, g) in enumerate(zip(rungs, values, good, strict=True))
    ]  # fmt: skip
    layout = {
        "xaxis": scale,
        "yaxis": axis("model", range=[len(rungs) - 0.4, -0.8], showticklabels=False, showgrid=False, zeroline=False),
        "annotations": notes,
    }
    return Chart("ladder", "Error of every model", tuple(data), layout, 150 + RUNG_PX * len(rungs))


def _amounts(values: Array, good: NDArray[np.bool_]) -> str:
    """Misses [mm] of the clips used and of those held out, in words."""
    used = f"{number(values[0])} mm" if good[0] else "no number"
    return used + (f", held out {number(values[1])} mm" if good[1] else "")


def curve_charts(unexplained: Mapping[str, Any] | None) -> list[Chart]:
    """Curves of what no effect explains, as result.json has them, each with a band of two standard deviations."""
    found = []
    for place, curve in enumerate((unexplained or {}).get("curves", ())):
        at, value = np.array(curve["at"]), np.array(curve["value"])
        sd = np.array([math.nan if one is None else one for one in curve["sd"]])
        known = np.isfinite(sd)
        band = np.stack([at, value - 2 * sd, value, value + 2 * sd], axis=1)[known]
        data = band_of(band, "two standard deviations", "the curve", MODEL)
        unit = f" [{curve['variable_unit']}]" if curve["variable_unit"] != "1" else ""
        layout = {"xaxis": axis(f"{curve['variable']}{unit}"), "yaxis": axis(curve["quantity"], zeroline=True)}
        title = f"{curve['quantity'].partition(' [')[0]} by {curve['variable']}"
        found.append(Chart(f"curve{place}", title[0].upper() + title[1:], tuple(data), layout))
    return found


def shots_chart(comparisons: Sequence[tuple[str, Comparison]]) -> Chart | None:
    """Rms miss of every shot, the worst first, of the first and the last comparison; None without a number."""
    last = comparisons[-1][1]
    rows = [c for c in last.clips if math.isfinite(c.rms_m)]
    if not rows:
        return None
    first = {c.file: c.rms_m for c in comparisons[0][1].clips} if len(comparisons) > 1 else {}
    rows.sort(key=lambda c: (-first.get(c.file, c.rms_m), c.file))
    names = [label(PurePosixPath(c.file).stem, 24) for c in rows]
    place = list(range(1, len(rows) + 1))
    data: list[dict[str, Any]] = []

    def marks(name: str, colour: str, values: dict[int, float], symbol: str) -> None:
        data.append({
            "type": "scatter", "mode": "markers", "name": name, "x": list(values), "y": list(values.values()),
            "marker": {"color": colour, "size": 8, "symbol": symbol}, "text": [names[k - 1] for k in values],
            "hovertemplate": "%{text}: %{y:.4g} mm<extra>" + name + "</extra>",
        })  # fmt: skip

    if first:
        before = {
            k: 1e3 * first[c.file]
            for k, c in zip(place, rows, strict=True)
            if math.isfinite(first.get(c.file, math.nan))
        }
        marks(f"before: {label(comparisons[0][0], 40)}", BEFORE, before, "circle-open")
    what = "after" if first else "this model"
    for held, name, colour in ((False, what, MODEL), (True, f"{what}, held out", HELD_OUT)):
        values = {k: 1e3 * c.rms_m for k, c in zip(place, rows, strict=True) if c.held_out is held}
        if values:
            marks(name, colour, values, "diamond" if held else "circle")
    if last.noise_m > 0:
        floor = 1e3 * MISS_OVER_AXIS * last.noise_m
        data.append(line_at(floor, f"noise alone {number(floor)} mm", (0.5, len(rows) + 0.5)))
    seen = [y for trace in data for y in trace["y"] if y > 0] or [1.0]
    layout = {
        "xaxis": axis("shots, the worst first [count]", range=[0.4, len(rows) + 0.6], zeroline=False),
        "yaxis": log_axis("rms miss over the shot [mm]", min(seen) / 1.4, 1.4 * max(seen)),
    }
    return Chart("shots", "Error of every shot", tuple(data), layout, 340)


def dependence_charts(comparison: Comparison) -> list[Chart]:
    """Miss over noise against time, speed, heading, sidespin, impacts; none without samples or noise."""
    s, noise = comparison.samples, comparison.noise_m
    if not noise > 0 or not len(s.time):
        return []
    ratio, moving = np.hypot(*s.residual.T) / noise, is_moving(s)
    everywhere = np.ones_like(moving)
    panels: tuple[tuple[str, str, Array, NDArray[np.bool_]], ...] = (
        ("Time since the start", "time [s]", s.time, everywhere),
        ("Speed", "speed [m/s]", s.speed, moving),
        ("Heading", "heading from +x [degrees]", (np.degrees(s.heading) + 180) % 360 - 180, moving),
        ("Sidespin", "sidespin [rad/s], + is right", s.spin, moving),
        ("Impacts so far", "impacts [count]", s.events.astype(float), everywhere),
    )
    bands = [binned(x[use], ratio[use]) for _, _, x, use in panels]
    ends = np.concatenate([band[:, 1:].ravel() for band in bands] + [np.array([0.35, 3.0])])
    span = (0.8 * ends[ends > 0].min(), 1.25 * ends.max())
    found = []
    for k, ((title, words, _, _), band) in enumerate(zip(panels, bands, strict=True)):
        if not len(band):
            continue
        across = (band[0, 0], band[-1, 0])
        least, middle, most = RAYLEIGH_QUANTILES
        low, high = ({"x": across, "y": [quantile, quantile]} for quantile in (least, most))
        data = [*_band(low, high, "perfect model: 10–90 %", PERFECT), line_at(middle, "perfect model: median", across)]
        data += band_of(band, "this model: 10–90 %", "this model: median", MODEL)
        layout = {"xaxis": axis(words), "yaxis": log_axis("miss / noise [1]", *span), "showlegend": k == 0}
        found.append(Chart(f"depends-{k}", title, tuple(data), layout, 270))
    signed = _signed_chart(s, moving & np.isfinite(s.heading))
    return [*found, *([signed] if signed else [])]


def _signed_chart(s: Samples, use: NDArray[np.bool_]) -> Chart | None:
    """Miss along and across the ball's direction of motion against time."""
    (x, y), cos, sin = s.residual[use].T, np.cos(s.heading[use]), np.sin(s.heading[use])
    data = []
    for name, colour, value in (
        ("along: + model ahead", ALONG_COLOUR, x * cos + y * sin),
        ("across: + model left", ACROSS_COLOUR, y * cos - x * sin),
    ):
        band = binned(s.time[use], 1e3 * value)
        data += band_of(band, f"{name}, 10–90 %", name, colour) if len(band) else []
    if not data:
        return None
    layout = {"xaxis": axis("time [s]"), "yaxis": axis("miss [mm]")}
    return Chart("signed", "Along and across the motion", tuple(data), layout, 300)


def _band(low: dict[str, Any], high: dict[str, Any], name: str, colour: str) -> list[dict[str, Any]]:
    """A filled band between two curves, "x" and "y" of each."""
    edge = {"type": "scatter", "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    return [
        {**edge, **low, "showlegend": False},
        {**edge, **high, "name": name, "fill": "tonexty", "fillcolor": colour},
    ]


def band_of(band: Array, name: str, middle: str, colour: str, *, marked: bool = True) -> list[dict[str, Any]]:
    """A band (n, 4) of x, its lower edge, its middle and its upper edge, such as `binned` gives."""
    rgb = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    filled = f"rgba({rgb[0]},{rgb[1]},{rgb[2]},0.25)"
    low, high = ({"x": band[:, 0], "y": band[:, k]} for k in (1, 3))
    line = {
        "type": "scatter", "mode": "lines+markers" if marked else "lines", "name": middle, "x": band[:, 0],
        "y": band[:, 2], "line": {"color": colour, "width": 2}, "marker": {"size": 5},
        "hovertemplate": "%{y:.3g}<extra></extra>",
    }  # fmt: skip
    return [*_band(low, high, name, filled), line]


def segments_chart(comparison: Comparison) -> Chart | None:
    """Segments' residual over noise as a histogram; None without any."""
    ratios = np.array([s.ratio for s in comparison.segments], dtype=float)
    ratios = ratios[np.isfinite(ratios) & (ratios > 0)]
    if not len(ratios):
        return None
    edges = np.geomspace(0.99 * min(0.4, ratios.min()), 1.01 * max(4.0, ratios.max()), 36)
    counts, _ = np.histogram(ratios, edges)
    centres = np.sqrt(edges[1:] * edges[:-1])
    middle = float(np.median(ratios))
    data = (
        {"type": "bar", "name": f"{len(ratios)} segments, median {number(middle)}", "x": centres, "y": counts,
         "width": np.diff(edges), "marker": {"color": MODEL}, "hovertemplate": "%{x:.3g}: %{y}<extra></extra>"},
        line_at(1.0, "noise alone", (0, counts.max()), vertical=True),
    )  # fmt: skip
    layout = {"xaxis": log_axis("rms residual / noise [1]", edges[0], edges[-1]), "yaxis": axis("segments [count]")}
    return Chart("segments", "Segments between impacts", data, layout)


def white_chart(comparison: Comparison) -> Chart | None:
    """Autocorrelation of whole shots' residuals with white noise's band; None without samples."""
    white = comparison.white
    value = np.array(white.autocorrelation)
    if not white.samples or not math.isfinite(float(value[0])):
        return None
    lag, band = np.arange(1, len(value) + 1), np.array(white.band)
    data = (
        *_band({"x": lag, "y": -band}, {"x": lag, "y": band}, "white noise: 95 %", PERFECT),
        {"type": "bar", "name": "this model", "x": lag, "y": value, "marker": {"color": MODEL},
         "hovertemplate": "lag %{x}: %{y:.2f}<extra></extra>"},
    )  # fmt: skip
    layout = {"xaxis": axis("lag [samples]"), "yaxis": axis("autocorrelation [1]")}
    return Chart("white", "Autocorrelation of the residuals", data, layout)


def is_moving(samples: Samples) -> NDArray[np.bool_]:
    """Which samples are of moving balls: (n,)."""
    return np.array([motion != "rest" for motion in samples.motion], dtype=bool)


def binned(x: Array, y: Array) -> Array:
    """Bins of about equal count: (n, 4) median x, then the 10, 50 and 90 % quantiles of y."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if not len(x):
        return np.empty((0, 4))
    values = np.unique(x)
    edges = values
    if len(values) > MAX_BINS:
        ends = np.quantile(x, np.linspace(0, 1, MAX_BINS + 1))
        place = np.floor((ends - ends[0]) / (ends[-1] - ends[0]) * 4 * MAX_BINS)
        edges = ends[:-1][np.diff(place, prepend=-1.0)[:-1] > 0]  # one bin where many would crowd
    index = np.searchsorted(edges, x, side="right") - 1
    groups = [index == k for k in range(len(edges))]
    rows = [[np.median(x[g]), *np.quantile(y[g], [0.1, 0.5, 0.9])] for g in groups if g.sum() >= MIN_BIN_SAMPLES]
    return np.array(rows, dtype=float).reshape(-1, 4)
