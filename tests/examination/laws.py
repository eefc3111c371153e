"""Laws out of laws, for families of hidden causes."""

from __future__ import annotations

import math

from tests.examination.motion import Law, Seen


def times(law: Law, factor: Law) -> Law:
    """The product of two laws."""
    return lambda seen: law(seen) * factor(seen)


def plus(law: Law, more: Law) -> Law:
    """The sum of two laws."""
    return lambda seen: law(seen) + more(seen)


def heading(seen: Seen) -> float:
    """Direction of a ball's way [rad]."""
    return math.atan2(seen.ball[3], seen.ball[2])
