"""Shots of the validation: tables, constants, and states before impacts, golden and random.

In: counts. Out: `Shot`s, and the analytic model with the constants of the snooker table of Mathavan, Jackson and Parkin
(2009, 2010, 2014).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from models.engine.play import play
from models.model_file import full_model
from models.shot import Array, Ball, Session, Shot, Table, Track
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

OPEN_TABLE = Table(60.0, 60.0, pockets=False)  # so wide that no ball touches a cushion
MATHAVAN_TABLE = Table(2.959, 1.473, pockets=False)
FULL_TABLE = dataclasses.replace(SNOOKER_TABLE, pockets=False)
SLIDING_FRICTION, ROLLING_FRICTION, SPIN_DECELERATION = 0.212, 0.0127, 22.0  # [1], [1], [rad/s^2]
MATHAVAN_CONSTANTS = {
    "decoupled_cloth.slide": SLIDING_FRICTION, "decoupled_cloth.roll": ROLLING_FRICTION,
    "decoupled_cloth.spin": SPIN_DECELERATION,
    "ball_impact.restitution": 0.89, "ball_impact.friction": 0.05,
    "cushion_impact.restitution": 0.98, "cushion_impact.friction": 0.14,
}  # fmt: skip
ANALYTIC_MODEL = full_model(MATHAVAN_TABLE, SNOOKER_BALL).with_values(MATHAVAN_CONSTANTS)
LEAD_TIME_S = 1e-4  # time from the start to the touch
MAX_IMPACTS = 4  # of a random shot
RANDOM_SEED = 3


def random_states(count: int, radius: float = SNOOKER_BALL.radius) -> tuple[Array, Array]:
    """Random velocities (n, 2) [m/s] of 0.2 to 3 m/s, and spins (n, 3) [rad/s]."""
    rng = np.random.default_rng(RANDOM_SEED)
    heading, speed = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.2, 3.0, count)
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return velocity, rng.normal(0, 1, (count, 3)) * np.minimum(speed[:, None], 2.0) / radius


GOLDEN_BALL = (  # angle to the line of centres [degrees], R w_roll and R w_z over speed
    (0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (30, 0, 0), (30, 1, 0), (30, -0.5, 0), (30, 0, 0.75), (30, 0, -0.75),
    (30, 1, 0.5), (60, 1, 0),
)  # fmt: skip
GOLDEN_CUSHION = (  # angle to the cushion [degrees], R w_top and R w_side over speed
    (30, 1, 0), (30, 0, 0), (30, 1, 1), (30, 1, -1), (45, 1, 0), (45, 0, 0), (45, 1, 1), (45, 1, -1), (45, 2, 0),
    (60, 1, 0), (60, 0, 0), (60, 1, 1), (90, 1, 0), (90, 1, 1),
)  # fmt: skip


def impact_shot(
    kind: str, speed: float, angle: float, top: float, side: float, after: float, table: Table = MATHAVAN_TABLE,
    ball: Ball = SNOOKER_BALL,
) -> Shot:  # fmt: skip
    """A ball LEAD_TIME_S before an impact, sampled then and a time `after` the touch.

    Args:
        kind: "ball" or "cushion".
        speed: of the ball [m/s].
        angle: to the normal of the contact [rad].
        top: R omega of top spin over speed.
        side: the same of sidespin.
        after: how long after the touch [s].
        table: with the cushion.
        ball: properties of the ball or balls.
    """
    direction = np.array([np.cos(angle), np.sin(angle)])
    spin = np.array([-top * direction[1], top * direction[0], side]) * speed / ball.radius
    start = -LEAD_TIME_S * speed * direction
    times = np.array([0.0, LEAD_TIME_S + after])
    if kind == "cushion":
        start = start + np.array([float(table.centre_limits(ball)[0]), 0.0])
        return Shot(("white",), start[None], speed * direction[None], spin[None], times)
    places = np.array([start - [ball.diameter, 0.0], [0.0, 0.0]])
    return Shot(
        ("white", "red"), places, np.array([speed * direction, [0, 0]]), np.array([spin, np.zeros(3)]), times
    )  # fmt: skip


def impact_states(kind: str, count: int = 500) -> tuple[Array, Array]:
    """Golden rows and random impacts: (n, 4) of speed [m/s], angle to the normal [rad], top and side over speed."""
    rng = np.random.default_rng(RANDOM_SEED)
    golden = np.array(GOLDEN_BALL if kind == "ball" else GOLDEN_CUSHION, float)
    angle = np.radians(golden[:, 0] if kind == "ball" else 90 - golden[:, 0])
    # The golden table has the cushion along x, ahead of the ball; here it is across, so angles change their sign.
    fixed = np.column_stack([np.ones(len(golden)), angle if kind == "ball" else -angle, golden[:, 1:]])
    some = np.column_stack(
        [rng.uniform(0.5, 3, count), np.radians(rng.uniform(-70, 70, count)), rng.uniform(-1.5, 1.5, count),
         rng.normal(0, 1, count)]
    )  # fmt: skip
    return fixed, some


def random_shots(count: int) -> tuple[list[Shot], list[Track]]:
    """Shots of one to three balls with one to four impacts, sampled when the struck ball rests, and tracks."""
    rng = np.random.default_rng(RANDOM_SEED)
    shots: list[Shot] = []
    half = MATHAVAN_TABLE.centre_limits(SNOOKER_BALL) - 0.1
    while len(shots) < count:
        n = int(rng.integers(1, 4))
        places = rng.uniform(-half, half, (n, 2))
        gaps = np.linalg.norm(places[:, None] - places, axis=-1) + np.eye(n)
        if gaps.min() < 0.2:
            continue
        to = places[1] - places[0] if n > 1 else rng.normal(size=2)
        off = 0.6 * SNOOKER_BALL.diameter / np.linalg.norm(to) if n > 1 else 0.0
        heading = np.arctan2(to[1], to[0]) + rng.uniform(-1, 1) * off
        direction, speed = np.array([np.cos(heading), np.sin(heading)]), rng.uniform(0.5, 2.0)
        velocity, spin = np.zeros((n, 2)), np.zeros((n, 3))
        velocity[0] = speed * direction
        top, side = rng.uniform(-1, 1), rng.normal(0, 0.5)
        spin[0] = np.array([-top * direction[1], top * direction[0], side]) * speed / SNOOKER_BALL.radius
        names = ("white", "red", "black")[:n]
        times = np.arange(0, 40, 0.05)
        shot = Shot(names, places, velocity, spin, times)
        track = play(ANALYTIC_MODEL, [shot])[0]
        rest = int(np.argmax(~np.any(track.velocity[:, 0], axis=-1)))
        if 1 <= len(track.events) <= MAX_IMPACTS and rest > 0:
            shots.append(dataclasses.replace(shot, times=times[[0, rest]]))
    return shots, play(ANALYTIC_MODEL, shots)


def two_ball_shots(count: int, table: Table = FULL_TABLE, ball: Ball = SNOOKER_BALL) -> list[Shot]:
    """Shots of 0.5 to 3.5 m/s with spin, most of them at another ball, over 4 s on a table."""
    rng = np.random.default_rng(RANDOM_SEED)
    shots: list[Shot] = []
    half = table.centre_limits(ball) - 0.05
    while len(shots) < count:
        places = rng.uniform(-half, half, (2, 2))
        to = places[1] - places[0]
        if np.hypot(*to) < 0.1:
            continue
        heading = np.arctan2(to[1], to[0]) + rng.normal(0, 0.03) if rng.random() < 0.7 else rng.uniform(-np.pi, np.pi)
        speed, velocity, spin = rng.uniform(0.5, 3.5), np.zeros((2, 2)), np.zeros((2, 3))
        velocity[0] = speed * np.array([np.cos(heading), np.sin(heading)])
        spin[0] = rng.normal(0, 0.5, 3) * speed / ball.radius
        times = np.linspace(0, 4, 241)
        shots.append(Shot(("white", "red"), places, velocity, spin, times, session=Session(float(rng.random()))))
    return shots


def pocket_shots(count: int) -> list[Shot]:
    """Rolling balls of 0.7 to 2.5 m/s aimed at a mouth of a full snooker table, inside and outside its acceptance."""
    rng = np.random.default_rng(RANDOM_SEED)
    half, shots = np.array([SNOOKER_TABLE.length, SNOOKER_TABLE.width]) / 2, list[Shot]()
    for number in range(count):
        target = half * ((1, 1), (-1, 1), (0, 1), (1, -1), (-1, -1), (0, -1))[number % 6]
        start, speed = rng.uniform(-0.6, 0.6, 2) * [2.0, 1.0], rng.uniform(0.7, 2.5)
        way = target - start
        heading = np.arctan2(way[1], way[0]) + rng.uniform(-0.07, 0.07) / np.linalg.norm(way)
        velocity = speed * np.array([np.cos(heading), np.sin(heading)])
        spin = np.array([-velocity[1], velocity[0], 0.0]) / SNOOKER_BALL.radius
        shots.append(Shot(("white",), start[None], velocity[None], spin[None], np.linspace(0, 4, 241)))
    return shots
