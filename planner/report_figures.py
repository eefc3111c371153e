"""Figures of a plan: the table from above, the cue ball's face, resting positions, and thumbnails of alternatives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from models.analytic.cueing import SEED_LIMIT
from models.recording.plan import AVOID_COLOUR, OUTCOME_COLOURS, OUTLINE_SHARES, TARGET_COLOUR
from models.recording.planned import dropped, fate, outline, path_of, resting, scene_of, wanted
from models.report.axes import TABLE_MARGIN_M, circle, draw_table, legend_on_cloth, rgb
from models.report.figure import FIGURE_WIDTH_IN, INK_COLOUR, MODEL_COLOUR, NARROW_WIDTH_IN, NOISE_COLOUR, Draw, svg
from models.report.numbers import number
from models.shot import Array, Ball, Table
from models.table.palette import ball_colour

MAX_LINE_POINTS = 260  # most points of a path, to keep the file small
SHADOW_COLOUR = "#10151a"  # behind a path and around a ball
MIN_HALF_VIEW_M = 0.12  # least half width of the figure of resting positions
FACE_WIDTH_IN = 3.3  # width of the figure of the cue ball's face
THUMBNAIL_WIDTH_IN = 3.6  # width of the figure of an alternative
NARROW_REST_HEIGHT_IN = 8.0  # height of the figure of resting positions on a phone
MIN_NARROW_SHARE = 0.5  # least ratio of the sides of a figure for a phone


def table_from_above(plan: Mapping[str, Any], narrow: bool = False) -> tuple[float, Draw]:
    """Height [inch] and drawing function of the table from above; `narrow` shows only the part that the shot uses."""
    table, ball, balls = scene_of(plan)
    edge = np.array([table.length, table.width]) / 2 + TABLE_MARGIN_M
    low, high = part_used(plan, edge) if narrow else (-edge, edge)
    width_in = NARROW_WIDTH_IN if narrow else FIGURE_WIDTH_IN
    tall = (width_in - 0.6) * float((high - low)[1] / (high - low)[0]) + 0.6

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        draw_table(ax, table)
        _draw_samples(ax, plan)
        _draw_goal(ax, plan, ball, balls)
        _draw_shot(ax, plan, table, ball, balls)
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        fig.set_size_inches(width_in, tall + 0.19 * _add_legend(fig, ax, 2 if narrow else 4))

    return tall, draw


def part_used(plan: Mapping[str, Any], edge: Array) -> tuple[Array, Array]:
    """Corners (2,) [m] of the rectangle around planned paths and resting positions, within +-edge."""
    paths = [path_of(track) for track in plan.get("tracks") or []]
    points = np.concatenate([path for path in [*paths, resting(plan)[0]] if len(path)] or [np.array([-edge, edge])])
    low, high = points.min(axis=0) - TABLE_MARGIN_M, points.max(axis=0) + TABLE_MARGIN_M
    least = MIN_NARROW_SHARE * (high - low)[::-1]
    half = np.minimum(np.maximum(high - low, least) / 2, edge)
    middle = np.clip((low + high) / 2, half - edge, edge - half)
    return middle - half, middle + half


def _draw_samples(ax: Any, plan: Mapping[str, Any]) -> None:
    fan = plan.get("fan") or []
    for word, colour in OUTCOME_COLOURS.items():
        drawn = [draw for draw in fan if fate(draw) == word]
        label = f"{word} in {len(drawn)} of {len(fan)} samples"
        for k, path in enumerate(path_of(track) for draw in drawn for track in draw["tracks"]):
            style = {"color": rgb(colour), "alpha": 0.45, "lw": 0.7, "ls": "--" if word == "foul" else "-"}
            ax.plot(*_thin(path).T, **style, zorder=4, label=label if k == 0 else None)
    _draw_cloud(ax, plan, 1.9)


def _draw_cloud(ax: Any, plan: Mapping[str, Any], size: float) -> None:
    """Draw resting positions and their outlines."""
    cloud, potted = resting(plan)
    for word, chosen in (("potted", potted), ("missed", ~potted)):
        if chosen.any():
            style = {"ms": size, "mec": "none", "alpha": 0.75, "color": rgb(OUTCOME_COLOURS[word]), "zorder": 5}
            ax.plot(*cloud[chosen].T, "o" if word == "potted" else "^", **style, label=f"cue ball at rest, {word}")
    for share, line in zip(OUTLINE_SHARES, ("-", "--"), strict=True):
        ring = outline(cloud, share)
        if len(ring):
            ax.plot(*ring.T, line, color="white", lw=1.1, zorder=8, label=f"{100 * share:.0f} % of these positions")


def _draw_goal(ax: Any, plan: Mapping[str, Any], ball: Ball, balls: Mapping[str, Array]) -> None:
    """Draw the wanted position of the cue ball, and the balls to avoid."""
    goal, (place, radius) = plan["scene"].get("goal") or {}, wanted(plan)
    mark = {"color": rgb(TARGET_COLOUR), "zorder": 9, "ls": "none"}
    if place is not None:
        ax.plot(*place, "x", ms=9, mew=2.2, **mark, label="wanted position")
    if place is not None and radius > 0:
        ax.add_patch(circle(place, radius, fc="none", ec=rgb(TARGET_COLOUR), lw=1.4, ls=":", zorder=8))
    if goal.get("rest_for") in balls:
        mark["label"] = f"wanted: a shot on {goal['rest_for']}"
        ax.plot(*balls[goal["rest_for"]], "s", ms=15, mfc="none", mew=1.6, **mark)
    for k, name in enumerate(name for name in goal.get("avoid") or [] if name in balls):
        style = {
            "ls": "none",
            "color": rgb(AVOID_COLOUR),
            "mew": 1.8,
            "label": "keep clear of this" if k == 0 else None,
        }
        ax.plot(*balls[name], "D", ms=14, mfc="none", **style, zorder=9)


def _draw_shot(
    ax: Any, shot: Mapping[str, Any], table: Table, ball: Ball, balls: Mapping[str, Array], bold: float = 1.0
) -> None:
    """Draw balls at the start, planned paths, and rings at their ends; `bold` scales the lines of a small picture."""
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


def face_svg(plan: Mapping[str, Any], ball: Ball) -> str:
    """Draw the ball's face as seen along the cue, in mm, with the contact of the tip and the cue's axis."""
    execution = plan.get("execution") or {}
    stroke, r = plan["stroke"], 1e3 * ball.radius
    aim = 1e3 * np.array([stroke.get("side", 0.0), stroke.get("height", 0.0)])
    spread = 1e3 * np.array([execution.get("side_sd") or 0.0, execution.get("height_sd") or 0.0])
    name = (plan["scene"].get("goal") or {}).get("cue", "cue")

    def draw(fig: Any) -> None:
        from matplotlib.patches import Ellipse

        fig.set_size_inches(FACE_WIDTH_IN, FACE_WIDTH_IN)
        ax = fig.subplots()
        ax.add_patch(circle((0, 0), r, fc=rgb(ball_colour(name)), ec=NOISE_COLOUR, lw=1.2))
        ax.add_patch(circle((0, 0), SEED_LIMIT * r, fc="none", ec=SHADOW_COLOUR, lw=1.0, ls="--"))
        ax.plot([-r, r], [0, 0], [0, 0], [-r, r], color=NOISE_COLOUR, lw=0.6)
        for k in (2, 1):
            ax.add_patch(
                Ellipse(
                    (aim[0], aim[1]), *(2 * k * spread), fc=MODEL_COLOUR, ec=MODEL_COLOUR, alpha=0.4, lw=0.8, zorder=3
                )
            )
        ax.plot([aim[0], aim[0], 0], [0, aim[1], aim[1]], color=MODEL_COLOUR, lw=0.8, ls=":")
        ax.plot(*aim, "o", ms=3, mec="none", color=SHADOW_COLOUR, zorder=4)
        ax.text(
            0, -SEED_LIMIT * r - 0.05 * r, "0.5 R", ha="center", va="top", color=SHADOW_COLOUR,
            bbox={"fc": rgb(ball_colour(name)), "ec": "none", "pad": 1},
        )  # fmt: skip
        edge = 1.06 * r
        ax.set(xlim=(-edge, edge), ylim=(-edge, edge), aspect="equal", xlabel="x′ [mm]", ylabel="y′ [mm]")
        ax.set(xticks=(-20, -10, 0, 10, 20), yticks=(-20, -10, 0, 10, 20))
        ax.spines[:].set_visible(False)
        ax.tick_params(length=2, labelsize=7.5)

    return svg("face", FACE_WIDTH_IN, draw)


def rest_svg(plan: Mapping[str, Any], table: Table, ball: Ball, narrow: bool = False) -> str:
    """Draw resting positions, and their share within a distance; `narrow` puts one below the other."""
    cloud, potted = resting(plan)
    place, radius = wanted(plan)
    mean = np.array((plan.get("rest") or {}).get("mean") or cloud.mean(axis=0), float)
    centre = mean if place is None else place
    ends = np.array([*outline(cloud, OUTLINE_SHARES[-1]), mean, centre - radius, centre + radius])
    middle, half = (ends.max(axis=0) + ends.min(axis=0)) / 2, max(MIN_HALF_VIEW_M, 0.56 * np.ptp(ends, axis=0).max())
    outside = int((np.abs(cloud - middle) > half).any(axis=1).sum())
    far = 1e3 * np.hypot(*(cloud - centre).T)

    def draw(fig: Any) -> None:
        if narrow:
            fig.set_size_inches(NARROW_WIDTH_IN, NARROW_REST_HEIGHT_IN)
            left, right = fig.subplots(2, 1, height_ratios=[12, 10])
        else:
            left, right = fig.subplots(1, 2, width_ratios=[11, 10])
        fig.get_layout_engine().set(h_pad=0.09)
        draw_table(left, table)
        _draw_cloud(left, plan, 3.4)
        left.plot(*mean, "P", ms=9, mfc=SHADOW_COLOUR, mec="white", mew=1.1, ls="none", zorder=9, label="mean")
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
        for share, line in zip(OUTLINE_SHARES, ("-", "--"), strict=True):
            value = float(np.quantile(far, share))
            text = f"{100 * share:.0f} % within {number(value)} mm"
            right.plot([0, value, value], [100 * share, 100 * share, 0], line, color=NOISE_COLOUR, lw=1.0, label=text)
        right.set(xlim=(0, 1.05 * float(np.quantile(far, 0.98)) or 1.0), ylim=(0, 103), ylabel="share of samples [%]")
        right.set_xlabel("distance from the " + ("mean" if place is None else "wanted position") + " [mm]")
        right.grid()
        right.set_axisbelow(True)
        right.legend(loc="lower right")
        _add_legend(fig, left, 2 if narrow else 6)

    return svg("rest narrow" if narrow else "rest", 5.9, draw)


def _add_legend(fig: Any, ax: Any, columns: int) -> int:
    """Draw a legend with marks of one size; returns its number of rows."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        for mark in legend_on_cloth(fig, handles, labels, columns).legend_handles:
            mark.set(alpha=1.0, markersize=6.5, linewidth=max(1.2, mark.get_linewidth()))
    return math.ceil(len(handles) / columns)


def thumbnail_svg(name: str, shot: Mapping[str, Any], table: Table, ball: Ball, balls: Mapping[str, Array]) -> str:
    """Draw a thumbnail of a shot's paths on the table."""
    aspect = (table.width + 2 * TABLE_MARGIN_M) / (table.length + 2 * TABLE_MARGIN_M)

    def draw(fig: Any) -> None:
        fig.set_size_inches(THUMBNAIL_WIDTH_IN, THUMBNAIL_WIDTH_IN * aspect)
        ax = fig.subplots()
        draw_table(ax, table)
        _draw_shot(ax, shot, table, ball, balls, bold=0.75)
        ax.set_axis_off()

    return svg(name, THUMBNAIL_WIDTH_IN * aspect, draw)


def _thin(path: Array) -> Array:
    """A path thinned to at most MAX_LINE_POINTS points."""
    return (
        path
        if len(path) <= MAX_LINE_POINTS
        else path[np.unique(np.linspace(0, len(path) - 1, MAX_LINE_POINTS).astype(int))]
    )
