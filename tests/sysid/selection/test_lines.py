"""Terms that act on one side of a line on the cloth, or of a value of another variable."""

from __future__ import annotations

import numpy as np

from models.model_file import full_model
from models.shot import Ball, Session, Shot, Table
from models.simulation.simulate import simulate
from sysid.selection.formulas.families import shapes, shapes_beyond
from sysid.selection.formulas.terms import effect_from_terms

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)


def along_x(order: float = 0.0) -> Shot:
    """A ball that rolls along x and comes back from the rail."""
    v, w = np.array([[1.5, 0.2]]), np.array([[-0.2, 1.5, 0.0]]) / BALL.radius
    return Shot(("cue",), np.array([[0.3, 0.0]]), v, w, np.linspace(0, 3, 31), session=Session(order))


def test_a_step_acts_beyond_its_line_alone() -> None:
    term = next(t for family in shapes("drag", "x", -1.0, 1.0) for (t, *_) in family if t.factor == "x > 0.5")
    model = full_model(TABLE, BALL)
    shot = along_x()
    plain = simulate(model, [shot])[0]
    slower = simulate(model.add(effect_from_terms("odd_cloth", (term,), (0.05,))), [shot])[0]
    before = plain.position[:, 0, 0] < 0.5
    before &= np.cumsum(~before) == 0
    np.testing.assert_allclose(slower.position[before], plain.position[before], atol=1e-9)
    assert slower.velocity[5, 0, 0] < plain.velocity[5, 0, 0] - 1e-3
    earlier = simulate(
        model.add(effect_from_terms("odd_cloth", (term,), (0.05,))).with_values({"odd_cloth.drag_x_above_at": 0.4}),
        [shot],
    )[0]
    assert earlier.velocity[5, 0, 0] < slower.velocity[5, 0, 0] - 1e-3
    moved = simulate(model.add(effect_from_terms("odd_cloth", (term.moved(0.4),), (0.05,))), [shot])[0]
    assert moved.position.tobytes() == earlier.position.tobytes()


def test_a_term_may_act_on_one_side_of_a_value_alone() -> None:
    """A drag in the middle of the session, where x is above 0.5 m: the engine stops where the ball gets there."""
    (line,) = next(shape for family in shapes("drag", "order", 0.0, 1.0, (0.3,)) for shape in family if shape[0].limits)
    (term,) = shapes_beyond((line,), "x", -1.0, 1.0, (0.5,))[0][0]
    assert (term.name, term.factor) == ("drag_x_over_order_above", "(x > 0.5) * (order > 0.3)")
    assert term.where == "rolling on the cloth, order of the clips above 0.3, where x > 0.5 m"
    assert term.depends_on == ("place", "order of the clips")
    model = full_model(TABLE, BALL)
    wet = model.add(effect_from_terms("odd_cloth", (term,), (0.05,)))
    early, late = along_x(0.2), along_x(0.4)
    plain = simulate(model, [late])[0]
    np.testing.assert_allclose(simulate(wet, [early])[0].position, plain.position, atol=1e-9)
    slower = simulate(wet, [late])[0]
    before = plain.position[:, 0, 0] < 0.5
    before &= np.cumsum(~before) == 0
    np.testing.assert_allclose(slower.position[before], plain.position[before], atol=1e-9)
    assert slower.velocity[5, 0, 0] < plain.velocity[5, 0, 0] - 1e-3
    sooner = simulate(wet.with_values({"odd_cloth.drag_x_over_order_above_from": 0.4}), [late])[0]
    assert sooner.velocity[5, 0, 0] < slower.velocity[5, 0, 0] - 1e-3
    moved = model.add(effect_from_terms("odd_cloth", (term.acting_from(0.4),), (0.05,)))
    assert simulate(moved, [late])[0].position.tobytes() == sooner.position.tobytes()
    placed = term.placed({"drag_x_over_order_above_from": 0.4, "drag_x_over_order_above_at": 0.35})
    assert placed.factor == "(x > 0.4) * (order > 0.35)" and placed.where.endswith("where x > 0.4 m")
