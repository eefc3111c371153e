"""The report of a plan: one HTML file with its figures inside, for a browser without network or scripts.

The stroke to set, the planned paths of the balls and the sampled ones, where the cue ball comes to rest, and the
alternatives. Outlines hold 50 % and 90 % of the samples themselves (models/recording/plan.py), so they need no normal
distribution; they are left out where there are few samples. This module computes the values of the tables and draws
the figures, templates/plan.html.j2 holds headings and captions. The same plan gives the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from models.files import write_whole
from models.recording.plan import (
    AVOID,
    FATES,
    SHARES,
    WANTED,
    dropped,
    fate,
    given,
    outline,
    path_of,
    percent,
    rest_words,
    resting,
    scene_of,
    sentence,
    strike_words,
    wanted,
)
from models.recording.shots import ball_colour
from models.report.axes import TABLE_MARGIN_M, circle, draw_table, legend_on_cloth, rgb
from models.report.figure import FIGURE_WIDTH_IN, INK_COLOUR, MODEL_COLOUR, NOISE_COLOUR, Draw, png, svg
from models.report.numbers import NO_VALUE, number
from models.report.page import write_page
from models.shot import Array, Ball, Table

TEMPLATE = Path(__file__).with_name("templates") / "plan.html.j2"
MAX_OFFSET = 0.5  # of the contact, over the ball's radius; no stroke is played beyond (Robotic Billiards 2015)
MAX_LINE_POINTS = 260  # of a path, to keep the file small
SHADOW_COLOUR = "#10151a"  # behind a path and around a ball
MIN_HALF_VIEW_M = 0.12  # of the figure of resting positions, from its middle to its edge
FACE_WIDTH_IN = 3.3  # of the cue ball's face
THUMBNAIL_WIDTH_IN = 3.6  # of an alternative
METHODS = {"risk": "expected utility under execution and model errors", "ga": "genetic algorithm"}


def write_report(path: Path | str, plan: Mapping[str, Any], title: str) -> None:
    """Write one HTML file, whole or not at all; BadInput where it cannot be written or `plan` is no plan."""
    table, ball, balls = scene_of(plan)
    stroke = bool(plan.get("stroke"))
    write_page(
        path,
        TEMPLATE,
        title=title,
        sentence=sentence(plan),
        why=plan.get("why") or "",
        stroke=stroke,
        face=_face(plan, ball) if stroke else None,
        settings=_settings(plan),
        above=svg("plan", *_picture(plan)),
        rest=_rest_svg(plan, table, ball) if len(resting(plan)[0]) else None,
        place_wanted=wanted(plan)[0] is not None,
        alternatives=_alternatives(plan, table, ball, balls),
        fouls=_fouls(plan),
        any_foul=percent(plan.get("foul_probability")),
        computed=_computed(plan, table, ball),
    )


def write_picture(path: Path | str, plan: Mapping[str, Any]) -> None:
    """Write the table from above as PNG, whole or not at all; BadInput as for the report."""
    scene_of(plan)
    write_whole(path, png(*_picture(plan), dpi=144))


def _settings(plan: Mapping[str, Any]) -> list[tuple[str, str]]:
    """(value, what it is) of what to set, then the probabilities with their intervals."""
    chances = [(f"{what}, with its interval", percent(plan.get(f"{what}_probability"))) for what in ("pot", "foul")]
    return [(value, what) for what, value in strike_words(plan) + chances]


def _picture(plan: Mapping[str, Any]) -> tuple[float, Draw]:
    """Height [inch] of the table from above, and what draws it."""
    table, ball, balls = scene_of(plan)
    tall = (FIGURE_WIDTH_IN - 0.6) * (table.width + 2 * TABLE_MARGIN_M) / (table.length + 2 * TABLE_MARGIN_M) + 0.6

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        draw_table(ax, table, dark=True)
        _draw_samples(ax, plan)
        _draw_goal(ax, plan, ball, balls)
        _draw_shot(ax, plan, table, ball, balls)
        fig.set_size_inches(FIGURE_WIDTH_IN, tall + 0.19 * _add_legend(fig, ax, 4))

    return tall, draw


def _draw_samples(ax: Any, plan: Mapping[str, Any]) -> None:
    fan = plan.get("fan") or []
    for word, colour in FATES.items():
        drawn = [draw for draw in fan if fate(draw) == word]
        label = f"{word} in {len(drawn)} of {len(fan)} samples"
        for k, path in enumerate(path_of(track) for draw in drawn for track in draw["tracks"]):
            style = {"color": rgb(colour), "alpha": 0.45, "lw": 0.7, "ls": "--" if word == "foul" else "-"}
            ax.plot(*_thin(path).T, **style, zorder=4, label=label if k == 0 else None)
    _draw_cloud(ax, plan, 1.9)


def _draw_cloud(ax: Any, plan: Mapping[str, Any], size: float) -> None:
    """Resting positions and their outlines."""
    cloud, potted = resting(plan)
    for word, chosen in (("potted", potted), ("missed", ~potted)):
        if chosen.any():
            style = {"ms": size, "mec": "none", "alpha": 0.75, "color": rgb(FATES[word]), "zorder": 5}
            ax.plot(*cloud[chosen].T, "o" if word == "potted" else "^", **style, label=f"cue ball at rest, {word}")
    for share, line in zip(SHARES, ("-", "--"), strict=True):
        ring = outline(cloud, share)
        if len(ring):
            ax.plot(*ring.T, line, color="white", lw=1.1, zorder=8, label=f"{100 * share:.0f} % of these positions")


def _draw_goal(ax: Any, plan: Mapping[str, Any], ball: Ball, balls: Mapping[str, Array]) -> None:
    """Where the cue ball is wanted, and the balls to avoid."""
    goal, (place, radius) = plan["scene"].get("goal") or {}, wanted(plan)
    mark = {"color": rgb(WANTED), "zorder": 9, "ls": "none"}
    if place is not None:
        ax.plot(*place, "x", ms=9, mew=2.2, **mark, label="position that is wanted")
    if place is not None and radius > 0:
        ax.add_patch(circle(place, radius, fc="none", ec=rgb(WANTED), lw=1.4, ls=":", zorder=8))
    if goal.get("rest_for") in balls:
        mark["label"] = f"wanted: a shot on {goal['rest_for']}"
        ax.plot(*balls[goal["rest_for"]], "s", ms=15, mfc="none", mew=1.6, **mark)
    for k, name in enumerate(name for name in goal.get("avoid") or [] if name in balls):
        style = {"ls": "none", "color": rgb(AVOID), "mew": 1.8, "label": "keep clear of this" if k == 0 else None}
        ax.plot(*balls[name], "D", ms=14, mfc="none", **style, zorder=9)


def _draw_shot(
    ax: Any, shot: Mapping[str, Any], table: Table, ball: Ball, balls: Mapping[str, Array], bold: float = 1.0
) -> None:
    """Balls at the start, planned paths, and rings where these end; `bold` scales the lines of a small picture."""
    goal = (shot.get("scene") or {}).get("goal") or {}
    roles = {goal.get("cue"): "cue ball", goal.get("object"): "object ball"}
    for track in shot.get("tracks") or []:
        name, path = track["ball"], path_of(track)
        colour = rgb(ball_colour(name))
        if not len(path):
            continue
        label = None if not goal else f"{name}, {roles[name]}" if name in roles and roles[name] != name else name
        ax.plot(*_thin(path).T, color=SHADOW_COLOUR, lw=3.4 * bold, alpha=0.55, zorder=6, solid_capstyle="round")
        ax.plot(*_thin(path).T, color="white", lw=2.5 * bold, zorder=6, solid_capstyle="round")
        ax.plot(*_thin(path).T, color=colour, lw=1.7 * bold, zorder=6.5, label=label)
        if not dropped(table, ball, path[-1]):
            ax.add_patch(circle(path[-1], ball.radius, fc="none", ec="white", lw=1.9 * bold, zorder=7))
            ax.add_patch(circle(path[-1], ball.radius, fc="none", ec=colour, lw=1.2 * bold, zorder=7.5))
    for name, xy in balls.items():
        ax.add_patch(circle(xy, ball.radius, fc=rgb(ball_colour(name)), ec=SHADOW_COLOUR, lw=0.7 * bold, zorder=8.5))


def _face(plan: Mapping[str, Any], ball: Ball) -> str:
    """The ball's face as seen along the cue, in mm."""
    launcher, execution = plan.get("launcher") or {}, plan.get("execution") or {}
    stroke, r = plan["stroke"], 1e3 * ball.radius
    aim = np.array(
        [launcher.get("x0_mm", 1e3 * stroke.get("side", 0.0)), launcher.get("y0_mm", 1e3 * stroke.get("height", 0.0))]
    )
    spread = 1e3 * np.array([execution.get("side_sd") or 0.0, execution.get("height_sd") or 0.0])
    name = (plan["scene"].get("goal") or {}).get("cue", "cue")

    def draw(fig: Any) -> None:
        from matplotlib.patches import Ellipse

        fig.set_size_inches(FACE_WIDTH_IN, FACE_WIDTH_IN)
        ax = fig.subplots()
        ax.add_patch(circle((0, 0), r, fc=rgb(ball_colour(name)), ec=NOISE_COLOUR, lw=1.2))
        ax.add_patch(circle((0, 0), MAX_OFFSET * r, fc="none", ec=INK_COLOUR, lw=1.0, ls="--"))
        ax.plot([-r, r], [0, 0], [0, 0], [-r, r], color=NOISE_COLOUR, lw=0.6)
        for k in (2, 1):
            ax.add_patch(
                Ellipse(
                    (aim[0], aim[1]), *(2 * k * spread), fc=MODEL_COLOUR, ec=MODEL_COLOUR, alpha=0.4, lw=0.8, zorder=3
                )
            )
        ax.plot([aim[0], aim[0], 0], [0, aim[1], aim[1]], color=MODEL_COLOUR, lw=0.8, ls=":")
        ax.plot(*aim, "o", ms=3, mec="none", color=INK_COLOUR, zorder=4)
        ax.text(
            0, -MAX_OFFSET * r - 0.05 * r, "0.5 R", ha="center", va="top", bbox={"fc": "white", "ec": "none", "pad": 1}
        )
        edge = 1.06 * r
        ax.set(xlim=(-edge, edge), ylim=(-edge, edge), aspect="equal", xlabel="x′ [mm]", ylabel="y′ [mm]")
        ax.set(xticks=(-20, -10, 0, 10, 20), yticks=(-20, -10, 0, 10, 20))
        ax.spines[:].set_visible(False)
        ax.tick_params(length=2, labelsize=7.5)

    return svg("face", FACE_WIDTH_IN, draw)


def _rest_svg(plan: Mapping[str, Any], table: Table, ball: Ball) -> str:
    """Resting positions, and the share of them within a distance."""
    cloud, potted = resting(plan)
    place, radius = wanted(plan)
    mean = np.array((plan.get("rest") or {}).get("mean") or cloud.mean(axis=0), float)
    centre = mean if place is None else place
    ends = np.array([*outline(cloud, SHARES[-1]), mean, centre - radius, centre + radius])
    middle, half = (ends.max(axis=0) + ends.min(axis=0)) / 2, max(MIN_HALF_VIEW_M, 0.56 * np.ptp(ends, axis=0).max())
    outside = int((np.abs(cloud - middle) > half).any(axis=1).sum())
    far = 1e3 * np.hypot(*(cloud - centre).T)

    def draw(fig: Any) -> None:
        left, right = fig.subplots(1, 2, width_ratios=[11, 10])
        fig.get_layout_engine().set(h_pad=0.09)
        draw_table(left, table, dark=True)
        _draw_cloud(left, plan, 3.4)
        left.plot(*mean, "P", ms=9, mfc=INK_COLOUR, mec="white", mew=1.1, ls="none", zorder=9, label="mean")
        _draw_goal(left, plan, ball, {})
        left.add_patch(circle(centre, ball.radius, fc="none", ec="white", lw=0.9, zorder=8))
        left.set(xlim=middle[0] + [-half, half], ylim=middle[1] + [-half, half], xlabel="x [mm]", ylabel="y [mm]")
        for axis in (left.xaxis, left.yaxis):
            axis.set_major_formatter(lambda value, _: f"{1e3 * value:.0f}".replace("-", "−"))
        left.set_title(f"{len(cloud)} samples" + (f", {outside} of them outside the figure" if outside else ""))
        for label, colour, use in (
            ("all samples", INK_COLOUR, np.ones(len(far), bool)),
            ("samples that pot", MODEL_COLOUR, potted),
        ):
            if use.any():
                values = np.concatenate([[0.0], np.sort(far[use])])
                right.step(values, np.linspace(0, 100, len(values)), where="post", color=colour, lw=1.6, label=label)
        for share, line in zip(SHARES, ("-", "--"), strict=True):
            value = float(np.quantile(far, share))
            text = f"{100 * share:.0f} % within {number(value)} mm"
            right.plot([0, value, value], [100 * share, 100 * share, 0], line, color=NOISE_COLOUR, lw=1.0, label=text)
        right.set(xlim=(0, 1.05 * float(np.quantile(far, 0.98)) or 1.0), ylim=(0, 103), ylabel="share of samples [%]")
        right.set_xlabel("distance from the " + ("mean" if place is None else "wanted position") + " [mm]")
        right.grid()
        right.set_axisbelow(True)
        right.legend(loc="lower right", frameon=True, facecolor="white", edgecolor="none", framealpha=0.9)
        _add_legend(fig, left, 6)

    return svg("rest", 5.9, draw)


def _add_legend(fig: Any, ax: Any, columns: int) -> int:
    """A legend with marks of one size; the number of rows it takes."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        for mark in legend_on_cloth(fig, handles, labels, columns).legend_handles:
            mark.set(alpha=1.0, markersize=6.5, linewidth=max(1.2, mark.get_linewidth()))
    return math.ceil(len(handles) / columns)


def _alternatives(
    plan: Mapping[str, Any], table: Table, ball: Ball, balls: Mapping[str, Array]
) -> list[dict[str, str]]:
    """Picture and words of every other stroke that was considered."""
    aspect = (table.width + 2 * TABLE_MARGIN_M) / (table.length + 2 * TABLE_MARGIN_M)

    def thumbnail(fig: Any, other: Mapping[str, Any]) -> None:
        fig.set_size_inches(THUMBNAIL_WIDTH_IN, THUMBNAIL_WIDTH_IN * aspect)
        ax = fig.subplots()
        draw_table(ax, table, dark=True)
        _draw_shot(ax, other, table, ball, balls, bold=0.75)
        ax.set_axis_off()

    rows = []
    for k, other in enumerate(plan.get("alternatives") or [], start=1):
        words = dict(strike_words(other))
        rows.append({
            "picture": svg(f"alternative {k}", 2.2, partial(thumbnail, other=other)),
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


def _computed(plan: Mapping[str, Any], table: Table, ball: Ball) -> list[tuple[str, str]]:
    """What the plan was computed with, as (what, value)."""
    execution, model = plan.get("execution") or {}, plan.get("model") or {}

    def sd(key: str, factor: float, unit: str) -> str:
        value = execution.get(key)
        return given(None if value is None else factor * value, ".2g", unit)

    errors = f"speed {sd('speed_sd', 100, ' %')}, direction {sd('azimuth_sd', 180 / math.pi, '°')}, "
    errors += f"side {sd('side_sd', 1e3, ' mm')}, height {sd('height_sd', 1e3, ' mm')}"
    return [
        ("method", METHODS.get(plan.get("method", ""), NO_VALUE)),
        ("random seed", str(plan.get("seed", NO_VALUE))),
        ("execution errors, one standard deviation", errors),
        ("model", PurePath(str(model.get("file") or NO_VALUE)).name),
        ("effects", ", ".join(model.get("effects") or []) or "none"),
        ("samples", f"{len(plan.get('fan') or [])} drawn as lines, {len(resting(plan)[0])} as resting positions"),
        ("value of the plan", given(plan.get("value"), ".2f")),
        ("table, ball", f"{table.length:g} m × {table.width:g} m, {1e3 * ball.diameter:g} mm, {ball.mass:g} kg"),
    ]


def _thin(path: Array) -> Array:
    """A path of few enough points."""
    return (
        path
        if len(path) <= MAX_LINE_POINTS
        else path[np.unique(np.linspace(0, len(path) - 1, MAX_LINE_POINTS).astype(int))]
    )
