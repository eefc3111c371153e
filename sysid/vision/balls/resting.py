"""Balls at rest all the time, in what the pictures of a footage show most of the time.

In: that picture beside the bed's colour. Out: where balls are; the empty table is mended there (background.py). A hand
or an arm that stays has pieces that look like balls: what goes on beyond its rim, and comes in over a cushion, is none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.vision.balls.background import View
from sysid.vision.balls.discs import new_discs
from sysid.vision.balls.edges import Optics
from sysid.vision.balls.intruders import intruding, shows
from sysid.vision.balls.outline_fit import MIN_FOREGROUND, balls
from sysid.vision.balls.palette import Palette
from sysid.vision.balls.view_geometry import Array, Mask

AROUND = 48  # places about a ball that rests all the time,
AROUND_RADII = 1.6  # so far from its centre,
BESIDE_RADII = 1.3  # and so far from those of other balls, to be none of theirs,
MAX_AROUND = 0.3  # of which show what comes in over a cushion: more, and it is a part of that


def resting_balls(view: View, optics: Optics, palette: Palette) -> list[Array]:
    """Pixels (2,) of balls in what pictures show most of the time: outlines, and what out of focus has none."""
    found = [] if palette.patterned else [fit.xy for fit in balls(view, optics, MIN_FOREGROUND)]
    for fit in new_discs(view, None):
        if all(np.hypot(*(fit.xy - xy)) > fit.radius for xy in found):
            found.append(fit.xy)
    intruders = intruding(view)
    return [xy for k, xy in enumerate(found) if not _is_part(intruders, view, xy, found[:k] + found[k + 1 :])]


def _is_part(intruders: Mask, view: View, xy: Array, others: Sequence[Array]) -> bool:
    """Whether what seems a ball at a pixel (2,) goes on beyond its rim, and not as other balls beside it."""
    radius = view.geometry.radius(xy)
    angles = np.arange(AROUND) * 2 * np.pi / AROUND
    ring = xy + AROUND_RADII * radius * np.column_stack([np.cos(angles), np.sin(angles)])
    beside = np.array([np.hypot(*(ring - other).T) < BESIDE_RADII * radius for other in others], bool)
    covered = shows(intruders, ring) & ~beside.reshape(len(others), AROUND).any(axis=0)
    return bool(covered.mean() > MAX_AROUND)
