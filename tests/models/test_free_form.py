"""Free forms: splines as scipy has them, the shots that they play, and what pickles."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
from scipy.interpolate import BSpline

from models import formula as doors
from models.free_form import ALONE, Axis, FreeForm, free_form
from models.model_file import full_model
from models.shot import Array, Ball, Shot, Table
from models.simulation.observe import observed
from models.simulation.simulate import simulate

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)


def values_at(form: FreeForm, one: Array) -> Array:
    """A function of one variable, at its values (n,)."""
    return form.axes[0].weights(one) @ np.array([getattr(form, key) for key in form.parameters()])


def test_splines_are_those_of_scipy() -> None:
    rng = np.random.default_rng(1)
    axis = Axis.over("speed", 0.5, 3.0, 5)
    made = free_form("one", doors.DRAG, axis, ALONE, 9.0)(*rng.normal(size=axis.count))
    knots = axis.low + axis.step * np.arange(-3, axis.count + 1)
    known = BSpline(knots, [getattr(made, key) for key in made.parameters()], 3)
    at = rng.uniform(0.5, 3.0, 50)
    np.testing.assert_allclose(values_at(made, at), known(at), atol=1e-12)
    assert values_at(made, np.array([9.0])) == pytest.approx(values_at(made, np.array([3.0])))


def test_a_heading_has_no_seam() -> None:
    rng = np.random.default_rng(2)
    made = free_form("round", doors.DRAG, Axis.around("heading", 8), ALONE, 9.0)(*rng.normal(size=8))
    before, after = values_at(made, np.array([np.pi - 1e-9, -np.pi + 1e-9]))
    assert before == pytest.approx(after, abs=1e-6)


def test_a_constant_function_is_the_constant() -> None:
    """Of drag, of a cushion's restitution and of a push: as the same change of the model's own constants plays."""
    times = np.linspace(0.0, 2.0, 9)
    shot = Shot(("white",), np.zeros((1, 2)), np.array([[1.5, 0.7]]), np.array([[-0.7, 1.5, 0.0]]) / 0.02625, times)
    base = full_model(TABLE, BALL)
    cushion = base.parameters()["cushion_impact.restitution"]
    axes = (Axis.over("x", -1.8, 1.8, 3), Axis.over("y", -0.9, 0.9, 2))
    made = free_form("flat", doors.CUSHION_E, *axes, 9.0)(*np.full(30, -0.1))
    (one,) = simulate(base.add(made), [shot])
    (two,) = simulate(base.with_values({"cushion_impact.restitution": float(cushion) - 0.1}), [shot])
    np.testing.assert_allclose(one.position, two.position, atol=1e-9)
    tilted = free_form("push", doors.PUSH_X, Axis.around("heading", 8), ALONE, 9.0)(*np.full(8, 0.02))
    (moved,) = simulate(base.add(tilted), [shot])
    assert np.abs(moved.position - one.position).max() > 1e-3


def test_sidespin_dies_as_fast_as_a_function_says() -> None:
    """Deceleration alpha (1 + 0.4) of the struck ball's."""
    model = full_model(TABLE, BALL).with_values({"decoupled_cloth.spin": 20.0})
    faster = model.add(free_form("one", doors.SPIN, Axis.counted("number", 1), ALONE, 9.0)(0.4))
    shot = Shot(("cue",), np.zeros((1, 2)), np.array([[0.5, 0.0]]), np.array([[0.0, 0.0, 40.0]]), np.array([0.0, 1.0]))
    for one, rate in ((model, 20.0), (faster, 28.0)):
        for engine, within in (("events", 1e-9), ("mujoco", 0.05)):
            track = simulate(dataclasses.replace(one, engine=engine), [shot])[0]
            assert track.spin[-1, 0, 2] == pytest.approx(40.0 - rate, abs=within)


def test_a_late_picture_shows_balls_where_they_come_to() -> None:
    model, times = full_model(TABLE, BALL), np.linspace(0.0, 1.0, 6)
    late = model.add(free_form("one", doors.CLOCK, Axis.counted("number", 2), ALONE, 9.0)(0.004, -0.003))
    v = np.array([[1.5, 0.2], [-0.3, 0.4]])
    shot = Shot(("cue", "red"), np.array([[-0.3, 0.0], [0.2, 0.5]]), v, np.zeros((2, 3)), times)
    (true,), (seen,) = observed(model, [shot]), observed(late, [shot])
    delay = np.array([0.004, -0.003])[:, None]
    np.testing.assert_allclose(seen.position, true.position + delay * true.velocity, atol=1e-12)


def test_it_pickles() -> None:
    made = free_form("one", doors.BALL_MU, Axis.counted("number", 3), ALONE, 0.5)(0.1, 0.2, 0.3)
    again = pickle.loads(pickle.dumps(made))
    assert again == made and type(again) is type(made)


def test_too_many_coefficients_are_refused() -> None:
    with pytest.raises(ValueError, match="40 coefficients; give 1 to 32"):
        free_form("wide", doors.DRAG, Axis.over("x", 0, 1, 5), Axis.over("y", 0, 1, 2), 1.0)


def test_a_function_times_a_variable() -> None:
    """A clock that runs 0.2 % slow in half of a session: the picture is late by that much of the time."""
    model, times = full_model(TABLE, BALL), np.linspace(0.0, 1.0, 6)
    axes = Axis.over("order", 0.0, 1.0, 1), Axis.along("time", 2.0)
    slow = model.add(free_form("one", doors.CLOCK, *axes, 9.0)(*np.full(4, 0.004)))
    shot = Shot(("cue",), np.zeros((1, 2)), np.array([[1.5, 0.2]]), np.zeros((1, 3)), times)
    (true,), (seen,) = observed(model, [shot]), observed(slow, [shot])
    late = 0.002 * times[:, None, None]
    np.testing.assert_allclose(seen.position, true.position + late * true.velocity, atol=1e-12)
