"""Effects of the catalogue against an independent program that has the same effect hidden."""

from __future__ import annotations

import numpy as np
import pytest

from models.model_file import effect_class, full_model
from models.simulation.simulate import simulate
from tests.support.effect_shots import BALL, BASE, TABLE, shots
from tests.truth import physics
from tests.truth.cloth import Constants

CASES = [
    ("table_tilt", {"slope_x": 0.0007, "slope_y": -0.0016}, {"tilt_x": 0.0007, "tilt_y": -0.0016}),
    ("air_drag", {"rate": 0.02}, {"drag2": 0.02}),
    ("speed_drag", {"rate": 0.035}, {"drag1": 0.035}),
    ("cushion_restitution_speed", {"rate": 0.09}, {"ec_v": 0.09}),
]


@pytest.mark.parametrize(("name", "values", "hidden"), CASES, ids=[c[0] for c in CASES])
def test_an_effect_is_what_the_hidden_one_is(name: str, values: dict[str, float], hidden: dict[str, float]) -> None:
    played = shots(6)
    base = full_model(TABLE, BALL).with_values(BASE)
    with_effect = base.add(effect_class(name)(**values))
    truth, moved = [], []
    for shot, track, plain in zip(played, simulate(with_effect, played), simulate(base, played), strict=True):
        starts = {
            n: physics.Start(tuple(p), tuple(v), tuple(w))
            for n, p, v, w in zip(shot.names, shot.position, shot.velocity, shot.spin, strict=True)
        }
        table = physics.Table(TABLE.length, TABLE.width, False)
        motion = physics.simulate(table, Constants(**hidden), starts, shot.times, increments=20_000)
        truth.append(np.abs(motion.xy - track.position).max())
        moved.append(np.abs(plain.position - track.position).max())
    assert max(moved) > 2e-3, "the effect shows in these shots"
    assert max(truth) < 0.02 * max(moved) + 5e-5
