"""Impacts through springs, the engine's and MuJoCo's: clusters of three and more; two bodies as by their impulse."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from models.model_file import Model, full_model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from sysid.validation.shots import impact_shot, impact_states

Play = Callable[..., list[Track]]
BALL, TABLE = Ball(0.0525, 0.1406), Table(2.0, 1.6, pockets=False)
D, REACH = BALL.diameter * (1 + 1e-12), float(TABLE.centre_limits(BALL)[0])


def model(e: float = 0.94, mu: float = 0.05, cushion: float = 0.98) -> Model:
    return full_model(TABLE, BALL).with_values(
        {"ball_impact.restitution": e, "ball_impact.friction": mu, "cushion_impact.restitution": cushion}
    )


@pytest.fixture(params=["events", "mujoco"])
def play(request: pytest.FixtureRequest) -> Play:
    """Either engine."""

    def on(world: Model, shots: list[Shot], **more: Any) -> list[Track]:
        return simulate(dataclasses.replace(world, engine=request.param), shots, **more)

    return on


def in_mujoco(world: Model, shots: list[Shot]) -> list[Track]:
    """Moved by MuJoCo, through its contacts."""
    return simulate(dataclasses.replace(world, engine="mujoco"), shots)


def met(
    play: Play, places: list[tuple[float, float]], velocity: tuple[float, float], world: Model | None = None,
    after: float = 2e-3,
) -> Track:  # fmt: skip
    """What comes of a ball, the first, that is a millimetre from others at rest."""
    n = len(places)
    v = np.zeros((n, 2))
    v[0] = velocity
    shot = Shot(tuple("abcdefgh"[:n]), np.array(places), v, np.zeros((n, 3)), np.array([0.0, after]))
    return play(world or model(), [shot])[0]


def energy(track: Track, k: int) -> float:
    r2 = 0.4 * BALL.radius**2
    return float(np.sum(track.velocity[k] ** 2) + r2 * np.sum(track.spin[k] ** 2)) * 0.5 * BALL.mass


CLUSTERS = {
    "row of three": [(-D - 1e-3, 0), (0, 0), (D, 0)],
    "row of five": [(-D - 1e-3, 0), (0, 0), (D, 0), (2 * D, 0), (3 * D, 0)],
    "two at once": [(-D * np.cos(np.pi / 6) - 1e-3, 0), (0, D / 2), (0, -D / 2)],
    "triangle": [(-D - 1e-3, 0.002), (0, 0), (D * 0.8660254, D / 2), (D * 0.8660254, -D / 2)],
}


@pytest.mark.parametrize("name", CLUSTERS)
def test_momentum_stays_and_energy_falls(play: Play, name: str) -> None:
    world = model().with_values({"decoupled_cloth.slide": 0.05, "ball_impact.friction": 0.0})
    track = met(play, CLUSTERS[name], (1.0, 0.0), world)
    lost = 0.05 * 9.81 * 2e-3 * len(CLUSTERS[name])  # at most, to the cloth
    assert track.velocity[-1].sum(axis=0) == pytest.approx([1.0, 0.0], abs=lost)
    assert energy(track, -1) < energy(track, 0)
    assert energy(track, -1) > 0.6 * energy(track, 0)


def test_a_row_hands_the_speed_to_its_last_ball(play: Play) -> None:
    three, five = (met(play, CLUSTERS[k], (1.0, 0.0)).velocity[-1, :, 0] for k in ("row of three", "row of five"))
    assert 0.90 < three[-1] < 0.95
    assert 0.83 < five[-1] < 0.95
    assert np.all(np.diff(five) > 0)  # nothing still presses


def test_what_is_symmetric_stays_so(play: Play) -> None:
    v = met(play, CLUSTERS["two at once"], (1.0, 0.0)).velocity[-1]
    assert v[1] == pytest.approx(v[2] * [1, -1], abs=1e-9)
    assert v[0, 1] == pytest.approx(0.0, abs=1e-9)
    # Two frictionless spheres at 30 degrees, hit without loss: 4/5 of the speed along their lines, and -1/5.
    ideal = met(play, CLUSTERS["two at once"], (1.0, 0.0), model(1.0, 0.0).with_values({"decoupled_cloth.slide": 0.05}))
    assert ideal.velocity[-1, 0, 0] == pytest.approx(-0.2, abs=3e-3)
    assert ideal.velocity[-1, 1, 0] == pytest.approx(0.6, abs=3e-3)


def test_order_of_the_balls_does_not_matter(play: Play) -> None:
    places = CLUSTERS["triangle"]
    swapped = [places[k] for k in (0, 3, 1, 2)]
    one, other = met(play, places, (1.0, 0.2)), met(play, swapped, (1.0, 0.2))
    assert other.velocity[-1][[0, 2, 3, 1]] == pytest.approx(one.velocity[-1], abs=1e-9)


def test_a_ball_frozen_to_a_cushion(play: Play) -> None:
    straight = met(play, [(REACH - D - 1e-3, 0), (REACH, 0)], (1.0, 0.0)).velocity[-1]
    assert straight[0, 0] == pytest.approx(-0.78, abs=0.02)  # the impulse goes through to the rail and comes back
    assert -0.2 < straight[1, 0] <= 0.0
    along = met(play, [(REACH, -D - 1e-3), (REACH, 0)], (0.0, 1.0)).velocity[-1]
    assert along[1] == pytest.approx([0.0, 0.967], abs=5e-3)


FROZEN = [(REACH - D - 1e-3, 0), (REACH, 0)]


@pytest.mark.parametrize("spin", [(0.0, 0.0, 0.0), (20.0, 40.0, -30.0)])
@pytest.mark.parametrize("places", [*CLUSTERS.values(), FROZEN], ids=[*CLUSTERS, "frozen"])
def test_both_engines_make_the_same_of_a_cluster(
    places: list[tuple[float, float]], spin: tuple[float, float, float]
) -> None:
    """The same springs: steps that begin elsewhere, and balls that MuJoCo turns meanwhile, make the difference."""
    n = len(places)
    v, w = np.zeros((n, 2)), np.zeros((n, 3))
    v[0], w[0] = (1.5, 0.1), spin
    shot = Shot(tuple("abcde"[:n]), np.array(places), v, w, np.array([0.0, 2e-3, 0.3]))
    one, other = (simulate(dataclasses.replace(model(), engine=e), [shot])[0] for e in ("events", "mujoco"))
    near = 0.004 * 1.5
    assert one.velocity[1] == pytest.approx(other.velocity[1], abs=near)
    assert BALL.radius * one.spin[1] == pytest.approx(BALL.radius * other.spin[1], abs=near)
    assert one.position[2] == pytest.approx(other.position[2], abs=0.3 * near)
    assert {name for e in one.events for name in e.balls} == {name for e in other.events for name in e.balls}


def test_a_corner_is_met_by_both_cushions_at_once(play: Play) -> None:
    top = float(TABLE.centre_limits(BALL)[1])
    frictionless = full_model(TABLE, BALL).with_values(
        {"cushion_impact.restitution": 1.0, "cushion_impact.friction": 0.0, "decoupled_cloth.slide": 0.05}
    )
    track = met(play, [(REACH - 1e-3, top - 1e-3)], (1.0, 1.0), frictionless)
    assert track.velocity[-1, 0] == pytest.approx([-1.0, -1.0], rel=0.06)
    assert {e.rail for e in track.events} == {"+x", "+y"}


def test_a_break_keeps_its_momentum_and_order(play: Play) -> None:
    rng = np.random.default_rng(0)
    gap = D * (1 + 1e-6)
    rack = [(row * gap * np.sqrt(3) / 2, (k - row / 2) * gap) for row in range(5) for k in range(row + 1)]
    rack = [tuple(np.array(xy) + rng.uniform(-1, 1, 2) * 1e-8) for xy in rack]
    shot = Shot(
        tuple(f"{i}" for i in range(16)), np.array([(-0.06, 0.004), *rack]), np.array([(8.0, 0.0), *[(0, 0)] * 15]),
        np.zeros((16, 3)), np.array([0.0, 4e-3]),
    )  # fmt: skip
    world = model(mu=0.0).with_values({"decoupled_cloth.slide": 0.05})
    one, two = (play(world, [shot] * 2, threads=n)[1] for n in (1, 2))
    assert one.position.tobytes() == two.position.tobytes()
    assert one.velocity[-1].sum(axis=0) == pytest.approx([8.0, 0.0], abs=0.05)
    assert energy(one, -1) < energy(one, 0)
    assert len({name for e in one.events for name in e.balls}) == 16
    apart = np.linalg.norm(one.position[-1][:, None] - one.position[-1], axis=-1) + np.eye(16)
    assert apart.min() > D - 1e-4


@pytest.mark.parametrize("e", [0.5, 0.8, 0.9, 0.98])
def test_restitution_of_two_balls_knows_no_speed(e: float) -> None:
    for speed in (0.2, 1.0, 4.0):
        world = model(e, 0.0).with_values({"decoupled_cloth.slide": 0.05})
        track = met(in_mujoco, [(-D - 1e-6, 0), (0, 0)], (speed, 0.0), world, after=1e-6 / speed + 5e-4)
        v = track.velocity[-1, :, 0]
        assert v[1] - v[0] == pytest.approx(e * speed, abs=4e-3 * speed)


@pytest.mark.parametrize("kind", ["ball", "cushion"])
def test_two_bodies_come_out_as_by_their_impulse(kind: str) -> None:
    states = np.concatenate(impact_states(kind, 60))
    shots = [impact_shot(kind, v, angle, top, side, 6e-4) for v, angle, top, side in states]
    world = dataclasses.replace(model(0.89), table=Table(2.959, 1.473, pockets=False))
    tracks = in_mujoco(world, shots), simulate(world, shots, contacts="never")
    for scale, what in ((1.0, "velocity"), (BALL.radius, "spin")):
        error = scale * np.array(
            [np.abs(getattr(a, what)[-1] - getattr(b, what)[-1]).max() for a, b in zip(*tracks, strict=True)]
        )
        assert np.median(error / states[:, 0]) < 0.002
        assert np.max(error / states[:, 0]) < 0.005


def test_results_are_smooth_in_what_goes_in() -> None:
    def ends(kind: str, which: int) -> Array:
        state = np.repeat([[1.5, 0.5, 0.6, 0.4]], 60, axis=0)
        state[:, which] *= np.linspace(0.9995, 1.0005, 60)
        shots = [impact_shot(kind, v, angle, top, side, 6e-4) for v, angle, top, side in state]
        world = dataclasses.replace(model(0.89), table=Table(2.959, 1.473, pockets=False))
        tracks = in_mujoco(world, shots)
        return np.array([np.append(t.velocity[-1, 0], BALL.radius * t.spin[-1, 0]) for t in tracks])

    for kind in ("ball", "cushion"):
        for which in range(4):
            assert np.abs(np.diff(ends(kind, which), 2, axis=0)).max() < 1e-9


def test_balls_that_lean_on_each_other_are_one_event(play: Play) -> None:
    v, w = np.array([[0.5, 0.0], [0.3, 0.0]]), np.zeros((2, 3))
    w[:, 1] = v[:, 0] / BALL.radius
    w[0, 1] += 40.0  # topspin drives it into the other again and again
    shot = Shot(("a", "b"), np.array([[-0.6, 0.0], [-0.6 + D + 0.001, 0.0]]), v, w, np.array([0.0, 1.0]))
    track = play(model(), [shot])[0]
    assert 1 <= len(track.events) < 25


def test_an_unknown_way_through_contacts_is_named() -> None:
    shot = Shot(("a",), np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 3)), np.zeros(1))
    with pytest.raises(ValueError, match="contacts is 'some'; choose from clusters, never"):
        simulate(model(), [shot], contacts="some")


POCKETS = Table(3.569, 1.778)


@pytest.mark.parametrize(
    ("hanging", "start", "velocity"),
    [((1.7245, 0.874), (1.5245, 0.874), (1.0, 0.0)), ((0.05, 0.879), (0.05, 0.679), (0.0, 1.0))],
    ids=["corner", "middle"],
)
def test_a_ball_that_hangs_over_a_pocket_is_potted(
    play: Play, hanging: tuple[float, float], start: tuple[float, float], velocity: tuple[float, float]
) -> None:
    world = full_model(POCKETS, BALL)
    v = np.array([velocity, (0.0, 0.0)])
    shot = Shot(("white", "red"), np.array([start, hanging]), v, np.zeros((2, 3)), np.linspace(0, 1, 201))
    track = play(world, [shot])[0]
    assert np.nanmax(np.abs(track.velocity)) <= 1.0 + 1e-9
    assert ("pocket", ("red",)) in [(e.kind, e.balls) for e in track.events[:2]]  # in MuJoCo it falls at once


def test_potted_balls_are_gone_from_clusters(play: Play) -> None:
    world = full_model(POCKETS, BALL)
    row = [(-0.6, -0.3), (-0.4, -0.3), (-0.4 + D, -0.3), (-0.4 + 2 * D, -0.3)]
    places = np.array([(0.0, 0.6), (0.0, 0.3), *row])
    v = np.zeros((6, 2))
    v[0], v[1], v[2] = (0.0, 1.0), (0.0, 0.95), (0.45, 0.0)
    w = np.zeros((6, 3))
    w[:, 0], w[:, 1] = -v[:, 1] / BALL.radius, v[:, 0] / BALL.radius
    shot = Shot(tuple("abcdef"), places, v, w, np.linspace(0, 0.9, 181))
    track = play(world, [shot])[0]
    assert {e.balls for e in track.events if e.kind == "pocket"} == {("a",), ("b",)}
    assert sum(e.kind == "ball" for e in track.events) >= 3
    assert np.nanmax(np.abs(track.velocity)) <= 1.0 + 1e-9


def test_energy_never_rises_where_balls_are_packed(play: Play) -> None:
    rng = np.random.default_rng(4)
    world = model(0.95, 0.1, 0.9)
    shots = []
    while len(shots) < 24:
        places = rng.uniform(-0.16, 0.16, (6, 2)) + np.array([REACH - 0.2, 0.0])
        gaps = np.linalg.norm(places[:, None] - places, axis=-1) + np.eye(6)
        if gaps.min() < D or places[:, 0].max() > REACH:
            continue
        v, w = rng.normal(0, 1, (6, 2)), rng.normal(0, 40, (6, 3))
        shots.append(Shot(tuple("abcdef"), places, v, w, np.linspace(0, 0.4, 801)))
    for track in play(world, shots):
        energies = np.array([energy(track, k) for k in range(len(track.times))])
        before = np.maximum.reduce([energies[k : k - 3] for k in range(3)])  # a spring may hold some for a moment
        assert np.max(energies[3:] / before) < 1 + 1e-9
        assert np.max(track.position[..., 0]) < REACH + 5e-4  # no deeper than a cushion gives in an impact


def test_a_ball_that_spins_against_a_cushion_stays_outside_it(play: Play) -> None:
    spin = np.array([[0.0, 150.0, 0.0]])
    shot = Shot(("a",), np.array([[REACH, 0.0]]), np.zeros((1, 2)), spin, np.linspace(0, 1, 101))
    track = play(model(), [shot])[0]
    assert len(track.events) <= 2
    assert np.max(track.position[..., 0]) < REACH + 1e-5
    assert np.max(np.abs(track.velocity)) < 0.01
    pair = dataclasses.replace(
        shot, names=("a", "b"), position=np.array([[REACH - D, 0.0], [REACH, 0.0]]), velocity=np.zeros((2, 2)),
        spin=np.array([[0.0, 150.0, 0.0], [0.0, 0.0, 0.0]]),
    )  # fmt: skip
    assert np.max(np.abs(play(model(), [pair])[0].velocity)) < 0.02


def test_native_terms_may_differ_between_shots() -> None:
    places = CLUSTERS["row of three"]
    v = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    shot = Shot(tuple("abc"), np.array(places), v, np.zeros((3, 3)), np.array([0.0, 2e-3]))
    several = model().with_values({"native.ball_friction": np.array([0.2, 0.21])})
    one, other = simulate(several, [shot, shot])
    assert one.velocity.tobytes() == other.velocity.tobytes()


def test_native_impacts_on_exact_cloth_are_not_stepped_over() -> None:
    from models.effect_catalogue import effect_class

    cloth = Model(TABLE, BALL, effects=(effect_class("decoupled_cloth")(),))
    spin = np.array([[0.0, 180.0, 0.0]])  # topspin speeds it up
    shot = Shot(("a",), np.array([[-0.5, 0.0]]), np.array([[2.0, 0.0]]), spin, np.linspace(0, 1.5, 301))
    track = simulate(cloth, [shot])[0]
    assert np.max(track.position[..., 0]) < REACH + 2e-3
    assert np.max(np.abs(track.velocity)) < 3.5
