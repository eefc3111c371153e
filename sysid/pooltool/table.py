"""Conversion of tables to and from pooltool: straight noses and facings, arcs between them, circular pockets.

Both programs test contacts with a ball's centre, so the lines for centres (models/analytic/pocket.py) are moved by a
radius R: a nose line and a facing lie R further out, and an arc that centres meet at rho has the radius rho - R. The
circles into which balls fall are the same. Names are those of pooltool's own tables: 3, 6, 9, 12, 15 and 18 are the
straight noses, the others facings, and with a t the arcs before them.

Back: a mouth m, from the end e of a straight nose before a corner, is 2 (w + R) with w = (e - tan(t/2) r) / sqrt(2)
- R cos(theta) of clean room, t the turn from the nose into the facing and r the arc's radius here; at a middle, the
same without the root.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from models.analytic.pocket import pockets_of
from models.errors import BadInput
from models.shot import NOSE_COSINE, Array, Ball, Table
from models.table.pocket_shape import (
    CORNER_PARALLEL_RAD,
    MIDDLE_PARALLEL_RAD,
    POCKET_SETS,
    SNOOKER_POCKETS,
    PocketShapes,
    read_pockets,
)
from sysid.pooltool.frame import TableFrame, nose_shift, turned_there

NOSES_BY_RAIL: Mapping[str, tuple[str, ...]] = {"+x": ("9",), "-x": ("18",), "+y": ("3", "6"), "-y": ("15", "12")}
POCKET_IDS = {(-1, -1): "rb", (0, -1): "rc", (1, -1): "rt", (-1, 1): "lb", (0, 1): "lc", (1, 1): "lt"}
MIN_NOSE_RADIUS_M = 1e-4  # least radius of an arc in pooltool
DECIMALS, SAME_SIZE = 6, 2e-6  # rounding of pooltool's sizes [m, rad]: a ball's centre is placed to 1e-6 m
POCKET_DEPTH_M = 0.08  # depth of pooltool's own pockets
TABLE_HEIGHT_M, LIGHTS_HEIGHT_M = 0.708, 1.99  # used for drawing only


def frame_of(table: Table, ball: Ball) -> TableFrame:
    """The pooltool frame of one of our tables."""
    return TableFrame(*(size + 2 * nose_shift(ball.radius) for size in (table.length, table.width)))


def jaw_id(rail: str, along: float, corner: bool) -> str:
    """pooltool's name of the jaw at an end of our rail; `along` is the end's coordinate along the rail."""
    names = {
        ("+x", True): ("10", "8"), ("-x", True): ("17", "1"), ("+y", True): ("2", "7"), ("-y", True): ("16", "11"),
        ("+y", False): ("4", "5"), ("-y", False): ("14", "13"),
    }  # fmt: skip
    return names[rail, corner][along > 0]


def table_there(table: Table, ball: Ball, heights: Mapping[str, float]) -> dict[str, Any]:
    """A table as pooltool's `Table` in plain values.

    Args:
        table: with the sizes used in play.
        ball: whose radius shifts the noses.
        heights: of the nose by rail, +x, -x, +y, -y [m].
    """
    frame, pockets = frame_of(table, ball), pockets_of(table, ball)
    linear, circular = dict[str, Any](), dict[str, Any]()
    half = np.array([table.length, table.width]) / 2
    for rail, names in NOSES_BY_RAIL.items():
        k, sign = "xy".index(rail[1]), 1.0 if rail[0] == "+" else -1.0
        corner, middle = float(pockets.ends[0]), float(pockets.ends[1])
        spans = [(-half[1 - k] + corner, half[1 - k] - corner)]
        if len(names) > 1 and table.pockets:
            spans = [(-half[0] + corner, -middle), (middle, half[0] - corner)]
        if not table.pockets:
            names = {"+y": ("3",), "-y": ("12",)}.get(rail, names)
        for name, ends in zip(names, spans, strict=True):
            normal, nose = np.zeros(2), np.zeros((2, 2))
            normal[k] = sign
            nose[:, k] = sign * (half[k] + nose_shift(ball.radius))
            nose[:, 1 - k] = ends
            linear[name] = _segment(name, frame.place(nose), turned_there(normal), heights[rail])
    for row, (arc, number) in enumerate(zip(pockets.jaws[:12], (0, 0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3), strict=False)):
        rail, corner = ("+x", "-x", "+y", "-y")[number], row not in (6, 7, 10, 11)
        name = jaw_id(rail, float(arc[1] if number < 2 else arc[0]), corner)
        centre = [*map(float, frame.place(arc[:2])), heights[rail]]
        radius = max(float(arc[2]) - ball.radius, MIN_NOSE_RADIUS_M)
        circular[f"{name}t"] = {"id": f"{name}t", "center": centre, "radius": radius}
        if len(pockets.jaws) > 12 and pockets.jaws[12 + row, 2] > 0:
            facing = pockets.jaws[12 + row]
            normal = facing[3:]
            ends_xy = facing[:2] + np.outer([-facing[2], facing[2]], [-normal[1], normal[0]]) + ball.radius * normal
            linear[name] = _segment(name, frame.place(ends_xy), turned_there(normal), heights[rail])
    return {
        "cushion_segments": {"linear": linear, "circular": circular},
        "pockets": {p["id"]: p for p in (_pocket(frame, *row) for row in pockets.falls.tolist())},
        "table_type": "pocket" if table.pockets else "billiard", "model_descr": {"name": "null"},
        "height": TABLE_HEIGHT_M, "lights_height": LIGHTS_HEIGHT_M,
    }  # fmt: skip


def _pocket(frame: TableFrame, x: float, y: float, radius: float) -> dict[str, Any]:
    name = POCKET_IDS[round(math.copysign(1, x)) if x else 0, round(math.copysign(1, y))]
    centre = [*map(float, frame.place(np.array([x, y]))), 0.0]
    return {"id": name, "center": centre, "radius": radius, "depth": POCKET_DEPTH_M, "contains": []}


def _segment(name: str, ends: Array, normal: Array, height: float) -> dict[str, Any]:
    """A straight nose; `normal` points into the rubber. Its direction defines the side on which balls are."""
    (x1, y1), (x2, y2) = sorted((float(x), float(y)) for x, y in ends)
    # pooltool's line is lx x + ly y + l0 = 0, with lx = 1 for one along y, and ly = 1 for any other.
    lx, ly = (1.0, 0.0) if x1 == x2 else (-(y2 - y1) / (x2 - x1), 1.0)
    side = 0 if lx * float(normal[0]) + ly * float(normal[1]) > 0 else 1
    return {"id": name, "p1": [x1, y1, height], "p2": [x2, y2, height], "direction": side}


def table_here(data: Mapping[str, Any], ball: Ball) -> tuple[Table, TableFrame, str]:
    """Our table for one of pooltool's, its frame, and a remark on parts without a counterpart; "" for none.

    Raises:
        KeyError, TypeError, ValueError: if it differs from pooltool's format.
    """
    linear = {name: np.array([one["p1"], one["p2"]], float)[:, :2] for name, one in _segments(data, "linear").items()}
    width = float(linear["12"][0, 0] - linear["3"][0, 0])
    length = float(linear["9"][0, 1] - linear["18"][0, 1])
    frame, shift = TableFrame(length, width), nose_shift(ball.radius)
    table = Table(round(length - 2 * shift, DECIMALS), round(width - 2 * shift, DECIMALS), pockets=False)
    if not data["pockets"]:
        return table, frame, ""
    try:
        shapes = {which: _shape(data, which, table, ball, frame, linear) for which in ("corner", "middle")}
        table = dataclasses.replace(table, pockets=_known(read_pockets(shapes)))
        pockets_of(table, ball)
    except (BadInput, LookupError, ArithmeticError):
        return (
            dataclasses.replace(table, pockets=True),
            frame,
            "its pockets are of another kind: snooker pockets are used instead",
        )
    return table, frame, ""


def _known(found: bool | PocketShapes) -> bool | PocketShapes:
    """The pockets themselves, or a known set of the same geometry, which includes the acceptance."""
    for known in POCKET_SETS.values():
        if isinstance(found, PocketShapes) and all(
            abs(getattr(a, f.name) - getattr(b, f.name)) <= SAME_SIZE
            for a, b in ((found.corner, known.corner), (found.middle, known.middle))
            for f in dataclasses.fields(a)
            if f.name != "acceptance"
        ):
            return read_pockets(known) if known != SNOOKER_POCKETS else True
    return found


def _segments(data: Mapping[str, Any], kind: str) -> Mapping[str, Any]:
    found: Mapping[str, Any] = data["cushion_segments"][kind]
    return found


def _shape(
    data: Mapping[str, Any], which: str, table: Table, ball: Ball, frame: TableFrame, linear: Mapping[str, Array]
) -> dict[str, float]:
    """Our shape of a kind of pooltool pocket, from its first one: lower left, or left centre."""
    corner, near, shift = which == "corner", ball.radius * NOSE_COSINE, nose_shift(ball.radius)
    name = "2" if corner else "4"
    arc = _segments(data, "circular")[f"{name}t"]
    x = float(frame.place_here(np.array(arc["center"], float)[:2])[0])
    radius = float(arc["radius"]) + shift
    parallel = CORNER_PARALLEL_RAD if corner else MIDDLE_PARALLEL_RAD
    cut = parallel
    if name in linear:
        way = np.abs(linear[name][1] - linear[name][0])
        cut = math.pi - math.atan2(way[0], way[1]) if corner else math.pi / 2 + math.atan2(way[1], way[0])
    bend = math.tan((math.pi - cut) / 2) * radius
    end = (table.length / 2 + x) if corner else -x
    clean = (end - bend) / (math.sqrt(2) if corner else 1.0) - near
    mouth = 2 * (clean + ball.radius)
    hole = data["pockets"]["lb" if corner else "lc"]
    hx, hy = frame.place_here(np.array(hole["center"], float)[:2])
    edge = float(hole["radius"])
    beyond = math.hypot(hx + table.length / 2, hy - table.width / 2) if corner else float(hy) - table.width / 2
    shelf = beyond - edge + (mouth / 2 if corner else 0.0)
    sizes = {"mouth": mouth, "nose_radius": radius, "cut_angle": cut, "edge_radius": edge, "shelf": max(shelf, 0.0)}
    return {key: round(value, DECIMALS) for key, value in sizes.items()}
