"""A struck ball that is heavier or lighter than the others.

Its mass is `factor` times theirs, and so is its inertia 2/5 m R^2. On the cloth and at a cushion the mass cancels; a
ball that it meets moves off with more, and it follows further: head-on, (m - e) / (m + 1) of its speed is left to it.
Source: Newton; the rules want a set within 3 g. Leaves out that a ball of another mass may have another radius.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import STRUCK_BALL, Effect, ImpactState, param


@dataclass(frozen=True)
class CueBallMass(Effect):
    """Mass of the struck ball over that of the others."""

    factor: float = param(1.02, off=1.0, unit="1", bounds=(0.8, 1.25), source="rules of snooker: a set within 3 g, 2 %")

    def impact(self, hit: ImpactState) -> None:
        """Wherever it meets something; the second body is a ball only where two balls meet."""
        if hit.first == STRUCK_BALL:
            hit.mass_first *= self.factor
        if not hit.cushion and hit.second == STRUCK_BALL:
            hit.mass_second *= self.factor
