"""The report of a comparison: one HTML file with its figures inside, for a browser without network or scripts.

In: comparisons, rounds of candidates, notes. Out: the file. This module computes the values of the tables,
sysid/report/plots.py and plots_where.py draw the figures, templates/comparison.html.j2 holds headings and captions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from models.model_file import Estimate, Model
from models.report.numbers import millimetres, number, value_with_sd
from models.report.page import write_page
from sysid.report.findings import NOTHING_MISSING, confounded_lines, round_rows
from sysid.report.health import HealthLine, health, health_lines
from sysid.report.plots import Rung, dependence_svg, ladder_svg, spread_svg, tracks_svg, white_svg
from sysid.report.plots_where import map_svg, missing_map_svg, missing_svg
from sysid.report.text import in_words
from sysid.residuals.comparison import Comparison, Group
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


def write_report(
    path: Path | str,
    title: str,
    comparisons: Sequence[tuple[str, Comparison]],
    *,
    ladder: Sequence[Rung] = (),
    notes: Sequence[str] = (),
    model: Model | None = None,
    rounds: Sequence[Screening] = (),
) -> None:
    """Write one HTML file, whole or not at all; the last comparison is drawn in full.

    Args:
        path: the file.
        title: its heading.
        comparisons: (label, comparison), from the poorest model to the best; of several, the first is shown in short.
        ladder: models that come between them; one with a comparison's label stands in its place.
        notes: lines shown on top.
        model: whose constants are listed; the last comparison's if None.
        rounds: of candidates for what is missing.

    Raises:
        BadInput: the file cannot be written there.
    """
    label, last = comparisons[-1] if comparisons else ("", None)
    listed = model or (last.model if last else None)
    rungs = _rungs(comparisons, ladder)
    values: dict[str, object] = {"last": None}
    if last is not None:
        values = {
            "last": last,
            "cards": _cards(last),
            "departures": _departures(last),
            "groups": _groups(last.where),
            "tracks": tracks_svg(last),
            "map": map_svg(last),
            "dependence": dependence_svg(last),
            "missing_map": missing_map_svg(last),
            "missing": missing_svg(last),
            "white": white_svg(last),
            "spread": spread_svg(last),
        }
    first = None
    if len(comparisons) > 1:
        first = {"label": comparisons[0][0], "lines": in_words(comparisons[0][1]),
                 "missing_map": missing_map_svg(comparisons[0][1])}  # fmt: skip
    write_page(
        path,
        REPORT_TEMPLATE,
        title=title,
        label=label,
        notes_on_top=notes,
        ladder_rows=_ladder_rows(comparisons, rungs),
        ladder=ladder_svg(rungs, last.noise_m if last else math.nan),
        first=first,
        rounds=[_round(number, seen) for number, seen in enumerate(rounds, 1)],
        constants=_constants(listed) if listed else None,
        health=_health(listed) if listed else None,
        **values,
    )


def _cards(comparison: Comparison) -> list[tuple[str, str]]:
    """The figures that a person asks for first."""
    medians = comparison.summary()
    held = sum(c.held_out for c in comparison.clips)
    return [
        (str(len(comparison.clips)), f"clips, {held} of them held out"),
        (number(len(comparison.samples.time)), "samples compared"),
        (millimetres(comparison.noise_m), "noise, one standard deviation per axis"),
        (millimetres(medians["struck_rms_median_m"]), "struck ball, rms over a shot, median"),
        (millimetres(medians["struck_rms_median_held_out_m"]), "the same, held-out clips only"),
        (millimetres(medians["mujoco_struck_rms_median_m"]), "struck ball, the same constants in MuJoCo"),
        (number(medians["segment_ratio_median"]), "residual / noise of segments, median"),
    ]


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
    """A round of candidates; each row has the length of a bar for delta BIC, logarithmic, in per cent."""
    heads, *rows = round_rows(seen)
    delta_bic = [max(float(row[1]), 0.0) for row in rows]
    top = max([1.0, *delta_bic])
    return {
        "number": number,
        "segments": seen.segments,
        "effects": ", ".join(e.name() for e in seen.base.model.effects) or "nothing",
        "heads": heads,
        "rows": [(row, 100 * math.log1p(v) / math.log1p(top)) for row, v in zip(rows, delta_bic, strict=True)],
        "lines": [*([] if seen.best else [NOTHING_MISSING]), *confounded_lines(seen)],
    }


def _health(model: Model) -> dict[str, object] | None:
    """Rows of constants beside typical values, or why there are none; None for a model that was not fitted."""
    lines: list[HealthLine] = health(model)
    rows = [(one.what, one.measured, one.typical, one.source, one.verdict) for one in lines]
    notes = [] if rows else health_lines(model)
    return {"rows": rows, "notes": notes} if rows or notes else None


def _constants(model: Model) -> list[tuple[str, ...]]:
    """Name, value with standard deviation, unit and source of every constant that acts."""
    rows: list[tuple[str, ...]] = []
    for name, value in model.parameters().items():
        estimate = model.estimates.get(name, Estimate())
        shown = "one per simulation" if np.ndim(value) else value_with_sd(float(value), estimate.sd)
        meta = model.meta(name)
        rows.append((name, shown, str(meta["unit"]), estimate.source or str(meta["source"])))
    return rows
