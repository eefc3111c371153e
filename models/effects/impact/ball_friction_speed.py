"""Friction between balls that depends on how fast they slip.

Friction mu + gain exp(-decay s), s the slip with which the impact begins, throughout the impact; mu, the base's, is
what remains of it at fast slip. Source: throw of pool balls (Marlow), fitted by Alciatore (technical proof A.14):
0.01 + 0.108 exp(-1.088 s). Friction there is what throw shows, the mean over an impact, against the slip at its
beginning; what it is while a slip dies away was not measured. Leaves out chalk and dirt (cling), which change it from
one impact to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import Effect, ImpactState, param


@dataclass(frozen=True)
class BallFrictionSpeed(Effect):
    """Friction between balls that fades with their slip."""

    gain: float = param(0.1, off=0.0, unit="1", bounds=(-0.2, 0.4), source="Alciatore TP A.14: 0.108")
    decay: float = param(1.088, off=None, unit="s/m", bounds=(0.2, 5.0), source="Alciatore TP A.14")

    def impact(self, hit: ImpactState) -> None:
        """More for what slips less, where the gain is positive."""
        if not hit.cushion:
            hit.friction += self.gain * math.exp(-self.decay * hit.slip)
