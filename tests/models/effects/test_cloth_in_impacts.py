"""The cloth within impacts: with what changes its sliding friction, against an independent program, in both engines."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.model_file import Model, full_model
from models.shot import Array, Ball, Shot, Table
from models.simulation.simulate import simulate
from tests.truth import physics
from tests.truth.cloth import Constants

BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778, pockets=False)
CHANGES = {
    "struck_ball_slide": ({"change": 0.3}, {"cue_mus": 0.3}),
    "worn_patch": (
        {"slide": 0.4, "roll": 0.4, "x": 0.5, "y": 0.5, "radius": 0.9},
        {"patch": 0.4, "patch_x": 0.5, "patch_y": 0.5, "patch_r": 0.9},
    ),
    "slide_friction_speed": ({"rate": 0.2}, {"mus_v": 0.2}),
    "spin_slide_coupling": ({"lever": 0.012}, {"contensou": 0.012}),
}


def model(name: str, share: float) -> Model:
    """The base with an effect on sliding friction, and the share of it that acts within impacts."""
    base = full_model(TABLE, BALL).with_values({
        "decoupled_cloth.slide": 0.212, "decoupled_cloth.roll": 0.0127, "decoupled_cloth.spin": 22.0,
        "ball_impact.restitution": 0.92, "ball_impact.friction": 0.05, "cushion_impact.restitution": 0.90,
        "cushion_impact.friction": 0.14,
    })  # fmt: skip
    return base.add(effect_class(name)(**CHANGES[name][0])).add(effect_class("cloth_in_impacts")(share=share))


def shots() -> list[Shot]:
    """Balls that reach cushions, and one that is met, with spin."""
    noise, played = np.random.default_rng(6), []
    for heading, speed, offset in ((1.2, 1.2, -0.2), (1.6, 2.6, -0.2), (0.4, 3.2, -0.2), (0.9, 1.5, 0.02)):
        way = np.array([np.cos(heading), np.sin(heading)])
        place = np.array([0 * way, 0.1 * way + offset * np.array([-way[1], way[0]])])
        v, w = np.zeros((2, 2)), np.zeros((2, 3))
        v[0], w[0] = speed * way, noise.normal(0, 25, 3)
        played.append(Shot(("white", "red"), place, v, w, np.linspace(0, 1.5, 9)))
    return played


def truth(played: Shot, share: float, name: str) -> Array:
    """Positions (n, 2, 2) [m] by the independent program."""
    starts = {
        n: physics.Start(tuple(p), tuple(v), tuple(w))
        for n, p, v, w in zip(played.names, played.position, played.velocity, played.spin, strict=True)
    }
    c = Constants(**CHANGES[name][1], follow=share)
    return physics.simulate(
        physics.Table(TABLE.length, TABLE.width, False), c, starts, played.times, increments=20_000
    ).xy


@pytest.mark.parametrize("name", CHANGES)
def test_it_is_what_the_hidden_one_is(name: str) -> None:
    played = shots()
    without, seen = simulate(model(name, 0.0), played), simulate(model(name, 0.8), played)
    moved = max(np.abs(a.position - b.position).max() for a, b in zip(without, seen, strict=True))
    off = max(np.abs(truth(s, 0.8, name) - t.position).max() for s, t in zip(played, seen, strict=True))
    assert moved > 5e-4, "it shows in these shots"
    assert off < 5e-4 * moved + 1e-5


@pytest.mark.parametrize("name", ["struck_ball_slide", "worn_patch"])
def test_the_contacts_of_mujoco_have_it_as_well(name: str) -> None:
    changes = []
    for engine in ("events", "mujoco"):
        without, seen = (
            simulate(dataclasses.replace(model(name, share), engine=engine), shots()) for share in (0.0, 1.0)
        )
        changes.append(np.array([b.position - a.position for a, b in zip(without, seen, strict=True)]))
    assert np.abs(changes[0]).max() > 2e-3
    assert np.abs(changes[0] - changes[1]).max() < 0.03 * np.abs(changes[0]).max()


def test_alone_it_changes_nothing() -> None:
    base = full_model(TABLE, BALL)
    with_it = base.add(effect_class("cloth_in_impacts")(share=1.0))
    for one, other in zip(simulate(base, shots()), simulate(with_it, shots()), strict=True):
        assert one.position.tobytes() == other.position.tobytes()
