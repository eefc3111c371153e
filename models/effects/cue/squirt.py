"""Squirt: a ball struck off centre leaves to the side away from the tip.

Direction = aim + per_offset b, b the side offset commanded, positive to the right as the player sees it: the right side
sends the ball to the left. b = 2 R^2 omega_S / (5 v), where an elevated cue has tilted omega_S = (omega_z, omega_aim).
The spin's horizontal part turns along. Source: Alciatore TP A.31, Cross 2008: tan = 5/2 (b / R) / (1 + M/m_e + 5/2),
with no dependence on speed. In a fit the initial state of a shot is then what was commanded, and only clips with a cue
identify it. Leaves out the spin that squirt costs, the curvature at large offsets, and strikes beyond the miscue limit,
which count as at the limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import STILL, Effect, StrokeState, param

MISCUE_OFFSET = 0.5  # largest offset over radius (Robotic Billiards 2015)
LEVEL_OFFSET = 0.03  # offset over radius below which spin about the aim says nothing of the cue's elevation


@dataclass(frozen=True)
class Squirt(Effect):
    """Angle between the aim and the ball's direction, per side offset."""

    per_offset: float = param(
        3.0, off=0.0, unit="rad/m", bounds=(-20.0, 20.0), source="Alciatore TP A.31: 2.5 / (R (3.5 + M/m_e)), 12 to 50"
    )

    def strike(self, cue: StrokeState) -> None:
        """Velocity and horizontal spin, turned."""
        speed = math.sqrt(cue.vx * cue.vx + cue.vy * cue.vy)
        if speed <= STILL:
            return
        lever = 0.4 * cue.radius * cue.radius / speed
        up, aim = lever * cue.wz, lever * (cue.wx * cue.vx + cue.wy * cue.vy) / speed
        level = LEVEL_OFFSET * cue.radius
        offset = up * math.sqrt(1.0 + aim * aim / (up * up + level * level))
        limit = MISCUE_OFFSET * cue.radius
        angle = self.per_offset * min(max(offset, -limit), limit)
        c, s = math.cos(angle), math.sin(angle)
        cue.vx, cue.vy = c * cue.vx - s * cue.vy, s * cue.vx + c * cue.vy
        cue.wx, cue.wy = c * cue.wx - s * cue.wy, s * cue.wx + c * cue.wy
