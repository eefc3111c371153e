"""Factors of terms: what a term of a formula (models/formula.py) is of place, motion, time or impact."""

from __future__ import annotations

import math
from typing import NamedTuple

from models.compiled import compiled

# Factors, of constants a, b, c, d; "v" is the variable of code a (models/variables.py).
(
    ONE,
    BOX,  # 1 where |x - a| <= b and |y - c| <= d [m]
    COS,  # cos(a heading)
    SIN,  # sin(a heading)
    VARIABLE,  # (v - b)^c
    ABOVE,  # 1 where v > b, or with c = -1 where v < b
    EQUAL,  # 1 where v = b
    DECAY,  # exp(-v / b)
    HAT,  # 1 where v = b, falling to 0 at b - c and b + c; with d = 1 it stays 1 below b, with -1 above
    TWIST,  # |omega_z| [rad/s]
    SPIN_COS,  # omega_z cos(heading) [rad/s]
    SPIN_SIN,  # omega_z sin(heading) [rad/s]
    POWER,  # x^a y^b (x^2 + y^2)^c
    ALONG_RAIL,  # power a of the distance from the middle of a rail [m]
    WITH,  # 1 where ball a takes part
    BEND,  # how far v is above b, or with c = -1 below it; 0 on the other side
) = range(16)


class TermRow(NamedTuple):
    """A term as compiled code reads it."""

    coefficient: float
    door: float  # quantity that it changes; 0 behind the last term
    factor: float
    a: float
    b: float
    c: float
    d: float
    within: float  # variable of the condition under which the term acts; NONE without one
    which: float  # value of that variable
    side: float  # 0: at that value alone; 1: above it; -1: below it
    times: float  # code of the variable with which the factor is multiplied; NONE for 1


class FactorArguments(NamedTuple):
    """What a factor depends on: a ball, an impact of ball `first` with ball or rail `second`, or an image."""

    v: float  # the factor's variable
    x: float  # [m]
    y: float
    vx: float  # [m/s]
    vy: float
    wz: float  # [rad/s]
    first: float
    second: float


@compiled
def factor_value(term: TermRow, at: FactorArguments) -> float:
    """The factor of a term."""
    _, _, factor, a, b, c, d, _, _, _, _ = term
    v, x, y, vx, vy, wz, first, second = at
    if factor == BOX:
        return 1.0 if abs(x - a) <= b and abs(y - c) <= d else 0.0
    if factor == COS:
        return math.cos(a * math.atan2(vy, vx))
    if factor == SIN:
        return math.sin(a * math.atan2(vy, vx))
    if factor == VARIABLE:
        return (v - b) ** int(c)
    if factor == ABOVE:
        return 1.0 if (v < b if c < 0.0 else v > b) else 0.0
    if factor == EQUAL:
        return 1.0 if v == b else 0.0
    if factor == DECAY:
        return math.exp(-v / b)
    if factor == HAT:
        away = (v - b) / c
        return min(max(1.0 - (abs(away) if d == 0.0 else d * away), 0.0), 1.0)
    if factor == TWIST:
        return abs(wz)
    if factor == SPIN_COS:
        return wz * math.cos(math.atan2(vy, vx))
    if factor == SPIN_SIN:
        return wz * math.sin(math.atan2(vy, vx))
    if factor == POWER:
        return x ** int(a) * y ** int(b) * (x * x + y * y) ** int(c)
    if factor == ALONG_RAIL:
        return (abs(y) if second < 2.0 else abs(x)) ** int(a)
    if factor == WITH:
        return 1.0 if first == a or second == a else 0.0
    if factor == BEND:
        return max(c * (v - b), 0.0)
    return 1.0
