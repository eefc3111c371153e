"""Rails that are not alike, against an independent program that has the same rail hidden."""

from __future__ import annotations

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.model_file import full_model
from models.shot import NOSE_COSINE, NOSE_SINE, Array, Shot
from models.simulation.simulate import simulate
from tests.support.effect_shots import BALL, BASE, TABLE, apart, truth
from tests.truth import physics
from tests.truth.cloth import Constants

RAILS = {"px": (1.0, 0.0), "mx": (-1.0, 0.0), "py": (0.0, 1.0), "my": (0.0, -1.0)}
OF_ONE_RAIL = (("cushion_restitution", "ec"), ("cushion_friction", "muc"), ("nose_height", "nose"))
CASES = [(f"{what}_{rail}", c, rail) for what, c in OF_ONE_RAIL for rail in RAILS]
CHANGE = {"ec": -0.12, "muc": 0.1, "nose": -0.13}


def at_rails() -> list[Shot]:
    """One ball with spin at each rail, in their order, off its normal."""
    limits: Array = np.array([TABLE.length, TABLE.width]) / 2
    found = []
    for way in map(np.array, RAILS.values()):
        across = np.array([-way[1], way[0]])
        place, v = way * (limits - 0.3), 1.5 * way + 0.5 * across
        found.append(Shot(("white",), place[None], v[None], np.array([[5.0, -10.0, 30.0]]), np.linspace(0, 1, 21)))
    return found


@pytest.mark.parametrize(("name", "constant", "rail"), CASES, ids=[c[0] for c in CASES])
def test_a_rail_differs_as_the_hidden_one_does_and_no_other(name: str, constant: str, rail: str) -> None:
    played, change = at_rails(), CHANGE[constant]
    base = full_model(TABLE, BALL).with_values(BASE)
    plain, seen = simulate(base, played), simulate(base.add(effect_class(name)(change=change)), played)
    assert [t.events[0].rail for t in plain] == ["+x", "-x", "+y", "-y"] and all(len(t.events) == 1 for t in plain)
    moved, here = apart(plain, seen), list(RAILS).index(rail)
    assert moved[here] > 5e-3 and (np.delete(moved, here) == 0.0).all()
    off = np.abs(truth(played[here], {f"{constant}_{rail}": change}) - seen[here].position).max()
    assert off < 5e-4 * moved[here] + 1e-5


@pytest.mark.parametrize("change", [-0.2, -0.13, 0.1])  # carom, pool, higher than snooker's
def test_noses_of_another_height(change: float) -> None:
    """They meet the ball at another place, R cos theta, which the size of the table has to take up."""
    played = at_rails()
    base = full_model(TABLE, BALL).with_values(BASE)
    plain, seen = simulate(base, played), simulate(base.add(effect_class("nose_height")(change=change)), played)
    nearer = float(np.sqrt(1.0 - (NOSE_SINE + change) ** 2) - NOSE_COSINE) * BALL.diameter
    for shot, a, b in zip(played, plain, seen, strict=True):
        start = physics.Start(tuple(shot.position[0]), tuple(shot.velocity[0]), tuple(shot.spin[0]))
        table = physics.Table(TABLE.length + nearer, TABLE.width + nearer, False)
        true = physics.simulate(table, Constants(nose=change), {"white": start}, shot.times, increments=20_000).xy
        moved = np.abs(a.position - b.position).max()
        assert moved > 5e-3 and np.abs(true - b.position).max() < 5e-4 * moved + 1e-5
