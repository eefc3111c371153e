"""Slide, roll and sidespin on cloth, each with a friction of its own.

Sliding: force -mu_s N u/|u|, u the slip of the lowest point. Rolling: deceleration mu_r g of the ball and mu_r g / R
of its spin, so that it keeps rolling; what other effects push is shared by a reaction that keeps the slip at zero,
up to mu_s N. Sidespin: deceleration alpha, whatever the rest does. Source: Robotic Billiards (2015) section IV.B,
constants from Mathavan, Jackson, Parkin 2009; the formulas stand in models/analytic/cloth.py. Other effects may change
the friction by factors (BallState). Leaves out that spin and slide share a finite contact patch (Contensou).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from models.effect import Effect, param

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True)
class DecoupledCloth(Effect):
    """Friction of the cloth, decoupled."""

    slide: float = param(
        0.2, off=0.0, unit="1", bounds=(0.05, 0.6), source="Mathavan 2009: 0.178 to 0.245 on a snooker table",
        published=(0.15, 0.4), published_by="Alciatore, pool: 0.15 to 0.4",
    )  # fmt: skip
    roll: float = param(
        0.0127, off=0.0, unit="1", bounds=(0.001, 0.05), source="Mathavan 2009: 0.0126 to 0.0128",
        published=(0.005, 0.015), published_by="Alciatore, pool: 0.005 to 0.015",
    )  # fmt: skip
    spin: float = param(
        22.0, off=0.0, unit="rad/s^2", bounds=(1.0, 80.0), source="Robotic Billiards (2015), sidespin deceleration",
        published=(5.0, 22.0), published_by="Alciatore, pool: 5 to 15 rad/s^2; Robotic Billiards (2015): 22",
    )  # fmt: skip

    plain: ClassVar[bool] = True
    slot: ClassVar[str] = "cloth"
    last: ClassVar[bool] = True

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Leave MuJoCo the support alone."""
        for pair in spec.pairs:
            if pair.classname.name == "ball_bed":
                pair.condim = 1
