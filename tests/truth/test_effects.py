"""The hidden effects of the generator of clips with known truth, against closed forms and on numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.truth.camera import displaced, image, rolled, stamps
from tests.truth.cloth import GRAVITY, Constants
from tests.truth.effects import CAMERA, HIDDEN
from tests.truth.physics import Cue, Motion, Start, Table, simulate, strike
from tests.truth.shots import clip_constants
from tests.truth.sizes import KEPT, NATURAL, scaled

Array = NDArray[np.float64]

OPEN = Table(100.0, 100.0, pockets=False)
SQUARE = Table(2.0, 2.0, pockets=False)
R = 0.02625
BASE = Constants(radius=R, mus=0.212, spin=22.0)
BUSY: dict[str, Start] = {
    "cue": Start((-0.9, 0.1), (2.2, 0.35), (20.0, 50.0, 60.0)),
    "black": Start((0.1, 0.24)),
    "red": Start((1.3, 0.2)),
}


def play(c: Constants, balls: Mapping[str, Start], until: float, table: Table = OPEN) -> Motion:
    return simulate(table, c, balls, np.array([0.0, until]))


def turned(ball: Start) -> Start:
    """The same ball, turned half a circle about the table's centre, to the other two rails."""
    (x, y), (vx, vy), (wx, wy, wz) = ball.xy, ball.velocity, ball.omega
    return Start((-x, -y), (-vx, -vy), (-wx, -wy, wz))


def rolling(speed: float, spin: float = 0.0) -> dict[str, Start]:
    return {"cue": Start((0.0, 0.0), (speed, 0.0), (0.0, speed / R, spin))}


def gain(start: dict[str, Start], **effect: float) -> Array:
    """What an effect adds to the velocity in its first 10 ms, as an acceleration: (2,) [m/s^2]."""
    on, off = (play(c, start, 0.01).velocity[-1, 0] for c in (BASE._replace(**effect), BASE))
    return np.asarray(on - off) / 0.01


def test_effects_on_the_cloth() -> None:
    roll, slide = rolling(1.0), {"cue": Start((0.0, 0.0), (1.0, 0.0))}
    np.testing.assert_allclose(gain(roll, tilt_y=0.002), (0, 5 / 7 * GRAVITY * 0.002), atol=1e-4)
    np.testing.assert_allclose(gain(slide, tilt_x=0.002), (GRAVITY * 0.002, 0), atol=1e-4)
    push = 0.2 * BASE.mur * GRAVITY * np.array([math.cos(2.0), math.sin(2.0)])
    np.testing.assert_allclose(gain(roll, nap=0.2, nap_phi=2.0), 5 / 7 * push, atol=1e-4)
    np.testing.assert_allclose(gain(slide, nap=0.2, nap_phi=2.0), push, atol=5e-4)  # the slip turns a little
    np.testing.assert_allclose(gain(roll, drag1=0.03), (-0.03, 0), atol=1e-4)
    np.testing.assert_allclose(gain(slide, drag1=0.03), 0, atol=1e-12)
    np.testing.assert_allclose(gain(roll, drag2=0.03), (-0.03 * 5 / 7, 0), atol=1e-4)
    np.testing.assert_allclose(gain(slide, drag2=0.03), (-0.03, 0), atol=1e-3)
    np.testing.assert_allclose(gain(rolling(1.0, 40.0), swerve=0.002), (0, 0.08), atol=1e-3)


def test_spin_shares_the_sliding_friction() -> None:
    start = {"cue": Start((0.0, 0.0), (1.0, 0.0), (0.0, 0.0, 60.0))}
    twist = 0.012 * 60.0
    motion = play(BASE._replace(contensou=0.012), start, 0.005)
    share = 1.0 / math.hypot(1.0, twist)
    assert (1.0 - motion.velocity[-1, 0, 0]) / 0.005 == pytest.approx(BASE.mus * GRAVITY * share, rel=0.01)
    assert (60.0 - motion.omega[-1, 0, 2]) / 0.005 == pytest.approx(22.0 * twist * share, rel=0.02)


def test_effects_at_impacts() -> None:
    table = Table(2.0, 2.0, pockets=False)
    back = [
        play(BASE._replace(ec_v=k), {"cue": Start((0.9, 0.0), (v, 0.0), (0.0, v / R, 0.0))}, 0.2, table).velocity[
            -1, 0, 0
        ]
        for v in (0.9, 2.0)
        for k in (0.0, 0.1)
    ]
    assert back[1] < back[0] < 0
    assert back[2] < back[3] < 0
    stun = {"cue": Start((0.0, 0.0), (1.0, 0.0)), "red": Start((0.1, R))}
    plain, rough = (play(c, stun, 0.2).velocity[-1, 1] for c in (BASE, BASE._replace(mubb_b=0.1)))
    assert math.atan2(rough[1], rough[0]) < math.atan2(plain[1], plain[0])


@pytest.mark.parametrize("name", sorted(set(HIDDEN) - set(CAMERA) - {"squirt", "drying_cloth"}))
def test_every_effect_changes_a_shot_and_off_is_absent(name: str) -> None:
    """At its natural size, and at 1/16 of it less."""
    table = Table(pockets=False)
    assert set(HIDDEN[name]) <= set(Constants._fields)
    c = BASE._replace(mubb=NATURAL["ball_friction_speed"]["mubb"], patch_y=0.3)
    balls = {k: turned(b) for k, b in BUSY.items()} if name.endswith(("_mx", "_my")) else BUSY
    plain = play(c, balls, 3.0, table).xy[-1]
    on, little, off = (play(c._replace(**scaled(name, scale)), balls, 3.0, table).xy[-1] for scale in (1, 1 / 16, 0))
    assert np.max(np.abs(on - plain)) > 1e-3
    assert np.max(np.abs(little - plain)) < np.max(np.abs(on - plain)) / 4
    np.testing.assert_array_equal(off, plain)


def test_every_effect_has_a_natural_size() -> None:
    assert list(NATURAL) == list(HIDDEN)
    for name, values in NATURAL.items():
        assert set(values) - KEPT <= set(HIDDEN[name]), name
    assert scaled("clock_scale", 0.25)["clock"] == pytest.approx(1.003)
    assert scaled("cue_ball_mass", 1 / 16)["cue_mass"] == pytest.approx(1.00125)
    assert scaled("ball_friction_speed", 0.25) == {"mubb": 0.01, "mubb_b": 0.027, "mubb_c": 1.088}


@pytest.mark.parametrize("k", [0.12, -0.2, 0.3])
def test_sliding_friction_that_falls_with_the_slip(k: float) -> None:
    """du/dt = -(7/2) g mus (1 - k (u - 1)), so u - (1 + 1/k) grows at the rate (7/2) g mus k."""
    rate, until, u0 = 3.5 * GRAVITY * BASE.mus, 0.15, 2.0
    motion = play(BASE._replace(mus_v=k), {"cue": Start((0.0, 0.0), (u0, 0.0))}, until)
    rest = 1.0 + 1.0 / k
    u = rest + (u0 - rest) * math.exp(rate * k * until)
    assert motion.velocity[-1, 0, 0] - R * motion.omega[-1, 0, 1] == pytest.approx(u, abs=1e-6)
    assert motion.velocity[-1, 0, 0] == pytest.approx(u0 - 2 / 7 * (u0 - u), abs=1e-6)


def test_sliding_friction_keeps_a_twentieth() -> None:
    motion = play(BASE._replace(mus_v=2.0), {"cue": Start((0.0, 0.0), (3.0, 0.0))}, 0.1)
    assert motion.velocity[-1, 0, 0] == pytest.approx(3.0 - 0.05 * BASE.mus * GRAVITY * 0.1, abs=1e-9)


def test_sidespin_decays_faster_on_a_fast_ball() -> None:
    """alpha (1 + k v) over the run v t - a t^2 / 2."""
    k, until, a = 0.4, 1.0, BASE.mur * GRAVITY
    motion = play(BASE._replace(spin_v=k), rolling(1.0, 60.0), until)
    run = 1.0 * until - a * until**2 / 2
    assert motion.omega[-1, 0, 2] == pytest.approx(60.0 - 22.0 * (until + k * run), abs=1e-5)
    still = play(BASE._replace(spin_v=k), {"cue": Start((0.0, 0.0), omega=(0.0, 0.0, 44.0))}, 1.0)
    assert still.omega[-1, 0, 2] == pytest.approx(22.0, abs=1e-9)


def rebound(c: Constants, velocity: tuple[float, float], xy: tuple[float, float] = (0.9, 0.0)) -> Array:
    """State (vx, vy, wz) just after a ball with sidespin has met the +x cushion, or the one it runs at."""
    times = np.arange(0.0, 0.3, 1e-3)
    motion = simulate(SQUARE, c, {"cue": Start(xy, velocity, (0.0, 0.0, 30.0))}, times)
    after = int(np.searchsorted(times, motion.events[0].time))
    return np.append(motion.velocity[after, 0], motion.omega[after, 0, 2])


def test_cushion_constants_that_follow_the_approach() -> None:
    """As the constants themselves, at the approach speed of the moment."""
    c = BASE._replace(mus=1e-9, mur=0.0, spin=0.0)  # so that nothing changes the speed before the impact
    for speed in (0.5, 1.0, 1.8):
        v = (speed, 0.3)
        np.testing.assert_allclose(
            rebound(c._replace(muc_v=0.05), v), rebound(c._replace(muc=c.muc - 0.05 * (speed - 1)), v), atol=1e-5
        )
    np.testing.assert_allclose(rebound(c._replace(muc_v=0.5), (2.0, 0.3)), rebound(c._replace(muc=0.0), (2.0, 0.3)))


def test_one_rail_unlike_the_others() -> None:
    places = {0: ((0.9, 0.0), (1.0, 0.2)), 1: ((-0.9, 0.0), (-1.0, 0.2)), 2: ((0.0, 0.9), (0.2, 1.0))}
    places[3] = ((0.0, -0.9), (0.2, -1.0))
    for rail, (xy, v) in places.items():
        for other, name in enumerate(("px", "mx", "py", "my")):
            here = float(other == rail)
            made = rebound(BASE._replace(**{f"ec_{name}": -0.1}), v, xy)
            np.testing.assert_array_equal(made, rebound(BASE._replace(ec=BASE.ec - 0.1 * here), v, xy))
            made = rebound(BASE._replace(**{f"muc_{name}": 0.05}), v, xy)
            np.testing.assert_array_equal(made, rebound(BASE._replace(muc=BASE.muc + 0.05 * here), v, xy))


def test_cushions_soft_at_their_ends() -> None:
    for y in (0.0, 0.5, -0.8):
        made = rebound(BASE._replace(ends=0.1), (1.5, 0.0), (0.9, y))
        # Met at (2 s / L)^2 with s the place of the impact, which the sidespin leaves where it is.
        np.testing.assert_allclose(
            made, rebound(BASE._replace(ec=BASE.ec - 0.1 * y**2), (1.5, 0.0), (0.9, y)), atol=1e-6
        )


def head_on(c: Constants, speed: float) -> tuple[float, float]:
    """Speeds just after a sliding ball has met one that rests."""
    times = np.arange(0.0, 0.2, 1e-4)
    c = c._replace(mus=1e-9)
    balls = {"cue": Start((0.0, 0.0), (speed, 0.0)), "red": Start((2 * R + 0.05 * speed, 0.0))}
    motion = simulate(OPEN, c, balls, times)
    assert len(motion.events) == 1
    return float(motion.velocity[-1, 0, 0]), float(motion.velocity[-1, 1, 0])


def test_ball_restitution_falls_with_speed() -> None:
    for speed in (0.5, 1.0, 3.0):
        one, other = head_on(BASE._replace(ebb_v=0.05), speed)
        assert (other - one) / speed == pytest.approx(BASE.ebb - 0.05 * (speed - 1), abs=1e-6)
    one, other = head_on(BASE._replace(ebb_v=2.0), 3.0)
    assert one == pytest.approx(other, abs=1e-6)


def test_a_heavier_struck_ball() -> None:
    """Momentum is kept: k v = k v1 + v2 and v2 - v1 = e v."""
    for k in (1.02, 0.9, 2.0):
        one, other = head_on(BASE._replace(cue_mass=k), 1.0)
        assert k * one + other == pytest.approx(k, abs=1e-6)
        assert other - one == pytest.approx(BASE.ebb, abs=1e-6)
    stun = {"cue": Start((0.0, 0.0), (1.0, 0.4), (0.0, 0.0, 20.0))}
    np.testing.assert_allclose(  # alone on the cloth its mass is of no matter, at cushions neither
        play(BASE._replace(cue_mass=2.0), stun, 2.0, SQUARE).xy, play(BASE, stun, 2.0, SQUARE).xy, atol=1e-9
    )


def test_an_off_centre_ball_weaves() -> None:
    """Sideways v_y = g k R / v (1 - cos(v t / R)) as long as the ball hardly turns aside; the other ball does not."""
    c, t = BASE._replace(mur=0.0, off_centre=0.003), np.linspace(0.0, 0.5, 26)
    motion = simulate(OPEN, c, rolling(1.0), t)
    expected = GRAVITY * 0.003 * R * (1 - np.cos(t / R))
    np.testing.assert_allclose(motion.velocity[:, 0, 1], expected, atol=1e-5)
    pair = {"cue": Start((5.0, 5.0)), "red": rolling(1.0)["cue"]}
    assert np.all(simulate(OPEN, c, pair, t).xy[:, 1, 1] == 0.0)


def test_the_struck_ball_hops() -> None:
    """Unbraked for hop V0, then as from a start there; the spin waits too, the slope does not."""
    c, start = BASE._replace(hop=0.0125), Start((0.0, 0.0), (2.0, 0.0), (10.0, 0.0, 30.0))
    motion = simulate(OPEN, c, {"cue": start}, np.array([0.0, 0.0249, 0.525]))
    np.testing.assert_allclose(motion.velocity[1, 0], (2.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(motion.omega[1, 0], start.omega, atol=1e-12)
    assert motion.theta[1, 0] == pytest.approx(30.0 * 0.0249)
    later = play(BASE, {"cue": Start((0.05, 0.0), start.velocity, start.omega)}, 0.5)
    np.testing.assert_allclose(motion.xy[2], later.xy[1], atol=1e-9)
    down = play(c._replace(tilt_y=0.002, nap=0.2, nap_phi=1.0), {"cue": start}, 0.02)
    np.testing.assert_allclose(down.velocity[-1, 0], (2.0, GRAVITY * 0.002 * 0.02), atol=1e-12)


def test_squirt_throws_the_ball_to_the_other_side() -> None:
    ball = strike((0.0, 0.0), Cue(2.0, 0.5, side=0.004), R, 4.0)
    assert math.atan2(ball.velocity[1], ball.velocity[0]) == pytest.approx(0.5 + 0.016)
    assert math.hypot(*ball.velocity) == pytest.approx(2.0) and ball.omega[2] > 0.0


def test_cloth_that_resists_by_heading() -> None:
    for way, phi, sign in ((0.0, 0.0, 1.0), (math.pi / 4, 0.0, 0.0), (math.pi / 2, 0.0, -1.0), (0.6, 0.6, 1.0)):
        v = np.array([math.cos(way), math.sin(way)])
        start = {"cue": Start((0.0, 0.0), (v[0], v[1]), (-v[1] / R, v[0] / R, 0.0))}
        brake = -0.1 * sign * BASE.mur * GRAVITY * v
        np.testing.assert_allclose(gain(start, ripple=0.1, ripple_phi=phi), brake, atol=1e-9)


def test_a_struck_ball_that_the_cloth_brakes_more() -> None:
    roll, slide = rolling(1.0), {"cue": Start((0.0, 0.0), (1.0, 0.0))}
    np.testing.assert_allclose(gain(roll, cue_mur=0.1), (-0.1 * BASE.mur * GRAVITY, 0), atol=1e-9)
    np.testing.assert_allclose(gain(slide, cue_mus=0.1), (-0.1 * BASE.mus * GRAVITY, 0), atol=1e-9)
    for start in (roll, slide):
        pair = {"cue": Start((5.0, 5.0)), "red": start["cue"]}
        made, plain = (play(c, pair, 0.5).xy for c in (BASE._replace(cue_mur=0.1, cue_mus=0.1), BASE))
        np.testing.assert_array_equal(made, plain)


def test_sidespin_bends_a_slide() -> None:
    """A force at the lowest point: it pushes to the left by k omega_z v, and turns the ball by 5/2 of that over R."""
    slide = {"cue": Start((0.0, 0.0), (1.0, 0.0), (0.0, 0.0, 60.0))}
    np.testing.assert_allclose(gain(slide, slide_swerve=0.002), (0, 0.12), atol=0.01)
    on, off = (play(c, slide, 0.01).omega[-1, 0] for c in (BASE._replace(slide_swerve=0.002), BASE))
    assert (on - off)[0] / 0.01 == pytest.approx(2.5 * 0.12 / R, rel=0.08)
    assert np.all(gain(rolling(1.0, 60.0), slide_swerve=0.002) == 0.0)


def test_structures_on_the_cloth() -> None:
    roll, slide = rolling(1.0), {"cue": Start((0.0, 0.0), (1.0, 0.0))}
    here = {"patch": 0.5, "patch_x": 0.0, "patch_y": 0.1, "patch_r": 0.2}
    np.testing.assert_allclose(gain(roll, **here), (-0.5 * BASE.mur * GRAVITY, 0), atol=1e-9)
    np.testing.assert_allclose(gain(slide, **here), (-0.5 * BASE.mus * GRAVITY, 0), atol=1e-9)
    assert np.all(gain(roll, **{**here, "patch_y": 0.3}) == 0.0)
    brake = 0.3 * math.exp(-1.0 / 0.25) * BASE.mur * GRAVITY
    np.testing.assert_allclose(gain(roll, slow=0.3), (-brake, 0), rtol=0.01, atol=1e-12)


def test_a_crowned_slate() -> None:
    """Away from the centre a ball gains (5/7) g k per metre; where friction holds it, it stays."""
    k = 0.05
    start = Start((0.4, -0.2), (1e-9, 0.0), (0.0, 1e-9 / R, 0.0))
    motion = play(BASE._replace(crown=k, mur=0.0), {"cue": start}, 0.5)
    grow = math.sqrt(5 / 7 * GRAVITY * k)
    np.testing.assert_allclose(motion.xy[-1, 0], np.array([0.4, -0.2]) * math.cosh(grow * 0.5), atol=1e-5)
    creeping = Start((0.4, -0.2), (1e-3, 0.0), (0.0, 1e-3 / R, 0.0))
    held = simulate(OPEN, BASE._replace(crown=0.0008), {"cue": creeping}, np.array([0.0, 1.0, 2.0]))
    np.testing.assert_array_equal(held.xy[1], held.xy[2])


def test_a_ball_that_clings() -> None:
    c, rough = BASE._replace(cling=1.0), BASE._replace(mubb=2 * BASE.mubb)
    stun = {"cue": Start((0.0, 0.0), (1.0, 0.0)), "red": Start((0.1, R))}
    np.testing.assert_array_equal(play(c, stun, 0.2).velocity, play(rough, stun, 0.2).velocity)
    other = {"cue": stun["cue"], "black": stun["red"]}
    np.testing.assert_array_equal(play(c, other, 0.2).velocity, play(BASE, other, 0.2).velocity)


def test_constants_of_a_session() -> None:
    drying = [clip_constants(BASE._replace(wear=0.2), 3, k, 11).mur / BASE.mur for k in range(1, 12)]
    np.testing.assert_allclose(drying, np.linspace(1.0, 1.2, 11))
    assert clip_constants(BASE._replace(wear=0.2), 3, 1, 1).mur == BASE.mur
    clings = [clip_constants(BASE._replace(cling=1.0, cling_share=0.4), 3, k, 200).cling for k in range(1, 201)]
    assert set(clings) == {0.0, 1.0} and 0.3 < np.mean(clings) < 0.5
    assert clip_constants(BASE, 3, 5, 11) == BASE


def test_the_camera_on_numbers() -> None:
    xy, t = np.array([[[1.5, -0.8], [0.0, 0.5]]]), np.array([2.0])
    np.testing.assert_array_equal(image(xy, t, BASE), xy)
    np.testing.assert_array_equal(stamps(t, BASE), t)
    assert stamps(t, BASE._replace(clock=1.012))[0] == pytest.approx(2.024)
    for effect, factors in (
        ({"lens": 0.006}, (1 - 0.006 * 2.89, 1 - 0.006 * 0.25)),
        ({"lens": 0.006, "lens4": 0.001}, (1 - 0.006 * 2.89 - 0.001 * 2.89**2, 1 - 0.006 * 0.25 - 0.001 * 0.25**2)),
        ({"camera_tilt": 0.01}, (1 / (1 + 0.015 - 0.004), 1 / (1 + 0.0025))),
        ({"image_scale": 0.01}, (1.01, 1.01)),
        ({"image_aspect": 0.01}, ((1.01, 0.99), (1.01, 0.99))),
    ):
        made = image(xy, t, BASE._replace(**effect))
        np.testing.assert_allclose(made, xy * np.reshape(factors, (2, -1)), rtol=1e-12)
    shaken = image(xy, t, BASE._replace(shake=0.001, shake_hz=2.0), clip=3) - xy
    np.testing.assert_allclose(shaken[0], [[0.001 * math.sin(8 * math.pi + 7.2), 0.0]] * 2, atol=1e-12)


def test_a_rolling_shutter_reads_later_up_the_table() -> None:
    """Along y a rolling ball is seen where it is shutter y later, through cushions too, and not before it starts."""
    c, times = BASE._replace(shutter=0.0033), np.arange(0.0, 2.0, 0.01)
    table, balls = (
        Table(pockets=False),
        {"cue": Start((0.1, -0.3), (0.3, 1.5), (-1.5 / R, 0.3 / R, 0.0)), "red": Start((1.0, 0.0))},
    )
    plain = simulate(table, c, balls, times)
    seen = rolled(plain, table, c, balls)
    read = times + c.shutter * plain.xy[:, 0, 1]
    read[read < 0] = 0.0
    exact = simulate(table, c, balls, read).xy[:, 0]
    np.testing.assert_allclose(seen.xy[:, 0], exact, atol=1e-8)
    assert np.max(np.abs(seen.xy - plain.xy)) > 0.002 and plain.events
    np.testing.assert_array_equal(seen.xy[:, 1], plain.xy[:, 1])
    assert rolled(plain, table, BASE, balls) is plain


def test_outliers_are_few_and_far() -> None:
    xy = np.zeros((1000, 2, 2))
    far = np.hypot(*np.moveaxis(displaced(xy, 0.05, np.random.default_rng(1)), -1, 0))
    assert 0.03 < np.mean(far > 0) < 0.07
    assert np.all((far == 0) | ((far >= 0.02 - 1e-12) & (far <= 0.08 + 1e-12)))
