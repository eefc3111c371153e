"""The losses of an export: distances of balls from their positions in the model, by cause.

In: a model and the one played in its place. Out: `Loss`, in words and mm: at the second impact, before errors have
grown, and where balls stop. Both are played in our engine on the same random shots of two balls, so that only the cause
is measured. The table has no pockets: noses and pockets are exported exactly, and whether a ball falls would change its
position by metres.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.model_file import Model
from models.shot import Array, Shot, Track
from models.simulation.simulate import simulate
from sysid.pooltool.laws import Laws, own_ball_friction, own_cushions

SHOTS, SEED = 200, 6
BALL_SPEEDS_M_S = (0.5, 3.0)  # range of the struck ball
LAST_S = 60.0  # time by which all balls rest
BEFORE_S = 1e-6  # time before the second impact at which positions are compared


@dataclass(frozen=True)
class Loss:
    """The position error by one cause: median and 95 % quantile over shots [m]."""

    cause: str
    second_impact: tuple[float, float]
    rest: tuple[float, float]

    @property
    def text(self) -> str:
        """In a line."""
        (early, early_95), (late, late_95) = (tuple(1e3 * v for v in pair) for pair in (self.second_impact, self.rest))
        return (
            f"{self.cause}: {early:.2g} mm at the second impact (95 %: {early_95:.2g}), {late:.2g} mm where balls stop "
            f"(95 %: {late_95:.2g})"
        )


def losses(model: Model, laws: Laws) -> list[Loss]:
    """Losses by all causes together, by each lost effect alone, and by pooltool's default laws without ours."""
    shots, base, played = random_shots(model), _closed(model), _closed(laws.played)
    found = []
    if laws.lost or played.effects != base.effects:
        found.append(loss("in all", base, played, shots))
    found += [loss(f"without {name}", base, base.without(name), shots) for name in laws.lost]
    found.append(loss("without the laws file, pooltool's own cushions", played, own_cushions(played), shots))
    found.append(
        loss("without the laws file, pooltool's own friction of balls", played, own_ball_friction(played), shots)
    )
    return found


def off_at_rest(model: Model, other: Model) -> float:
    """Median distance between the end points of balls in two models, over the same shots [m]."""
    return loss("", _closed(model), _closed(other), random_shots(model)).rest[0]


def _closed(model: Model) -> Model:
    """The model on its table without pockets."""
    return dataclasses.replace(model, table=dataclasses.replace(model.table, pockets=False))


def loss(cause: str, model: Model, other: Model, shots: Sequence[Shot]) -> Loss:
    """The distance between two models on the same shots."""
    ends = [simulate(one, shots) for one in (model, other)]
    second = np.array([[_second_impact(track) for track in tracks] for tracks in ends]).min(axis=0) - BEFORE_S
    early = [
        dataclasses.replace(shot, times=np.array([0.0, max(float(t), 0.0)]))
        for shot, t in zip(shots, second, strict=True)
    ]
    at_second = _apart(*(simulate(one, early) for one in (model, other)))
    return Loss(cause, _quantiles(at_second), _quantiles(_apart(*ends)))


def random_shots(model: Model, count: int = SHOTS) -> list[Shot]:
    """Shots at a second ball on the model's table, with all spins, played until all balls rest."""
    rng, ball, shots = np.random.default_rng(SEED), model.ball, list[Shot]()
    half = model.table.centre_limits(ball) - 2 * ball.radius
    while len(shots) < count:
        places = rng.uniform(-half, half, (2, 2))
        to = places[1] - places[0]
        distance = float(np.hypot(*to))
        if distance < 4 * ball.radius:
            continue
        # Up to 0.9 diameters off the line of centres: a hit, down to a thin one.
        heading = np.arctan2(to[1], to[0]) + np.arcsin(rng.uniform(-0.9, 0.9) * ball.diameter / distance)
        aim, speed = np.array([np.cos(heading), np.sin(heading)]), rng.uniform(*BALL_SPEEDS_M_S)
        roll, side = rng.uniform(-1.0, 1.0, 2) * speed / ball.radius
        velocity, spin = np.zeros((2, 2)), np.zeros((2, 3))
        velocity[0], spin[0] = speed * aim, (-roll * aim[1], roll * aim[0], side)
        shots.append(Shot(("cue", "object"), places, velocity, spin, np.array([0.0, LAST_S])))
    return shots


def _second_impact(track: Track) -> float:
    """Time of the second impact [s]; the end of the shot if there is none."""
    times = sorted(event.time for event in track.events)
    return times[1] if len(times) > 1 else float(track.times[-1])


def _apart(some: Sequence[Track], others: Sequence[Track]) -> Array:
    """The larger distance of a ball at the end of each shot: (n,) [m]."""
    pairs = zip(some, others, strict=True)
    return np.array([np.hypot(*(a.position[-1] - b.position[-1]).T).max() for a, b in pairs])


def _quantiles(values: Array) -> tuple[float, float]:
    return float(np.median(values)), float(np.quantile(values, 0.95))
