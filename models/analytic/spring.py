"""The springs that represent contacts in small steps: the force between two bodies at a depth.

Two balls load the spring of Hertz, K d^1.5, a cushion a linear and softer one. Both unload so much more stiffly that
the part e^2 of the work done on them comes back (Walton, Braun 1986; Stronge, Impact Mechanics, 2000), whatever else
acts meanwhile and however fast: restitution is energetic, as in the impulse models. What meets too slowly to come back
at all meets a damper. Stepped semi-implicitly, in clusters of the event engine (engine/cluster.py) and in MuJoCo's
contacts (mujoco/contact.py) alike.
"""

from __future__ import annotations

import numpy as np

from models.compiled import compiled, compiled_in_place
from models.shot import NOSE_SINE

SPRING_STEP_S = 4e-6  # time step of springs [s]
BALL_TIME = 1e-4  # two balls' contact at 1 m/s [s]; real ones' 0.2 to 0.3 ms, in which the line of centres turns
CUSHION_TIME = 4e-4  # contact with a cushion [s]; some 8 ms for real ones
HERTZ_STIFFNESS = (3.2180 / BALL_TIME) ** 2.5  # acceleration of the gap is HERTZ_STIFFNESS d^1.5 [m^-0.5 s^-2]
MIN_GIVEN_BACK = 0.1  # restitution: the steps resolve no spring that unloads more stiffly
DEAD_DAMPING = 4.0  # damping over the critical one of a cushion without restitution
MAX_CLUSTER_S = 2e-2  # duration of a cluster after which its rest is left to the next one [s]
CONTACT_GAP_M = 1e-9  # gap below which bodies touch [m]
CALM_TIME_S = 2 * CUSHION_TIME  # time without a relative speed at contacts after which a cluster ends [s]
NOSE_RADIUS = 0.002  # radius of the capsule that represents the nose [m]
SLIP_PARTS = 8  # parts of a step over which a slip may turn


@compiled_in_place
def pushed(cushion: bool, pressed: float, deepest: float, gives_back: float, approach: float) -> float:
    """Acceleration that separates two bodies, per unit of their effective mass [m/s^2].

    Pressed so deep now and at most [m], with a restitution, approaching at a speed [m/s].
    """
    if pressed <= CONTACT_GAP_M:  # a touch is landed on to rounding: nothing acts on either side of it
        return 0.0
    if gives_back > 0.0:
        e = max(gives_back, MIN_GIVEN_BACK)
        depth = max(deepest - (deepest - pressed) / (e * e), 0.0)
        return depth * (np.pi / CUSHION_TIME) ** 2 if cushion else HERTZ_STIFFNESS * np.sqrt(depth) * depth
    if cushion:
        rate = np.pi / CUSHION_TIME
        return max(rate * rate * pressed + 2.0 * DEAD_DAMPING * rate * approach, 0.0)
    rate = np.sqrt(HERTZ_STIFFNESS) * pressed**0.25
    return max(rate * rate * pressed + DEAD_DAMPING * rate * approach, 0.0)


@compiled
def depth_of(cushion: bool, gap: float, r: float, sine: float = NOSE_SINE) -> tuple[float, float]:
    """Depth along the normal, and the normal's horizontal part; a cushion's from the middle of its capsule."""
    if not cushion:
        return -gap, 1.0
    contact_radius = r + NOSE_RADIUS
    across = contact_radius * np.sqrt(1.0 - sine * sine) + gap
    apart = np.sqrt(across * across + (contact_radius * sine) ** 2)
    return contact_radius - apart, across / apart
