"""A whole shot: balls on a table, moved in small steps from impact to impact.

Shares no code with the models it tests. Table frame: origin at the centre, x along the length, z up; omega_z > 0 is
counter-clockwise from above. Left out: pocket jaws (a ball that meets a rail within a pocket's mouth is gone).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tests.truth.cloth import (
    AIR,
    BALL,
    CUSHION,
    GRAVITY,
    NOTHING,
    POTTED,
    REST,
    ROLL,
    SLIDE,
    STRUCK,
    THETA,
    VX,
    VY,
    WIDTH,
    WX,
    WY,
    WZ,
    Array,
    Constants,
    advance,
    sliding_friction,
)
from tests.truth.impact import BALLS, INCREMENTS, NOSE, NOSE_SINE, impact, springs

RAILS = ("+x", "-x", "+y", "-y")
STEP = 5e-5  # [s]
MOST_GRIP = 0.43  # above a cushion friction of 0.436 a ball would climb the nose [1]
CLINGS = "red"  # the ball whose impacts may have more friction


@dataclass(frozen=True)
class Table:
    """A playing surface, nose to nose; mouths are measured along the rails, in ball diameters."""

    length: float = 3.569  # along x [m]
    width: float = 1.778  # along y [m]
    pockets: bool = True
    corner_mouth: float = 64.0 / 52.5  # from the corner: a 90 mm opening at 45 degrees, over sqrt 2
    middle_mouth: float = 55.0 / 52.5  # to each side of the middle (Robotic Billiards, 2015)

    def reach(self, radius: float, nose: float = 0.0) -> Array:
        """Largest |x|, |y| of a ball's centre: touching, it is R cos(theta) from the nose line: (2,) [m].

        Noses are higher than 7R/5 by nose [R].
        """
        return np.array([self.length / 2, self.width / 2]) - radius * np.sqrt(1.0 - (NOSE_SINE + nose) ** 2)

    def rubber(self, xy: Array, axis: int, radius: float) -> float:
        """Share of a whole strip behind the rail across axis (0: x, 1: y) at xy [m]: it ends at a mouth."""
        along, diameter = abs(float(xy[1 - axis])), 2 * radius
        half = (self.width if axis == 0 else self.length) / 2
        ends = [half - self.corner_mouth * diameter - along] + [along - self.middle_mouth * diameter] * (axis == 1)
        return float(np.clip(min(ends) / diameter, 0.0, 1.0)) if self.pockets else 1.0

    def in_mouth(self, xy: Array, axis: int, radius: float) -> bool:
        """Whether a ball that meets the rail across axis (0: x, 1: y) at xy [m] finds a pocket there."""
        along = abs(float(xy[1 - axis]))
        half = (self.width if axis == 0 else self.length) / 2
        corner = half - along < self.corner_mouth * 2 * radius
        return self.pockets and (corner or (axis == 1 and along < self.middle_mouth * 2 * radius))


@dataclass(frozen=True)
class Cue:
    """A stroke: the ball's speed, the aim, the contact point and the cue's elevation."""

    speed: float  # of the ball [m/s]
    azimuth: float  # [rad]
    side: float = 0.0  # positive to the right as the player sees it, giving omega_z > 0 [m]
    height: float = 0.0  # above the centre [m]
    elevation: float = 0.0  # [rad]


@dataclass(frozen=True)
class Start:
    """One ball at t = 0."""

    xy: tuple[float, float]  # [m]
    velocity: tuple[float, float] = (0.0, 0.0)  # [m/s]
    omega: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [rad/s]


@dataclass(frozen=True)
class Event:
    """An impact or a pot."""

    time: float  # [s]
    kind: str  # "ball", "cushion", "pocket"
    balls: tuple[str, ...]
    rail: str = ""


@dataclass(frozen=True)
class Motion:
    """What every ball did; a potted ball is NaN from then on."""

    names: tuple[str, ...]
    times: Array  # (n,) [s]
    xy: Array  # (n, nball, 2) [m]
    velocity: Array  # (n, nball, 2) [m/s]
    omega: Array  # (n, nball, 3) [rad/s]
    theta: Array  # (n, nball) [rad], turned about the vertical
    resting: Array  # (n,) 1 where nothing moves or turns any more
    events: tuple[Event, ...]


def leaves(cue: Cue, squirt: float) -> float:
    """Where the struck ball goes: the aim turned by squirt [rad/m] per contact point to the right [rad]."""
    return cue.azimuth + squirt * cue.side


def strike(xy: tuple[float, float], cue: Cue, radius: float, squirt: float = 0.0) -> Start:
    """The struck ball: v = V0 f, omega = omega_S (cos(el) z^ + sin(el) f) + omega_T z^ x f.

    omega_S, omega_T = 5 (side, height) V0 / (2 R^2): an impulse M V0 along f, gripping at that lever. f is where the
    ball leaves to, which squirt [rad/m] turns from the aim.
    Source: Robotic Billiards (2015), equations 1a and 1b; the tilted axis from the impulse along an elevated cue.
    """
    azimuth = leaves(cue, squirt)
    f = np.array([np.cos(azimuth), np.sin(azimuth)])
    side, top = 2.5 * cue.speed / radius**2 * np.array([cue.side, cue.height])
    flat = side * np.sin(cue.elevation) * f + top * np.array([-f[1], f[0]])
    vx, vy = cue.speed * f
    return Start(xy, (float(vx), float(vy)), (float(flat[0]), float(flat[1]), float(side * np.cos(cue.elevation))))


def cushion_restitution(speed: float, c: Constants, rail: int = -1, along: float = 0.0) -> float:
    """Energetic restitution at an approach speed [m/s]: e = ec - ec_v (v_n - 1), held within 0 and 1.

    A dead rail has less, and so has every rail towards its ends: along goes from -1 at one end to 1 at the other.
    """
    own = (c.ec_px, c.ec_mx, c.ec_py, c.ec_my)[rail] if rail >= 0 else 0.0
    e = c.ec + own - c.ec_v * (speed - 1.0) - c.ends * along**2
    return float(np.clip(e, 0.0, 1.0))


def cushion_friction(speed: float, c: Constants, rail: int = -1) -> float:
    """Friction at an approach speed [m/s]: muc - muc_v (v_n - 1), at least 0 and never so high that balls climb.

    Every rail may have more or less of its own.
    """
    own = (c.muc_px, c.muc_mx, c.muc_py, c.muc_my)[rail] if rail >= 0 else 0.0
    return float(np.clip(c.muc + own - c.muc_v * (speed - 1.0), 0.0, max(c.muc, MOST_GRIP)))


def ball_restitution(speed: float, c: Constants) -> float:
    """Energetic restitution at an approach speed [m/s]: ebb - ebb_v (v_n - 1), held within 0 and 1."""
    return float(np.clip(c.ebb - c.ebb_v * (speed - 1.0), 0.0, 1.0))


def ball_friction(q: Array, c: Constants) -> float:
    """Friction of two balls (2, 5) that are about to meet along the first axis: mubb + mubb_b exp(-mubb_c slip).

    It is that of the slip with which the impact begins, as Alciatore (technical proof A.14) takes it, all the way.
    """
    across = q[0, 1] - q[1, 1] + c.radius * (q[0, 4] + q[1, 4])
    slip = np.hypot(across, c.radius * (q[0, 3] + q[1, 3]))
    return max(float(c.mubb + c.mubb_b * np.exp(-c.mubb_c * slip)), 0.0)


def _turned(rows: Array, x: float, y: float) -> Array:
    """(k, 5) rows (vx, vy, wx, wy, wz) in the frame whose first axis is the table's direction (x, y)."""
    turn = np.array([[x, y], [-y, x]])
    return np.column_stack([rows[:, :2] @ turn.T, rows[:, 2:4] @ turn.T, rows[:, 4]])


def _masses(state: Array, c: Constants) -> Array:
    """Mass of each ball: (n,) [kg]."""
    return np.where(state[:, STRUCK] > 0.0, c.mass * c.cue_mass, c.mass)


def friction_within(s: Array, lost: Array, c: Constants) -> float:
    """Sliding friction under a ball that an impact presses, when that has taken the velocity lost (2,) from it [1]."""
    if c.follow == 0.0:
        return c.mus
    ux, uy = s[VX] - lost[0] - c.radius * s[WY], s[VY] - lost[1] + c.radius * s[WX]
    own = sliding_friction(s, ux, uy, c) * np.hypot(ux, uy)
    return c.mus + c.follow * (own - c.mus)


def _collide(state: Array, i: int, j: int, grip: float, c: Constants, n: int) -> None:
    """Resolve the impact of balls i and j in place, with grip times their friction."""
    line = state[j, :2] - state[i, :2]
    x, y = line / np.hypot(*line)
    q = _turned(state[[i, j], VX : WZ + 1], x, y)
    approach, mass = float(q[0, 0] - q[1, 0]), _masses(state[[i, j]], c)
    e = ball_restitution(approach, c)
    first = q[0, 3] + q[1, 3] < 0.0  # friction presses it, and else the second
    lost = approach * mass[1] / mass.sum() if first else -approach * mass[0] / mass.sum()
    mus = friction_within(state[i if first else j], lost * np.array([x, y]), c)
    q = impact(BALLS, q, e, (grip * ball_friction(q, c), 0.0, 0.0), mus, mass, c.radius, n)
    state[[i, j], VX : WZ + 1] = _turned(q, x, -y)


def _rebound(state: Array, i: int, rail: int, table: Table, c: Constants, n: int) -> None:
    """Resolve the impact of ball i on a rail in place."""
    x, y = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))[rail]
    q = np.zeros((2, 5))
    q[:1] = _turned(state[[i], VX : WZ + 1], x, y)
    speed = float(q[0, 0])
    along = float(state[i, 1 - rail // 2]) / ((table.width if rail < 2 else table.length) / 2)
    e, mu = cushion_restitution(speed, c, rail, along), (cushion_friction(speed, c, rail), 0.0, 0.0)
    sine = NOSE_SINE + c.nose + (c.nose_px, c.nose_mx, c.nose_py, c.nose_my)[rail]
    mass, mus = _masses(state[[i, i]], c), friction_within(state[i], speed * np.array([x, y]), c)
    if c.compliance > 0.0:
        q = springs(q, e, mu[0], mus, float(mass[0]), c.radius, n, sine, c.compliance, c.bed)
    else:
        q = impact(NOSE, q, e, mu, mus, mass, c.radius, n, sine, c.bed)
    state[[i], VX : WZ + 1] = _turned(q[:1], x, -y)
    # A ball that leaves later has its way back from where it would have been, slowed by the cloth.
    away, slowing = max(-float(q[0, 0]), 0.0), c.mus * GRAVITY
    stays = min(c.contact, 0.4 * away / slowing)
    deep = (away - 0.5 * slowing * stays) * stays * table.rubber(state[i, :2], rail // 2, c.radius)
    state[i, :2] += deep * np.array([x, y])


def simulate(
    table: Table,
    c: Constants,
    balls: Mapping[str, Start],
    times: Array,
    step: float = STEP,
    increments: int = INCREMENTS,
) -> Motion:
    """Play a shot and report it at times [s] (increasing, from 0); steps of at most step [s] between them.

    The first ball is the struck one, for the effects that are about it.
    """
    c = Constants(*map(float, c))  # an int among them would compile everything again
    names = tuple(balls)
    state = np.zeros((len(names), WIDTH))
    for row, ball in zip(state, balls.values(), strict=True):
        row[:THETA] = (*ball.xy, *ball.velocity, *ball.omega)
    state[0, STRUCK] = 1.0
    state[0, AIR] = c.hop * np.hypot(*state[0, VX:WX])
    mode = np.where(np.any(state[:, VX:WZ] != 0.0, axis=1), SLIDE, REST).astype(np.int64)
    reach = table.reach(c.radius, c.nose)
    seen = np.full((len(times), len(names), WIDTH), np.nan)
    resting = np.zeros(len(times))
    events: list[Event] = []
    now = 0.0
    for k, due in enumerate(times):
        while now < due:
            used, kind, i, j = advance(state, mode, c, reach, due - now, step)
            now = due if kind == NOTHING else now + used
            if kind == CUSHION and table.in_mouth(state[i, :2], j // 2, c.radius):
                mode[i] = POTTED
                state[i, VX:THETA] = 0.0
                events.append(Event(now, "pocket", (names[i],), RAILS[j]))
            elif kind == CUSHION:
                _rebound(state, i, j, table, c, increments)
                mode[i] = SLIDE
                events.append(Event(now, "cushion", (names[i],), RAILS[j]))
            elif kind == BALL:
                grip = 1.0 + c.cling if CLINGS in (names[i], names[j]) else 1.0
                _collide(state, i, j, grip, c, increments)
                mode[[i, j]] = SLIDE
                events.append(Event(now, "ball", (names[i], names[j])))
        on = mode != POTTED
        seen[k, on] = state[on]
        resting[k] = not np.any((mode == SLIDE) | (mode == ROLL) | (state[:, WZ] != 0.0))
    return Motion(
        names, times, seen[..., :VX], seen[..., VX:WX], seen[..., WX:THETA], seen[..., THETA], resting, tuple(events)
    )
