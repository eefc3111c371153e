"""Figures read from what the measuring commands write.

In: a file or folder of results. Out: figures by name, as the pages show them. Sources without a reader here take days,
hardware or clicks of others to measure: their figures are entered by hand, with the command and the date.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.figures.pages import ROOT
from tests.figures.real_shot import real_shot

AXES = math.sqrt(2)  # a distance over an error per axis
Figures = dict[str, str]


def demo(folder: Path) -> Figures:
    """Of `sysid demo --out folder`."""
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    out: Figures = {}
    for name, rung in zip(("base", "mended"), result["ladder"], strict=True):
        for suffix, key in (("", "rms_m"), ("_held_out", "held_out_rms_m")):
            out[name + suffix] = f"{1e3 * AXES * rung[key]:.2f} mm"
        chi2 = rung["chi2_reduced"]
        out[f"{name}_chi2"] = f"{chi2:.1f}" if chi2 > 2 else f"{chi2:.2f}"
    first, second = result["rounds"][0][:2]
    out |= {"delta_bic": f"{first['delta_bic']:.0f}", "next_best": f"{second['delta_bic']:.0f}"}
    for axis in "xy":
        slope = result["parameters"][f"table_tilt.slope_{axis}"]
        out[f"slope_{axis}"] = f"{1e3 * slope['value']:.2f} +- {1e3 * slope['sd']:.2f}"
    return out


def drying(folder: Path) -> Figures:
    """Of the commands of docs/effects.md for a cloth that dries, whose results lie in a folder."""
    found = json.loads((folder / "dry-found" / "result.json").read_text(encoding="utf-8"))
    rest, base = found["unexplained"], found["ladder"][0]
    drag = json.loads((folder / "dry-fit.json").read_text(encoding="utf-8"))["parameters"]["drying.drag_order"]
    return {
        "formula": rest["form"].split(": ")[-1], "before": f"{1e3 * AXES * base['rms_m']:.1f} mm",
        "after": f"{1e3 * AXES * rest['rms_m']:.2f} mm", "held_out": f"{1e3 * AXES * rest['held_out_rms_m']:.2f} mm",
        "fitted": f"{drag['value']:.5f} +- {drag['sd']:.5f}",
    }  # fmt: skip


def match(folder: Path) -> Figures:
    """Of `sysid discover CAROM --out folder`: of whole shots held out, and of the one that README's picture shows."""
    shot = real_shot(folder / "report.html")
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    base, mended = (result["whole_shots"][k] for k in (0, -1))
    return {
        "base": f"{1e3 * base['struck_rms_median_held_out_m']:.0f} mm",
        "mended": f"{1e3 * mended['struck_rms_median_held_out_m']:.0f} mm",
        "segments": f"{mended['segment_ratio_median']:.1f}", "time": f"{result['elapsed_s'] / 60:.0f} minutes",
        "inside_band": f"{100 * mended['held_out_coverage']:.0f} %", "held_out": f"{shot.held_out}",
        **{f"shot_{name}": f"{miss:.0f} mm" for name, miss in zip(("base", "found"), shot.misses_mm, strict=True)},
    }  # fmt: skip


def films_found(folder: Path) -> Figures:
    """Of `sysid discover` on the clips of the seven films: what it names, and what it leaves."""
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    fitted, held_out = misses(result["ladder"])
    out = {"miss": fitted, "miss_held_out": held_out}
    if slope := result["parameters"].get("table_tilt.slope_x"):
        out["slope"] = f"{1e3 * abs(slope['value']):.1f} +- {1e3 * slope['sd']:.1f} mm/m"
    return out


def misses(ladder: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Rms misses of the first model and of the last: of the clips fitted, and of those held out."""
    fitted, held_out = (
        " to ".join(f"{1e3 * AXES * ladder[k][key]:.1f}" for k in (0, -1)) for key in ("rms_m", "held_out_rms_m")
    )
    return f"{fitted} mm", f"{held_out} mm"


def loop(file: Path) -> Figures:
    """Of `robot learn --all --json file`: a row for each block."""
    out: Figures = {}
    for block in json.loads(file.read_text(encoding="utf-8"))["blocks"]:
        row = f"shots_{block['first']}"
        millimetres = {"miss": "miss_median_m", "scatter": "scatter_median_m", "from_wanted": "from_wanted_median_m"}
        out |= {f"{row}_{name}": f"{1e3 * block[key]:.0f} mm" for name, key in millimetres.items()}
        out |= {
            f"{row}_potted": f"{block['potted']} of {block['seen']}",
            f"{row}_predicted": f"{block['predicted']:.1f}",
        }
    return out


def mujoco(file: Path) -> Figures:
    """Of `sysid match --json file`."""
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    errors = {(row["model"], row["case"]): row["error"] for row in rows}
    errors |= {("analytic", row["case"]): row["analytic"] for row in rows if row["analytic"] is not None}
    whole, cloth = "whole shots, 200, 1 to 4 impacts: median", "cloth, 500 random states, 3 s"
    collisions = [f"oblique collisions of Mathavan 2009, {what}" for what in ("10 speeds", "5 deflections")]
    out: Figures = {"engine_moved_native": f"{short(errors['analytic', whole])} mm"}
    for model in ("native", "effects"):
        out[f"whole_{model}"] = f"{short(errors[model, whole])} mm"
        out[f"cloth_{model}"] = f"{short(errors[model, f'{cloth}: position, worst'])} mm"
        out[f"sidespin_{model}"] = f"{short(errors[model, f'{cloth}: sidespin, worst'])} %"
        out[f"roughness_{model}"] = f"{short(1e-3 * errors[model, 'roughness of end points over friction'])} mm"
        for name, case in (("balls", "ball-ball"), ("cushion", "cushion")):
            for what, key in (("velocity", "velocity"), ("spin", "R omega")):
                both = [short(errors[model, f"{case}, 500 random: {key}, {kind}"]) for kind in ("median", "worst")]
                out[f"{name}_{what}_{model}"] = f"{' / '.join(both)} %"
    tip = [
        errors["effects", f"launcher's tip, 455 strokes: {w}, rms"]
        for w in ("ball speed", "R omega over speed", "squirt")
    ]
    out["launcher_effects"] = "{} %, {} %, {}°".format(*map(short, tip))
    for model in ("native", "effects", "analytic"):
        for year, count in (("2010", 19), ("2009", 8)):
            parts = [f"rebounds of Mathavan {year}, {count}, {part}" for part in ("below 2.5 m/s", "all")]
            out[f"rebounds_{year}_{model}"] = f"{' / '.join(short(errors[model, part]) for part in parts)} m/s"
        speed, turn = (short(errors[model, case]) for case in collisions)
        out[f"collisions_2009_{model}"] = f"{speed} %, {turn}°"
    shots = [row for row in rows if row["case"].startswith("effect ") and row["model"] == "effects"]
    worst = [
        max(row["error"] for row in shots if row["case"].endswith(end)) for end in ("impact, median", "balls: median")
    ]
    return out | {"catalogue_effects": f"{short(worst[0])}; {short(worst[1])} mm"}


def short(value: float) -> str:
    """To two digits, three above a hundred; the power of ten of what is nothing."""
    if value < 1e-6:
        return f"{value:.0e}".replace("e-0", "e-")
    return f"{value:#.{3 if value >= 99.5 else 2}g}".rstrip(".")


def plans(page: Path) -> Figures:
    """Of planner/STUDY.md, which `planner study --report` writes."""
    rows = table_rows(page)

    def share(name: str, column: int) -> str:
        return re.sub(r"^([\d.]+) % ± ([\d.]+)$", r"\1 +- \2 %", rows[name][column])

    out = {name: share("potted without a foul", k) for k, name in enumerate(("ours", "paper", "best"))}
    out["best_possible"] = out["best"].split()[0]
    out |= {f"{name}_fouls": rows["fouls"][k].split(" ±")[0] for k, name in enumerate(("ours", "paper"))}
    gap = "largest gap of calibration, {}"
    out |= {"ours_gap": rows[gap.format("ours")][0], "paper_gap": rows[gap.format("baseline")][1]}
    out = {name: value.replace(" %", " points") if name.endswith("_gap") else value for name, value in out.items()}
    placed = "cue ball from the wanted place, median of all plays that potted"
    return out | {f"{name}_placed": rows[placed][k] for k, name in enumerate(("ours", "paper"))}


def hidden(page: Path) -> Figures:
    """Of tests/study/REPORT.md, which `make study` writes."""
    rows = {name: cells[1] for name, cells in table_rows(page).items() if len(cells) > 1}
    names = {
        "natural": "the hidden effect is the verdict, natural size",
        "quarter": "the same at a quarter of the size, base chi-square above 1.05",
        "sixteenth": "the same at a sixteenth of the size, base chi-square above 1.03",
        "false_alarms": "false alarms on sets without a hidden effect",
        "two": "two hidden effects, both named and nothing else",
        "outside": "outside the catalogue: reported as unexplained, with the right place",
        "outside_named": "outside the catalogue: a wrong effect named, alone or besides",
        "soiled_one": "soiled clips, one effect hidden: the verdict",
        "soiled_two": "soiled clips, two hidden: the verdict",
        "soiled_none": "soiled clips, nothing hidden: an effect named",
        "coverage_effects": "coverage of the 95 % interval, effects' parameters",
        "coverage_constants": "coverage of the 95 % interval, constants",
    }
    out = {name: _counted(rows[row]) for name, row in names.items()}
    out["size_error"] = rows["size of the effect, error of its main parameter"].replace(", 90 % below", ";")
    median, rest = rows["error on held-out clips over noise"].removeprefix("median ").split("; ")
    out["held_out"] = f"{median}; {rest.split(' = ')[1].split(' (')[0]}"
    median, longest = rows["time for 12 clips, one thread"].removeprefix("median ").split(", longest ")
    out |= {"seconds": f"{median}; {longest}", "seconds_median": median}
    sets = re.search(r"^(\d+) of \1 planned sets", page.read_text(encoding="utf-8"), re.MULTILINE)
    return out | {"sets": sets[1] if sets else "some"}


def _counted(cell: str) -> str:
    """124/129 = 96 % (91 to 98): 124 of 129."""
    return cell.split(" = ")[0].replace("/", " of ")


def table_rows(page: Path) -> dict[str, list[str]]:
    """Cells of a page's tables by their first one; of rows of the same name the first."""
    out: dict[str, list[str]] = {}
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.startswith("|"):
            name, *cells = (cell.strip() for cell in line.strip("|").split("|"))
            out.setdefault(name, cells)
    return out


READERS: Mapping[str, Callable[[Path], Figures]] = {
    "demo": demo,
    "drying": drying,
    "match": match,
    "films_found": films_found,
    "loop": loop,
    "mujoco": mujoco,
    "plans": plans,
    "hidden": hidden,
}
REPORTS: Mapping[str, Path] = {  # those whose results are in the repository
    "plans": ROOT / "planner" / "STUDY.md", "hidden": ROOT / "tests" / "study" / "REPORT.md",
}  # fmt: skip


def numbers(text: str) -> list[float]:
    """The numbers in a text, in order."""
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", text)]


def agree(one: str, other: str, tolerance: float) -> bool:
    """Whether two figures have the same words, and numbers that differ by a share at most, or by their last digit."""
    ours, theirs = numbers(one), numbers(other)
    words = [re.sub(r"\d+(?:\.\d+)?", "#", text) for text in (one, other)]
    if words[0] != words[1]:
        return False
    digits = [len(found.partition(".")[2]) for found in re.findall(r"\d+(?:\.\d+)?", one)]
    return all(
        abs(a - b) <= max(tolerance * abs(b), 1.5 * 10.0**-places)
        for a, b, places in zip(ours, theirs, digits, strict=True)
    )


def unlike(figures: Mapping[str, str], source: Mapping[str, Any], tolerance: float) -> list[str]:
    """What of measured figures is not as the file has it."""
    known = source["figures"]
    return [
        f"{name}: {value} measured, {known.get(name)} in figures.toml"
        for name, value in figures.items()
        if name in known and not agree(value, known[name], tolerance)
    ]
