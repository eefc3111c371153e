"""Figures of a closed-loop series: misses and pots by block, refits, and the true constants of an emulated one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from models.commands.console import table
from sysid.estimation.fitted import MISS_OVER_AXIS

if TYPE_CHECKING:
    from robot.learning.emulated_rig import EmulatedRig
    from robot.learning.history import History, Refit
    from robot.learning.loop import LearningConfig

LEARN_FORMAT = "billiard-learn/1"


def figures(story: History, course: LearningConfig, stand: EmulatedRig | None) -> dict[str, Any]:
    """A series as plain values, format billiard-learn/1."""
    return {
        "format": LEARN_FORMAT, "seed": course.seed, "shots": len(story.shots), "every": course.every,
        "ended": story.ended, "blocks": _blocks(story, course.every),
        "refits": [dataclasses.asdict(refit) for refit in story.refits],
        "truth": _truth(story.refits[-1] if story.refits else None, course, stand),
    }  # fmt: skip


def _blocks(story: History, every: int) -> list[dict[str, Any]]:
    """Figures of the shots in every block."""
    blocks = []
    for first in range(1, len(story.shots) + 1, every):
        shots = story.shots[first - 1 : first - 1 + every]
        last = shots[-1].number
        to_pot = story.played_to_pot(first, last)
        away = [s.from_wanted for s in to_pot if math.isfinite(s.from_wanted)]
        blocks.append({
            "first": first, "last": last, "chosen": len(shots) - len(to_pot), "learnt": shots[0].learnt,
            "miss_median_m": story.median_miss(first, last), "foreseen_median_m": story.median_spread(first, last),
            "scatter_median_m": story.floor(first, last),
            "potted": sum(s.potted is True for s in to_pot), "seen": sum(s.potted is not None for s in to_pot),
            "predicted": sum(s.pot_probability for s in to_pot if s.potted is not None),
            "from_wanted_median_m": float(np.median(away)) if away else math.nan,
        })  # fmt: skip
    return blocks


def _truth(last: Refit | None, course: LearningConfig, stand: EmulatedRig | None) -> dict[str, Any]:
    """Start, learnt and hidden constants of an emulated table and launcher."""
    start = course.model.parameters()
    began = {n: float(v) for n, v in start.items()} | dataclasses.asdict(course.cueing_map.constants)
    hidden: dict[str, float] = {}
    if stand is not None:
        hidden = {n: float(v) for n, v in stand.model.parameters().items()} | dataclasses.asdict(stand.cue)
    found = {**last.values, **last.launcher} if last else {}
    units = {f.name: f.metadata["unit"] for f in dataclasses.fields(course.cueing_map.constants)}
    rows = []
    for name in dict.fromkeys((*hidden, *found)):
        value, sd = found.get(name, (math.nan, math.nan))
        if not name.startswith("native."):
            rows.append({
                "name": name, "unit": units[name] if name in units else course.model.meta(name)["unit"],
                "began": began.get(name), "value": value, "sd": sd, "hidden": hidden.get(name),
            })  # fmt: skip
    base = {e.name() for e in course.model.stack()}
    return {
        "effects": [e.name() for e in stand.model.stack() if e.name() not in base] if stand else None,
        "found": list(last.verdict) if last else [],
        "constants": rows,
    }


def text_of(result: dict[str, Any]) -> str:
    """The figures as text."""
    rows: list[tuple[str, ...]] = [
        ("shots", "learnt from", "miss mm", "predicted mm", "scatter mm", "potted", "predicted pots", "from wanted mm")
    ]
    for b in result["blocks"]:
        sizes = (b[f"{k}_median_m"] for k in ("miss", "foreseen", "scatter", "from_wanted"))
        miss, foreseen, scatter, away = (f"{1e3 * v:.0f}" if math.isfinite(v) else "-" for v in sizes)
        shots = f"{b['first']} to {b['last']}"
        potted = f"{b['potted']} of {b['seen']}"
        rows.append((shots, str(b["learnt"]), miss, foreseen, scatter, potted, f"{b['predicted']:.1f}", away))
    parts = [
        table(rows),
        "medians: distance of the cue ball from the planned place, measured, predicted by the plan, and due to the "
        "launcher alone; and its distance from the wanted place; all without shots chosen for learning",
        "",
    ]
    for r in result["refits"]:
        found = ", ".join(r["verdict"]) or "no effect beyond the base"
        rest = f"; unexplained: {r['unexplained']}" if r["unexplained"] else ""
        distance = f"rms distance {1e3 * MISS_OVER_AXIS * r['rms']:.2f} mm"
        parts.append(f"after {r['shots']} shots: {found}{rest} ({distance}, {r['seconds']:.0f} s)")
    if not result["refits"]:
        parts.append(f"no refit: the first is made after {result['every']} shots")
    return "\n".join([*parts, f"ended: {result['ended']}", "", *_truth_lines(result["truth"])])


def _truth_lines(truth: dict[str, Any]) -> list[str]:
    """Lines with the true and the learnt constants."""
    emulated = truth["effects"] is not None
    rows: list[tuple[str, ...]] = [("constant", "unit", "began with", "learnt", "sd", *["true"] * emulated)]
    for c in truth["constants"]:
        values = (c["began"], c["value"], c["sd"], *[c["hidden"]] * emulated)
        rows.append((c["name"], c["unit"], *_numbers(*values)))
    lines = [f"found: {', '.join(truth['found']) or 'none'}", table(rows, 2)]
    if emulated:
        effects = ", ".join(truth["effects"]) or "none beyond those of the first model"
        lines.insert(0, f"effects of the emulated table: {effects}")
    return lines


def _numbers(*values: float | None) -> Sequence[str]:
    return ["-" if v is None or not math.isfinite(v) else f"{v:.4g}" for v in values]
