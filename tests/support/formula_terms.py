"""Terms of formulas of every kind, and the same as a result.json tells them."""

from __future__ import annotations

from typing import Any

from models.shot import Ball, Table
from sysid.selection.formulas.families import (
    counted_shapes,
    shapes,
    shapes_at_one,
    shapes_beyond,
    shapes_of_drift,
    shapes_times,
)
from sysid.selection.formulas.terms import Term, library

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
SHAPED = (
    ("drag", "x"),
    ("drag", "speed"),
    ("cushion_e", "along"),
    ("ball_mu", "slip"),
    ("grip", "order"),
    ("push_x", "x"),
    ("image_y", "order"),
)
SHAPES = [family[-1] for q, v in SHAPED for family in shapes(q, v, 0.0, 1.5)[1:]]
SHAPES += [family[-1] for family in shapes_at_one("cushion_mu", "rail", 2, "along", -1.7, 1.7)]
SHAPES += counted_shapes("cushion_e", "rail", 4)[1]
SHAPES += [
    shapes_beyond(next(one for one in SHAPES if one[0].name == name), over, -0.7, 1.3)[side][4]
    for name, over, side in (
        ("drag_x_above", "order", 0), ("grip_order_up_from", "y", 1), ("cushion_e_along_size", "grazing", 1),
        ("drag_speed_fade", "x", 0), ("drag_x_curve_16_0", "order", 1),
    )
]  # fmt: skip
SHAPES += [family[0] for q in ("drag", "grip") for family in shapes_times(q, "order", "x", 0.0, 1.0)]
SHAPES += shapes_times("image_x", "order", "x", 0.0, 1.0)[0]
DRIFTS = (
    ("drag", "x", "order"), ("cushion_mu", "wz", "hour"), ("ball_e", "approach", "cloth_age"), ("spin", "wz", "order"),
    ("image_x", "y", "order"), ("grip", "slip", "warmth"), ("clock", "time", "order"),
)  # fmt: skip
SHAPES += [family[0] for names in DRIFTS for family in shapes_of_drift(*names, (0.0, 1.0), 0.0, 1.0)]
COUNTS = {"rail": 4, "number": 3, "table": 3, "player": 3}
TERMS = list({t.name: t for t in (*library(TABLE, COUNTS), *(t for shape in SHAPES for t in shape))}.values())


def terms_of(*names: str) -> list[Term]:
    return [next(t for t in TERMS if t.name == n) for n in names]


def told(term: Term, value: float = 0.01) -> dict[str, Any]:
    """A term as a result.json tells it."""
    return {
        "name": term.name, "door": term.quantity, "factor": term.factor, "unit": term.unit, "width": term.width,
        "value": value, "sd": None, "where": term.where, "depends_on": list(term.depends_on), "gain": 50.0,
    }  # fmt: skip
