"""Effects of cloth and ball against an independent program that has them hidden, and how steps follow them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.model_file import Model, full_model
from models.shot import Shot, Table
from models.simulation.simulate import simulate
from tests.support.effect_shots import BALL, BASE, TABLE, apart, shots, truth

CASES = [
    ("table_tilt", {"slope_x": 0.0007, "slope_y": -0.0016}, {"tilt_x": 0.0007, "tilt_y": -0.0016}),
    ("air_drag", {"rate": 0.02}, {"drag2": 0.02}),
    ("speed_drag", {"rate": 0.035}, {"drag1": 0.035}),
    ("cloth_nap", {"push": 0.03}, {"nap": 0.03 / (0.0127 * 9.81)}),
    ("cloth_nap", {"push": -0.015}, {"nap": 0.015 / (0.0127 * 9.81), "nap_phi": np.pi}),
    ("spin_slide_coupling", {"lever": 0.006}, {"contensou": 0.006}),
    ("slide_friction_speed", {"rate": 0.12}, {"mus_v": 0.12}),
    ("slide_friction_speed", {"rate": -0.12}, {"mus_v": -0.12}),
    ("spin_decay_speed", {"rate": 0.8}, {"spin_v": 0.8}),
    ("off_centre_ball", {"offset": 0.003}, {"off_centre": 0.003}),
    ("cue_hop", {"time_per_speed": 0.02}, {"hop": 0.02}),
    ("struck_ball_slide", {"change": 0.2}, {"cue_mus": 0.2}),
    ("struck_ball_roll", {"change": -0.2}, {"cue_mur": -0.2}),
    ("cloth_grain", {"along": 0.2, "diagonal": 0.0}, {"ripple": 0.2}),
    ("cloth_grain", {"along": 0.0, "diagonal": -0.2}, {"ripple": 0.2, "ripple_phi": -np.pi / 4}),
    ("slide_curve", {"rate": 0.003}, {"slide_swerve": 0.003}),
    ("slide_curve", {"rate": -0.01}, {"slide_swerve": -0.01}),
    ("worn_patch", {"roll": 0.9, "slide": 0.9, "radius": 0.35}, {"patch": 0.9, "patch_x": 0.0, "patch_y": 0.0}),
    (
        "worn_patch",
        {"roll": -0.3, "slide": -0.3, "x": 0.3, "y": 0.1, "radius": 0.2},
        {"patch": -0.3, "patch_x": 0.3, "patch_y": 0.1, "patch_r": 0.2},
    ),
]
VARYING = [
    ("table_tilt", {"slope_x": 0.0007, "slope_y": -0.0016}), ("cloth_nap", {"push": 0.03}),
    ("speed_drag", {"rate": 0.035}), ("air_drag", {"rate": 0.02}), ("side_curve", {"rate": 0.002}),
    ("spin_slide_coupling", {"lever": 0.005}), ("slide_friction_speed", {"rate": 0.1}),
    ("spin_decay_speed", {"rate": 0.3}), ("off_centre_ball", {"offset": 0.002}),
    ("cloth_grain", {"along": 0.2, "diagonal": 0.1}), ("slide_curve", {"rate": 0.003}),
    ("worn_patch", {"roll": 0.5, "slide": 0.2, "x": 0.2}),
]  # fmt: skip


def base() -> Model:
    return full_model(TABLE, BALL).with_values(BASE)


def model(name: str, values: dict[str, float]) -> Model:
    """The base with one more effect."""
    return base().add(effect_class(name)(**values))


@pytest.mark.parametrize(("name", "values", "hidden"), CASES, ids=[f"{c[0]}-{k}" for k, c in enumerate(CASES)])
def test_an_effect_is_what_the_hidden_one_is(name: str, values: dict[str, float], hidden: dict[str, float]) -> None:
    played = shots(6)
    seen = simulate(model(name, values), played)
    plain = simulate(base(), played)
    error = max(np.abs(truth(shot, hidden) - track.position).max() for shot, track in zip(played, seen, strict=True))
    moved = apart(plain, seen).max()
    assert moved > 2e-3, "the effect shows in these shots"
    assert error < 0.02 * moved + 5e-5


@pytest.mark.parametrize(("name", "values"), VARYING, ids=[c[0] for c in VARYING])
def test_steps_follow_what_varies(name: str, values: dict[str, float]) -> None:
    """Long steps end where the fine ones of MuJoCo do."""
    rng, played = np.random.default_rng(11), []
    for heading in rng.uniform(-np.pi, np.pi, 12):
        v = np.array([[np.cos(heading), np.sin(heading)]]) * rng.uniform(0.5, 3.0)
        played.append(Shot(("white",), np.zeros((1, 2)), v, rng.normal(0, 25, (1, 3)), np.linspace(0, 8, 97)))
    both = (simulate(dataclasses.replace(model(name, values), engine=e), played) for e in ("events", "mujoco"))
    early = [
        np.abs(one.position - other.position)[one.times < min((e.time for e in one.events), default=np.inf)].max()
        for one, other in zip(*both, strict=True)
    ]
    assert max(early) < (1e-3 if name == "spin_slide_coupling" else 1e-4)


def test_touches_are_landed_on() -> None:
    """Under a force that varies a ball meets a cushion where it is."""
    played = [
        Shot(("white",), np.zeros((1, 2)), np.array([[1.0, 1.3]]), np.zeros((1, 3)), np.linspace(0, 6, 4001)),
    ]  # fmt: skip
    tilted = model("table_tilt", {"slope_x": 0.004, "slope_y": -0.003})
    track = simulate(tilted, played)[0]
    reach = TABLE.centre_limits(BALL)
    assert len(track.events) > 1
    times = np.array([e.time for e in track.events])
    seen = np.sort(np.concatenate([played[0].times, times]))
    again = simulate(tilted, [dataclasses.replace(played[0], times=seen)])[0]
    for event in track.events:
        axis = "xy".index(event.rail[1])
        at = again.position[np.searchsorted(seen, event.time), 0, axis]
        assert abs(abs(at) - reach[axis]) < 1e-9
    assert (np.abs(track.position[:, 0]) < reach + 1e-9).all()


def test_a_hopping_ball_meets_no_cloth() -> None:
    times = np.linspace(0, 0.06, 7)
    shot = Shot(("white",), np.zeros((1, 2)), np.array([[2.0, 0.0]]), np.array([[0.0, 0.0, 40.0]]), times)
    track = simulate(model("cue_hop", {"time_per_speed": 0.02}), [shot])[0]
    flies = times <= 0.04
    assert (track.velocity[flies, 0, 0] == 2.0).all()
    assert np.abs(track.spin[flies, 0, 2] - 40.0).max() < 1e-12
    assert track.velocity[-1, 0, 0] == pytest.approx(2.0 - 0.02 * 0.212 * 9.81, abs=1e-9)
    assert track.spin[-1, 0, 2] == pytest.approx(40.0 - 0.02 * 22.0, abs=1e-9)


def test_a_ball_at_rest_stays_there_under_the_nap() -> None:
    shot = Shot(("white",), np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 3)), np.linspace(0, 5, 3))
    assert not simulate(model("cloth_nap", {"push": 0.1}), [shot])[0].position.any()


def test_slip_and_sidespin_share_their_friction() -> None:
    """At the start each has the share that the lever says."""
    u, wz, h = 1.0, 100.0, 1e-4
    shot = Shot(("white",), np.zeros((1, 2)), np.array([[u, 0.0]]), np.array([[0.0, 0.0, wz]]), np.array([0.0, h]))
    track = simulate(model("spin_slide_coupling", {"lever": 0.01}), [shot])[0]
    assert (u - track.velocity[1, 0, 0]) / h == pytest.approx(0.212 * 9.81 / np.sqrt(2), rel=1e-3)
    assert (wz - track.spin[1, 0, 2]) / h == pytest.approx(22.0 / np.sqrt(2), rel=1e-3)


@pytest.mark.parametrize("rate", [-0.01, 0.01])
def test_no_friction_drives_a_sliding_ball(rate: float) -> None:
    """At any bound, however fast it is and turns: what bends its path is friction, and takes energy."""
    v, w = np.array([[6.0, 2.0]]), np.array([[-60.0, 150.0, 200.0]])
    shot = Shot(("white",), np.zeros((1, 2)), v, w, np.linspace(0, 1.0, 101))
    wide = dataclasses.replace(model("slide_curve", {"rate": rate}), table=Table(10.0, 10.0, False))
    track = simulate(wide, [shot])[0]
    whole = np.sum(track.velocity[:, 0] ** 2, axis=1) + 0.4 * BALL.radius**2 * np.sum(track.spin[:, 0] ** 2, axis=1)
    assert (np.diff(whole) <= 0.0).all()


@pytest.mark.parametrize("name", ["side_curve", "air_drag", "slide_friction_speed", "off_centre_ball"])
@pytest.mark.parametrize("gap", [0.0, -1e-4, -0.02])
def test_balls_that_touch_from_the_start_part_as_without_the_effect(name: str, gap: float) -> None:
    places = np.array([[0.0, 0.0], [BALL.diameter + gap, 0.0]])
    shot = Shot(("a", "b"), places, np.array([[0.9, 0.3], [0.0, 0.0]]), np.zeros((2, 3)), np.linspace(0, 0.3, 10))
    usual = base()
    plain, varied = (simulate(m, [shot])[0] for m in (usual, usual.add(effect_class(name)())))
    assert len(varied.events) == len(plain.events) == 1
    assert np.abs(varied.position - plain.position).max() < 0.01
