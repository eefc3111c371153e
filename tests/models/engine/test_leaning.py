"""A ball that rubs at a rail, spun into it by the cloth: it is not thrown back."""

from __future__ import annotations

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.model_file import Model, full_model
from models.shot import Ball, Shot, Table, Track
from models.simulation.simulate import simulate

TABLE, BALL = Table(2.84, 1.42, False), Ball(0.0615, 0.21)
LIMIT = float(TABLE.centre_limits(BALL)[0])
ROUGH = {  # constants, effects, and velocity [m/s] and spin [rad/s] of a ball at a gap [m]
    "strong cloth": (
        {"decoupled_cloth.slide": 0.6, "cushion_impact.restitution": 0.8, "cushion_impact.friction": 0.0},
        {"cushion_friction_px": {"change": 0.4}},
        (3.093e-4, (0.00201, -0.0029), (119.0, 82.312, 0.0)),
    ),
    "slip and sidespin share": (
        {"decoupled_cloth.slide": 0.171, "decoupled_cloth.spin": 1.13, "cushion_impact.restitution": 0.987},
        {"spin_slide_coupling": {"lever": 0.0256}, "cushion_friction_px": {"change": 0.4}},
        (9.7e-5, (0.0152, -0.036), (14.38, 6.07, 23.76)),
    ),
    "worn patch": (
        {"decoupled_cloth.slide": 0.5, "cushion_impact.restitution": 0.9},
        {"worn_patch": {"roll": 0.0, "slide": 4.0, "x": LIMIT, "y": 0.0, "radius": 1.0}},
        (1e-5, (0.004, 0.02), (0.0, 80.0, 0.0)),
    ),
}


def track_of(case: str) -> Track:
    constants, effects, (gap, v, w) = ROUGH[case]
    world: Model = full_model(TABLE, BALL).with_values(constants)
    for name, values in effects.items():
        world = world.add(effect_class(name)(**values))
    place = np.array([[LIMIT - gap, 0.1]])
    shot = Shot(("a",), place, np.array([v]), np.array([w]), np.linspace(0.0, 4.0, 401))
    return simulate(world, [shot])[0]


@pytest.mark.parametrize("case", ["strong cloth", "worn patch"])
def test_what_leans_on_a_rail_is_not_thrown_back(case: str) -> None:
    """Each impact gives back a part of the last: once the ball leans, none lets it leave."""
    track = track_of(case)
    impacts = [e.time for e in track.events if e.rail == "+x"]
    leans = track.times > impacts[0] + 0.5
    assert len(impacts) < 40
    assert np.abs(track.position[leans, 0, 0] - LIMIT).max() < 5e-6
