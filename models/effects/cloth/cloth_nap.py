"""The cloth's nap pushes a ball along the table: an acceleration towards the top cushion, from baulk.

Force M push along +x, through the centre: a sliding ball gets the whole of it, a rolling one 5/7, as the cloth turns
it along. A resting ball stays until the push exceeds the rolling friction. Source: estimate, kappa of 0.5 to 3 mm/s^2;
the nap runs from baulk to the top cushion. Leaves out that side drifts with the nap, and any part of it across the
table. A slope along x is confounded with it: only a level separates them.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import BallState, Effect, param


@dataclass(frozen=True)
class ClothNap(Effect):
    """Push of the nap; positive towards +x."""

    push: float = param(
        0.02, off=0.0, unit="m/s^2", bounds=(-0.1, 0.1), source="estimate: a few percent of mu_r g and up to half of it"
    )

    def forces(self, ball: BallState) -> None:
        """The push on a ball that lies on the cloth."""
        if ball.weight > 0.0:
            ball.ax += self.push
