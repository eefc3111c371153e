"""A plan on paper: one HTML file with its pictures inside, for a browser without network or scripts.

The stroke to set, where the balls should run and where they may run instead, where the cue ball comes to rest, and
what else could be played. Outlines hold 50 % and 90 % of the draws themselves (models/recording/plan.py), so they need
no normal distribution; they are left out where there are few draws. The same plan gives the same bytes.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from models.files import write_whole
from models.recording.palette import CLOTH_COLOUR, ball_colour
from models.recording.plan import (
    AVOID_COLOUR,
    OUTCOME_COLOURS,
    OUTLINE_SHARES,
    TARGET_COLOUR,
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
from models.shot import Array, Ball, Table
from sysid.report.drawing import INK, MODEL, NOISE, WIDTH, png, svg
from sysid.report.html import CSS
from sysid.report.plots import draw_table, number

LIMIT = 0.5  # offset over radius beyond which no stroke is played (Robotic Billiards 2015)
MARGIN = 0.11  # of the table around its playing surface, as drawn [m]
FEW = 260  # most points of a line
OWN_CSS = """
.lead{font-size:17px;max-width:920px;margin:10px 0 4px}
.why{color:var(--soft);max-width:920px;margin:0}
.set{display:grid;grid-template-columns:300px 1fr;gap:8px 26px;align-items:center}
.set .cards{grid-template-columns:repeat(3,1fr)}
.mini{width:274px}
.mini img{display:block;width:260px;height:auto}
@media(max-width:760px){.set{grid-template-columns:1fr}}
"""
FACE = (
    "The cue ball as seen along the cue. The dot is where the cue's axis is to point, the ellipses are one and two "
    "standard deviations of the launcher; nothing is played beyond the dashed circle at half the radius."
)
ABOVE = (
    "The table from above. Thick lines and rings: the shot as planned and where it leaves the balls. Thin lines: draws "
    "of what launcher and table may do instead, by what becomes of them. Dots: where the cue ball came to rest in the "
    "draws in which it stayed on the table; the white outlines hold 50 % and 90 % of them."
)
REST = (
    "Left: the same resting places, in mm from the centre of the table; the plus is their mean. Right: how many of "
    "the draws come to rest within a distance {of}."
)


def write_report(path: Path | str, plan: Mapping[str, Any], title: str) -> None:
    """Write one HTML file, whole or not at all; BadInput where it cannot be written or is given no plan."""
    table, ball, balls = scene_of(plan)
    body = [f"<h1>{_text(title)}</h1>", f'<p class="lead">{_text(sentence(plan))}</p>']
    body.append(f'<p class="why">{_text(plan.get("why") or "")}</p>')
    if plan.get("stroke"):
        cards = "".join(f'<div class="card"><b>{_text(b)}</b><span>{_text(s)}</span></div>' for s, b in _cards(plan))
        face = _figure(_face(plan, ball), "Where the tip strikes", "")
        body += ["<h2>What to set</h2>", f'<div class="set">{face}<div class="cards">{cards}</div></div>']
        body.append(f"<figure><figcaption>{FACE}</figcaption></figure>")
    what = "The shot" if plan.get("stroke") else "The scene"
    body += [f"<h2>{what} from above</h2>", _figure(svg("plan", *_picture(plan)), what, ABOVE)]
    if len(resting(plan)[0]):
        of = "of the place that is wanted" if wanted(plan)[0] is not None else "of the mean, as no place is wanted"
        body += ["<h2>Where the cue ball comes to rest</h2>"]
        body.append(_figure(_rest_svg(plan, table, ball), "Resting places", REST.format(of=of)))
    body += ["<h2>Alternatives</h2>", _alternatives(plan, table, ball, balls)]
    if plan.get("stroke"):
        body += ["<h2>Fouls</h2>", _fouls(plan)]
    body += ["<h2>How it was computed</h2>", _computed(plan, table, ball)]
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{_text(title)}</title>'
    page = f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}\n<style>{CSS}{OWN_CSS}</style></head>\n<body>\n'
    write_whole(path, (page + "\n".join(body) + "\n</body>\n</html>\n").encode())


def write_picture(path: Path | str, plan: Mapping[str, Any]) -> None:
    """Write the table from above as PNG, whole or not at all; BadInput as for the report."""
    scene_of(plan)
    write_whole(path, png(*_picture(plan), dpi=144))


def _cards(plan: Mapping[str, Any]) -> list[tuple[str, str]]:
    chances = [(what, percent(plan.get(f"{what}_probability"))) for what in ("pot", "foul")]
    return strike_words(plan) + [(f"{what}, with its interval", value) for what, value in chances]


def _picture(plan: Mapping[str, Any]) -> tuple[float, Callable[[Any], None]]:
    """Height [inch] of the table from above, and what draws it."""
    table, ball, balls = scene_of(plan)
    tall = (WIDTH - 0.6) * (table.width + 2 * MARGIN) / (table.length + 2 * MARGIN) + 0.6

    def draw(fig: Any) -> None:
        ax = fig.subplots()
        draw_table(ax, table, dark=True)
        _draw_draws(ax, plan)
        _draw_goal(ax, plan, ball, balls)
        _draw_shot(ax, plan, table, ball, balls)
        fig.set_size_inches(WIDTH, tall + 0.19 * _explain(fig, ax, 4))

    return tall, draw


def _draw_draws(ax: Any, plan: Mapping[str, Any]) -> None:
    fan = plan.get("fan") or []
    for word, colour in OUTCOME_COLOURS.items():
        drawn = [draw for draw in fan if fate(draw) == word]
        label = f"{word} in {len(drawn)} of {len(fan)} draws"
        for k, path in enumerate(path_of(track) for draw in drawn for track in draw["tracks"]):
            style = {"color": _rgb(colour), "alpha": 0.45, "lw": 0.7, "ls": "--" if word == "foul" else "-"}
            ax.plot(*_thin(path).T, **style, zorder=4, label=label if k == 0 else None)
    _draw_cloud(ax, plan, 1.9)


def _draw_cloud(ax: Any, plan: Mapping[str, Any], size: float) -> None:
    """Resting places and their outlines."""
    cloud, potted = resting(plan)
    for word, chosen in (("potted", potted), ("missed", ~potted)):
        if chosen.any():
            style = {"ms": size, "mec": "none", "alpha": 0.75, "color": _rgb(OUTCOME_COLOURS[word]), "zorder": 5}
            ax.plot(*cloud[chosen].T, "o" if word == "potted" else "^", **style, label=f"cue ball at rest, {word}")
    for share, line in zip(OUTLINE_SHARES, ("-", "--"), strict=True):
        ring = outline(cloud, share)
        if len(ring):
            ax.plot(*ring.T, line, color="white", lw=1.1, zorder=8, label=f"{100 * share:.0f} % of these places")


def _draw_goal(ax: Any, plan: Mapping[str, Any], ball: Ball, balls: Mapping[str, Array]) -> None:
    """Where the cue ball is wanted, what it shall not touch, the pocket."""
    goal, (place, radius) = plan["scene"].get("goal") or {}, wanted(plan)
    mark = {"color": _rgb(TARGET_COLOUR), "zorder": 9, "ls": "none"}
    if place is not None:
        ax.plot(*place, "x", ms=9, mew=2.2, **mark, label="the place that is wanted")
    if place is not None and radius > 0:
        ax.add_patch(_circle(place, radius, fc="none", ec=_rgb(TARGET_COLOUR), lw=1.4, ls=":", zorder=8))
    if goal.get("rest_for") in balls:
        mark["label"] = f"wanted: a shot on {goal['rest_for']}"
        ax.plot(*balls[goal["rest_for"]], "s", ms=15, mfc="none", mew=1.6, **mark)
    for k, name in enumerate(name for name in goal.get("avoid") or [] if name in balls):
        style = {
            "ls": "none",
            "color": _rgb(AVOID_COLOUR),
            "mew": 1.8,
            "label": "keep clear of this" if k == 0 else None,
        }
        ax.plot(*balls[name], "D", ms=14, mfc="none", **style, zorder=9)


def _draw_shot(
    ax: Any, shot: Mapping[str, Any], table: Table, ball: Ball, balls: Mapping[str, Array], bold: float = 1.0
) -> None:
    """The balls at the start, their planned ways, and rings where these end; `bold` widens lines of a small picture."""
    goal = (shot.get("scene") or {}).get("goal") or {}
    roles = {goal.get("cue"): "cue ball", goal.get("object"): "object ball"}
    for track in shot.get("tracks") or []:
        name, path = track["ball"], path_of(track)
        colour = _rgb(ball_colour(name))
        if not len(path):
            continue
        label = None if not goal else f"{name}, {roles[name]}" if name in roles and roles[name] != name else name
        ax.plot(*_thin(path).T, color="#10151a", lw=3.4 * bold, alpha=0.55, zorder=6, solid_capstyle="round")
        ax.plot(*_thin(path).T, color="white", lw=2.5 * bold, zorder=6, solid_capstyle="round")
        ax.plot(*_thin(path).T, color=colour, lw=1.7 * bold, zorder=6.5, label=label)
        if not dropped(table, ball, path[-1]):
            ax.add_patch(_circle(path[-1], ball.radius, fc="none", ec="white", lw=1.9 * bold, zorder=7))
            ax.add_patch(_circle(path[-1], ball.radius, fc="none", ec=colour, lw=1.2 * bold, zorder=7.5))
    for name, xy in balls.items():
        ax.add_patch(_circle(xy, ball.radius, fc=_rgb(ball_colour(name)), ec="#10151a", lw=0.7 * bold, zorder=8.5))


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

        fig.set_size_inches(3.3, 3.3)
        ax = fig.subplots()
        ax.add_patch(_circle((0, 0), r, fc=_rgb(ball_colour(name)), ec=NOISE, lw=1.2))
        ax.add_patch(_circle((0, 0), LIMIT * r, fc="none", ec=INK, lw=1.0, ls="--"))
        ax.plot([-r, r], [0, 0], [0, 0], [-r, r], color=NOISE, lw=0.6)
        for k in (2, 1):
            ax.add_patch(Ellipse((aim[0], aim[1]), *(2 * k * spread), fc=MODEL, ec=MODEL, alpha=0.4, lw=0.8, zorder=3))
        ax.plot([aim[0], aim[0], 0], [0, aim[1], aim[1]], color=MODEL, lw=0.8, ls=":")
        ax.plot(*aim, "o", ms=3, mec="none", color=INK, zorder=4)
        ax.text(0, -LIMIT * r - 0.05 * r, "0.5 R", ha="center", va="top", bbox={"fc": "white", "ec": "none", "pad": 1})
        reach = 1.06 * r
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="x′ [mm]", ylabel="y′ [mm]")
        ax.set(xticks=(-20, -10, 0, 10, 20), yticks=(-20, -10, 0, 10, 20))
        ax.spines[:].set_visible(False)
        ax.tick_params(length=2, labelsize=7.5)

    return svg("face", 3.3, draw)


def _rest_svg(plan: Mapping[str, Any], table: Table, ball: Ball) -> str:
    """Resting places near by, and the share of them within a distance."""
    cloud, potted = resting(plan)
    place, radius = wanted(plan)
    mean = np.array((plan.get("rest") or {}).get("mean") or cloud.mean(axis=0), float)
    centre = mean if place is None else place
    ends = np.array([*outline(cloud, OUTLINE_SHARES[-1]), mean, centre - radius, centre + radius])
    middle, half = (ends.max(axis=0) + ends.min(axis=0)) / 2, max(0.12, 0.56 * np.ptp(ends, axis=0).max())
    outside = int((np.abs(cloud - middle) > half).any(axis=1).sum())
    far = 1e3 * np.hypot(*(cloud - centre).T)

    def draw(fig: Any) -> None:
        left, right = fig.subplots(1, 2, width_ratios=[11, 10])
        fig.get_layout_engine().set(h_pad=0.09)
        draw_table(left, table, dark=True)
        _draw_cloud(left, plan, 3.4)
        left.plot(*mean, "P", ms=9, mfc=INK, mec="white", mew=1.1, ls="none", zorder=9, label="mean")
        _draw_goal(left, plan, ball, {})
        left.add_patch(_circle(centre, ball.radius, fc="none", ec="white", lw=0.9, zorder=8))
        left.set(xlim=middle[0] + [-half, half], ylim=middle[1] + [-half, half], xlabel="x [mm]", ylabel="y [mm]")
        for axis in (left.xaxis, left.yaxis):
            axis.set_major_formatter(lambda value, _: f"{1e3 * value:.0f}".replace("-", "−"))
        left.set_title(f"{len(cloud)} draws" + (f", {outside} of them outside the picture" if outside else ""))
        for label, colour, use in (
            ("all draws", INK, np.ones(len(far), bool)),
            ("draws that pot", MODEL, potted),
        ):
            if use.any():
                values = np.concatenate([[0.0], np.sort(far[use])])
                right.step(values, np.linspace(0, 100, len(values)), where="post", color=colour, lw=1.6, label=label)
        for share, line in zip(OUTLINE_SHARES, ("-", "--"), strict=True):
            value = float(np.quantile(far, share))
            text = f"{100 * share:.0f} % within {number(value)} mm"
            right.plot([0, value, value], [100 * share, 100 * share, 0], line, color=NOISE, lw=1.0, label=text)
        right.set(xlim=(0, 1.05 * float(np.quantile(far, 0.98)) or 1.0), ylim=(0, 103), ylabel="share of draws [%]")
        right.set_xlabel("distance from the " + ("mean" if place is None else "wanted place") + " [mm]")
        right.grid()
        right.set_axisbelow(True)
        right.legend(loc="lower right", frameon=True, facecolor="white", edgecolor="none", framealpha=0.9)
        _explain(fig, left, 6)

    return svg("rest", 5.9, draw)


def _explain(fig: Any, ax: Any, columns: int) -> int:
    """A legend on cloth, where white shows, its marks of one size whatever theirs is above: how many rows it takes."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        style = {"facecolor": _rgb(CLOTH_COLOUR), "edgecolor": "none", "labelcolor": "white", "framealpha": 1.0}
        legend = fig.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=True, **style)
        for mark in legend.legend_handles:
            mark.set(alpha=1.0, markersize=6.5, linewidth=max(1.2, mark.get_linewidth()))
    return math.ceil(len(handles) / columns)


def _alternatives(plan: Mapping[str, Any], table: Table, ball: Ball, balls: Mapping[str, Array]) -> str:
    others = plan.get("alternatives") or []
    if not others:
        return '<p class="sub">None was found.</p>'
    wide, tall = table.length + 2 * MARGIN, table.width + 2 * MARGIN
    rows = []
    for k, other in enumerate(others, start=1):

        def draw(fig: Any, other: Mapping[str, Any] = other) -> None:
            fig.set_size_inches(3.6, 3.6 * tall / wide)
            ax = fig.subplots()
            draw_table(ax, table, dark=True)
            _draw_shot(ax, other, table, ball, balls, bold=0.75)
            ax.set_axis_off()

        words = dict(strike_words(other))
        stroke = f"string {words['string']}, θ {words['θ, counter-clockwise from +x']}"
        offsets = f"x′0 {words['x′0, + is right']}, y′0 {words['y′0, + is up']}; {words['ball speed']}"
        cells = [_img(svg(f"alternative {k}", 2.2, draw), f"Alternative {k}"), f"{_text(other.get('kind') or '')}"]
        cells[1] += f'<div class="more">{_text(other.get("why") or "")}</div>'
        cells += [f"{_text(stroke)}<div>{_text(offsets)}</div>", percent(other.get("pot_probability"))]
        cells += [percent(other.get("foul_probability")), _text(rest_words(other.get("rest")))]
        cells.append(given(other.get("value"), ".2f"))
        kinds = ("mini", "", "", "", "", "", "n")
        rows.append("".join(f'<td class="{c}">{cell}</td>' for c, cell in zip(kinds, cells, strict=True)))
    heads = "".join(f"<th>{h}</th>" for h in ("", "shot", "stroke", "pot", "foul", "cue ball"))
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f'<table><thead><tr>{heads}<th class="n">value</th></tr></thead><tbody>{body}</tbody></table>'


def _fouls(plan: Mapping[str, Any]) -> str:
    fouls = sorted((plan.get("fouls") or {}).items(), key=lambda pair: (-pair[1], pair[0]))
    rows = "".join(
        f'<tr><td>{_text(name)}</td><td class="n">{given(100 * chance, ".1f", " %")}</td>'
        f'<td><div class="bar"><i style="width:{min(100.0, 100 * chance):.1f}%"></i></div></td></tr>'
        for name, chance in fouls
    )
    total = f'<p class="sub">Any foul: {percent(plan.get("foul_probability"))}. One draw may commit several.</p>'
    head = '<th>foul</th><th class="n">of the draws</th><th></th>'
    return total + (f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>" if rows else "")


def _computed(plan: Mapping[str, Any], table: Table, ball: Ball) -> str:
    execution, model = plan.get("execution") or {}, plan.get("model") or {}

    def sd(key: str, factor: float, form: str, unit: str) -> str:
        value = execution.get(key)
        return given(None if value is None else factor * value, form, unit)

    noise = f"speed {sd('speed_sd', 100, '.2g', ' %')}, direction {sd('azimuth_sd', 180 / math.pi, '.2g', '°')}, "
    noise += f"side {sd('side_sd', 1e3, '.2g', ' mm')}, height {sd('height_sd', 1e3, '.2g', ' mm')}"
    rows = (
        ("method", {"risk": "risk under noise", "ga": "genetic algorithm"}.get(plan.get("method", ""), "–")),
        ("seed", str(plan.get("seed", "–"))),
        ("launcher, one standard deviation", noise),
        ("model", PurePath(str(model.get("file") or "–")).name),
        ("effects", ", ".join(model.get("effects") or []) or "none"),
        ("draws", f"{len(plan.get('fan') or [])} drawn as lines, {len(resting(plan)[0])} as resting places"),
        ("value of the plan", given(plan.get("value"), ".2f")),
        ("table, ball", f"{table.length:g} m × {table.width:g} m, {1e3 * ball.diameter:g} mm, {ball.mass:g} kg"),
    )
    return "<table>" + "".join(f"<tr><th>{a}</th><td>{_text(b)}</td></tr>" for a, b in rows) + "</table>"


def _thin(path: Array) -> Array:
    """A line with few enough points to keep the file small."""
    return path if len(path) <= FEW else path[np.unique(np.linspace(0, len(path) - 1, FEW).astype(int))]


def _rgb(colour: Sequence[int]) -> tuple[float, ...]:
    return tuple(c / 255 for c in colour)


def _circle(centre: Any, radius: float, **style: Any) -> Any:
    from matplotlib.patches import Circle

    return Circle(tuple(centre), radius, **style)


def _img(picture: str, what: str) -> str:
    data = base64.b64encode(picture.encode()).decode()
    return f'<img alt="{escape(what)}" src="data:image/svg+xml;base64,{data}">'


def _figure(picture: str, what: str, caption: str) -> str:
    return f"<figure>{_img(picture, what)}<figcaption>{caption}</figcaption></figure>"


def _text(text: object) -> str:
    """Any text, safe in HTML; characters that cannot be shown are spelt out."""
    return escape("".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in str(text)))
