"""Pockets as they are measured: mouth, nose, facings and slate, one shape for the corners and one for the middles.

Seen from above a cushion's nose runs to a point, where its facing turns off into the pocket. The mouth is the distance
between the two points, where the lines of noses and facings meet (WPA: "from pointed lip to pointed lip"). The cut
angle is inside the rubber, between nose and facing: at 135 degrees at a corner and 90 at a middle facings run along the
pocket's axis, at wider angles they close towards the throat. A radius rounds the point. The shelf is how far the slate
extends beyond the middle of the mouth, along the axis; it ends in an arc, open to the table. The acceptance sums all
this up for models without jaws: how far from the axis a slow ball, on its way along it, still falls.

Files hold `pockets = true` (those of snooker), false, the name of a set below, or its numbers:

    [table.pockets]
    corner = { mouth = 0.1159, nose_radius = 0.021, cut_angle = 2.478, shelf = 0.0413, edge_radius = 0.062 }
    middle = { mouth = 0.1286, nose_radius = 0.008, cut_angle = 1.815, shelf = 0.0048, edge_radius = 0.0645 }

in m and rad, with an `acceptance` where it has been measured.

Sources. Robotic Billiards: Robotic Billiards 2015. The templates of the WPBSA are not published. WPA: World
Pool-Billiard Association, Tournament Table and Equipment Specifications, sections 9 and 16, the middle of what they
allow. Showood: a 7 ft table that the authors of pooltool measured (pooltool/objects/table/collection.py). The WPA
leaves radii of noses and slate open: Showood's are taken. Acceptances of pool: what these jaws let in at 0.3 m/s with
MuJoCo's and the event engine's impacts of models/analytic/impulse.py (measured by tests/models/table/test_presets.py).
Leaves out the facings' own rubber and the back draft of the cut.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Any

from models.errors import BadInput
from models.files.faults import shown

INCH_M = 0.0254
CORNER_PARALLEL_RAD, MIDDLE_PARALLEL_RAD = math.radians(135.0), math.radians(90.0)  # cuts along the axis
ACCEPTANCE_OF_MOUTH = 0.65  # usual ratio of acceptance to half a mouth: 0.62 to 0.69 for the pools below
SHAPE_BOUNDS: Mapping[str, tuple[str, float, float]] = {  # unit, from, to
    "mouth": ("m", 0.02, 0.3),
    "nose_radius": ("m", 0.0, 0.3),
    "cut_angle": ("rad", 1.4, 3.0),
    "shelf": ("m", 0.0, 0.1),
    "edge_radius": ("m", 0.01, 0.3),
    "acceptance": ("m", 0.001, 0.3),
}


@dataclass(frozen=True)
class PocketShape:
    """One pocket, seen from above."""

    mouth: float  # between the points of the noses [m]
    nose_radius: float  # of the nose line's bend into the facing [m]
    cut_angle: float  # inside the rubber, between nose line and facing [rad]
    shelf: float  # of slate beyond the middle of the mouth [m]
    edge_radius: float  # of the arc in which the slate ends [m]
    acceptance: float  # half width of what it lets in, slowly along its axis [m]

    def edge_depth(self, *, corner: bool) -> float:
        """How far the middle of the slate's edge is beyond a corner, or beyond the nose line of a middle [m]."""
        return self.shelf + self.edge_radius - self.mouth / 2 * corner


@dataclass(frozen=True)
class PocketShapes:
    """The pockets of a table: four corners alike, two middles alike."""

    corner: PocketShape
    middle: PocketShape


# Mouths, acceptances: Robotic Billiards. Nose radii: such that they let in what it says (models/analytic/pocket.py).
# Shelf: "about the line of the cushion" (Broadfoot, Billiards, 1896). Edge: half a mouth.
SNOOKER_POCKETS = PocketShapes(
    corner=PocketShape(0.090, 0.122, CORNER_PARALLEL_RAD, 0.0, 0.045, 0.045),
    middle=PocketShape(0.090, 0.085, MIDDLE_PARALLEL_RAD, 0.0, 0.045, 0.055),
)
WPA_POCKETS = PocketShapes(
    corner=PocketShape(
        mouth=4.5625 * INCH_M,  # WPA 9: 4.5 to 4.625 in
        nose_radius=0.02095,  # Showood
        cut_angle=math.radians(142.0),  # WPA 9: 142 degrees, 1 more or less
        shelf=1.625 * INCH_M,  # WPA 9: 1 to 2.25 in
        edge_radius=0.062,  # Showood
        acceptance=0.0355,
    ),
    middle=PocketShape(
        mouth=5.0625 * INCH_M,  # WPA 9: 5 to 5.125 in
        nose_radius=0.00795,  # Showood
        cut_angle=math.radians(104.0),  # WPA 9: 104 degrees, 1 more or less
        shelf=0.1875 * INCH_M,  # WPA 9: 0 to 0.375 in
        edge_radius=0.0645,  # Showood
        acceptance=0.0415,
    ),
)
# All Showood. There a facing's angle is to the axis, and a circle of the edge's radius has its centre 41.7 mm beyond a
# corner and 68.5 mm beyond a middle: shelves are 118 / 2 + 41.7 - 62 mm and 68.5 - 64.5 mm.
SHOWOOD_POCKETS = PocketShapes(
    corner=PocketShape(0.118, 0.02095, math.radians(135.0 + 5.3), 0.0387, 0.062, 0.0375),
    middle=PocketShape(0.137, 0.00795, math.radians(90.0 + 7.14), 0.004, 0.0645, 0.0475),
)
POCKET_SETS: Mapping[str, PocketShapes] = {
    "snooker": SNOOKER_POCKETS,
    "pool 9 ft": WPA_POCKETS,
    "pool 8 ft": WPA_POCKETS,  # WPA: the same for both sizes
    "pool 7 ft": SHOWOOD_POCKETS,
}


def read_pockets(value: Any) -> bool | PocketShapes:
    """Pockets from the entry of a file, true for those of snooker; BadInput names the faults of an entry."""
    if isinstance(value, bool | PocketShapes):
        return value
    names = ", ".join(f'"{name}"' for name in POCKET_SETS)
    if isinstance(value, str) and value in POCKET_SETS:
        return _plain(POCKET_SETS[value])
    if isinstance(value, str):
        near = get_close_matches(value, POCKET_SETS, 1)
        raise BadInput(
            f"pockets = {shown(value)} is no set of pockets: "
            + (f'did you mean "{near[0]}"?' if near else f"write true or false, or one of {names}")
        )
    if not isinstance(value, Mapping):
        raise BadInput(f"pockets = {shown(value)} is not true or false: write one of them, {names} or [table.pockets]")
    for key in value:
        if key not in ("corner", "middle"):
            raise BadInput(f"pockets has an unknown key {shown(key)}: write corner and middle")
    return _plain(PocketShapes(_shape(value, "corner"), _shape(value, "middle")))


def _plain(shapes: PocketShapes) -> bool | PocketShapes:
    """Those of snooker are written and compared as they always were."""
    return True if shapes == SNOOKER_POCKETS else shapes


def _shape(pockets: Mapping[str, Any], which: str) -> PocketShape:
    entry = pockets.get(which)
    names = [f.name for f in fields(PocketShape)]
    if not isinstance(entry, Mapping):
        raise BadInput(f"pockets.{which} is {shown(entry)}: write a table of {', '.join(names)}")
    for key in entry:
        if key not in names:
            near = get_close_matches(str(key), names, 1)
            hint = f"did you mean {near[0]}?" if near else f"choose from {', '.join(names)}"
            raise BadInput(f"pockets.{which} has an unknown key {key!r}: {hint}")
    found: dict[str, float] = {}
    for key, (unit, low, high) in SHAPE_BOUNDS.items():
        number = entry.get(key)
        if key == "acceptance" and number is None:
            number = ACCEPTANCE_OF_MOUTH * found["mouth"] / 2
        if not isinstance(number, int | float) or isinstance(number, bool) or not low <= number <= high:
            raise BadInput(f"pockets.{which}.{key} is {number!r}: write a number of {low:g} to {high:g} [{unit}]")
        found[key] = float(number)
    return PocketShape(**found)
