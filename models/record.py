"""Columns of the records that hooks see, by number, for the compiled code that fills and reads them.

A ball's record has the fields of `BallState` in their order, an impact's those of `ImpactState` (models/hooks.py).
Compiled code reads them through the module, as constants: `r[rec.VX]`, `hit[rec.FRICTION]`.
"""

from __future__ import annotations

from models.hooks import BallState, ImpactState, fields_of

BALL_FIELDS, IMPACT_FIELDS = len(fields_of(BallState)), len(fields_of(ImpactState))
(
    X, Y, VX, VY, WX, WY, WZ, SLIP_X, SLIP_Y, TIME, LAUNCH, SESSION, *_, ROLLED, NUMBER, RADIUS, MASS, ROLLING, WEIGHT,
    AX, AY, BX, BY, BZ, SLIDE_FACTOR, ROLL_FACTOR, SPIN_FACTOR, DRAG, ACROSS,
) = range(BALL_FIELDS)  # fmt: skip
(
    CUSHION_HIT, APPROACH, SLIP, HIT_X, HIT_Y, HIT_VX, HIT_VY, HIT_WZ, FIRST, SECOND, HIT_SESSION, *_, HIT_TIME,
    RESTITUTION, FRICTION, GAIN, DECAY, MASS_FIRST, MASS_SECOND, NOSE, COMPLIANCE, SINK,
    CONTACT_TIME, CLOTH_SHARE,
) = range(IMPACT_FIELDS)  # fmt: skip
