"""Cushions that a ball sinks into: it leaves them some milliseconds after it has met them.

The base's impact takes no time. A strip of rubber is a soft spring, whose half period is the time of contact, whatever
the speed: a ball comes out of it that much later, and so lags behind by its way of that time across the rail. Along the
rail it goes with the speed that it leaves with. Measured on 222 cushion contacts above 1 m/s of a three-cushion match
(erdo100/3cushiontool, 2.84 m table): 5 to 6 ms between the way in and the way out, 5.35 ms of the way out along the
rail, none of the way in. While it stays, the ball is as deep in the rail as its way out takes it to come back.
Within a diameter of a mouth, where the rubber ends, the time falls to none. A ball that stops in the rail,
since another one has hit it or the cloth resists more there, is pushed out slowly. Leaves out that the real depth is
less, jaws, and cushions where more bodies touch at once.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, ImpactState, param


@dataclass(frozen=True)
class CushionContactTime(Effect):
    """Time for which a ball stays in a cushion."""

    time: float = param(
        0.005, off=0.0, unit="s", bounds=(0.0, 0.03), source="measured on a carom match: 5 to 6 ms above 1 m/s"
    )

    def impact(self, hit: ImpactState) -> None:
        """The ball leaves later."""
        if hit.cushion:
            hit.contact_time += self.time
