"""What compiled code passes together: a table in the space of ball centres, and the motion of a centre."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class TableGeometry(NamedTuple):
    """Where the centres of balls of one size can be on one table (models/analytic/pocket.py)."""

    radius: float  # of a ball [m]
    limits: Array  # (2,) largest |x|, |y| of a centre [m]
    half: Array  # (2,) of length and width [m]
    mouths: Array  # (3,) ends of straight cushions, from a corner and from a middle, and a corner's capture radius [m]
    jaws: Array  # (m, 5) arcs and facings; no rows without jaws
    falls: Array  # (6, 3) the slate's edges; no rows without jaws


class Parabola(NamedTuple):
    """A centre at a constant acceleration, in the frame of the table or relative to another one."""

    x: float  # [m]
    y: float
    vx: float  # [m/s]
    vy: float
    ax: float  # [m/s^2]
    ay: float
