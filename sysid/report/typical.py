"""Values that a model's constants have on other tables, each with its source.

In: nothing. Out: `TYPICAL_RANGES`, by the constant's name. Sources: Mathavan, Jackson, Parkin 2009, 2010 and 2014 and
Robotic Billiards (2015) on snooker tables; Alciatore's collection for pool; rules and fitters where there is a
tolerance. What nobody measured is not listed. Ranges are what was published, not what is desirable.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from models.shot import GRAVITY


@dataclass(frozen=True)
class TypicalRange:
    """Where a constant usually lies, and the words for one that lies elsewhere."""

    what: str  # the constant in plain words
    low: float  # in the constant's own unit
    high: float
    source: str
    within: str  # verdicts
    below: str
    above: str
    shown_unit: str = ""
    shown_scale: float = 1.0  # from the constant's own unit to the one that is shown


SNOOKER_CLOTH: Final = "Mathavan 2009: 0.0127 g on a snooker table; Alciatore: 0.005 to 0.015 g on pool tables"
FAST_CLOTH_ROLL = 0.010  # rolling friction: the middle of Alciatore's range, below which a cloth is called fast
FITTERS_SLOPE_RAD = 0.0004  # slope that table fitters aim at
CUE_BALL_TOLERANCE = 0.02  # of the mass: rules of snooker, a set within 3 g
BALL_HEIGHT_STRETCH = 0.0133  # at most, of a camera calibrated on the cloth and 2 m high or more: R / (H - R)

TYPICAL_RANGES: Final[Mapping[str, TypicalRange]] = {
    "decoupled_cloth.roll": TypicalRange(
        "cloth, rolling deceleration", 0.005, 0.015, SNOOKER_CLOTH, "of ordinary speed", "very fast", "slow",
        "m/s^2", GRAVITY,
    ),
    "decoupled_cloth.slide": TypicalRange(
        "cloth, sliding friction", 0.15, 0.40, "Mathavan 2009: 0.178 to 0.245; Alciatore: 0.15 to 0.4 for pool",
        "as usual", "slippery: draw and follow last longer", "grips more than usual: draw and follow die early",
    ),
    "decoupled_cloth.spin": TypicalRange(
        "cloth, deceleration of sidespin", 5.0, 22.0, "Robotic Billiards 2015: 22; Alciatore: 5 to 15 for pool",
        "as usual", "sidespin lasts longer than usual", "sidespin dies faster than usual", "rad/s^2",
    ),
    "ball_impact.restitution": TypicalRange(
        "balls, restitution", 0.89, 0.98, "Mathavan 2014: 0.89; Alciatore: 0.92 to 0.98 for pool",
        "as usual", "balls give back less than usual", "balls give back more than usual",
    ),
    "ball_impact.friction": TypicalRange(
        "balls, friction", 0.01, 0.11, "Mathavan 2014: 0.05; Alciatore A.14: 0.11 at slow to 0.01 at fast slip",
        "as usual", "slippery: less throw than usual", "more throw than usual: clean the balls and film again",
    ),
    "cushion_impact.restitution": TypicalRange(
        "cushions, restitution", 0.85, 0.98, "Mathavan 2010: 0.98, which falls to some 0.85 at 3.4 m/s",
        "as usual", "cushions give back less than usual", "cushions give back more than usual",
    ),
    "cushion_impact.friction": TypicalRange(
        "cushions, friction", 0.10, 0.30, "Mathavan 2010: 0.14; 0.1 to 0.3 between tables",
        "as usual", "slippery: side takes less than usual", "side takes more than usual",
    ),
    "cushion_restitution_speed.rate": TypicalRange(
        "cushions, fall of restitution with speed", 0.0, 0.10, "Mathavan 2009, 2010: 0 below, 0.10 above 2.1 m/s",
        "as usual", "gives back more the harder it is hit, which no rubber is known to do: look at the clock and lens",
        "hard shots come back slower than usual", "per m/s",
    ),
    "cue_ball_mass.factor": TypicalRange(
        "cue ball, mass over that of the others", 1 - CUE_BALL_TOLERANCE, 1 + CUE_BALL_TOLERANCE,
        "rules of snooker: a set within 3 g, 2 %", "within the rules", "lighter than the rules allow: weigh it",
        "heavier than the rules allow: weigh it",
    ),
}  # fmt: skip

AT_ONE_METRE_PER_SECOND: Final[Mapping[str, str]] = {  # constants that hold there when this effect acts
    "ball_impact.restitution": "ball_restitution_speed",
    "cushion_impact.restitution": "cushion_restitution_speed",
    "cushion_impact.friction": "cushion_friction_speed",
    "decoupled_cloth.slide": "slide_friction_speed",
}
AT_FAST_SLIP: Final[Mapping[str, str]] = {"ball_impact.friction": "ball_friction_speed"}
AT_LOW_SPEED: Final[Mapping[str, str]] = {
    "decoupled_cloth.roll": "speed_drag",
    "decoupled_cloth.spin": "spin_decay_speed",
}
