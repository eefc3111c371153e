"""The report of a comparison or a discovery: one HTML file that needs no network.

In: comparisons, a verdict, rounds of candidates, notes. Out: the file. This module computes the values of the tables;
figures.py and figures_where.py make the figures, player.py the shots that are played back, and
templates/comparison.html.j2 holds headings and captions. The script that draws is embedded once (models/report/chart).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.model_file import Estimate, Model
from models.report.chart import Chart, embedded
from models.report.numbers import NO_VALUE, millimetres, number, value_with_sd
from models.report.page import write_page
from sysid.report.finding import INTERVAL_SDS
from sysid.report.findings import NOTHING_MISSING, confounded_lines, round_rows
from sysid.report.health import health, health_lines
from sysid.report.pictures.figures import (
    Rung,
    curve_charts,
    dependence_charts,
    ladder_chart,
    segments_chart,
    shots_chart,
    white_chart,
)
from sysid.report.pictures.figures_where import lacking_charts, misses_map
from sysid.report.pictures.first_figures import first_figures
from sysid.report.pictures.player import playback
from sysid.report.pictures.shot_picture import shot_pictures
from sysid.report.text import in_words
from sysid.report.typical import TYPICAL_RANGES
from sysid.report.verdict import Verdict
from sysid.residuals.comparison import Comparison, Group
from sysid.selection.next_shot import NextShot
from sysid.selection.screening import Screening

__all__ = ["Rung", "write_report"]

REPORT_TEMPLATE = Path(__file__).with_name("templates") / "comparison.html.j2"
MAX_GROUPS_LISTED = 10  # of one kind
GROUP_TITLES = {
    "phase": "By the ball's motion",
    "event": "By the impact before",
    "speed": "By speed",
    "rail": "By cushion",
    "ball": "By ball",
    "segment": "By segment between impacts",
    "clip": "By clip",
}
MIN_BAR_RATIO = 0.5  # residual over noise at which a bar begins
MIN_FULL_BAR_RATIO = 2.0  # residual over noise that a full bar stands for, at least
STRIP_MARGIN = 0.08  # of a strip's width, on either side of what it shows


def write_report(
    path: Path | str,
    title: str,
    comparisons: Sequence[tuple[str, Comparison]],
    *,
    ladder: Sequence[Rung] = (),
    notes: Sequence[str] = (),
    rounds: Sequence[Screening] = (),
    verdict: Verdict | None = None,
    unexplained: Mapping[str, Any] | None = None,
    next_shots: Sequence[NextShot] = (),
) -> None:
    """Write one HTML file, whole or not at all; the last comparison is drawn in full.

    Args:
        path: the file.
        title: its heading.
        comparisons: (label, comparison), from the poorest model to the best; of several, the first stands beside it.
        ladder: models that come between them; one with a comparison's label stands in its place.
        notes: lines shown on top, or folded below the verdict.
        rounds: of candidates for what is missing.
        verdict: of a discovery.
        unexplained: what no effect explains, as result.json has it.
        next_shots: to film, which are drawn as the last model plays them.

    Raises:
        BadInput: the file cannot be written there.
    """
    label, last = comparisons[-1] if comparisons else ("", None)
    rungs = _rungs(comparisons, ladder)
    rising = ladder_chart(rungs, last.noise_m if last else math.nan)
    charts: dict[str, list[Chart]] = {"ladder": [rising] if rising else [], "curves": curve_charts(unexplained)}
    if last is not None:
        charts |= _charts(comparisons, last)
    first = first_figures(comparisons)
    charts["first"] = [chart for figure in first for chart in figure.charts]
    player = playback(comparisons)
    drawn = [chart.to_json() for part in charts.values() for chart in part]
    write_page(
        path,
        REPORT_TEMPLATE,
        title=title,
        label=label,
        first_label=comparisons[0][0] if len(comparisons) > 1 else "",
        first_lines=in_words(comparisons[0][1]) if len(comparisons) > 1 else [],
        verdict=verdict,
        notes_on_top=notes,
        ladder_rows=_ladder_rows(comparisons, rungs),
        rounds=[_round(number, seen) for number, seen in enumerate(rounds, 1)],
        charts=charts,
        first_figures=first,
        next_shots=shot_pictures(next_shots, last.model) if last else [],
        figures=embedded({"charts": drawn, "player": player}) if drawn or player else "",
        player=player,
        **_values(last),
    )


def _values(last: Comparison | None) -> dict[str, object]:
    """What tables and lists say of the last comparison."""
    if last is None:
        return {"last": None, "constants": [], "health_notes": []}
    return {
        "last": last, "cards": _cards(last), "departures": _departures(last), "groups": _groups(last.where),
        "constants": _constants(last.model),
        "health_notes": [] if health(last.model) else health_lines(last.model),
    }  # fmt: skip


def _charts(comparisons: Sequence[tuple[str, Comparison]], last: Comparison) -> dict[str, list[Chart]]:
    """The figures of the last comparison and of shots, by their sections."""
    parts: dict[str, list[Chart | None]] = {
        "shots": [shots_chart(comparisons)], "misses": [misses_map(last)],
        "dependence": [*dependence_charts(last)], "lacking": [*lacking_charts(last)],
        "noise": [white_chart(last), segments_chart(last)],
    }  # fmt: skip
    return {name: [chart for chart in found if chart is not None] for name, found in parts.items()}


def _cards(comparison: Comparison) -> list[tuple[str, str]]:
    """The main figures, shown first."""
    medians = comparison.summary()
    held = sum(c.held_out for c in comparison.clips)
    found = [
        (str(len(comparison.clips)), f"clips, {held} of them held out" if held else "clips"),
        (number(len(comparison.samples.time)), "samples compared"),
        (millimetres(comparison.noise_m), "noise, one standard deviation per axis"),
        (millimetres(comparison.slow_noise.sd or math.nan), "part of it: wander of tracks about smooth paths"),
        (millimetres(medians["struck_rms_median_m"]), "struck ball, rms miss over a shot, median"),
        (millimetres(medians["struck_rms_median_held_out_m"]), "the same, held-out clips only"),
        (millimetres(medians["mujoco_struck_rms_median_m"]), "struck ball, the same constants in MuJoCo"),
        (number(medians["segment_ratio_median"]), "residual / noise of segments, median"),
    ]
    return [(value, what) for value, what in found if value != NO_VALUE]


def _rungs(comparisons: Sequence[tuple[str, Comparison]], ladder: Sequence[Rung]) -> list[Rung]:
    """All models in order: the comparisons but the last, the ladder given, the last comparison."""
    given = {rung.label for rung in ladder}
    compared = [_rung(label, comparison) for label, comparison in comparisons]
    before = [rung for rung in compared[:-1] if rung.label not in given]
    return [*before, *ladder, *(rung for rung in compared[-1:] if rung.label not in given)]


def _rung(label: str, comparison: Comparison) -> Rung:
    """A comparison's place on the ladder: every clip has the same weight, χ² is the clips' median."""

    def rms(values: Iterable[float]) -> float:
        finite = [v for v in values if math.isfinite(v)]
        return math.sqrt(float(np.mean(np.square(finite)))) if finite else math.nan

    clips = comparison.clips
    used = [c.rms_m for c in clips if not c.held_out] or [c.rms_m for c in clips]
    chi2 = [c.chi2_reduced for c in clips if math.isfinite(c.chi2_reduced)]
    held = rms(c.rms_m for c in clips if c.held_out)
    return Rung(label, rms(used), held, float(np.median(chi2)) if chi2 else math.nan)


def _ladder_rows(comparisons: Sequence[tuple[str, Comparison]], rungs: Sequence[Rung]) -> list[list[str]]:
    """Label, six figures and a note of every model; medians are those of models that were compared."""
    medians = {label: comparison.summary() for label, comparison in comparisons}
    rows = []
    for rung in rungs:
        known = medians.get(rung.label, {})
        struck, held = (known.get(f"struck_rms_median{part}_m") for part in ("", "_held_out"))
        cells = [millimetres(rung.rms_m), millimetres(rung.held_out_rms_m), number(rung.chi2_reduced)]
        cells += [millimetres(struck), millimetres(held), number(known.get("segment_ratio_median"))]
        rows.append([rung.label, *cells, rung.note])
    return rows


def _departures(comparison: Comparison) -> list[tuple[str, ...]]:
    """Significant departures: where, variable, quantity, value with sd, z, count."""
    return [
        (d.where, d.variable, f"{d.quantity} [{d.unit}]", value_with_sd(d.value, d.sd), f"{d.z:.0f}", number(d.samples))
        for d in comparison.local.named
    ]


def _groups(where: Sequence[Group]) -> list[dict[str, object]]:
    """Groups of samples, one table per kind, the worst first, with the length of a logarithmic bar in per cent."""
    top = max([MIN_FULL_BAR_RATIO, *(d.ratio for d in where if math.isfinite(d.ratio))])

    def percent(ratio: float) -> float | None:
        if not math.isfinite(ratio):
            return None
        return 100 * min(
            1.0, max(0.0, math.log(max(ratio, MIN_BAR_RATIO) / MIN_BAR_RATIO) / math.log(top / MIN_BAR_RATIO))
        )

    tables: list[dict[str, object]] = []
    kinds = dict.fromkeys(d.by for d in where)
    for by in [*(b for b in GROUP_TITLES if b in kinds), *(b for b in kinds if b not in GROUP_TITLES)]:
        rows = sorted((d for d in where if d.by == by), key=lambda d: -d.ratio if math.isfinite(d.ratio) else math.inf)
        tables.append({
            "title": GROUP_TITLES.get(by, by), "by": by, "noise_mark": percent(1.0),
            "rows": [(d, percent(d.ratio)) for d in rows[:MAX_GROUPS_LISTED]], "more": len(rows) - MAX_GROUPS_LISTED,
        })  # fmt: skip
    return tables


def _round(number: int, seen: Screening) -> dict[str, object]:
    """A round of candidates; each row has the length of a bar for delta BIC, from zero and to scale, in per cent.

    Delta BIC is twice a log likelihood, and so a logarithm already: what compares two candidates is their difference.
    A logarithmic bar would show 82 as half of 13,948, where the odds between the two are beyond all doubt.
    """
    heads, *rows = round_rows(seen)
    delta_bic = [max(float(row[1]), 0.0) for row in rows]
    top = max([1.0, *delta_bic])
    return {
        "number": number,
        "windows": seen.windows,
        "effects": ", ".join(e.name() for e in seen.base.model.effects) or "nothing",
        "heads": heads,
        "rows": [(row, 100 * v / top) for row, v in zip(rows, delta_bic, strict=True)],
        "lines": [*([] if seen.best else [NOTHING_MISSING]), *confounded_lines(seen)],
    }


def _constants(model: Model) -> list[dict[str, object]]:
    """Every constant that acts: its name, value, unit and source, and beside typical values a strip and a verdict."""
    known = {line.constant: line for line in health(model)}
    rows: list[dict[str, object]] = []
    for name, value in model.parameters().items():
        estimate, line = model.estimates.get(name, Estimate()), known.get(name)
        one = np.ndim(value) == 0
        rows.append({
            "name": name, "unit": str(model.meta(name)["unit"]),
            "value": _with_known_sd(float(value), estimate.sd) if one else "one per simulation",
            "source": estimate.source or str(model.meta(name)["source"]),
            "what": line.what if line else "", "typical": f"{line.typical}: {line.source}" if line else "",
            "verdict": line.verdict if line else "", "strip": _strip(name, float(value), estimate.sd) if one else None,
        })  # fmt: skip
    return rows


def _with_known_sd(value: float, sd: float) -> str:
    return value_with_sd(value, sd) if math.isfinite(sd) and sd > 0 else f"{value:.5g}"


def _strip(name: str, value: float, sd: float) -> dict[str, float] | None:
    """Where typical range, interval and value lie on a strip [per cent]; None where one of them is not known."""
    usual = TYPICAL_RANGES.get(name)
    if usual is None or not math.isfinite(sd):
        return None
    low, high = value - INTERVAL_SDS * sd, value + INTERVAL_SDS * sd
    start, end = min(low, usual.low), max(high, usual.high)
    margin = STRIP_MARGIN * (end - start)
    start, end = start - margin, end + margin

    def at(place: float) -> float:
        return 100 * (place - start) / (end - start)

    return {
        "usual": at(usual.low), "usual_width": at(usual.high) - at(usual.low), "low": at(low),
        "width": at(high) - at(low), "value": at(value),
    }  # fmt: skip
