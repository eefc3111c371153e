"""Effects that vary along a step: against closed forms, and to the very end of the motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.model_file import Model, full_model
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate

BALL = Ball(0.0615, 0.21)


def rolling(speed: float, side: float, times: np.ndarray) -> Shot:
    """A ball that rolls along x, turning about the vertical."""
    spin = np.array([[0.0, speed / BALL.radius, side]])
    return Shot(("ball",), np.zeros((1, 2)), np.array([[speed, 0.0]]), spin, times)


ENGINES = pytest.mark.parametrize("engine", ["events", "mujoco"])


def model(engine: str, **rates: float) -> Model:
    """Open cloth with some effects."""
    built = dataclasses.replace(full_model(Table(100.0, 100.0, False), BALL), engine=engine)
    for name, rate in rates.items():
        built = built.add(effect_class(name)(rate))  # type: ignore[call-arg]
    return built.with_values({"decoupled_cloth.roll": 0.004, "decoupled_cloth.spin": 5.0})


@ENGINES
def test_speed_drag_follows_its_closed_form(engine: str) -> None:
    """dv/dt = -(d + k v) has an exponential solution."""
    times, k, d = np.linspace(0, 8, 81), 0.0138, 0.004 * 9.81
    track = simulate(model(engine, speed_drag=k), [rolling(1.0, 0.0, times)])[0]
    way = (1 + d / k) * (1 - np.exp(-k * times)) / k - d / k * times
    assert np.abs(track.position[:, 0, 0] - way).max() < 1e-4


@ENGINES
def test_side_curve_bends_by_half_a_t_squared_at_first(engine: str) -> None:
    """Lateral acceleration c omega_z, to the left of the motion for positive c omega_z."""
    times = np.linspace(0, 0.2, 3)
    for side in (20.0, -20.0):
        track = simulate(model(engine, side_curve=0.001), [rolling(1.0, side, times)])[0]
        expected = 0.5 * 0.001 * (side - np.sign(side) * 5.0 * 0.2 / 3) * 0.2**2
        assert track.position[-1, 0, 1] == pytest.approx(expected, rel=0.02)


@ENGINES
@pytest.mark.parametrize("rate", [0.0005, 0.003])
def test_every_ball_comes_to_rest(rate: float, engine: str) -> None:
    """Whatever pushes it, and from many speeds: the last steps do not shrink without end."""
    times = np.linspace(0, 30, 4)
    shots = [rolling(v, side, times) for v in np.geomspace(0.001, 1.0, 12) for side in (0.0, 4.0, 40.0)]
    for track in simulate(model(engine, speed_drag=0.01, side_curve=rate), shots):
        assert np.abs(track.velocity[-1]).max() < 1e-6


def test_a_push_across_the_way_keeps_no_ball_going() -> None:
    """Though sidespin pushes harder than the cloth brakes, it takes nothing off the speed, nor adds any."""
    speeds, brake, times = np.linspace(0.02, 0.07, 6), 0.013 * 9.81, np.linspace(0.0, 1.0, 201)
    slow = model("events", side_curve=0.0025).with_values({"decoupled_cloth.roll": 0.013, "decoupled_cloth.spin": 22.0})
    for speed, track in zip(speeds, simulate(slow, [rolling(v, -65.0, times) for v in speeds]), strict=True):
        size, stop = np.hypot(*track.velocity[:, 0].T), speed / brake
        assert size == pytest.approx(np.maximum(speed - brake * times, 0.0), abs=1e-3)
        assert np.all(size[times > stop + 0.03] < 1e-9) and track.spin[-1, 0, 2] < -40.0
