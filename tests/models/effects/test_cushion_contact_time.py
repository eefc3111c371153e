"""A ball that stays in a cushion: how much later it leaves, where, and that it comes out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.effect import Effect, ImpactState, param
from models.effects.impact.cushion_contact_time import CushionContactTime
from models.model_file import full_model
from models.shot import Ball, Shot, Table, Track
from models.simulation.simulate import simulate

TIME = 0.006


@dataclasses.dataclass(frozen=True)
class AnyContactTime(Effect):
    """A user's effect that forgets to ask whether it is a cushion."""

    time: float = param(0.01, off=0.0, unit="s", bounds=(0.0, 0.03), source="made up")

    def impact(self, hit: ImpactState) -> None:
        """Every impact takes time."""
        hit.contact_time += self.time


BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778, pockets=False)
LIMIT = float(TABLE.centre_limits(BALL)[1])


def played(time: float, v: tuple[float, float], x: float = 0.0, table: Table = TABLE) -> Track:
    """A sliding ball without spin that is a decimetre before the cushion at +y, seen every millisecond."""
    shot = Shot(
        ("a",), np.array([[x, LIMIT - 0.1]]), np.array([v]), np.zeros((1, 3)), np.linspace(0.0, 1.0, 1001)
    )  # fmt: skip
    model = full_model(table, BALL)
    return simulate(model.add(CushionContactTime(time=time)) if time else model, [shot])[0]


def leaves(track: Track) -> float:
    """When the ball comes out of the cushion [s], from the first sample that is out of it."""
    y, v = track.position[:, 0, 1], track.velocity[:, 0, 1]
    k = int(np.flatnonzero((y < LIMIT) & (v < 0.0))[0])
    return float(track.times[k] - (LIMIT - y[k]) / abs(v[k]))


@pytest.mark.parametrize("speed", [0.8, 2.0, 4.0])
def test_a_ball_leaves_later_by_the_time_of_contact_whatever_its_speed(speed: float) -> None:
    later, soon = (leaves(played(t, (0.3, speed))) for t in (TIME, 0.0))
    assert later - soon == pytest.approx(TIME, rel=0.01)


def test_along_the_rail_it_goes_with_the_speed_that_it_leaves_with() -> None:
    late, plain = played(TIME, (1.0, 2.0)), played(0.0, (1.0, 2.0))
    k = int(np.argmax(plain.velocity[:, 0, 1] < 0.0)) + 20
    assert late.position[k, 0, 0] == pytest.approx(plain.position[k, 0, 0], abs=1e-9)
    assert late.position[k, 0, 1] - plain.position[k, 0, 1] == pytest.approx(-TIME * plain.velocity[k, 0, 1], rel=0.03)


@pytest.mark.parametrize("speed", [0.003, 0.02, 0.1])
def test_a_slow_ball_comes_out(speed: float) -> None:
    track = played(0.03, (0.0, 0.6 + speed))  # the cloth takes about 0.6 m/s on the way there
    assert track.position[-1, 0, 1] <= LIMIT + 1e-9
    assert not track.velocity[-1, 0].any() or track.velocity[-1, 0, 1] <= 0.0


def test_at_a_mouth_there_is_none() -> None:
    """The rubber ends there: half as long half a ball's diameter beside it."""
    table = dataclasses.replace(TABLE, pockets=True)
    middle, times = table.mouths()[1], []
    for beside in (1e-4, 0.5 * BALL.diameter, 1.5 * BALL.diameter):
        later, soon = (leaves(played(t, (0.0, 2.0), middle + beside, table)) for t in (TIME, 0.0))
        times.append(later - soon)
    assert times == pytest.approx([0.0, 0.5 * TIME, TIME], abs=0.02 * TIME)


def test_balls_that_meet_stay_where_they_are() -> None:
    """Ball number 1 is no rail."""
    v = np.array([[1.0, 0.3], [0.0, 0.0]])
    met = Shot(("a", "b"), np.array([[0, 0], [0.1, 0.01]]), v, np.zeros((2, 3)), np.linspace(0, 0.3, 31))
    model = full_model(TABLE, BALL)
    plain, timed = (simulate(one, [met])[0].position for one in (model, model.add(AnyContactTime())))
    np.testing.assert_array_equal(timed, plain)


def test_no_ball_rests_in_pressed_rubber() -> None:
    """One that is 3 mm in comes to lean on another: it is pushed out, and the other one with it."""
    v, places = np.array([[0.0, -0.001], [0.0, 0.0]]), np.array([[0.0, LIMIT + 0.003]] * 2)
    places[1, 1] -= BALL.diameter + 1e-5
    shot = Shot(("a", "b"), places, v, np.zeros((2, 3)), np.linspace(0.0, 8.0, 81))
    model = full_model(TABLE, BALL).add(CushionContactTime(time=0.01))
    end = simulate(model, [shot])[0]
    y = end.position[-1, :, 1]
    assert np.abs(end.velocity[-1]).max() < 1e-9
    assert y[0] == pytest.approx(LIMIT, abs=1e-9)
    assert y[0] - y[1] >= BALL.diameter - 1e-6
