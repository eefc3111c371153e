"""Sizes of table and ball that a fit may correct, since measurements by hand are never exact.

A model keeps table and ball as stated, and in `Model.sizes` the fitted sizes, which are used in play. Length and width
are from nose to nose.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from models.shot import Ball, Table

TABLE_LENGTH, TABLE_WIDTH, BALL_DIAMETER = "table.length", "table.width", "ball.diameter"
SIZE_NAMES = (TABLE_LENGTH, TABLE_WIDTH, BALL_DIAMETER)
# Bounds relative to a stated size: three standard deviations of a tape and a caliper. A fit that lacks an effect would
# bias a size further; larger errors appear as a camera's scale, or are found by `sysid check`.
MAX_SIZE_ERRORS = {TABLE_LENGTH: 0.01, TABLE_WIDTH: 0.01, BALL_DIAMETER: 0.015}
SIZE_SOURCE = "as stated, give or take three standard deviations of a tape or a caliper"


def stated_size(name: str, table: Table, ball: Ball) -> float:
    """A size as stated [m]."""
    return {TABLE_LENGTH: table.length, TABLE_WIDTH: table.width, BALL_DIAMETER: ball.diameter}[name]


def size_meta(name: str, stated: float) -> dict[str, Any]:
    """Unit, bounds and source of a size, as for effects' parameters; a size has no off value."""
    bounds = ((1 - MAX_SIZE_ERRORS[name]) * stated, (1 + MAX_SIZE_ERRORS[name]) * stated)
    return {"default": stated, "off": None, "unit": "m", "bounds": bounds, "source": SIZE_SOURCE}


def with_sizes(table: Table, ball: Ball, sizes: Mapping[str, float]) -> tuple[Table, Ball]:
    """Table and ball with other sizes."""
    length, width, diameter = (float(sizes.get(name, stated_size(name, table, ball))) for name in SIZE_NAMES)
    return dataclasses.replace(table, length=length, width=width), dataclasses.replace(ball, diameter=diameter)
