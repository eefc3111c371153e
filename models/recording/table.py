"""The table that every recording is drawn on, and the open recording that it is drawn into.

Cushions and pockets are drawn for orientation only. `top` is the table from above, `space` the same in 3-D.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.shot import NOSE_HEIGHT, Array, Ball, Table
from models.table.palette import CLOTH_COLOUR, CUSHION_COLOUR, POCKET_COLOUR, RAIL_COLOUR

PATH_HEIGHT_M = 0.003  # height of paths over the cloth in the 3-D view [m]


@dataclass(frozen=True)
class Out:
    """The open recording."""

    rr: Any  # the module
    stream: Any

    def path(self, *parts: str) -> str:
        """An entity path, from parts that may hold any character."""
        return "/".join(self.rr.escape_entity_path_part(part) for part in parts)

    def fixed(self, path: str, *what: Any) -> None:
        """Log what holds at all times."""
        self.stream.log(path, *what, static=True, strict=True)


def draw_table(out: Out, table: Table, ball: Ball) -> None:
    """The table in both views; `top` is mirrored, so that +y is up."""
    rr, half, d, nose = out.rr, np.array([table.length, table.width]) / 2, ball.diameter, NOSE_HEIGHT * ball.radius
    out.fixed("top", rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0])))  # up is +y on a table, -y in a picture
    layers = (("rail", 2.6 * d, RAIL_COLOUR), ("cushion", d, CUSHION_COLOUR), ("cloth", 0.0, CLOTH_COLOUR))
    for order, (name, margin, colour) in enumerate(layers):
        scale = half + margin  # an image of 2 by 2: the only thing that Rerun fills in 2-D
        image = rr.Image(np.full((2, 2, 3), colour, dtype=np.uint8), draw_order=order - 100)
        out.fixed(f"top/table/{name}", rr.Transform3D(translation=[*-scale, 0], scale=[*scale, 1]), image)
    (x, y), (u, v) = half + d / 2, half
    centres = [(0, 0, -0.01), (x, 0, nose / 2), (-x, 0, nose / 2), (0, y, nose / 2), (0, -y, nose / 2)]
    halves = [(*half + d, 0.01), *[(d / 2, v + d, nose / 2)] * 2, *[(u, d / 2, nose / 2)] * 2]
    colours = [CLOTH_COLOUR] + [CUSHION_COLOUR] * 4
    out.fixed("space/table", rr.Boxes3D(centers=centres, half_sizes=halves, colors=colours, fill_mode="solid"))
    if table.pockets:
        discs, r = pocket_discs(table)
        out.fixed("top/table/pockets", rr.Points2D(discs, radii=r, colors=POCKET_COLOUR, draw_order=-50))
        holes = {"lengths": 1.1 * nose, "radii": r, "centers": lift(discs, nose / 2), "fill_mode": "solid"}
        out.fixed("space/table/pockets", rr.Cylinders3D(**holes, colors=POCKET_COLOUR))


def pocket_discs(table: Table) -> tuple[Array, Array]:
    """Discs as wide as the mouths, for orientation: centres (6, 2) and radii (6,) [m]."""
    u, v, r, q = table.length / 2, table.width / 2, table.shapes.corner.mouth / 2, table.shapes.middle.mouth / 2
    corners = [(sx * (u + 0.3 * r), sy * (v + 0.3 * r)) for sx in (-1, 1) for sy in (-1, 1)]
    return np.array([*corners, (0, v + 0.8 * q), (0, -v - 0.8 * q)]), np.array([r] * 4 + [q] * 2)


def lift(xy: Array, height: float) -> Array:
    """Places (n, 2) at one height: (n, 3) [m]."""
    return np.column_stack([xy, np.full(len(xy), height)])
