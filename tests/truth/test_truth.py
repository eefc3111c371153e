"""The physics behind clips with known truth: invariants, published figures, convergence.

Its hidden effects and what it writes are tested beside it, in `tests/truth/test_effects.py` and `test_files.py`.
"""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import tests.truth
from tests.truth.cloth import GRAVITY, Constants
from tests.truth.impact import BALLS, NOSE, impact
from tests.truth.physics import Cue, Motion, Start, Table, simulate, strike

Array = NDArray[np.float64]

PACKAGE = Path(tests.truth.__file__).parent
OPEN = Table(100.0, 100.0, pockets=False)
R = 0.02625
BASE = Constants(radius=R, mus=0.212, spin=22.0)
MASS = np.array([0.1406, 0.1406])
BUSY: dict[str, Start] = {
    "cue": Start((-0.9, 0.1), (2.2, 0.35), (20.0, 50.0, 60.0)),
    "red": Start((0.1, 0.24)),
    "black": Start((1.3, 0.2)),
}


def play(c: Constants, balls: Mapping[str, Start], until: float, table: Table = OPEN, step: float = 5e-5) -> Motion:
    return simulate(table, c, balls, np.array([0.0, until]), step)


def mirrored(ball: Start) -> Start:
    """The same ball seen in a mirror along the x axis."""
    (x, y), (vx, vy), (wx, wy, wz) = ball.xy, ball.velocity, ball.omega
    return Start((x, -y), (vx, -vy), (-wx, wy, -wz))


@pytest.mark.parametrize("step", [5e-5, 1e-5])
def test_energy_never_rises(step: float) -> None:
    times = np.arange(0.0, 4.0, 0.005)
    motion = simulate(Table(pockets=False), BASE, BUSY, times, step, increments=1000)
    energy = np.sum(motion.velocity**2, axis=(1, 2)) + 0.4 * R**2 * np.sum(motion.omega**2, axis=(1, 2))
    assert {e.kind for e in motion.events} == {"ball", "cushion"} and len(motion.events) >= 4
    assert np.all(np.diff(energy) <= 1e-12 * energy[0])


def test_mirror_symmetry() -> None:
    times = np.arange(0.0, 3.0, 0.01)
    table = Table(pockets=False)
    one = simulate(table, BASE, BUSY, times)
    other = simulate(table, BASE, {k: mirrored(b) for k, b in BUSY.items()}, times)
    np.testing.assert_allclose(one.xy * [1, -1], other.xy, atol=1e-9)
    np.testing.assert_allclose(one.omega * [-1, 1, -1], other.omega, atol=1e-6)


def test_turned_table_turns_the_shot() -> None:
    """A square table turned by 90 degrees: every rail obeys the same law."""
    square = Table(2.0, 2.0, pockets=False)
    times = np.arange(0.0, 3.0, 0.01)
    for ball in (Start((-0.5, 0.1), (2.0, 0.7), (10.0, 40.0, 50.0)), Start((0.3, 0.0), (-1.0, 1.9), (0.0, 0.0, -40.0))):
        (x, y), (vx, vy), (wx, wy, wz) = ball.xy, ball.velocity, ball.omega
        one = simulate(square, BASE, {"cue": ball}, times)
        other = simulate(square, BASE, {"cue": Start((-y, x), (-vy, vx), (-wy, wx, wz))}, times)
        assert one.events
        np.testing.assert_allclose(one.xy[..., ::-1] * [-1, 1], other.xy, atol=1e-9)


# v0, omega0, t_s, r(t_s), v(t_s), w_z(t_s): the closed forms of sliding for mu_s 0.212, alpha 22
SLIDES = [
    ((2, 0), (0, 0, 0), 0.274762, (0.471021, 0), (1.428571, 0), 0),
    ((2, 0), (30, 0, 60), 0.295295, (0.506219, -0.033221), (1.428571, -0.225), 53.5035),
    ((1.5, 0.5), (-20, -40, -30), 0.350339, (0.397885, 0.176421), (0.771429, 0.507143), -22.2925),
    ((1, 0), (0, 60, 0), 0.078994, (0.085483, 0), (1.164286, 0), 0),
    ((1, 0), (0, -60, 10), 0.353756, (0.223625, 0), (0.264286, 0), 2.2174),
]


@pytest.mark.parametrize(("v", "w", "t", "r_end", "v_end", "wz_end"), SLIDES)
def test_sliding_follows_the_closed_form(
    v: tuple[float, float],
    w: tuple[float, float, float],
    t: float,
    r_end: tuple[float, float],
    v_end: tuple[float, float],
    wz_end: float,
) -> None:
    motion = play(BASE, {"cue": Start((0.0, 0.0), v, w)}, t)
    np.testing.assert_allclose(motion.xy[-1, 0], r_end, atol=1e-4)
    np.testing.assert_allclose(motion.velocity[-1, 0], v_end, atol=1e-4)
    assert motion.omega[-1, 0, 2] == pytest.approx(wz_end, abs=1e-4)


def test_whole_run_of_a_stun_shot() -> None:
    """D = [12/(49 mu_s) + 25/(98 mu_r)] V0^2 / g, and the ball stays there."""
    motion = play(BASE, {"cue": Start((0.0, 0.0), (1.5, 0.0))}, 14.0)
    run = (12 / (49 * BASE.mus) + 25 / (98 * BASE.mur)) * 1.5**2 / GRAVITY
    assert motion.xy[-1, 0, 0] == pytest.approx(run, abs=1e-4)
    assert motion.resting[-1] == 1


def test_spin_in_place() -> None:
    motion = play(BASE, {"cue": Start((0.0, 0.0), omega=(0.0, 0.0, 44.0))}, 3.0)
    assert motion.theta[-1, 0] == pytest.approx(44.0**2 / (2 * 22.0), abs=1e-6)
    assert np.all(motion.xy == 0.0)


# phi [deg], k, q: v1, R w1, v2, R w2 after (e 0.89, mu_b 0.05, mu_s 0.21)
COLLISIONS = [
    (0, 0, 0, (0.0550, 0, 0, 0, 0), (0.9450, 0, 0, 0, 0)),
    (0, 1, 0, (0.0500, 0, 0, 0.8813, 0), (0.9400, 0, 0, -0.0938, 0)),
    (0, -1, 0, (0.0501, 0, 0, -0.8578, 0), (0.9401, 0, 0, 0.1175, 0)),
    (0, 0, 1, (0.0550, -0.0472, 0, 0, 0.8819), (0.9450, 0.0472, 0, 0, -0.1181)),
    (30, 0, 0, (0.0476, 0.4591, 0, 0, -0.1023), (0.8184, 0.0409, 0, 0, -0.1023)),
    (30, 1, 0, (0.0439, 0.4803, -0.5000, 0.7758, -0.0493), (0.8146, 0.0195, -0.0004, -0.0713, -0.0493)),
    (30, -0.5, 0, (0.0457, 0.4661, 0.2403, -0.3533, -0.0750), (0.8161, 0.0300, 0, 0.0691, -0.0750)),
    (30, 0, 0.75, (0.0476, 0.4591, 0, 0, 0.6477), (0.8184, 0.0409, 0, 0, -0.1023)),
    (30, 0, -0.75, (0.0476, 0.5357, 0, 0, -0.6607), (0.8184, -0.0357, 0, 0, 0.0893)),
    (30, 1, 0.5, (0.0448, 0.4695, -0.5000, 0.7972, 0.4238), (0.8155, 0.0303, -0.0005, -0.0544, -0.0762)),
    (60, 1, 0, (0.0262, 0.8457, -0.8660, 0.4697, -0.0509), (0.4712, 0.0202, -0.0003, -0.0240, -0.0509)),
]


@pytest.mark.parametrize(("phi", "k", "q", "first", "second"), COLLISIONS)
def test_ball_ball_table(phi: float, k: float, q: float, first: Array, second: Array) -> None:
    cos, sin = math.cos(math.radians(phi)), math.sin(math.radians(phi))
    before = np.zeros((2, 5))
    before[0] = cos, sin, -k * sin / R, k * cos / R, q / R
    after = impact(BALLS, before, 0.89, (0.05, 0.0, 0.0), 0.21, MASS, R, 4000)
    after[:, 2:] *= R
    np.testing.assert_allclose(after, [first, second], atol=2e-3)


# alpha from the cushion line [deg], k, q: v, R omega after (e 0.98, mu_w 0.14, mu_s 0.212), +y into the cushion
REBOUNDS = [
    (30, 1, 0, (0.7141, -0.4817, -0.1649, 0.7141, 0.3481)),
    (30, 0, 0, (0.6358, -0.4650, -0.0010, 0.0667, 0.3332)),
    (30, 1, 1, (0.7827, -0.4615, -0.1199, 0.7827, 1.1910)),
    (30, 1, -1, (0.7061, -0.4851, -0.1968, 0.7061, -0.6336)),
    (45, 1, 0, (0.5139, -0.6741, -0.1825, 0.5139, 0.4427)),
    (45, 0, 0, (0.4206, -0.6288, -0.0329, 0.0866, 0.4123)),
    (45, 1, 1, (0.6861, -0.6442, -0.1671, 0.6861, 1.0481)),
    (45, 1, -1, (0.4894, -0.6823, -0.2428, 0.4894, -0.5012)),
    (45, 2, 0, (0.6075, -0.6852, -0.8081, 1.1406, 0.3420)),
    (60, 1, 0, (0.3132, -0.8088, -0.2027, 0.3132, 0.4279)),
    (60, 0, 0, (0.2575, -0.7417, -0.0816, 0.1077, 0.3264)),
    (60, 1, 1, (0.5619, -0.7903, -0.2071, 0.5619, 0.8583)),
    (90, 1, 0, (0, -0.9107, -0.2351, 0, 0)),
    (90, 1, 1, (0.2330, -0.9392, -0.2325, 0.2330, 0.4661)),
]


@pytest.mark.parametrize(("alpha", "k", "q", "expected"), REBOUNDS)
def test_cushion_table(alpha: float, k: float, q: float, expected: tuple[float, ...]) -> None:
    cos, sin = math.cos(math.radians(alpha)), math.sin(math.radians(alpha))
    before = np.zeros((2, 5))
    before[0] = sin, -cos, k * cos / R, k * sin / R, q / R  # the table's +y is the impact's +x
    vx, vy, wx, wy, wz = impact(NOSE, before, 0.98, (0.14, 0.0, 0.0), 0.212, MASS, R, 4000)[0]
    np.testing.assert_allclose((-vy, vx, -wy * R, wx * R, wz * R), expected, atol=2e-3)


def test_ball_touches_the_nose_at_its_height() -> None:
    """Nose at 7R/5: the centre turns back at R sqrt(1 - 0.4^2) from the nose line."""
    times = np.arange(0.0, 2.0, 1e-4)
    motion = simulate(Table(pockets=False), BASE, {"cue": Start((1.0, 0.0), (1.5, 0.0))}, times)
    gap = Table().length / 2 - np.max(motion.xy[:, 0, 0])
    assert gap == pytest.approx(R * math.sqrt(0.84), abs=1.5e-4)


def test_result_converges_with_the_step() -> None:
    other = {"cue": Start((-1.0, 0.0), (1.8, 1.2), (40.0, -30.0, 50.0)), "red": Start((0.6, -0.3))}
    hidden = Constants(tilt_x=0.001, drag1=0.03, drag2=0.01, swerve=0.002, nap=0.1, nap_phi=1.0)
    for balls in (BUSY, other):
        for c in (BASE, hidden):
            ends = [play(c, balls, 2.5, Table(pockets=False), step).xy[-1] for step in (8e-4, 2e-4, 5e-5, 5e-6)]
            coarse, _, usual = (float(np.max(np.abs(end - ends[-1]))) for end in ends[:-1])
            assert usual < 1e-7
            assert usual < coarse / 50 or coarse < 1e-10  # without effects every step is exact


def test_impact_converges_with_its_increments() -> None:
    before = np.array([[1.0, 0.6, 10.0, 30.0, 20.0], [0.0, 0.0, 0.0, 0.0, 0.0]])
    for kind in (BALLS, NOSE):
        ends = [impact(kind, before, 0.9, (0.1, 0.05, 1.0), 0.2, MASS, R, n)[0, :2] for n in (500, 4000, 32000)]
        assert np.max(np.abs(ends[1] - ends[2])) < 2e-4
        assert np.max(np.abs(ends[1] - ends[2])) < np.max(np.abs(ends[0] - ends[2])) / 4


def test_the_strike() -> None:
    """Right side turns the ball counter-clockwise; an elevated cue tilts the axis towards the aim."""
    level = strike((0.0, 0.0), Cue(2.0, math.pi / 2, side=0.004, height=0.4 * R), R)
    np.testing.assert_allclose(level.velocity, (0.0, 2.0), atol=1e-12)
    np.testing.assert_allclose(level.omega, (-2.0 / R, 0.0, 2.5 * 0.004 * 2.0 / R**2), atol=1e-9)
    raised = strike((0.0, 0.0), Cue(2.0, 0.0, side=0.004, elevation=0.5), R)
    np.testing.assert_allclose(raised.omega, 0.02 / R**2 * np.array([math.sin(0.5), 0.0, math.cos(0.5)]), atol=1e-9)


def test_swerve_ends_in_the_coriolis_direction() -> None:
    """v_roll = v - (2/7) u whatever the friction: tan(delta) = a sin(el), towards the struck side."""
    start = strike((0.0, 0.0), Cue(1.5, 0.0, side=0.2 * R, elevation=0.6), R)
    motion = play(BASE, {"cue": start}, 1.5)
    vx, vy = motion.velocity[-1, 0]
    assert vy / vx == pytest.approx(-0.2 * math.sin(0.6), rel=1e-4)


def test_a_pocketed_ball_vanishes() -> None:
    times = np.arange(0.0, 3.0, 0.01)
    middle = {"cue": Start((0.0, 0.0), (0.02, 1.5), (-1.5 / R, 0.0, 0.0)), "red": Start((1.0, 0.0))}
    corner = {"cue": Start((0.895, 0.0), (1.0, 1.0), (-1.0 / R, 1.0 / R, 0.0))}
    for balls in (middle, corner):
        motion = simulate(Table(), BASE, balls, times)
        assert [e.kind for e in motion.events] == ["pocket"]
        gone = np.isnan(motion.xy[:, 0, 0])
        assert gone[-1] and not gone[0] and np.all(np.diff(gone.astype(int)) >= 0)
        assert simulate(Table(pockets=False), BASE, balls, times).events[0].kind == "cushion"
    assert np.all(simulate(Table(), BASE, middle, times).xy[:, 1] == [1.0, 0.0])


def test_the_generator_shares_no_code_with_what_it_tests() -> None:
    allowed = {"numpy", "numba", "tomli_w", "tests"}
    for path in sorted(set(PACKAGE.glob("*.py")) - set(PACKAGE.glob("test_*.py"))):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, path
                names = [node.module or ""]
            for name in names:
                top = name.split(".")[0]
                assert top not in {"models", "sysid", "planner", "robot"}, f"{path.name} imports {name}"
                assert top in allowed or top in sys.stdlib_module_names, f"{path.name} imports {name}"
                assert top != "tests" or name.startswith("tests.truth"), f"{path.name} imports {name}"
