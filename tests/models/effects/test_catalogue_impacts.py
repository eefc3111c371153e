"""Effects at impacts: against an independent program, conservation, one value a simulation, and through contacts."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from models import record as rec
from models.analytic.impulse import ImpactLaw, collide
from models.effect import Effect
from models.effect_catalogue import effect_class
from models.engine.impacts import CLIMB_FRICTION, ask
from models.hooks import hooks_of
from models.model_file import Model, full_model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from tests.reference.ball_ball import SpeedFriction, collide_balls
from tests.truth import physics
from tests.truth.cloth import Constants
from tests.truth.impact import BALLS, impact

BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778, pockets=False)
R, CLOTH, E = BALL.radius, 0.212, 0.92
SCALE = np.tile([1, 1, R, R, R], 2)  # spins as R omega [m/s]
BASE = {
    "decoupled_cloth.slide": CLOTH, "decoupled_cloth.roll": 0.0127, "decoupled_cloth.spin": 22.0,
    "ball_impact.restitution": E, "ball_impact.friction": 0.05, "cushion_impact.restitution": 0.90,
    "cushion_impact.friction": 0.14,
}  # fmt: skip
BALL_CASES: list[tuple[str, dict[str, float], dict[str, float]]] = [
    ("ball_restitution_speed", {"rate": 0.06}, {"ebb_v": 0.06}),
    ("ball_friction_speed", {"gain": 0.108, "decay": 1.088}, {"mubb_b": 0.108, "mubb_c": 1.088}),
    ("ball_friction_speed", {"gain": 0.3, "decay": 0.8}, {"mubb_b": 0.3, "mubb_c": 0.8}),
    ("cue_ball_mass", {"factor": 1.05}, {"cue_mass": 1.05}),
    ("cue_ball_mass", {"factor": 0.85}, {"cue_mass": 0.85}),
]
CUSHION_CASES: list[tuple[str, dict[str, float], dict[str, float]]] = [
    ("cushion_friction_speed", {"rate": 0.06}, {"muc_v": 0.06}),
    ("cushion_friction_speed", {"rate": -0.2}, {"muc_v": -0.2}),  # beyond what a ball climbs at
    ("cushion_restitution_speed", {"rate": 0.09}, {"ec_v": 0.09}),
    ("cushion_restitution_speed", {"rate": -0.15}, {"ec_v": -0.15}),  # beyond 1
    ("cushion_compliance", {"ratio": 0.3}, {"compliance": 0.3}),
    ("cushion_compliance", {"ratio": 1.5}, {"compliance": 1.5}),
    ("cushion_compliance", {"ratio": 4.0}, {"compliance": 4.0}),
    ("soft_bed", {"share": 0.3}, {"bed": 0.3}),
    ("soft_bed", {"share": 1.0}, {"bed": 1.0}),
    ("cushion_contact_time", {"time": 0.006}, {"contact": 0.006}),
]
OF_BALLS = {name for name, _, _ in BALL_CASES}
CASES = [*BALL_CASES, *CUSHION_CASES]


def name_of(value: Any) -> str | None:
    """Of a case, for the test's name."""
    return value if isinstance(value, str) else "-".join(map(str, value.values())) if isinstance(value, dict) else None


def world(name: str = "", **values: Any) -> Model:
    """The base, and one effect."""
    base = full_model(TABLE, BALL).with_values(BASE)
    return base.add(effect_class(name)(**values)) if name else base


def shot(
    heading: float, offset: float, speed: float, spin: Array, until: float, gap: float = 0.1, count: int = 9
) -> Shot:
    """The white at a red `gap` ahead [m], whose centre is `offset` [m] to the left of its way."""
    way = np.array([np.cos(heading), np.sin(heading)])
    place = np.array([0 * way, gap * way + offset * np.array([-way[1], way[0]])])
    v, w = np.zeros((2, 2)), np.zeros((2, 3))
    v[0], w[0] = speed * way, spin
    return Shot(("white", "red"), place, v, w, np.linspace(0, until, count))


def at_balls() -> list[Shot]:
    """Slow and fast, full and thin, with spin."""
    noise = np.random.default_rng(4)
    return [
        shot(noise.uniform(-3, 3), cut, speed, noise.normal(0, 25, 3), 0.5)
        for cut, speed in ((0.0, 0.9), (0.015, 1.5), (-0.03, 1.0), (0.035, 2.6))
    ]


def at_cushions() -> list[Shot]:
    """Two balls that miss each other, one of them at a rail soon."""
    noise = np.random.default_rng(6)
    return [
        shot(heading, 0.2, speed, noise.normal(0, 25, 3), 1.5, gap=-0.2)
        for heading, speed in ((1.2, 1.2), (1.6, 2.6), (-2.1, 3.2), (-1.0, 1.6))
    ]


def truth(played: Shot, **hidden: float) -> Array:
    """Positions (n, 2, 2) [m] by the independent program."""
    starts = {
        n: physics.Start(tuple(p), tuple(v), tuple(w))
        for n, p, v, w in zip(played.names, played.position, played.velocity, played.spin, strict=True)
    }
    table = physics.Table(TABLE.length, TABLE.width, False)
    return physics.simulate(table, Constants(**hidden), starts, played.times, increments=20_000).xy


@pytest.mark.parametrize(("name", "values", "hidden"), CASES, ids=name_of)
def test_an_effect_is_what_the_hidden_one_is(name: str, values: dict[str, float], hidden: dict[str, float]) -> None:
    played = at_balls() if name in OF_BALLS else at_cushions()
    plain, seen = simulate(world(), played), simulate(world(name, **values), played)
    moved = [np.abs(a.position - b.position).max() for a, b in zip(plain, seen, strict=True)]
    off = [np.abs(truth(s, **hidden) - t.position).max() for s, t in zip(played, seen, strict=True)]
    assert max(moved) > 5e-3, "the effect shows in these shots"
    assert max(off) < 5e-4 * max(moved) + 1e-5


def random_state(noise: np.random.Generator, speed: float) -> Array:
    """The first ball on its way to the second, which may move too; spins [rad/s]."""
    phi, roll, side = noise.uniform(-1.3, 1.3), noise.choice([0.0, 1.0, noise.uniform(-1, 2)]), noise.uniform(-1, 1)
    c, s = np.cos(phi), np.sin(phi)
    first = speed * np.array([c, s, -roll * s, roll * c, side])
    second = noise.normal(0, 0.3 * speed, 5) * (noise.random() < 0.4)
    second[0] = min(second[0], 0.9 * first[0])
    return np.concatenate([first, second]) / SCALE


def after(state: Array, e: float, mu: tuple[float, float, float], ratio: float, cloth: float = CLOTH) -> Array:
    """The state after an impact of friction mu[0] + mu[1] exp(-mu[2] slip)."""
    out = state.copy()
    collide(False, out, ImpactLaw(e, mu[0], cloth, mu[1], mu[2], ratio), R, 4)
    return out


@pytest.mark.parametrize("mu", [(0.05, 0.0, 0.0), (0.01, 0.108, 1.088), (0.05, 0.4, 5.0), (0.2, -0.15, 0.5)])
@pytest.mark.parametrize("ratio", [0.8, 1.0, 1.02, 1.25])
def test_one_impact_is_what_small_increments_make_of_it(mu: tuple[float, float, float], ratio: float) -> None:
    noise = np.random.default_rng(2)
    mass = np.array([ratio * BALL.mass, BALL.mass])
    for speed in (0.3, 1.0, 1.0, 4.0, 4.0):
        state = random_state(noise, speed)
        coarse, fine = (
            impact(BALLS, state.reshape(2, 5), E, mu, CLOTH, mass, R, n).ravel() * SCALE for n in (10_000, 20_000)
        )
        assert after(state, E, mu, ratio) * SCALE == pytest.approx(2 * fine - coarse, abs=2e-5 * speed)


def test_friction_follows_the_slip_of_the_moment() -> None:
    """As `hit.gain` says it: balls slip less and grip more as they go, which makes a seventh of the throw here."""
    state = np.array([1.4, 1.4, 0, 0, 0, 0, 0, 0, 0, 0.0])
    law = (0.01, 0.108, 1.088)
    moment = after(state, E, law, 1.0)
    before = after(state, E, (law[0] + law[1] * np.exp(-law[2] * 1.4), 0.0, 0.0), 1.0)
    assert before[6] == pytest.approx(0.87 * moment[6], rel=0.02)
    mathavan = collide_balls(
        (1.4, 1.4), (0, 0, 0), (0, 0), (0, 0, 0), (1, 0), BALL, restitution=E, friction=SpeedFriction(*law), cloth=CLOTH
    )
    assert mathavan[2] == pytest.approx(moment[5:7], abs=1e-15)


@pytest.mark.parametrize("ratio", [0.8, 1.02, 1.25])
def test_full_hits_follow_newton(ratio: float) -> None:
    state = np.array([2.0, 0, 0, 0, 0, -0.5, 0, 0, 0, 0])
    out = after(state, E, (0.0, 0.0, 0.0), ratio)
    middle = (2.0 * ratio - 0.5) / (ratio + 1)
    assert out[0] == pytest.approx(middle - E * 2.5 / (ratio + 1), abs=1e-9)
    assert out[5] == pytest.approx(middle + E * 2.5 * ratio / (ratio + 1), abs=1e-9)


@pytest.mark.parametrize("gain", [0.0, 0.3])
@pytest.mark.parametrize("ratio", [0.8, 1.25])
def test_what_unequal_balls_keep(ratio: float, gain: float) -> None:
    """Momentum; spin about the line of centres; energy never rises; who is called first does not matter."""
    noise = np.random.default_rng(9)
    weight = np.array([ratio] * 5 + [1.0] * 5)
    for _ in range(60):
        state, mu = random_state(noise, 1.0), (0.06, gain, 2.0)
        out = after(state, E, mu, ratio, cloth=0.0)
        for part in (slice(0, 10, 5), slice(1, 10, 5)):
            assert (out * weight)[part].sum() == pytest.approx((state * weight)[part].sum(), abs=1e-12)
        assert out[[2, 7]] == pytest.approx(state[[2, 7]], abs=1e-12)
        change = (out - state) * weight
        # Friction at the point of contact: what it turns is R times what it pushes, of both balls alike.
        assert 0.4 * R * change[[4, 9]] == pytest.approx([change[1], -change[6]], abs=1e-12)
        assert 0.4 * R * change[3] == pytest.approx(0.4 * R * change[8], abs=1e-12)
        kinetic = [float(np.sum(weight * np.tile([1, 1, 0.4, 0.4, 0.4], 2) * (x * SCALE) ** 2)) for x in (state, out)]
        assert kinetic[1] <= kinetic[0] + 1e-12
        # Seen from the other ball, both axes turn by half a circle.
        turned = np.concatenate([state[5:], state[:5]]) * np.tile([-1, -1, -1, -1, 1], 2)
        for cloth in (0.0, CLOTH):
            one, two = after(state, E, mu, ratio, cloth), after(turned, E, mu, 1 / ratio, cloth)
            two = np.concatenate([two[5:], two[:5]]) * np.tile([-1, -1, -1, -1, 1], 2)
            assert two * SCALE == pytest.approx(one * SCALE, abs=1e-7)


def test_without_gain_and_with_equal_masses_an_impact_is_the_same_to_the_last_bit() -> None:
    noise = np.random.default_rng(1)
    for _ in range(50):
        state = random_state(noise, 1.0)
        plain = state.copy()
        collide(False, plain, ImpactLaw(E, 0.05, CLOTH), R)
        assert plain.tobytes() == after(state, E, (0.05, 0.0, 3.0), 1.0).tobytes()


def numbers(track: Track) -> bytes:
    return b"".join(a.tobytes() for a in (track.position, track.velocity, track.spin, track.theta))


@pytest.mark.parametrize("engine", ["events", "mujoco"])
@pytest.mark.parametrize(("name", "values", "hidden"), CASES, ids=name_of)
def test_one_value_a_simulation(name: str, values: dict[str, float], hidden: dict[str, float], engine: str) -> None:
    played = (at_balls() if name in OF_BALLS else at_cushions())[:3]
    kind: type[Effect] = effect_class(name)
    off = {k: m["default"] if m["off"] is None else m["off"] for k, m in kind.parameters().items()}
    rows = [values, off, {k: 0.5 * (values[k] + off[k]) for k in values}]
    each = {k: np.array([r[k] for r in rows]) for k in values}

    def played_by(model: Model, some: list[Shot]) -> list[Track]:
        return simulate(dataclasses.replace(model, engine=engine), some)

    together = played_by(world(name, **each), played)
    for k, row in enumerate(rows):
        alone = played_by(world("" if row is off else name, **({} if row is off else row)), [played[k]])[0]
        assert numbers(together[k]) == numbers(alone)


def test_a_heavy_ball_in_a_cluster_keeps_momentum() -> None:
    d, factor = 2 * R * (1 + 1e-12), 1.2
    place = np.array([[-d * np.cos(np.pi / 6) - 1e-3, 0], [0, d / 2], [0, -d / 2]])
    v = np.array([[1.0, 0], [0, 0], [0, 0]])
    met = Shot(("white", "a", "b"), place, v, np.zeros((3, 3)), np.array([0.0, 2e-3]))
    frictionless = {"decoupled_cloth.slide": 0.05, "ball_impact.friction": 0.0}
    out = simulate(world("cue_ball_mass", factor=factor).with_values(frictionless), [met])[0].velocity[-1]
    total = factor * out[0] + out[1] + out[2]
    assert total == pytest.approx([factor, 0.0], abs=0.05 * 9.81 * 2e-3 * 3 * factor)
    kinetic = [factor * x[0] @ x[0] + x[1] @ x[1] + x[2] @ x[2] for x in (v, out)]
    assert 0.7 * kinetic[0] < kinetic[1] < kinetic[0]
    equal = simulate(world().with_values(frictionless), [met])[0].velocity[-1]
    assert out[0, 0] > equal[0, 0] + 0.02, "a heavy ball goes on further"


def test_a_heavy_ball_comes_off_a_cushion_as_any_other() -> None:
    played = at_cushions()[:2]
    both = simulate(world("cue_ball_mass", factor=1.2), played), simulate(world(), played)
    for one, other in zip(*both, strict=True):
        assert np.array_equal(one.position, other.position)


def asked(effects: list[Effect], cushion: bool, approach: float, first: int = 0, second: int = 1) -> Array:
    """What effects say of an impact, each in its turn: a record of models.hooks.ImpactState."""
    hit = np.zeros(rec.IMPACT_FIELDS)
    hit[[rec.CUSHION_HIT, rec.APPROACH, rec.FIRST, rec.SECOND, rec.MASS_FIRST, rec.MASS_SECOND]] = (
        cushion,
        approach,
        first,
        second,
        1.0,
        1.0,
    )
    hooks = hooks_of(effects, 1)
    ask(hit, hooks.own.ctypes.data, hooks.impact)
    return hit


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    ("name", "kind", "field", "most"),
    [
        ("ball_restitution_speed", "ball", "restitution", 1.0),
        ("cushion_restitution_speed", "cushion", "restitution", 1.0),
        ("cushion_friction_speed", "cushion", "friction", CLIMB_FRICTION),
    ],
)
def test_coefficients_stay_where_they_mean_something(
    name: str, kind: str, field: str, most: float, first: bool
) -> None:
    """In whatever order the effects speak; and each only of its own kind of impact."""
    base, where = effect_class(f"{kind}_impact")(restitution=0.9, friction=0.14), {"restitution": rec.RESTITUTION}
    usual, at = getattr(base, field), where.get(field, rec.FRICTION)
    for speed, rate, expected in ((1.0, 0.2, usual), (1.5, 0.1, usual - 0.05), (9.0, 0.2, 0.0), (9.0, -0.2, most)):
        effect = effect_class(name)(rate=rate)
        both = [effect, base] if first else [base, effect]
        assert asked(both, kind == "cushion", speed)[at] == pytest.approx(max(expected, 0.0), abs=1e-12)
        assert asked([effect], kind != "cushion", speed)[at] == 0.0


def test_only_the_struck_ball_is_heavy() -> None:
    heavy = [effect_class("cue_ball_mass")(factor=1.2)]
    for cushion, first, second, masses in (
        (False, 0, 2, [1.2, 1.0]), (False, 1, 0, [1.0, 1.2]), (False, 1, 2, [1.0, 1.0]),
        (True, 0, 2, [1.2, 1.0]), (True, 1, 0, [1.0, 1.0]),
    ):  # fmt: skip
        assert asked(heavy, cushion, 1.0, first, second)[[rec.MASS_FIRST, rec.MASS_SECOND]].tolist() == masses
