"""A planned shot to look at in the Rerun viewer: how it should run, how it may run, and what else could be played.

A plan is the parsed file `billiard-plan/1`, read by planned.py. The nominal shot runs on the timeline `shot_time` [s],
each alternative on the same one in a view and under an entity path of its own. Left out: the balls' rotation, and when
within the shot a draw parts from the nominal one.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.recording.file import whole_recording
from models.recording.planned import (
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
from models.recording.table import PATH_HEIGHT_M, Out, draw_table, lift
from models.shot import Array, Ball, Table
from models.table.palette import FLOOR_COLOUR, Colour, ball_colour

PLAN_APPLICATION = "cuelab_plan"
OUTCOME_COLOURS: Mapping[str, Colour] = {"potted": (86, 190, 255), "missed": (255, 159, 28), "foul": (255, 122, 217)}
TARGET_COLOUR, AVOID_COLOUR = (255, 255, 255), (255, 122, 217)
OUTLINE_SHARES = (0.5, 0.9)  # of the draws, inside the outlines
PLAN_GUIDE = """
* **Solid balls** roll the nominal shot: press play. **Rings** are where they started.
* **Thin lines**: draws of what the launcher may really do. Blue: potted. Orange: missed. Pink: a foul.
* **Dots**: where the cue ball may come to rest; the outlines hold 50 % and 90 % of them.
* **White cross and circle**: where it is wanted. **Pink ring**: a ball to keep clear of.
* Each alternative has a tab of its own; every layer can be hidden by its entity path (blueprint panel, on the left).
"""


def write_plan(path: Path | str, plan: Mapping[str, Any], *, title: str) -> None:
    """Write one Rerun recording of a plan; the file appears whole or not at all.

    Raises BadInput where it cannot be written, or is given no plan.
    """
    import rerun as rr

    table, ball, balls = scene_of(plan)
    digest = hashlib.sha256(json.dumps([title, plan], sort_keys=True).encode()).hexdigest()[:32]
    with whole_recording(path, PLAN_APPLICATION, digest, title, _blueprint(table, ball, plan)) as stream:
        out = Out(rr, stream)
        draw_table(out, table, ball)
        _draw_scene(out, plan, ball, balls)
        _draw_shot(out, "shot", plan.get("tracks") or [], table, ball, balls)
        for number, other in enumerate(plan.get("alternatives") or [], start=1):
            _draw_shot(out, f"alternative/{number}", other.get("tracks") or [], table, ball, balls)
        _draw_draws(out, plan)
        _describe(out, plan, title)


def _lines(out: Out, part: str, strips: Sequence[Array], colour: Colour, radius: float, order: float) -> None:
    """Lines in both views, for all times."""
    long = [strip for strip in strips if len(strip) > 1]
    if long:
        rr, style = out.rr, {"radii": radius, "colors": colour}
        out.fixed(f"top/{part}", rr.LineStrips2D(long, **style, draw_order=order))
        out.fixed(f"space/{part}", rr.LineStrips3D([lift(strip, PATH_HEIGHT_M) for strip in long], **style))


def _circle(centre: Array, radius: float) -> Array:
    turn = np.linspace(0.0, 2 * math.pi, 49)
    return np.asarray(centre + radius * np.column_stack([np.cos(turn), np.sin(turn)]))


def _draw_scene(out: Out, plan: Mapping[str, Any], ball: Ball, balls: Mapping[str, Array]) -> None:
    """Where the balls start, where the cue ball is wanted, what it shall not touch."""
    goal, r = plan["scene"].get("goal") or {}, ball.radius
    for name, xy in balls.items():
        _lines(out, f"start/{out.path(name)}", [_circle(xy, r)], ball_colour(name), -1.2, 15)
    place, radius = wanted(plan)
    if place is not None:
        cross = [place + r * np.array(bar) for bar in ([[-1, 0], [1, 0]], [[0, -1], [0, 1]])]
        _lines(out, "wanted", [*cross, _circle(place, radius or r)], TARGET_COLOUR, -1.5, 50)
    elif goal.get("rest_for") in balls:
        _lines(out, "wanted", [_circle(balls[goal["rest_for"]], 1.5 * r)], TARGET_COLOUR, -1.5, 50)
    for name in (name for name in goal.get("avoid") or [] if name in balls):
        _lines(out, f"avoid/{out.path(name)}", [_circle(balls[name], 1.6 * r)], AVOID_COLOUR, -1.5, 50)


def _draw_shot(
    out: Out, part: str, tracks: Sequence[Mapping[str, Any]], table: Table, ball: Ball, balls: Mapping[str, Array]
) -> None:
    """Balls that run along their ways on the timeline, the others where they are; a potted ball goes."""
    rr, r = out.rr, ball.radius
    moving = {track["ball"]: track for track in tracks if len(track["t"])}
    for name, start in balls.items():
        where, colour = f"{part}/ball/{out.path(name)}", ball_colour(name)
        if name not in moving:
            out.fixed(f"top/{where}", rr.Points2D([start], radii=r, colors=colour, draw_order=20))
            out.fixed(f"space/{where}", rr.Points3D(lift(start[None], r), radii=r, colors=colour))
            continue
        time, xy = np.array(moving[name]["t"], float), path_of(moving[name])
        _lines(out, f"{part}/path/{out.path(name)}", [xy], colour, -1.6, 10)
        rows = np.ones(len(time), int)
        if dropped(table, ball, xy[-1]):
            time, rows = np.append(time, time[-1] + 1e-3), np.append(rows, 0)
        column = [rr.TimeColumn("shot_time", duration=time)]
        for view, kind, places in (("top", rr.Points2D, xy), ("space", rr.Points3D, lift(xy, r))):
            flat = {"draw_order": 20} if view == "top" else {}
            out.fixed(f"{view}/{where}", kind.from_fields(radii=r, colors=colour, **flat))
            data = kind.columns(positions=places).partition(rows)
            out.stream.send_columns(f"{view}/{where}", column, data, strict=True)


def _draw_draws(out: Out, plan: Mapping[str, Any]) -> None:
    """What the launcher may really do: ways and resting places, by what became of the draw."""
    fan = plan.get("fan") or []
    for word, colour in OUTCOME_COLOURS.items():
        strips = [path_of(track) for draw in fan if fate(draw) == word for track in draw["tracks"]]
        _lines(out, f"fan/{word}", strips, colour, -0.5, 5)
    cloud, potted = resting(plan)
    for word, chosen in (("potted", potted), ("missed", ~potted)):
        if chosen.any():
            dots = {"radii": -1.4, "colors": OUTCOME_COLOURS[word]}
            out.fixed(f"top/rest/{word}", out.rr.Points2D(cloud[chosen], **dots, draw_order=30))
            out.fixed(f"space/rest/{word}", out.rr.Points3D(lift(cloud[chosen], PATH_HEIGHT_M), **dots))
    _lines(out, "rest/outline", [outline(cloud, share) for share in OUTLINE_SHARES], TARGET_COLOUR, -0.8, 40)


def _row(*cells: str) -> str:
    return "| " + " | ".join(" ".join(cell.replace("|", "/").split()) for cell in cells) + " |"


def _describe(out: Out, plan: Mapping[str, Any], title: str) -> None:
    """Words: the stroke and what it should give; the alternatives; how to read the recording."""
    why, lines = str(plan.get("why") or ""), [f"# {title}"]
    if plan.get("stroke"):
        lines += [f"**{sentence(plan)}**\n", f"{why}\n", "| set | |", "|---|---|"]
        lines += [_row(*words) for words in strike_words(plan)]
        lines += ["\n| expect | |", "|---|---|", _row("pot", percent(plan.get("pot_probability")))]
        lines += [_row("foul", percent(plan.get("foul_probability"))), _row("cue ball", rest_words(plan.get("rest")))]
        named = sorted((plan.get("fouls") or {}).items(), key=lambda pair: -pair[1])
        lines += [_row(f"foul: {name}", given(100 * chance, ".1f", " %")) for name, chance in named if chance > 0]
    else:
        lines += [f"**{sentence(plan)}**\n", why]
    others = plan.get("alternatives") or []
    table = ["# Alternatives", _row("", "shot", "string", "pot", "foul", "cue ball", "why"), "|---" * 7 + "|"]
    for number, other in enumerate(others, start=1):
        chances = (percent(other.get(key)) for key in ("pot_probability", "foul_probability"))
        string = str((other.get("launcher") or {}).get("string", "–"))
        words = (str(number), str(other.get("kind", "")), string, *chances, rest_words(other.get("rest")))
        table.append(_row(*words, str(other.get("why") or "")))
    pages = {"plan": lines, "alternatives": table if others else ["No alternatives."], "guide": [PLAN_GUIDE]}
    for name, page in pages.items():
        out.fixed(f"text/{name}", out.rr.TextDocument("\n".join(page), media_type="text/markdown"))


def _blueprint(table: Table, ball: Ball, plan: Mapping[str, Any]) -> Any:
    """The table on the left, a tab for every alternative; words on the right."""
    import rerun.blueprint as rrb

    x, y = np.array([table.length, table.width]) / 2 + 3 * ball.diameter
    bounds = rrb.VisualBounds2D(x_range=[-x, x], y_range=[-y, y])

    def above(name: str, *contents: str) -> Any:
        # From the root, as a view leaves out the transform of its own origin.
        whole = ["+ /top", "+ /top/table/**", "+ /top/start/**", "+ /top/wanted", "+ /top/avoid/**", *contents]
        return rrb.Spatial2DView(origin="/", contents=whole, visual_bounds=bounds, name=name, background=FLOOR_COLOUR)

    eye = rrb.EyeControls3D(kind="orbital", position=(0, -1.6 * y, 1.95 * y), look_target=(0, -0.1 * y, 0))
    space = rrb.Spatial3DView(
        origin="space", contents=["+ /space/**", "- /space/alternative/**"], name="In 3-D", eye_controls=eye,
        background=FLOOR_COLOUR, line_grid=False,
    )  # fmt: skip
    views = [above("The plan", "+ /top/shot/**", "+ /top/fan/**", "+ /top/rest/**"), space]
    for number in range(1, len(plan.get("alternatives") or []) + 1):
        views.append(above(f"Alternative {number}", f"+ /top/alternative/{number}/**"))
    names = {"alternatives": "Alternatives", "guide": "How to read this"}
    pages = [rrb.TextDocumentView(origin=f"text/{key}", name=name) for key, name in names.items()]
    words = rrb.Vertical(
        rrb.TextDocumentView(origin="text/plan", name="What to play"), rrb.Tabs(*pages), row_shares=[3, 2]
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(*views), words, column_shares=[7, 3]),
        rrb.TimePanel(state="collapsed", timeline="shot_time", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
