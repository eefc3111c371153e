"""Report of a study of plans: a table for the terminal, and Markdown with a picture.

In: the figures of a study (planner/study/figures.py) and its settings. Out: text, the same for the same scenes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from models.commands.console import table
from models.files import write_whole
from models.messages import counted
from planner.evaluation.outcome import FOULS
from planner.study.figures import CALIBRATION_BINS, MIN_BIN_SCENES, Record, figures
from planner.study.pictures import METHOD_TITLES, draw_study, share


def _number(form: str, unit: str, scale: float = 1.0) -> Callable[[Any], str]:
    return lambda value: "-" if value is None else f"{scale * value:{form}} {unit}"


def rows(study: Record) -> list[tuple[str, ...]]:
    """The table of figures: a heading, then a row for each."""
    methods, mm, s = study["methods"], _number(".0f", "mm", 1e3), _number(".1f", "s")
    columns = list(methods)
    out: list[tuple[str, ...]] = [("figure", *(METHOD_TITLES[m] for m in columns), "ceiling")]

    def line(text: str, show: Callable[[Any], str], key: str) -> None:
        top = share(study["ceiling"][key]) if key in study["ceiling"] else ""
        out.append((text, *(show(methods[m][key]) for m in columns), top))

    line("potted without a foul", share, "made")
    line("potted, with fouls", share, "potted")
    line("potted, as predicted", share, "predicted")
    line("fouls", share, "foul")
    for name in FOULS:
        out.append((f"  {name}", *(share(methods[m]["fouls"][name]) for m in columns), ""))
    line("cue ball from the goal position, median of all plays that potted", mm, "away_pooled")
    line("  median of the scenes' medians", mm, "away_medians")
    line("  likewise over all plays", mm, "away_all_medians")
    line("  likewise, as predicted", mm, "away_predicted")
    line("scenes without a stroke", str, "none")
    line("processor time to plan, median", s, "seconds_median")
    line("processor time to plan, 95 %", s, "seconds_95")
    for m in columns:
        gap = study["calibration"][m]["largest_gap"]
        cells = [share(gap) if k == m else "" for k in columns]
        out.append((f"largest gap of calibration, {METHOD_TITLES[m]}", *cells, ""))
    if "against" in study:
        against = study["against"]
        text = f"{share(against['better'])} better, {share(against['equal'])} equal, {share(against['worse'])} worse"
        out.append(("scenes against the baseline", text, "", ""))
        out.append(("more potted than by the baseline", share(against["gain"]), "", ""))
        few = f"in {len(against['overlooked'])} of {study['scenes']} scenes"
        out.append(("baseline's stroke of greater utility by the search's own figures", few, "", ""))
    return out


def text_table(study: Record) -> str:
    """The figures for a terminal."""
    head = counted(study["scenes"], "scene") + (f", {len(study['failed'])} more failed" if study["failed"] else "")
    return f"{head}\n\n{table(rows(study))}\n" if study["scenes"] else f"{head}\n"


def _grid(lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table; its first row is the heading."""
    return "\n".join("| " + " | ".join(r) + " |" for r in (lines[0], ["---"] * len(lines[0]), *lines[1:]))


def markdown(study: Record, settings: Record, out: str, picture: str) -> str:
    """The report's text, from a study's figures and settings, and the names of its folder and picture."""
    columns = list(study["methods"])
    parts = [
        "# Success of plans",
        _conditions(study, settings),
        f"![Calibration, pots by scene, distances, sample scenes]({picture})",
        "## Figures",
        _grid(rows(study)) if study["scenes"] else "No scene yet.",
        "The ceiling is the best stroke found by a search that knows the truth and has no goal position, for the same"
        " pocket; it was found by"
        f" {', '.join(f'{k} ({n})' for k, n in sorted(study['ceiling_by'].items())) or 'none'}.",
    ]
    for m in columns:
        gap = share(study["calibration"][m]["largest_gap"])
        parts += [f"## Calibration, {METHOD_TITLES[m]}", _calibration_grid(study["calibration"][m]["bins"])]
        parts.append(f"Largest gap of bins with {MIN_BIN_SCENES} scenes or more: {gap}.")
    parts += ["## By effect", "Potted without a foul.", _effect_grid(study["effects"], columns)]
    lines = [("constant", "mean drawn", "sd drawn")]
    lines += [(name, f"{v['mean']:.5g}", f"{v['sd']:.2g}") for name, v in study["constants"].items()]
    parts += ["## Constants drawn", _grid(lines), "## Worst scenes", "Farthest below the ceiling."]
    plan = f"planner plan scene.toml --model {out}/model.toml --out plan.json"
    export = f"`planner study --out {out} --scene N scene.toml`, then `{plan}`"
    parts += [_worst_grid(study["worst"]), f"To examine scene N: {export}."]
    if overlooked := study.get("against", {}).get("overlooked"):
        numbers = ", ".join(map(str, overlooked))
        parts.append(f"Scenes in which our own figures predict a greater utility for the baseline's stroke: {numbers}.")
    if study["failed"]:
        parts += ["## Failed", "\n".join(f"* {number}: {text}" for number, text in study["failed"])]
    return "\n\n".join(parts) + "\n"


def _conditions(study: Record, settings: Record) -> str:
    """A paragraph on the drawing of scenes and the evaluation of strokes."""
    execution = settings["execution"]
    errors = (
        f"{100 * execution['speed_sd']:g} % of the speed, {1e3 * execution['azimuth_sd']:g} mrad of azimuth, "
        f"{1e3 * execution['side_sd']:g} and {1e3 * execution['height_sd']:g} mm of the tip"
    )
    return (
        f"{study['scenes']} random scenes of {settings['balls']} balls, seed {settings['seed']}; every stroke played"
        f" {settings['plays']} times on a truth that the planner does not know (constants within the model's"
        f" uncertainty, and one small effect that it lacks), in MuJoCo, with the launcher's errors: {errors}."
        f" Model {settings['model']}, sources {settings['sources']}. Written by `planner study`."
    )


def _calibration_grid(bins: Sequence[Record]) -> str:
    """Predicted and observed shares by bin, as a Markdown table."""
    lines = [("predicted", "mean predicted", "mean observed", "scenes")]
    for b in bins:
        interval = f"{100 * b['from']:.0f} to {100 * (b['from'] + 1 / CALIBRATION_BINS):.0f} %"
        seen = share({"mean": b["seen"], "se": b["se"]})
        lines.append((interval, share(b["predicted"]), seen, str(b["scenes"])))
    return _grid(lines)


def _effect_grid(effects: Sequence[Record], methods: Sequence[str]) -> str:
    """Shots made by effect of the truth, as a Markdown table."""
    titles = [METHOD_TITLES[m] for m in methods]
    lines: list[tuple[str, ...]] = [("effect in the truth", "sizes drawn", "scenes", *titles, "ceiling")]
    for row in effects:
        sizes = ", ".join(f"{k} {low:.4g} to {high:.4g}" for k, (low, high) in row["drawn"].items())
        lines.append((row["effect"], sizes, str(row["scenes"]), *(share(row[m]) for m in (*methods, "ceiling"))))
    return _grid(lines)


def _worst_grid(worst: Sequence[Record]) -> str:
    """The scenes farthest below the ceiling, as a Markdown table."""
    lines = [("scene", "potted", "ceiling", "effect", "")]
    for w in worst:
        planned = "" if w["planned"] else "no stroke found"
        lines.append((str(w["number"]), share(w["made"]), share(w["ceiling"]), w["effect"], planned))
    return _grid(lines)


def write_report(path: Path | str, scenes: Sequence[Record], settings: Record, out: Path | str) -> None:
    """Write Markdown and its pictures as PNG next to it, each completely or not at all."""
    path = Path(path)
    picture, study = path.with_suffix(".png"), figures(scenes)
    write_whole(picture, draw_study([s for s in scenes if "error" not in s], study))
    write_whole(path, markdown(study, settings, Path(out).name, picture.name).encode())
