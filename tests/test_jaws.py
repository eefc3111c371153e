"""Pockets with jaws in MuJoCo: shots end as the analytic ones do, effects are told of jaws, and what goes without."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.analytic.pocket import OWNERS, pockets_of
from models.analytic.shot import Constants, play
from models.impacts import describe, part
from models.model_file import Model, full_model
from models.shot import Ball, Shot, Table, Track
from models.simulate import simulate

BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778)
R = BALL.radius
HALF = np.array([TABLE.length, TABLE.width]) / 2
POCKETS = pockets_of(TABLE, BALL)
CONSTANTS = Constants()


def model() -> Model:
    """The constants of the analytic shots."""
    return full_model(TABLE, BALL).with_values(
        {
            "decoupled_cloth.slide": 0.2, "decoupled_cloth.roll": 0.0127, "decoupled_cloth.spin": 22.0,
            "ball_impact.restitution": 0.89, "ball_impact.friction": 0.05,
            "cushion_impact.restitution": 0.98, "cushion_impact.friction": 0.14,
        }
    )  # fmt: skip


def into_pockets(n: int, seed: int, balls: int) -> list[Shot]:
    """Balls on their way to all pockets and their jaws, of their own or sent by one that comes from behind."""
    noise, made = np.random.default_rng(seed), []
    for k in range(n):
        sides = np.array([(1, 1), (0, 1), (-1, 1), (1, -1), (0, -1), (-1, -1)][k % 6])
        angle = np.arctan2(sides[1], sides[0]) + noise.uniform(-0.5, 0.5)
        u = np.array([np.cos(angle), np.sin(angle)])
        p = HALF * sides - noise.uniform(0.35, 0.6) * u + noise.uniform(-0.06, 0.06) * np.array([-u[1], u[0]])
        p = np.clip(p, 0.03 - HALF, HALF - 0.03)
        v, w, position = np.zeros((balls, 2)), np.zeros((balls, 3)), p - np.arange(balls)[::-1, None] * 0.2 * u
        v[0] = noise.uniform(0.6, 3.0) * u
        w[0] = [-v[0, 1] / R, v[0, 0] / R, noise.uniform(-30, 30)]
        made.append(Shot(tuple("ab"[:balls]), position, v, w, np.linspace(0, 3, 31)))
    return made


def fates(track: Track) -> list[tuple[str, tuple[str, ...], str]]:
    return [(e.kind, e.balls, e.rail) for e in track.events]


@pytest.mark.parametrize("balls", [1, 2])
def test_shots_into_pockets_agree_with_the_analytic_ones(balls: int) -> None:
    shots = into_pockets(102, 8, balls)
    both = zip(play(TABLE, BALL, CONSTANTS, shots, jaws=True), simulate(model(), shots, jaws=True), strict=True)
    potted = touched = 0
    for a, b in both:
        assert fates(a) == fates(b)
        assert np.array_equal(np.isnan(a.position), np.isnan(b.position))
        assert np.nanmax(np.abs(a.position - b.position)) < 1e-6
        kinds = [e.kind for e in a.events if e.balls[0] == "ab"[balls - 1]]
        potted += "pocket" in kinds
        touched += "cushion" in kinds and "pocket" in kinds
    assert 30 < potted < 100
    assert touched > 10  # fall off a jaw


def test_without_the_option_pockets_are_mouths() -> None:
    shots = into_pockets(24, 3, 1)
    plain, bent = simulate(model(), shots), simulate(model(), shots, jaws=True)
    for a, b in zip(play(TABLE, BALL, CONSTANTS, shots), plain, strict=True):
        assert fates(a) == fates(b)
        assert np.nanmax(np.abs(a.position - b.position)) < 1e-6
    assert [fates(a) for a in plain] != [fates(b) for b in bent]


def test_a_jaw_met_with_balls_close_by_ends_the_shot() -> None:
    # Three balls together before a corner and a middle: contacts of MuJoCo's for them, impulses for the jaws.
    d = 2 * R + 1e-9
    triangle = d * np.array([[0.0, 0.0], [-0.5, -np.sqrt(0.75)], [0.5, -np.sqrt(0.75)], [0.0, -4.0]])
    shots = []
    for place, turn in ((HALF - 0.055, -np.pi / 4), (np.array([0.03, HALF[1] - 0.03]), 0.0)):
        c, s = np.cos(turn), np.sin(turn)
        m = np.array([[c, -s], [s, c]])
        v = np.zeros((4, 2))
        v[3] = m @ [0.02, 2.0]
        shots.append(Shot(tuple("abcd"), place + triangle @ m.T, v, np.zeros((4, 3)), np.linspace(0, 6, 61)))
    for track in simulate(model(), shots, jaws=True):
        assert {"ball", "cushion", "pocket"} <= {e.kind for e in track.events}
        last = track.position[-1][~np.isnan(track.position[-1, :, 0])]
        gap = np.linalg.norm(last[:, None] - POCKETS.jaws[:, :2], axis=-1) - POCKETS.jaws[:, 2]
        assert gap.min() > -1e-6


def test_effects_are_told_the_rail_of_a_jaw_and_its_own_normal() -> None:
    jaw = POCKETS.jaws[2]
    p = np.zeros((1, 1, 3))
    p[0, 0, :2] = jaw[:2] + jaw[2] * np.array([-0.6, 0.8])
    v = np.array([[[0.5, 0.0, 0.0]]])
    found = describe(
        "cushion", BALL, p, v, np.zeros((1, 1, 3)), np.zeros(1, int), np.full(1, 6), np.zeros(1), POCKETS.jaws
    )
    assert found.approach == pytest.approx([0.3])
    assert found.second.tolist() == [OWNERS[2]]


def test_what_lies_in_a_jaw_is_put_back_to_where_it_touches() -> None:
    p = np.zeros((1, 1, 3))
    p[0, 0, :2] = POCKETS.jaws[5, :2] + (POCKETS.jaws[5, 2] - 1e-4) * np.array([0.6, -0.8])
    part(True, np.array([[2, 0, 9]]), p, R, TABLE.reach(BALL), POCKETS.jaws)
    assert p[0, 0, :2] == pytest.approx(POCKETS.jaws[5, :2] + POCKETS.jaws[5, 2] * np.array([0.6, -0.8]), abs=1e-15)


def test_a_ball_that_is_known_to_stay_does_so() -> None:
    shots = [dataclasses.replace(s, staying=("a",)) for s in into_pockets(24, 3, 1)]
    assert all(e.kind != "pocket" for track in simulate(model(), shots, jaws=True) for e in track.events)


def test_jaws_without_the_effects_that_meet_them_are_refused() -> None:
    shots = into_pockets(1, 3, 1)
    bare = dataclasses.replace(model(), effects=())
    with pytest.raises(ValueError, match="cloth, ball, cushion"):
        simulate(bare, shots, jaws=True)
    some = tuple(e for e in model().effects if e.name() != "cushion_impact")
    with pytest.raises(ValueError, match="none for cushion: add"):
        simulate(dataclasses.replace(model(), effects=some), shots, jaws=True)
