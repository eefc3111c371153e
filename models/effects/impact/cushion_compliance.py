"""Cushions whose rubber gives way along their face as well, and springs back.

A ball that grips the nose winds it up sideways, and part of its sidespin comes back turned round, or as speed along the
rail; the base's nose only rubs. The compliance is the stiffness along the normal over that along the face. Source:
Stronge, Impact Mechanics, 2000: (2 - nu) / (2 - 2 nu) for a half-space of Poisson's ratio nu, 1.2 for a metal, 1.5 for
rubber; Cross 2002, Am. J. Phys. 70, 1093: balls that grip leave with more spin than rubbing gives. Leaves out losses
along the face; where more bodies touch at once the nose is rigid.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, ImpactState, param


@dataclass(frozen=True)
class CushionCompliance(Effect):
    """Compliance of the cushions along their face."""

    ratio: float = param(
        1.5, off=0.0, unit="1", bounds=(0.0, 20.0), source="Stronge 2000: 1.5 for rubber; a strip shears more easily"
    )

    def impact(self, hit: ImpactState) -> None:
        """The nose gives way along its face."""
        if hit.cushion:
            hit.compliance += self.ratio
