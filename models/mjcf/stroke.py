"""The strokes of the launcher in figures (launcher.md): how the cue lies, speeds up and brakes."""

from __future__ import annotations

import math

CUE_TILT = math.radians(6.5)  # inclination of the cue (Robotic Billiards 2015) [rad]
RUN_UP_M = 0.16  # over which a fast cue accelerates; some 70 mm at constant speed follow
MIN_ACCELERATION = 5.0  # of a slow cue [m/s^2]
BRAKING_DECELERATION = 45.0  # after the hit [m/s^2]
