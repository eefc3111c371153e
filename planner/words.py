"""A plan as sentences and as a table of strokes, for the terminal and Python.

In: billiard-plan/1 as plain values. Out: lines and rows of text, for reading only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from models.recording.planned import percent, sentence

STROKE_HEADS = ("stroke", "string", "x'0 mm", "y'0 mm", "yaw deg", "potted", "fouls", "rest mm")


def plan_lines(made: Mapping[str, Any]) -> list[str]:
    """Lines on the stroke, the reason for it, and the tolerance of the yaw; or why there is none."""
    if not made["stroke"]:
        return [f"no shot: {made['why']}"]
    low, high = made["launcher"]["theta_tolerance_deg"]
    yaw = f"yaw: {made['launcher']['theta_deg']:.2f} degrees, {low:+.2f} to {high:+.2f} costs a tenth of the pots"
    spread = (made.get("model") or {}).get("published_sd") or {}
    unfitted = f"constants that were not fitted vary as published values do: {', '.join(spread)}"
    return [sentence(made), made["why"], yaw, *[unfitted] * bool(spread)]


def stroke_rows(made: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the best stroke and the alternatives, under `STROKE_HEADS`; empty without a stroke."""
    rows = []
    for one in (made, *made["alternatives"]) if made["stroke"] else ():
        terms, median = one["launcher"], one["rest"]["distance_median"]
        numbers = [f"{terms[name]:.{digits}f}" for name, digits in (("x0_mm", 1), ("y0_mm", 1), ("theta_deg", 2))]
        chances = [percent(one[f"{name}_probability"]) for name in ("pot", "foul")]
        rest = "-" if median is None else f"{1e3 * median:.0f}"
        rows.append((one["kind"], terms["string"], *numbers, *chances, rest))
    return rows
