"""Whether the cloth ends where an edge is taken for its end: it has the colour of the bed up to there, and not beyond.

In: a picture and a camera. Out: yes or no. A cushion in the dark is as little bright as wood, so the outline of the
cloth by its brightness may end before it; shares of the three colours of light hardly change with brightness.
"""

from __future__ import annotations

import numpy as np

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.edges import Image, strip

BED_M = (-0.10, -0.05)  # out of the nose, where the bed's colour is taken
BESIDE_M = (0.004, 0.016)  # of the end, on either side
MIN_BESIDE_PX = 1.0  # of it, at least: the end itself is blurred
MIN_UNLIKE = 0.08  # of the shares of the colours on both sides of an end that shows
MAX_UNLIKE = 0.4  # of the cloth before its end from the bed, of what is beyond from the bed


def cloth_ends(picture: Image, camera: Camera, rail: int, width: float) -> bool:
    """Whether the cloth ends so far out of a nose.

    Args:
        picture: (height, width, 3).
        camera: the camera.
        rail: the side.
        width: from the nose to the end [m].
    """
    pixel = float(camera.eye[2]) / camera.matrix[0, 0]
    least, most = (max(away, k * MIN_BESIDE_PX * pixel) for away, k in zip(BESIDE_M, (1, 3), strict=True))
    places = [BED_M, (width - most, width - least), (width + least, width + most)]
    strips = [strip(picture, camera, rail, low, high) for low, high in places]
    bed, before, beyond = (_shares(one.colours) if one is not None else None for one in strips)
    if bed is None or before is None or beyond is None:
        return False
    unlike, rest = float(np.linalg.norm(beyond - bed)), float(np.linalg.norm(before - bed))
    return unlike > MIN_UNLIKE and rest < MAX_UNLIKE * unlike


def _shares(colours: Array) -> Array:
    """Shares of blue, green and red in the median light of a strip (n, m, 3): (3,)."""
    light = np.median(colours.reshape(-1, 3), axis=0)
    return np.asarray(light / max(float(light.sum()), 1e-9))
