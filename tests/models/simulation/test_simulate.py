"""Whole shots on both engines: closed form of the cloth, invariants, the same bytes every time, faults named."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from models.model_file import Model, full_model
from models.shot import GRAVITY, Array, Ball, Shot, Table, Track
from models.simulation.simulate import simulate

Play = Callable[..., list[Track]]
SNOOKER = Ball(0.0525, 0.1406)
CAROM = full_model(Table(2.84, 1.42, pockets=False), Ball(0.0615, 0.21))
POCKETS = full_model(Table(3.569, 1.778), SNOOKER)
OPEN = Table(40.0, 40.0, pockets=False)  # no cushion within reach
TIMES = np.linspace(0, 3, 61)
LAW = (0.2, 0.0135, 22.0)  # slide, roll, sidespin deceleration [rad/s^2]
SHOTS = {  # velocity [m/s], spin [rad/s]
    "stun": ((2.0, 0.0), (0.0, 0.0, 0.0)),
    "side": ((2.0, 0.0), (0.0, 0.0, 60.0)),
    "roll": ((1.0, 0.0), (0.0, 1.0 / SNOOKER.radius, 0.0)),
    "swerve": ((2.0, 0.0), (30.0, 0.0, 60.0)),
    "draw": ((1.0, 0.5), (20.0, -60.0, -30.0)),
}


def alone(velocity: tuple[float, float], spin: tuple[float, float, float], times: Array = TIMES) -> Shot:
    """One ball from the centre."""
    return Shot(("white",), np.zeros((1, 2)), np.array([velocity]), np.array([spin]), times)


def cloth_model(slide: float, roll: float, spin: float, table: Table = OPEN) -> Model:
    """The full model with these constants of the cloth."""
    values = {"decoupled_cloth.slide": slide, "decoupled_cloth.roll": roll, "decoupled_cloth.spin": spin}
    return full_model(table, SNOOKER).with_values(values)


def closed_form(shot: Shot, slide: float, roll: float, alpha: float) -> tuple[Array, Array]:
    """Position (n, 2) and sidespin (n,) of one ball: slide, then roll, sidespin on its own."""
    r, v0, w0 = SNOOKER.radius, shot.velocity[0], shot.spin[0]
    u0 = v0 + r * np.array([-w0[1], w0[0]])
    size = float(np.hypot(*u0))
    way = u0 / size if size else u0
    ts = 2 * size / (7 * slide * GRAVITY)
    t = np.minimum(shot.times, ts)[:, None]
    place = shot.position[0] + v0 * t - 0.5 * slide * GRAVITY * way * t**2
    v = v0 - slide * GRAVITY * way * ts
    speed = float(np.hypot(*v))
    t = np.clip(shot.times - ts, 0, speed / (roll * GRAVITY))[:, None]
    place = place + v * t - 0.5 * roll * GRAVITY * v / speed * t**2
    return place, np.sign(w0[2]) * np.maximum(abs(w0[2]) - alpha * shot.times, 0)


def break_shots(count: int, balls: int, model: Model = CAROM, seed: int = 5) -> list[Shot]:
    """Fast shots among resting balls, none overlapping, all on the table."""
    noise, made = np.random.default_rng(seed), []
    reach, apart = model.table.centre_limits(model.ball) - 0.1, model.ball.diameter + 0.01
    while len(made) < count:
        xy = noise.uniform(-reach, reach, (balls, 2))
        if any(np.hypot(*(a - b)) < apart for a, b in itertools.combinations(xy, 2)):
            continue
        v, w = np.zeros((balls, 2)), np.zeros((balls, 3))
        heading = noise.uniform(0, 2 * np.pi)
        v[0] = noise.uniform(1, 4) * np.array([np.cos(heading), np.sin(heading)])
        w[0] = noise.normal(0, 30, 3)
        made.append(Shot(tuple(f"red {k}" for k in range(balls)), xy, v, w, TIMES))
    return made


def blob(track: Track) -> bytes:
    """Every number of a track, and its events."""
    parts = (track.position, track.velocity, track.spin, track.theta)
    return b"".join(a.tobytes() for a in parts) + repr(track.events).encode()


def energy(track: Track, ball: Ball) -> Array:
    """Kinetic energy of all balls over M/2: (n,) [m^2/s^2]."""
    rolling = np.sum(track.velocity**2, axis=-1) + 0.4 * ball.radius**2 * np.sum(track.spin**2, axis=-1)
    return np.asarray(np.nansum(rolling, axis=1))


@pytest.fixture(params=["events", "mujoco"])
def play(request: pytest.FixtureRequest) -> Play:
    """Either engine."""

    def on(model: Model, shots: list[Shot], **more: Any) -> list[Track]:
        return simulate(dataclasses.replace(model, engine=request.param), shots, **more)

    on.exact = request.param == "events"  # type: ignore[attr-defined]
    return on


def is_exact(play: Play) -> bool:
    """Whether an engine carries balls from event to event in closed form, and not in steps."""
    return bool(play.exact)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", SHOTS)
def test_cloth_follows_the_closed_form(play: Play, name: str) -> None:
    shot = alone(*SHOTS[name])
    place, side = closed_form(shot, *LAW)
    track = play(cloth_model(*LAW), [shot])[0]
    assert np.abs(track.position[:, 0] - place).max() < (1e-11 if is_exact(play) else 1e-6)
    assert np.abs(track.spin[:, 0, 2] - side).max() < (1e-10 if is_exact(play) else 1e-3)
    turned = SHOTS[name][1][2] * TIMES - 0.5 * LAW[2] * np.sign(SHOTS[name][1][2]) * TIMES**2
    spinning = np.abs(SHOTS[name][1][2]) > LAW[2] * TIMES
    assert np.abs(track.theta[spinning, 0] - turned[spinning]).max(initial=0.0) < 1e-7


def test_native_contact_is_wrong_by_centimetres_for_a_spinning_ball() -> None:
    native = Model(OPEN, SNOOKER).with_values(
        dict(zip(("native.slide", "native.roll", "native.spin"), LAW, strict=True))
    )
    off = {}
    for name in ("stun", "side", "roll"):
        shot = alone(*SHOTS[name])
        off[name] = np.abs(simulate(native, [shot])[0].position[:, 0] - closed_form(shot, *LAW)[0]).max()
    assert 0.05 < off["side"] < 0.3, "all friction of one contact shares one cone"
    assert off["stun"] < 0.03
    assert off["roll"] < 0.03


def test_every_run_gives_the_same_bytes(play: Play) -> None:
    shots = break_shots(12, 4)
    once, again, single, many = (
        [blob(t) for t in play(CAROM, shots, threads=n)] for n in (2, 2, 1, 5)
    )  # fmt: skip
    assert once == again == single == many


def test_a_shot_does_not_depend_on_what_else_is_played(play: Play) -> None:
    shots = break_shots(6, 4) + break_shots(3, 2, seed=6)
    together = play(CAROM, shots)
    assert [len(t.names) for t in together] == [4] * 6 + [2] * 3
    assert [blob(t) for t in play(CAROM, shots[::-1])] == [blob(t) for t in together[::-1]]
    for shot, track in zip(shots, together, strict=True):
        assert blob(play(CAROM, [shot])[0]) == blob(track)


def test_times_asked_for_do_not_change_the_shot(play: Play) -> None:
    shots = break_shots(8, 3)
    dense = [dataclasses.replace(s, times=np.linspace(0, 3, 601)) for s in shots]
    for usual, fine in zip(play(CAROM, shots), play(CAROM, dense), strict=True):
        assert fine.position[::10] == pytest.approx(usual.position, abs=1e-9)


@pytest.mark.parametrize("model", [CAROM, POCKETS], ids=["carom", "pockets"])
def test_energy_never_rises(play: Play, model: Model) -> None:
    for track in play(model, break_shots(60, 4, model)):
        seen = energy(track, model.ball)
        before = np.maximum(seen[1:-1], seen[:-2])  # a contact of MuJoCo's may hold some for a moment
        assert np.all(seen[2:] - before <= (1e-9 if is_exact(play) else 1e-3) * seen[0])


def test_balls_stay_apart_and_on_the_table(play: Play) -> None:
    reach = CAROM.table.centre_limits(CAROM.ball)
    for track in play(CAROM, break_shots(60, 4)):
        give = 1e-9 if is_exact(play) else 1e-3  # of a contact
        assert np.all(np.abs(track.position) <= reach + give)
        for i, j in itertools.combinations(range(4), 2):
            gap = np.hypot(*(track.position[:, i] - track.position[:, j]).T) - CAROM.ball.diameter
            assert gap.min() > -give


@pytest.mark.parametrize("axis", [0, 1])
def test_mirrored_shots_have_mirrored_tracks(play: Play, axis: int) -> None:
    flip, turn = np.ones(2), -np.ones(3)  # spin is an axial vector
    flip[axis], turn[axis] = -1, 1
    shots = [dataclasses.replace(s, times=TIMES[:41]) for s in break_shots(30, 4)]
    mirrored = [
        dataclasses.replace(s, position=s.position * flip, velocity=s.velocity * flip, spin=s.spin * turn)
        for s in shots
    ]
    far = []
    for one, other in zip(play(CAROM, shots), play(CAROM, mirrored), strict=True):
        far.append(np.abs(one.position - other.position * flip).max())
        assert [e.kind for e in one.events] == [e.kind for e in other.events]
    assert np.max(far) < 1e-7
    assert np.median(far) < 1e-11


def test_a_track_is_smooth_in_a_parameter(play: Play) -> None:
    # Two balls and a cushion; sliding friction from 0.19 to 0.21 in 200 steps.
    slide, n = np.linspace(0.19, 0.21, 201), 201
    xy = np.array([[-0.6, 0.0], [0.0, 0.02]])
    shot = Shot(("white", "red"), xy, np.array([[2.0, 0], [0, 0]]), np.array([[0, 20.0, 30], [0, 0, 0]]), TIMES[:41])
    tracks = play(CAROM.with_values({"decoupled_cloth.slide": slide}), [shot] * n)
    kinds = {tuple((e.kind, e.rail) for e in t.events) for t in tracks}
    assert len(kinds) == 1
    assert {"ball", "cushion"} <= {kind for kind, _ in next(iter(kinds))}
    ends = np.array([t.position[-1] for t in tracks]).reshape(n, -1)
    assert np.abs(np.diff(ends, axis=0)).max() > 1e-5, "the parameter matters"
    assert np.abs(np.diff(ends, n=2, axis=0)).max() < (1e-6 if is_exact(play) else 2e-4)


def test_events_come_in_order_and_name_their_balls(play: Play) -> None:
    tracks = play(POCKETS, break_shots(60, 4, POCKETS))
    kinds = set()
    for track in tracks:
        times = [e.time for e in track.events]
        assert times == sorted(times)
        for event in track.events:
            kinds.add(event.kind)
            assert len(event.balls) == (2 if event.kind == "ball" else 1)
            assert set(event.balls) <= set(track.names)
            assert (event.rail in ("+x", "-x", "+y", "-y")) == (event.kind == "cushion")
    assert kinds == {"ball", "cushion", "pocket"}


@pytest.mark.parametrize("model", [POCKETS, Model(POCKETS.table, SNOOKER)], ids=["full", "native"])
@pytest.mark.parametrize(("start", "velocity"), [((0.0, 0.3), (0.0, 1.5)), ((1.4, 0.5), (1.5, 1.5))])
def test_a_potted_ball_is_gone_for_good(play: Play, model: Model, start: Any, velocity: Any) -> None:
    xy, v = np.array([start, (-1.0, -0.5)]), np.array([velocity, (0.0, 0.0)])
    times = np.linspace(0, 1.5, 31)
    track = play(model, [Shot(("white", "red"), xy, v, np.zeros((2, 3)), times)])[0]
    assert [(e.kind, e.balls) for e in track.events if e.kind == "pocket"] == [("pocket", ("white",))]
    when = next(e.time for e in track.events if e.kind == "pocket")
    gone = times > when
    assert gone.any()
    for values in (track.position, track.velocity, track.spin):
        assert np.isnan(values[gone, 0]).all()
        assert np.isfinite(values[~gone, 0]).all()
        assert np.isfinite(values[:, 1]).all()


@pytest.mark.parametrize(("start", "velocity"), [((0.04, 0.3), (0.0, 1.5)), ((1.4, 0.5), (1.5, 1.5))])
def test_a_ball_that_is_known_to_stay_meets_cushions_where_mouths_are(play: Play, start: Any, velocity: Any) -> None:
    shot = Shot(("white",), np.array([start]), np.array([velocity]), np.zeros((1, 3)), np.linspace(0, 1.0, 21))
    closed = dataclasses.replace(POCKETS, table=dataclasses.replace(POCKETS.table, pockets=False))
    potted, stays = play(POCKETS, [shot, dataclasses.replace(shot, staying=("white",))])
    assert np.isnan(potted.position[-1]).all()
    assert {e.kind for e in stays.events} == {"cushion"}
    assert np.array_equal(stays.position, play(closed, [shot])[0].position)


@pytest.mark.parametrize("missing", ["decoupled_cloth", "ball_impact", "cushion_impact"])
def test_native_contacts_stand_in_for_a_missing_effect(missing: str) -> None:
    model = dataclasses.replace(CAROM, effects=tuple(e for e in CAROM.effects if e.name() != missing))
    shots = [dataclasses.replace(s, times=np.linspace(0, 1.2, 13)) for s in break_shots(3, 3)]
    reach = CAROM.table.centre_limits(CAROM.ball)
    for native, full in zip(simulate(model, shots), simulate(CAROM, shots), strict=True):
        assert np.isfinite(native.position).all()
        assert np.all(np.abs(native.position) <= reach + 0.01), "nothing leaves the table"
        assert native.position[1] == pytest.approx(full.position[1], abs=0.02)


def test_a_ball_at_rest_costs_nothing_and_stays(play: Play) -> None:
    shot = Shot(("red",), np.array([[0.2, 0.1]]), np.zeros((1, 2)), np.zeros((1, 3)), np.array([0.0, 100.0, 1000.0]))
    track = play(CAROM, [shot])[0]
    assert np.array_equal(track.position[:, 0], np.tile([0.2, 0.1], (3, 1)))


@pytest.mark.parametrize(("engine", "told"), [("events", [5]), ("mujoco", [3, 5])])
def test_progress_counts_the_shots_done(engine: str, told: list[int]) -> None:
    model, seen = dataclasses.replace(CAROM, engine=engine), []
    simulate(model, break_shots(3, 2) + break_shots(2, 3), seen.append)
    assert seen == told, "a batch of MuJoCo's has one number of balls"
    assert simulate(model, []) == []


GOOD = break_shots(1, 2)[0]
BAD = [
    ({"position": np.zeros((2, 3))}, r"shot 1: position has shape \(2, 3\); 2 balls need \(2, 2\)"),
    ({"velocity": np.zeros(2)}, r"shot 1: velocity has shape \(2,\)"),
    ({"spin": np.zeros((2, 2))}, r"shot 1: spin has shape \(2, 2\); 2 balls need \(2, 3\)"),
    ({"velocity": np.full((2, 2), np.nan)}, "shot 1: velocity holds nan; give finite numbers"),
    ({"times": np.array([0.0, np.inf])}, "shot 1: times holds inf"),
    ({"times": np.array([0.0, 1.0, 0.5])}, "shot 1: times go backwards"),
    ({"times": np.array([-1.0, 1.0])}, "shot 1: times go backwards or below 0"),
    ({"times": np.zeros((2, 2))}, "shot 1: times has shape"),
    ({"names": ()}, "shot 1 has no balls"),
]


@pytest.mark.parametrize(("change", "message"), BAD, ids=[message for _, message in BAD])
def test_a_bad_shot_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate(CAROM, [GOOD, dataclasses.replace(GOOD, **change)])


def test_parameters_of_another_length_are_named() -> None:
    model = CAROM.with_values({"ball_impact.friction": np.full(3, 0.05)})
    with pytest.raises(ValueError, match=r"ball_impact\.friction has shape \(3,\); .* each of 2 shots"):
        simulate(model, [GOOD, GOOD])
