"""The springs that stand for contacts of several bodies at once: stiffness, damping for a restitution, depth.

Two balls: the spring of Hertz, K d^1.5, with the damper a sqrt(K) d^0.25 (Tsuji, Tanaka, Ishida 1992), whose
restitution knows no speed; a cushion: linear, and softer. Stepped semi-implicitly, by MuJoCo (simulation/contact.py)
and by the event engine (engine/cluster.py) alike.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from models.compiled import compiled, compiled_in_place
from models.shot import NOSE_SINE, Array

SPRING_STEP_S = 4e-6  # [s]
BALL_TIME = 1e-4  # two balls' contact at 1 m/s [s]; real ones' 0.2 to 0.3 ms, in which the line of centres turns
CUSHION_TIME = 4e-4  # [s]; real ones' some 8 ms
HERTZ_STIFFNESS = (3.2180 / BALL_TIME) ** 2.5  # acceleration of the gap is HERTZ_STIFFNESS d^1.5 [m^-0.5 s^-2]
MAX_CLUSTER_S = 2e-2  # of a cluster, after which the rest of it is left to the next [s]
CONTACT_GAP_M = 1e-9  # gap below which bodies touch [m]
CALM_TIME_S = 2 * CUSHION_TIME  # without a speed between what touches, after which nothing more will come of it [s]
NOSE_RADIUS = 0.002  # of the capsule that stands for the nose [m]
SLIP_PARTS = 8  # of a step, over which a slip may turn


@compiled
def spring(cushion: bool, depth: float, damping: float) -> tuple[float, float]:
    """Stiffness over the depth [1/s^2] and damping [1/s] of a contact per unit of its effective mass."""
    if depth <= CONTACT_GAP_M:  # a touch is landed on to rounding: nothing acts on either side of it
        return 0.0, 0.0
    if cushion:
        return (np.pi / CUSHION_TIME) ** 2, 2.0 * damping * np.pi / CUSHION_TIME
    return HERTZ_STIFFNESS * np.sqrt(depth), damping * np.sqrt(HERTZ_STIFFNESS) * depth**0.25


@compiled
def _bounce(cushion: bool, damping: float) -> float:
    """Restitution of a contact at 1 m/s, stepped as MuJoCo steps it."""
    depth, v = 0.0, 1.0
    for _ in range(10_000):
        k, b = spring(cushion, depth, damping)
        v -= SPRING_STEP_S * max(k * depth + b * v, 0.0)
        depth += SPRING_STEP_S * v
        if depth <= 0.0:
            break
    return -v


@compiled
def _bounces(cushion: bool, dampings: Array) -> Array:
    return np.array([_bounce(cushion, d) for d in dampings])


@cache
def damping_table() -> Array:
    """Restitutions, rising, of balls and of cushions, and the damping that gives each: (3, n)."""
    damping = np.linspace(4.0, 0.0, 2001)
    return np.stack([_bounces(False, damping), _bounces(True, damping), damping])


@compiled_in_place
def damping_of(cushion: bool, restitution: float, table: Array) -> float:
    """The damping of one contact for its restitution, by the `damping_table`."""
    row, low, high = 1 if cushion else 0, 0, table.shape[1] - 1
    if restitution <= table[row, low]:
        return float(table[2, low])
    if restitution >= table[row, high]:
        return float(table[2, high])
    while high - low > 1:
        middle = (low + high) // 2
        if table[row, middle] <= restitution:
            low = middle
        else:
            high = middle
    part = (restitution - table[row, low]) / (table[row, high] - table[row, low])
    return float(table[2, low] + part * (table[2, high] - table[2, low]))


def dampings(cushion: bool, restitution: Array) -> Array:
    """The damping of contacts for their restitutions (n,): (n,)."""
    table = damping_table()
    return np.interp(restitution, table[int(cushion)], table[2])


@compiled
def depth_of(cushion: bool, gap: float, r: float, sine: float = NOSE_SINE) -> tuple[float, float]:
    """Depth along the normal, and the normal's horizontal part; a cushion's from the middle of its capsule."""
    if not cushion:
        return -gap, 1.0
    contact_radius = r + NOSE_RADIUS
    across = contact_radius * np.sqrt(1.0 - sine * sine) + gap
    apart = np.sqrt(across * across + (contact_radius * sine) ** 2)
    return contact_radius - apart, across / apart
