"""The cue, and closed forms of a stroke: the miscue limit, the spin of a contact offset, and squirt.

a and b are the offsets of the contact to the side and upwards over the ball's radius, c^2 = 1 - a^2 - b^2.
Spin: omega_S = 5 x_C V / (2 R^2), omega_T = 5 y_C V / (2 R^2) (Robotic Billiards 2015, equations 1a and 1b).
Squirt from the end mass m_e that follows the tip sideways: tan(alpha) = 5/2 a c / (1 + M / m_e + 5/2 c^2), to the side
away from the tip (Alciatore TP A.31, Cross 2008).
Leaves out a slipping tip (beyond the miscue limit), the shaft's bending, and that the cue slows during contact. A whole
stroke, with an elevated cue and the slate, is in models/analytic/cue_impulse.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.shot import Ball

SEED_LIMIT = 0.5  # offset over radius beyond which no shot is played (Robotic Billiards 2015)


@dataclass(frozen=True)
class CueStick:
    """A cue held at one elevation."""

    mass: float = 0.50  # [kg], bounds 0.3 to 0.8; 17 to 18 oz, a servo-driven cue acts as more
    end_mass: float = 0.00703  # [kg], bounds 0.002 to 0.03; M / m_e = 20, pool cues 12 to 30 (Alciatore TP B.1)
    tip_radius: float = 0.010  # [m], bounds 0.004 to 0.02; Robotic Billiards 2015
    tip_restitution: float = 0.75  # [1], bounds 0.5 to 1; leather 0.71 to 0.75 (Alciatore)
    elevation: float = math.radians(6.5)  # [rad], bounds 0 to pi/2; Robotic Billiards 2015


def miscue_limit(friction: float) -> float:
    """Largest contact offset over radius that the tip's friction holds: mu / sqrt(1 + mu^2)."""
    return friction / math.sqrt(1.0 + friction * friction)


def spin_estimate(contact: float, speed: float, ball: Ball) -> float:
    """Spin of a contact offset [m] at a ball speed [m/s], equations (1a) and (1b): [rad/s]."""
    return 2.5 * contact * speed / ball.radius**2


def squirt(a: float, b: float, mass_ratio: float) -> float:
    """Squirt angle [rad], positive for a > 0 though it points the other way; `mass_ratio` is ball over end mass."""
    c = math.sqrt(max(1.0 - a * a - b * b, 0.0))
    return math.atan(2.5 * a * c / (1.0 + mass_ratio + 2.5 * c * c))
