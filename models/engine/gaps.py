"""How far bodies are from touching, and how fast they come: balls, rails and jaws."""

from __future__ import annotations

import math

import numpy as np

from models.analytic.events import in_mouth
from models.analytic.pocket import jaw_gap, outward
from models.analytic.spring import CONTACT_GAP_M
from models.compiled import compiled_in_place
from models.engine import columns as col


@compiled_in_place
def meets(b, i, j, geometry):  # type: ignore[no-untyped-def]
    """Gap, approach speed and normal of balls i and j, or of ball i and rail or jaw -1 - j where j < 0."""
    radius = geometry.radius
    if j >= 0:
        x, y = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
        d2, touch = x * x + y * y, 2.0 * radius + CONTACT_GAP_M
        if d2 > touch * touch:
            return np.inf, 0.0, 1.0, 0.0
        d = math.sqrt(d2)
        x, y = x / d, y / d
        return d - 2.0 * radius, (b[i, col.VX] - b[j, col.VX]) * x + (b[i, col.VY] - b[j, col.VY]) * y, x, y
    rail = -1 - j
    gap = rail_gap(b[i], rail, geometry)
    if gap > CONTACT_GAP_M:
        return np.inf, 0.0, 1.0, 0.0
    x, y = outward(rail, b[i, col.X], b[i, col.Y], geometry.jaws)
    return gap, b[i, col.VX] * x + b[i, col.VY] * y, x, y


@compiled_in_place
def line_gap(b, rail, geometry):  # type: ignore[no-untyped-def]
    """Distance of a ball from a jaw, or from a rail's line of contact, also where that is open."""
    if rail >= 4:
        return jaw_gap(geometry.jaws[rail - 4], b[col.X], b[col.Y])
    return geometry.limits[rail // 2] - (1.0 - 2.0 * (rail % 2)) * b[rail // 2]


@compiled_in_place
def rail_gap(b, rail, geometry):  # type: ignore[no-untyped-def]
    """Distance of a ball from contact with a rail or a jaw; inf where that is open or elsewhere."""
    if rail < 4 and in_mouth(b[1 - rail // 2], rail, geometry.half, geometry.mouths):
        return math.inf
    return line_gap(b, rail, geometry)
