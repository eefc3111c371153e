"""The ball's motion after a stroke: speed, spin, squirt, and the effects of an elevated cue.

The tip's dome touches at (x_C, y_C) = (x_0, y_0) R / (R + r_t); a = x_C / R, b = y_C / R, c^2 = 1 - a^2 - b^2.
Spin: omega_S = 5 x_C V / (2 R^2), omega_T = 5 y_C V / (2 R^2) (Robotic Billiards 2015, equations 1a and 1b).
Speed: V = (1 + e) V_C / (1 + M / M_C + 5/2 (a^2 + b^2)). Squirt from the end mass m_e that follows the tip sideways:
tan(alpha) = 5/2 a c / (1 + M / m_e + 5/2 c^2), to the side away from the tip; the side spin loses (c / a) tan(alpha)
of itself (Alciatore TP A.31, Cross 2008). Elevation tilts the axis of side spin: omega_S (cos z + sin f), f the aim, so
that the ball swerves to the struck side by atan(a sin / (cos + b)) once it rolls. The ball is driven down at V sin,
hops off the slate with its restitution, and the slate's friction takes up to mu (1 + e) V sin from its slip.
Leaves out a slipping tip (beyond the miscue limit), the shaft's bending, and that the cue slows during contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.shot import GRAVITY, Ball

Array = NDArray[np.float64]
SEED_LIMIT = 0.5  # offset over radius beyond which no shot is played (Robotic Billiards 2015)
SLATE_RESTITUTION = 0.55  # restitution of ball on slate [1], 0.5 to 0.7 (Alciatore)


@dataclass(frozen=True)
class CueStick:
    """A cue held at one elevation."""

    mass: float = 0.50  # [kg], bounds 0.3 to 0.8; 17 to 18 oz, a servo-driven cue acts as more
    end_mass: float = 0.00703  # [kg], bounds 0.002 to 0.03; M / m_e = 20, pool cues 12 to 30 (Alciatore TP B.1)
    tip_radius: float = 0.010  # [m], bounds 0.004 to 0.02; Robotic Billiards 2015
    tip_restitution: float = 0.75  # [1], bounds 0.5 to 1; leather 0.71 to 0.75 (Alciatore)
    tip_friction: float = 0.6  # [1], bounds 0.1 to 1; chalked leather (Alciatore)
    elevation: float = math.radians(6.5)  # [rad], bounds 0 to pi/2; Robotic Billiards 2015


@dataclass(frozen=True)
class Stroke:
    """The motion of the ball as it leaves the tip."""

    velocity: Array  # (2,) [m/s], table frame
    spin: Array  # (3,) [rad/s], table frame
    hop_speed: float  # [m/s], upwards, off the slate


def contact_offset(offset: float, ball: Ball, cue: CueStick) -> float:
    """Where the dome touches, for an offset of the cue's axis [m]; either direction."""
    return offset * ball.radius / (ball.radius + cue.tip_radius)


def miscue_limit(friction: float) -> float:
    """Largest contact offset over radius that the tip's friction holds: mu / sqrt(1 + mu^2)."""
    return friction / math.sqrt(1.0 + friction * friction)


def spin_estimate(contact: float, speed: float, ball: Ball) -> float:
    """Spin of a contact offset [m] at a ball speed [m/s], equations (1a) and (1b): [rad/s]."""
    return 2.5 * contact * speed / ball.radius**2


def ball_speed(cue_speed: float, side: float, height: float, ball: Ball, cue: CueStick) -> float:
    """Ball speed for a cue speed [m/s] and offsets of the cue's axis [m]."""
    rho2 = (contact_offset(side, ball, cue) ** 2 + contact_offset(height, ball, cue) ** 2) / ball.radius**2
    return (1.0 + cue.tip_restitution) * cue_speed / (1.0 + ball.mass / cue.mass + 2.5 * rho2)


def squirt(a: float, b: float, mass_ratio: float) -> float:
    """Squirt angle [rad], positive for a > 0 though it points the other way; `mass_ratio` is ball over end mass."""
    c = math.sqrt(max(1.0 - a * a - b * b, 0.0))
    return math.atan(2.5 * a * c / (1.0 + mass_ratio + 2.5 * c * c))


def spin_kept(a: float, b: float, mass_ratio: float) -> float:
    """Part of the side spin that squirt leaves [1]."""
    c2 = max(1.0 - a * a - b * b, 0.0)
    return 1.0 - 2.5 * c2 / (1.0 + mass_ratio + 2.5 * c2)


def swerve(a: float, b: float, elevation: float) -> float:
    """Angle between aim and final roll [rad], to the struck side; without squirt."""
    return math.atan(a * math.sin(elevation) / (math.cos(elevation) + b))


def hop(hop_speed: float) -> tuple[float, float]:
    """Height [m] and duration [s] of a hop; its length is the duration times the speed."""
    return hop_speed**2 / (2.0 * GRAVITY), 2.0 * hop_speed / GRAVITY


def slate_loss(speed: float, elevation: float, friction: float, slate: float = SLATE_RESTITUTION) -> float:
    """Most speed that the slate's friction takes as the ball is driven onto it [m/s]."""
    return friction * (1.0 + slate) * speed * math.sin(elevation)


def strike(
    cue: CueStick, ball: Ball, cue_speed: float, azimuth: float, side: float = 0.0, height: float = 0.0,
    elevation: float | None = None, *, slate: float = SLATE_RESTITUTION, slate_friction: float = 0.0,
) -> Stroke:  # fmt: skip
    """Play a stroke.

    Args:
        cue: the cue.
        ball: the ball.
        cue_speed: [m/s].
        azimuth: horizontal aim [rad], counter-clockwise from +x.
        side: offset of the cue's axis to the right, seen from behind [m].
        height: offset upwards, at a right angle to the cue [m].
        elevation: [rad]; the cue's own where not given.
        slate: restitution of the slate [1].
        slate_friction: friction of ball on cloth during the drive onto the slate [1]; 0 leaves it out.

    Raises:
        ValueError: where the contact lies beyond the miscue limit.
    """
    el = cue.elevation if elevation is None else elevation
    a, b = contact_offset(side, ball, cue) / ball.radius, contact_offset(height, ball, cue) / ball.radius
    most = miscue_limit(cue.tip_friction)
    if math.hypot(a, b) > most:
        raise ValueError(f"offset {math.hypot(a, b):.3f} R is beyond the miscue limit {most:.3f} R; strike nearer")
    speed = ball_speed(cue_speed, side, height, ball, cue)
    ratio = ball.mass / cue.end_mass
    aim = azimuth + squirt(a, b, ratio)  # the right side sends the ball to the left
    along, left = np.array([math.cos(azimuth), math.sin(azimuth)]), np.array([-math.sin(azimuth), math.cos(azimuth)])
    velocity = speed * math.cos(el) * np.array([math.cos(aim), math.sin(aim)])
    w_side = spin_estimate(a * ball.radius, speed, ball) * spin_kept(a, b, ratio)
    w_top = spin_estimate(b * ball.radius, speed, ball)
    spin = np.append(w_top * left + w_side * math.sin(el) * along, w_side * math.cos(el))
    if slate_friction > 0.0:
        rub = velocity + ball.radius * np.array([-spin[1], spin[0]])
        size = float(np.linalg.norm(rub))
        if size > 0.0:
            push = -min(slate_loss(speed, el, slate_friction, slate), 2.0 / 7.0 * size) * rub / size
            velocity = velocity + push
            spin = spin + 2.5 / ball.radius * np.array([push[1], -push[0], 0.0])
    return Stroke(velocity, spin, slate * speed * math.sin(el))
