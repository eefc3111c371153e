"""The report of a plan: one HTML file with embedded figures, for a browser without network or scripts.

It shows the stroke to set, planned and sampled paths of the balls, resting positions of the cue ball, and the
alternatives. Outlines contain 50 % and 90 % of the samples (models/recording/planned.py), without assuming a normal
distribution; they are left out with few samples. This module computes the values of the tables,
planner/report_figures.py draws, templates/plan.html.j2 holds headings and captions. The same plan gives the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from models.files import write_whole
from models.recording.planned import given, percent, rest_words, resting, scene_of, sentence, strike_words, wanted
from models.report.figure import png, svg
from models.report.numbers import NO_VALUE
from models.report.page import write_page
from models.shot import Array, Ball, Table
from planner.report_figures import face_svg, rest_svg, table_from_above, thumbnail_svg

REPORT_TEMPLATE = Path(__file__).with_name("templates") / "plan.html.j2"
METHOD_NAMES = {
    "risk": "expected utility under execution and model errors", "ga": "genetic algorithm", "given": "a given stroke",
}  # fmt: skip


def write_report(path: Path | str, plan: Mapping[str, Any], title: str) -> None:
    """Write one HTML file, completely or not at all; BadInput if it cannot be written, or `plan` is not a plan."""
    table, ball, balls = scene_of(plan)
    stroke, rests = bool(plan.get("stroke")), len(resting(plan)[0]) > 0
    write_page(
        path,
        REPORT_TEMPLATE,
        title=title,
        sentence=sentence(plan),
        why=plan.get("why") or "",
        stroke=stroke,
        face=face_svg(plan, ball) if stroke else None,
        settings=_settings(plan),
        above=svg("plan", *table_from_above(plan)),
        above_narrow=svg("plan narrow", *table_from_above(plan, narrow=True)),
        rest=rest_svg(plan, table, ball) if rests else None,
        rest_narrow=rest_svg(plan, table, ball, narrow=True) if rests else None,
        place_wanted=wanted(plan)[0] is not None,
        alternatives=_alternatives(plan, table, ball, balls),
        fouls=_fouls(plan),
        any_foul=percent(plan.get("foul_probability")),
        computed=_computed(plan, table, ball),
    )


def write_picture(path: Path | str, plan: Mapping[str, Any]) -> None:
    """Write the table from above as PNG, completely or not at all; BadInput as for the report."""
    scene_of(plan)
    write_whole(path, png(*table_from_above(plan), dpi=144))


def _settings(plan: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Rows (value, description): the settings, then the probabilities with their intervals."""
    chances = [(f"{what}, with its interval", percent(plan.get(f"{what}_probability"))) for what in ("pot", "foul")]
    return [(value, what) for what, value in strike_words(plan) + chances]


def _alternatives(
    plan: Mapping[str, Any], table: Table, ball: Ball, balls: Mapping[str, Array]
) -> list[dict[str, str]]:
    """Picture and description of every alternative stroke."""
    rows = []
    for k, other in enumerate(plan.get("alternatives") or [], start=1):
        words = dict(strike_words(other))
        rows.append({
            "picture": thumbnail_svg(f"alternative {k}", other, table, ball, balls),
            "kind": other.get("kind") or "",
            "why": other.get("why") or "",
            "stroke": f"string {words['string']}, θ {words['θ, counter-clockwise from +x']}",
            "offsets": f"x′0 {words['x′0, + is right']}, y′0 {words['y′0, + is up']}; {words['ball speed']}",
            "pot": percent(other.get("pot_probability")),
            "foul": percent(other.get("foul_probability")),
            "rest": rest_words(other.get("rest")),
            "value": given(other.get("value"), ".2f"),
        })  # fmt: skip
    return rows


def _fouls(plan: Mapping[str, Any]) -> list[tuple[str, str, float]]:
    """Name, share as text and share [%] of every kind of foul, the most likely first."""
    fouls = sorted((plan.get("fouls") or {}).items(), key=lambda pair: (-pair[1], pair[0]))
    return [(name, given(100 * chance, ".1f", " %"), min(100.0, 100 * chance)) for name, chance in fouls]


def _published(model: Mapping[str, Any]) -> str:
    """Names of constants whose standard deviations are those of published values."""
    spread = model.get("published_sd") or {}
    return ", ".join(f"{name} {sd:.2g}" for name, sd in spread.items()) or "none"


def _computed(plan: Mapping[str, Any], table: Table, ball: Ball) -> list[tuple[str, str]]:
    """The inputs of the plan, as (description, value)."""
    execution, model = plan.get("execution") or {}, plan.get("model") or {}

    def sd(key: str, factor: float, unit: str) -> str:
        value = execution.get(key)
        return given(None if value is None else factor * value, ".2g", unit)

    errors = f"speed {sd('speed_sd', 100, ' %')}, direction {sd('azimuth_sd', 180 / math.pi, '°')}, "
    errors += f"side {sd('side_sd', 1e3, ' mm')}, height {sd('height_sd', 1e3, ' mm')}"
    return [
        ("method", METHOD_NAMES.get(plan.get("method", ""), NO_VALUE)),
        ("random seed", str(plan.get("seed", NO_VALUE))),
        ("execution errors, one standard deviation", errors),
        ("model", PurePath(str(model.get("file") or "none given: the base with its usual constants")).name),
        ("effects", ", ".join(model.get("effects") or []) or "none"),
        ("constants that were not fitted vary as published values do, one standard deviation", _published(model)),
        ("samples", f"{len(plan.get('fan') or [])} drawn as lines, {len(resting(plan)[0])} as resting positions"),
        ("value of the plan", given(plan.get("value"), ".2f")),
        ("table, ball", f"{table.length:g} m × {table.width:g} m, {1e3 * ball.diameter:g} mm, {ball.mass:g} kg"),
    ]
