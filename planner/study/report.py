"""Figures of a study of plans, on the terminal and as Markdown with pictures: the same scenes, the same text.

A pot counts if it came without a foul; shares are means over scenes of the part of plays seen on the truth, with the
standard error between scenes. Calibration sorts scenes by the probability promised, potted with fouls or without, into
ten bins: in each, as many should pot as were promised, but for the error of so many scenes.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.console import table
from models.files import write_whole
from models.recording.shots import ball_colour
from models.report.axes import draw_table
from models.report.figure import HELD_OUT_COLOUR, INK_COLOUR, MODEL_COLOUR, NOISE_COLOUR, png
from models.shot import Ball, Table
from planner.evaluation.outcome import FOULS

Array = NDArray[np.float64]
Told = Mapping[str, Any]
OWN, PAPER = "risk", "ga"
TITLES = {OWN: "ours", PAPER: "baseline", "ceiling": "ceiling"}
COLOURS = {OWN: MODEL_COLOUR, PAPER: HELD_OUT_COLOUR, "ceiling": INK_COLOUR}
BINS, ENOUGH = 10, 5  # of probability; scenes that a bin needs to count in the largest gap
WORST = 6  # scenes named


def figures(scenes: Sequence[Told]) -> dict[str, Any]:
    """All figures of a study, as plain values; None where there is nothing to tell from."""
    good = [s for s in scenes if "error" not in s]
    methods = list(good[0]["methods"]) if good else []
    out: dict[str, Any] = {
        "scenes": len(good), "failed": [[s["number"], s["error"]] for s in scenes if "error" in s],
        "methods": {m: _method(good, m) for m in methods},
        "ceiling": {k: _mean([s["ceiling"][k] for s in good]) for k in ("made", "potted")},
        "ceiling_by": dict(Counter(str(s["ceiling"]["by"]) for s in good)),
        "calibration": {m: _calibration(good, m) for m in methods}, "effects": _effects(good, methods),
        "constants": _constants(good),
    }  # fmt: skip
    first = methods[0] if methods else OWN
    ranked = sorted(good, key=lambda s: (_seen(s, first)["made"] - s["ceiling"]["made"], s["number"]))
    out["worst"] = [
        {"number": s["number"], "made": _seen(s, first)["made"], "ceiling": s["ceiling"]["made"],
         "effect": s["truth"]["effect"], "planned": s["methods"][first]["stroke"] is not None}
        for s in ranked[:WORST]
    ]  # fmt: skip
    if OWN in methods and PAPER in methods:
        gain = np.array([_seen(s, OWN)["made"] - _seen(s, PAPER)["made"] for s in good])
        worse = [s["number"] for s in good if _overlooked(s)]
        out["against"] = {
            "better": float((gain > 0).mean()), "equal": float((gain == 0).mean()), "worse": float((gain < 0).mean()),
            "gain": _mean(gain.tolist()), "overlooked": worse,
        }  # fmt: skip
    return out


def _seen(scene: Told, method: str) -> Told:
    return scene["methods"][method]["seen"]


def _overlooked(scene: Told) -> bool:
    """Whether the planner itself holds the baseline's stroke for worth more than the one that it chose."""
    mine, its = (scene["methods"][m]["predicted"] for m in (OWN, PAPER))
    return its is not None and its["value"] > (mine["value"] if mine else 0.0) + 0.01


def _mean(values: Sequence[float]) -> dict[str, float | None]:
    """Mean and its standard error."""
    n = len(values)
    se = float(np.std(values, ddof=1) / math.sqrt(n)) if n > 1 else None
    return {"mean": float(np.mean(values)) if n else None, "se": se}


def _quantile(values: Sequence[float], part: float) -> float | None:
    return float(np.quantile(values, part)) if len(values) else None


def _method(scenes: Sequence[Told], method: str) -> dict[str, Any]:
    """The figures of one way to plan."""
    seen = [_seen(s, method) for s in scenes]
    medians, everywhere = ([v[k] for v in seen if v[k] is not None] for k in ("median", "median_all"))
    pooled = [d for v in seen for d in v["away"]]
    seconds = [s["seconds"][method] for s in scenes]
    promised = [s["methods"][method]["predicted"] for s in scenes]
    promised_rest = [p["rest"]["distance_median"] for p in promised if p]
    return {
        **{k: _mean([v[k] for v in seen]) for k in ("made", "potted", "foul")},
        "fouls": {name: _mean([v["fouls"][name] for v in seen])["mean"] for name in FOULS},
        "promised": _mean([p["pot_probability"]["value"] for p in promised if p]),
        "none": sum(s["methods"][method]["stroke"] is None for s in scenes),
        "away_pooled": _quantile(pooled, 0.5), "away_medians": _quantile(medians, 0.5),
        "away_all_medians": _quantile(everywhere, 0.5),
        "away_promised": _quantile([d for d in promised_rest if d is not None], 0.5),
        "seconds_median": _quantile(seconds, 0.5), "seconds_95": _quantile(seconds, 0.95),
    }  # fmt: skip


def _pairs(scenes: Sequence[Told], method: str) -> Array:
    """Probability promised and part seen: (n, 2)."""
    told = [s["methods"][method] for s in scenes if s["methods"][method]["predicted"]]
    return np.array([[t["predicted"]["pot_probability"]["value"], t["seen"]["potted"]] for t in told]).reshape(-1, 2)


def _calibration(scenes: Sequence[Told], method: str) -> dict[str, Any]:
    """Promised against seen, by bins."""
    pairs, rows, gaps = _pairs(scenes, method), [], []
    which = np.minimum((pairs[:, 0] * BINS).astype(int), BINS - 1)
    for k in range(BINS):
        mine = pairs[which == k]
        if len(mine):
            promised, seen = (float(v) for v in mine.mean(axis=0))
            se = _mean(mine[:, 1].tolist())["se"]
            rows.append({"from": k / BINS, "promised": promised, "seen": seen, "se": se, "scenes": len(mine)})
            if len(mine) >= ENOUGH:
                gaps.append(abs(seen - promised))
    return {"bins": rows, "largest_gap": max(gaps) if gaps else None}


def _effects(scenes: Sequence[Told], methods: Sequence[str]) -> list[dict[str, Any]]:
    """The same by the effect that the truth held and the model did not."""
    rows = []
    for name in sorted({s["truth"]["effect"] for s in scenes}):
        mine = [s for s in scenes if s["truth"]["effect"] == name]
        drawn: dict[str, list[float]] = {}
        for s in mine:
            for key, value in s["truth"]["values"].items():
                drawn.setdefault(key, []).append(value)
        row = {"effect": name, "scenes": len(mine), "drawn": {k: [min(v), max(v)] for k, v in drawn.items()}}
        row |= {m: _mean([_seen(s, m)["made"] for s in mine]) for m in methods}
        rows.append(row | {"ceiling": _mean([s["ceiling"]["made"] for s in mine])})
    return rows


def _constants(scenes: Sequence[Told]) -> dict[str, dict[str, float]]:
    """Mean and standard deviation of the constants drawn."""
    found: dict[str, list[float]] = {}
    for s in scenes:
        for name, value in s["truth"]["constants"].items():
            found.setdefault(name, []).append(value)
    return {name: {"mean": float(np.mean(v)), "sd": float(np.std(v))} for name, v in found.items()}


def share(value: Mapping[str, float | None] | float | None) -> str:
    """A share in percent, with its standard error where it has one."""
    mean, se = (value["mean"], value["se"]) if isinstance(value, Mapping) else (value, None)
    if mean is None:
        return "-"
    return f"{100 * mean:.1f} %" + (f" ± {100 * se:.1f}" if se is not None else "")


def _number(form: str, unit: str, scale: float = 1.0) -> Callable[[Any], str]:
    return lambda value: "-" if value is None else f"{scale * value:{form}} {unit}"


def rows(told: Told) -> list[tuple[str, ...]]:
    """The table of figures: a heading, then a row for each."""
    methods, mm, s = told["methods"], _number(".0f", "mm", 1e3), _number(".1f", "s")
    columns = list(methods)
    out: list[tuple[str, ...]] = [("figure", *(TITLES[m] for m in columns), "ceiling")]

    def line(text: str, show: Callable[[Any], str], key: str) -> None:
        top = share(told["ceiling"][key]) if key in told["ceiling"] else ""
        out.append((text, *(show(methods[m][key]) for m in columns), top))

    line("potted without a foul", share, "made")
    line("potted, with fouls", share, "potted")
    line("potted, as promised", share, "promised")
    line("fouls", share, "foul")
    for name in FOULS:
        out.append((f"  {name}", *(share(methods[m]["fouls"][name]) for m in columns), ""))
    line("cue ball from the wanted place, median of all plays that potted", mm, "away_pooled")
    line("  median of the scenes' medians", mm, "away_medians")
    line("  the same over all plays", mm, "away_all_medians")
    line("  the same, as promised", mm, "away_promised")
    line("scenes without a stroke", str, "none")
    line("time to plan, median", s, "seconds_median")
    line("time to plan, 95 %", s, "seconds_95")
    for m in columns:
        gap = told["calibration"][m]["largest_gap"]
        cells = [share(gap) if k == m else "" for k in columns]
        out.append((f"largest gap of calibration, {TITLES[m]}", *cells, ""))
    if "against" in told:
        against = told["against"]
        text = f"{share(against['better'])} better, {share(against['equal'])} equal, {share(against['worse'])} worse"
        out.append(("scenes against the baseline", text, "", ""))
        out.append(("more potted than by the baseline", share(against["gain"]), "", ""))
        few = f"in {len(against['overlooked'])} of {told['scenes']} scenes"
        out.append(("baseline's stroke worth more by our own figures", few, "", ""))
    return out


def text_table(told: Told) -> str:
    """The figures for a terminal."""
    head = f"{told['scenes']} scenes" + (f", {len(told['failed'])} more failed" if told["failed"] else "")
    return f"{head}\n\n{table(rows(told))}\n" if told["scenes"] else f"{head}\n"


def _grid(lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table; its first row is the heading."""
    return "\n".join("| " + " | ".join(r) + " |" for r in (lines[0], ["---"] * len(lines[0]), *lines[1:]))


def markdown(told: Told, settings: Told, out: str, picture: str) -> str:
    """The report's text."""
    columns = list(told["methods"])
    execution = settings["execution"]
    noise = (
        f"{100 * execution['speed_sd']:g} % of the speed, {1e3 * execution['azimuth_sd']:g} mrad of azimuth, "
        f"{1e3 * execution['side_sd']:g} and {1e3 * execution['height_sd']:g} mm of the tip"
    )
    parts = [
        "# How plans fare",
        f"{told['scenes']} random scenes of {settings['balls']} balls, seed {settings['seed']}; every stroke played"
        f" {settings['plays']} times on a truth that the planner does not know (constants within the model's"
        f" uncertainty, and one small effect that it lacks), in MuJoCo, with the launcher's errors: {noise}."
        f" Model {settings['model']}, sources {settings['sources']}. Written by `planner study`.",
        f"![Calibration, pots by scene, distances, sample scenes]({picture})",
        "## Figures",
        _grid(rows(told)) if told["scenes"] else "No scene yet.",
        "The ceiling is the best found by a search that knows the truth and wants no place, for the same pocket; it was"
        f" found by {', '.join(f'{k} ({n})' for k, n in sorted(told['ceiling_by'].items())) or 'none'}.",
    ]
    lines: list[tuple[str, ...]]
    for m in columns:
        lines = [("promised", "mean promised", "mean seen", "scenes")]
        for r in told["calibration"][m]["bins"]:
            where = f"{100 * r['from']:.0f} to {100 * (r['from'] + 1 / BINS):.0f} %"
            seen = share({"mean": r["seen"], "se": r["se"]})
            lines.append((where, share(r["promised"]), seen, str(r["scenes"])))
        gap = f"Largest gap of bins with {ENOUGH} scenes or more: {share(told['calibration'][m]['largest_gap'])}."
        parts += [f"## Calibration, {TITLES[m]}", _grid(lines), gap]
    lines = [("effect in the truth", "sizes drawn", "scenes", *(TITLES[m] for m in columns), "ceiling")]
    for r in told["effects"]:
        sizes = ", ".join(f"{k} {low:.4g} to {high:.4g}" for k, (low, high) in r["drawn"].items())
        lines.append((r["effect"], sizes, str(r["scenes"]), *(share(r[m]) for m in (*columns, "ceiling"))))
    parts += ["## By effect", "Potted without a foul.", _grid(lines)]
    lines = [("constant", "mean drawn", "sd drawn")]
    lines += [(name, f"{v['mean']:.5g}", f"{v['sd']:.2g}") for name, v in told["constants"].items()]
    parts += ["## Constants drawn", _grid(lines)]
    lines = [("scene", "potted", "ceiling", "effect", "")]
    for w in told["worst"]:
        planned = "" if w["planned"] else "no stroke found"
        lines.append((str(w["number"]), share(w["made"]), share(w["ceiling"]), w["effect"], planned))
    plan = f"planner plan scene.toml --model {out}/model.toml --out plan.json"
    look = f"`planner study --out {out} --scene N scene.toml`, then `{plan}`"
    parts += ["## Worst scenes", "Farthest below the ceiling.", _grid(lines), f"To look at scene N: {look}."]
    if told.get("against", {}).get("overlooked"):
        few = ", ".join(map(str, told["against"]["overlooked"]))
        parts.append(f"Scenes whose baseline stroke our own figures hold for worth more than ours: {few}.")
    if told["failed"]:
        parts += ["## Failed", "\n".join(f"* {number}: {text}" for number, text in told["failed"])]
    return "\n\n".join(parts) + "\n"


def write_report(path: Path | str, scenes: Sequence[Told], settings: Told, out: Path | str) -> None:
    """Write Markdown and, beside it, its pictures as PNG, each whole or not at all."""
    path = Path(path)
    picture, told = path.with_suffix(".png"), figures(scenes)
    write_whole(picture, draw_study([s for s in scenes if "error" not in s], told))
    write_whole(path, markdown(told, settings, Path(out).name, picture.name).encode())


def draw_study(scenes: Sequence[Told], told: Told) -> bytes:
    """The pictures of a study, without those that failed, as PNG: the same bytes for the same scenes."""

    def draw(fig: Any) -> None:
        axes = fig.subplots(4, 2, height_ratios=[4, 4, 3, 3])
        if not scenes:
            return
        _draw_calibration(axes[0, 0], scenes, told)
        _draw_pots(axes[0, 1], scenes, told)
        for ax, key, title in ((axes[1, 0], "away", "plays that potted, all scenes"), (axes[1, 1], "median", "")):
            _draw_distances(ax, scenes, told, key, title or "scenes' medians of plays that potted")
        ranked = sorted(scenes, key=lambda s: (-_seen(s, next(iter(told["methods"])))["made"], s["number"]))
        for k, ax in enumerate(axes[2:].flat):
            ax.set_axis_off()
            if k < len(ranked):  # from where it goes well to where it goes badly
                _draw_scene(ax, ranked[min(k, 3) * (len(ranked) - 1) // max(min(3, len(ranked) - 1), 1)], told)

    return png(13.0, draw, dpi=120)


def _draw_calibration(ax: Any, scenes: Sequence[Told], told: Told) -> None:
    ax.plot([0, 100], [0, 100], color=NOISE_COLOUR, lw=1.0, ls="--", label="as promised")
    for m in told["methods"]:
        ax.plot(*(100 * _pairs(scenes, m).T), ".", color=COLOURS[m], ms=3, alpha=0.35, mec="none")
        bins = told["calibration"][m]["bins"]
        x, y = (100 * np.array([r[k] for r in bins]) for k in ("promised", "seen"))
        error = [100 * (r["se"] or 0.0) for r in bins]
        ax.errorbar(x, y, yerr=error, fmt="o-", ms=4.5, lw=1.4, color=COLOURS[m], label=TITLES[m])
    ax.set(xlim=(-2, 102), ylim=(-2, 102), xlabel="pots promised [%]", ylabel="pots seen on the truth [%]")
    ax.set_title("calibration; bars: standard error between scenes")
    ax.grid()
    ax.legend(loc="upper left")


def _draw_pots(ax: Any, scenes: Sequence[Told], told: Told) -> None:
    """By scene, in the order of the first method's share."""
    first = next(iter(told["methods"]))
    ranked = sorted(scenes, key=lambda s: (_seen(s, first)["made"], s["ceiling"]["made"], s["number"]))
    x = np.arange(1, len(ranked) + 1)
    ax.plot(x, [100 * s["ceiling"]["made"] for s in ranked], "_", color=INK_COLOUR, ms=5, mew=1.4, label="ceiling")
    for m in reversed(told["methods"]):
        style = {"ls": "-" if m == first else "none", "marker": "" if m == first else ".", "lw": 1.8, "ms": 4}
        ax.plot(x, [100 * _seen(s, m)["made"] for s in ranked], color=COLOURS[m], label=TITLES[m], **style)
    ax.set(ylim=(-2, 102), xlabel=f"scenes, sorted by {TITLES[first]}", ylabel="potted without a foul [%]")
    ax.set_title("pots by scene")
    ax.grid()
    ax.legend(loc="lower right")


def _draw_distances(ax: Any, scenes: Sequence[Told], told: Told, key: str, title: str) -> None:
    """How many cue balls stop within a distance of the wanted place."""
    most = 0.0
    for m in told["methods"]:
        found = [_seen(s, m)[key] for s in scenes]
        values = np.sort(1e3 * np.concatenate([np.zeros(0), *(np.ravel(v) for v in found if v is not None)]))
        if len(values):
            ax.step([0.0, *values], np.linspace(0, 100, len(values) + 1), where="post", color=COLOURS[m], lw=1.6,
                    label=f"{TITLES[m]}, median {np.median(values):.0f} mm")  # fmt: skip
            most = max(most, float(np.quantile(values, 0.95)))
    ax.set(xlim=(0, most or 1.0), ylim=(0, 102), xlabel="cue ball from the wanted place [mm]", ylabel="share [%]")
    ax.set_title(title)
    ax.grid()
    if most:
        ax.legend(loc="lower right")


def _draw_scene(ax: Any, told: Told, study: Told) -> None:
    """A scene from above with the planned tracks of the first method."""
    from matplotlib.patches import Circle

    scene, method = told["scene"], next(iter(study["methods"]))
    table_, ball = Table(**scene["table"]), Ball(**scene["ball"])
    ax.set_axis_on()
    draw_table(ax, table_, dark=True)
    for track in told["methods"][method].get("tracks", ()):
        colour = [c / 255 for c in ball_colour(track["ball"])]
        ax.plot(*np.array(track["xy"]).reshape(-1, 2).T, color=colour, lw=1.3, zorder=5)
    for name, xy in scene["balls"].items():
        ax.add_patch(Circle(xy, ball.radius, fc=[c / 255 for c in ball_colour(name)], ec=INK_COLOUR, lw=0.6, zorder=6))
    ax.plot(*scene["goal"]["rest"], "x", color="white", ms=8, mew=2.0, zorder=7)
    promised = told["methods"][method]["predicted"]
    text = f"promised {share(promised['pot_probability']['value'])}" if promised else "no stroke"
    ax.set_title(f"scene {told['number']}: {text}, seen {share(_seen(told, method)['made'])}")
