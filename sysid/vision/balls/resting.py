"""Balls at rest all the time, in what the pictures of a footage show most of the time.

In: that picture beside the bed's colour. Out: where balls are; the empty table is mended there (background.py). A hand
or an arm that stays has pieces that look like balls: what goes on beyond its rim, and comes in over a cushion, is none.
"""

from __future__ import annotations

import numpy as np

from sysid.vision.balls.background import View
from sysid.vision.balls.colours.palette import Palette
from sysid.vision.balls.discs import new_discs
from sysid.vision.balls.edges import Optics
from sysid.vision.balls.intruders import intruding, is_part
from sysid.vision.balls.outline_fit import MIN_FOREGROUND, balls
from sysid.vision.balls.view_geometry import Array


def resting_balls(view: View, optics: Optics, palette: Palette) -> list[Array]:
    """Pixels (2,) of balls in what pictures show most of the time: outlines, and what out of focus has none."""
    found = [] if palette.patterned else [fit.xy for fit in balls(view, optics, MIN_FOREGROUND)]
    for fit in new_discs(view, None):
        if all(np.hypot(*(fit.xy - xy)) > fit.radius for xy in found):
            found.append(fit.xy)
    intruders = intruding(view)
    return [xy for k, xy in enumerate(found) if not is_part(intruders, view, xy, found[:k] + found[k + 1 :])]
