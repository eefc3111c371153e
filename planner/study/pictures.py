"""Pictures of a study of plans: calibration, pots by scene, distances from the goal, sample scenes.

In: results of scenes and the figures of their study. Out: a PNG, the same bytes for the same scenes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from models.report.axes import draw_table
from models.report.figure import HELD_OUT_COLOUR, INK_COLOUR, MODEL_COLOUR, NOISE_COLOUR, png
from models.shot import Ball, Table
from models.table.palette import ball_colour
from planner.study.figures import BASELINE, SEARCH, Record, calibration_pairs, observed

METHOD_TITLES = {SEARCH: "ours", BASELINE: "baseline", "ceiling": "ceiling"}
METHOD_COLOURS = {SEARCH: MODEL_COLOUR, BASELINE: HELD_OUT_COLOUR, "ceiling": INK_COLOUR}


def share(value: Mapping[str, float | None] | float | None) -> str:
    """A share in percent, with its standard error if it has one."""
    mean, se = (value["mean"], value["se"]) if isinstance(value, Mapping) else (value, None)
    if mean is None:
        return "-"
    return f"{100 * mean:.1f} %" + (f" ± {100 * se:.1f}" if se is not None else "")


def draw_study(scenes: Sequence[Record], study: Record) -> bytes:
    """The pictures of a study, without those that failed, as PNG: the same bytes for the same scenes."""

    def draw(fig: Any) -> None:
        axes = fig.subplots(4, 2, height_ratios=[4, 4, 3, 3])
        if not scenes:
            return
        _draw_calibration(axes[0, 0], scenes, study)
        _draw_pots(axes[0, 1], scenes, study)
        for ax, key, title in ((axes[1, 0], "away", "plays that potted, all scenes"), (axes[1, 1], "median", "")):
            _draw_distances(ax, scenes, study, key, title or "scenes' medians of plays that potted")
        ranked = sorted(scenes, key=lambda s: (-observed(s, next(iter(study["methods"])))["made"], s["number"]))
        for k, ax in enumerate(axes[2:].flat):
            ax.set_axis_off()
            if k < len(ranked):  # from the best to the worst
                _draw_scene(ax, ranked[min(k, 3) * (len(ranked) - 1) // max(min(3, len(ranked) - 1), 1)], study)

    return png(13.0, draw, dpi=120)


def _draw_calibration(ax: Any, scenes: Sequence[Record], study: Record) -> None:
    ax.plot([0, 100], [0, 100], color=NOISE_COLOUR, lw=1.0, ls="--", label="as predicted")
    for m in study["methods"]:
        ax.plot(*(100 * calibration_pairs(scenes, m).T), ".", color=METHOD_COLOURS[m], ms=3, alpha=0.35, mec="none")
        bins = study["calibration"][m]["bins"]
        x, y = (100 * np.array([r[k] for r in bins]) for k in ("predicted", "seen"))
        error = [100 * (r["se"] or 0.0) for r in bins]
        ax.errorbar(x, y, yerr=error, fmt="o-", ms=4.5, lw=1.4, color=METHOD_COLOURS[m], label=METHOD_TITLES[m])
    ax.set(xlim=(-2, 102), ylim=(-2, 102), xlabel="pots predicted [%]", ylabel="pots observed on the truth [%]")
    ax.set_title("calibration; bars: standard error between scenes")
    ax.grid()
    ax.legend(loc="upper left")


def _draw_pots(ax: Any, scenes: Sequence[Record], study: Record) -> None:
    """Draw shares by scene, sorted by that of the first method."""
    first = next(iter(study["methods"]))
    ranked = sorted(scenes, key=lambda s: (observed(s, first)["made"], s["ceiling"]["made"], s["number"]))
    x = np.arange(1, len(ranked) + 1)
    ax.plot(x, [100 * s["ceiling"]["made"] for s in ranked], "_", color=INK_COLOUR, ms=5, mew=1.4, label="ceiling")
    for m in reversed(study["methods"]):
        style = {"ls": "-" if m == first else "none", "marker": "" if m == first else ".", "lw": 1.8, "ms": 4}
        ax.plot(
            x, [100 * observed(s, m)["made"] for s in ranked], color=METHOD_COLOURS[m], label=METHOD_TITLES[m], **style
        )
    ax.set(ylim=(-2, 102), xlabel=f"scenes, sorted by {METHOD_TITLES[first]}", ylabel="potted without a foul [%]")
    ax.set_title("pots by scene")
    ax.grid()
    ax.legend(loc="lower right")


def _draw_distances(ax: Any, scenes: Sequence[Record], study: Record, key: str, title: str) -> None:
    """Draw the share of cue balls that stop within a distance of the goal position."""
    most = 0.0
    for m in study["methods"]:
        found = [observed(s, m)[key] for s in scenes]
        values = np.sort(1e3 * np.concatenate([np.zeros(0), *(np.ravel(v) for v in found if v is not None)]))
        if len(values):
            ax.step([0.0, *values], np.linspace(0, 100, len(values) + 1), where="post", color=METHOD_COLOURS[m], lw=1.6,
                    label=f"{METHOD_TITLES[m]}, median {np.median(values):.0f} mm")  # fmt: skip
            most = max(most, float(np.quantile(values, 0.95)))
    ax.set(xlim=(0, most or 1.0), ylim=(0, 102), xlabel="cue ball from the goal position [mm]", ylabel="share [%]")
    ax.set_title(title)
    ax.grid()
    if most:
        ax.legend(loc="lower right")


def _draw_scene(ax: Any, result: Record, study: Record) -> None:
    """Draw a scene from above with the planned tracks of the first method."""
    from matplotlib.patches import Circle

    scene, method = result["scene"], next(iter(study["methods"]))
    table_, ball = Table(**scene["table"]), Ball(**scene["ball"])
    ax.set_axis_on()
    draw_table(ax, table_)
    for track in result["methods"][method].get("tracks", ()):
        colour = [c / 255 for c in ball_colour(track["ball"])]
        ax.plot(*np.array(track["xy"]).reshape(-1, 2).T, color=colour, lw=1.3, zorder=5)
    for name, xy in scene["balls"].items():
        ax.add_patch(Circle(xy, ball.radius, fc=[c / 255 for c in ball_colour(name)], ec=INK_COLOUR, lw=0.6, zorder=6))
    ax.plot(*scene["goal"]["rest"], "x", color="white", ms=8, mew=2.0, zorder=7)
    predicted = result["methods"][method]["predicted"]
    text = f"predicted {share(predicted['pot_probability']['value'])}" if predicted else "no stroke"
    ax.set_title(f"scene {result['number']}: {text}, observed {share(observed(result, method)['made'])}")
