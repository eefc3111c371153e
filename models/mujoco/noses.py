"""The rails of a table as geoms of MuJoCo: the noses of its cushions, and the arcs and facings of its jaws.

In: an MjSpec, half the table's sizes, the balls' radius and the pockets. Out: the geoms, added to it, by name and kind
(models/mujoco/memory.py).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from models.analytic.spring import NOSE_RADIUS
from models.mujoco import memory as mem
from models.shot import (
    NOSE_COSINE,
    NOSE_SINE,
    RAIL_NAMES,
)

if TYPE_CHECKING:
    from models.analytic.pocket import Pockets


POST_HALF_HEIGHT_M: Final = 0.05  # half height of the cylinder that represents the arc of a jaw [m]


def add_noses(
    spec: mujoco.MjSpec, half_length: float, half_width: float, radius: float, pockets: Pockets
) -> list[tuple[str, int, int]]:
    """Add the geoms of the rails; returns names, kinds, and numbers of rails, or 4 + those of jaws."""
    found: list[tuple[str, int, int]] = []
    height = radius + (radius + NOSE_RADIUS) * NOSE_SINE

    def add(name: str, kind: int, rail: int, **geom: Any) -> None:
        spec.worldbody.add_geom(name=name, group=4, **geom)
        found.append((name, kind, rail))

    def nose(name: str, rail: int, ends: Iterable[ArrayLike], outward: ArrayLike) -> None:
        shift = NOSE_RADIUS * NOSE_COSINE * np.asarray(outward)
        line = np.concatenate([np.append(np.asarray(end, float) + shift, height) for end in ends])
        add(name, mem.NOSE, rail, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[NOSE_RADIUS, 0, 0], fromto=line)

    # Over the whole length: the callback lets no ball meet them where there is a mouth, but one that is known to stay.
    for rail, name in enumerate(RAIL_NAMES):
        k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
        ends = np.array([[half_length, half_width], [half_length, half_width]])
        ends[:, k] *= sign
        ends[0, 1 - k] *= -1.0
        outward = np.zeros(2)
        outward[k] = sign
        nose(f"cushion {name}", rail, ends, outward)
    for number, (x, y, size, *normal) in enumerate(pockets.jaws):
        name, rail, place = f"jaw {number}", 4 + number, np.array([x, y])
        if normal[0] or normal[1]:  # a facing
            out, along = np.array(normal), np.array([-normal[1], normal[0]])
            middle_of = place + radius * NOSE_COSINE * out
            if size > 0.0:
                nose(name, rail, (middle_of - size * along, middle_of + size * along), out)
        elif size > radius:
            shape = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "size": [size - radius, POST_HALF_HEIGHT_M, 0]}
            add(name, mem.POST, rail, pos=[x, y, radius], **shape)
        else:  # a nose so sharp that a ball meets it above its middle
            rise = float(np.sqrt((radius + NOSE_RADIUS) ** 2 - size**2))
            shape = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [NOSE_RADIUS, 0, 0]}
            add(name, mem.NOSE, rail, pos=[x, y, radius + rise], **shape)
    return found
