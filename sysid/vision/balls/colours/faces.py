"""The faces of balls that have several colours, as those of pool: what they show, and which ball each is.

In: pictures beside the background, and where balls are seen in them. Out: the colours of their faces. Such balls are
found and followed as discs that are not the table (cover.py), whatever they show, and named by all that is seen of
them (names.py).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.vision.balls.background import Background, View
from sysid.vision.balls.colours.names import FACE_RADII
from sysid.vision.balls.colours.palette import colour_distance
from sysid.vision.balls.view_geometry import Array

ANY_BALL = "ball"  # one that has no name yet
OTHER_COLOUR = 0.22  # distance from the median colour of a face, from which on a place has another one
PLAIN_SHARE = 0.12  # of such places on a ball of one colour: its highlight, and the cue over it
MIN_PATTERNED = 0.2  # of the faces seen, that make a set of patterned balls


def face(background: Background, view: View, xy: Array, radius: float) -> Array:
    """Colours (n, 3) of a ball's face at a pixel (2,) in white light: red, green, blue, 0 to 1."""
    face_radius = FACE_RADII * radius
    window, _, corner = view.window(xy, face_radius)
    y, x = np.mgrid[: window.shape[0], : window.shape[1]]
    inside = np.hypot(x + corner[0] - xy[0], y + corner[1] - xy[1]) < face_radius
    return np.asarray((window[inside] / (255 * background.light_at(view, xy)))[:, ::-1], float)


def are_patterned(faces: Sequence[Array]) -> bool:
    """Whether faces (n, 3) show several colours each, and not only balls of one colour."""
    other = [(colour_distance(shown, np.median(shown, axis=0)) > OTHER_COLOUR).mean() for shown in faces]
    return bool(np.mean(np.array(other) > PLAIN_SHARE) > MIN_PATTERNED) if faces else False
