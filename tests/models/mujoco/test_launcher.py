"""Strokes of the launcher's tip in MuJoCo: they follow the cueing model, and the shot goes on from them."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from models.analytic import cueing
from models.analytic.cue_impulse import Constants, Geometry, launch
from models.errors import BadInput
from models.mjcf.launcher import TIP_FRICTION, TIP_RADIUS, CueProperties
from models.model_file import full_model
from models.mujoco import stroke
from models.mujoco.launcher import Launcher, SimulatedStroke
from models.mujoco.struck import TipStroke, play_struck
from models.mujoco.world import World
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate

ROOT = Path(__file__).resolve().parents[3]
TABLE, BALL, SPOT = Table(3.569, 1.778), Ball(0.0525, 0.1406), (-1.23, 0.1)
MODEL = full_model(TABLE, BALL)


def machine(**device: float) -> Launcher:
    return Launcher(World(MODEL, ("white",)), CueProperties(**device))


@pytest.fixture(scope="module")
def launcher() -> Launcher:
    return machine()


def strike(
    launcher: Launcher, *one: float, azimuth: float = 0.0, place: tuple[float, float] = SPOT, **more: bool
) -> SimulatedStroke:
    data = launcher.world.place({"white": place})
    launcher.aim(data, azimuth)
    return launcher.strike(data, *one, **more)


@pytest.mark.parametrize("one", [
    (0.5, 0.0, 0.0), (2.0, 0.0, 0.0), (1.0, 0.006, 0.0), (2.5, 0.012, 0.0), (1.5, 0.0, 0.012), (1.5, 0.0, -0.012),
    (2.0, 0.012, -0.012),
])  # fmt: skip
def test_strokes_follow_the_cueing_model(launcher: Launcher, one: tuple[float, float, float]) -> None:
    made = strike(launcher, *one)
    assert made.cue_speed == pytest.approx(one[0], rel=5e-3), "constant speed through the stroke"
    [(speed, spin, squirt)] = stroke.errors(launcher, [one], [made])
    assert abs(speed) < 0.8 and spin < 1.2 and abs(squirt) < 0.07
    assert abs(made.velocity[2]) < 1e-3, "the slate holds it up"
    assert made.contact_time == pytest.approx(0.9e-3, rel=0.15)
    assert made.slip < 5e-5 and not made.miscue


def test_a_stroke_that_begins_at_speed_is_the_whole_one(launcher: Launcher) -> None:
    whole, short = (strike(launcher, 2.0, 0.008, 0.006, run_up=flag) for flag in (True, False))
    part = short.cue_speed / whole.cue_speed
    assert short.velocity == pytest.approx(part * whole.velocity, rel=2e-3, abs=1e-3)
    assert short.spin == pytest.approx(part * whole.spin, rel=4e-3, abs=0.1)


def test_the_cloth_rubs_what_the_tip_presses_down() -> None:
    """A centre ball turns under the tip as far as the friction of the slate under that load says."""
    turned = []
    for friction in (0.01, 0.1, 0.4):
        launcher = Launcher(World(MODEL.with_values({"decoupled_cloth.slide": friction}), ("white",)))
        one = strike(launcher, 2.0)
        constants, at = Constants(slate_friction=friction), (np.array([v]) for v in (one.cue_speed, 0.0, 0.0))
        told = launch(constants, Geometry(BALL), *at)[1][0, 1]
        turned.append(one.spin[1])
        assert abs(one.spin[1] - told) * BALL.radius < 0.01 * one.velocity[0], friction
    assert np.diff(turned).min() > 2.0


def test_a_struck_ball_goes_on_into_the_shot() -> None:
    """A whole shot by the tip against the same ball started by what the tip gave it."""
    places, one, times = {"white": SPOT, "red": (0.4, 0.12)}, TipStroke(1.5, 0.0, 0.004, 0.0), np.arange(0, 3, 0.01)
    [track], [made] = play_struck(MODEL, places, [one], [times])
    assert track.position[0] == pytest.approx(np.array(list(places.values())))
    v, w = np.zeros((2, 2)), np.zeros((2, 3))
    v[0], w[0] = made.velocity[:2], made.spin
    start = Shot(tuple(places), np.array(list(places.values())), v, w, times)
    [free] = simulate(dataclasses.replace(MODEL, engine="mujoco"), [start])
    assert [e.kind for e in track.events] == [e.kind for e in free.events]
    late = track.events[0].time - free.events[0].time  # while the tip pushes, a ball is slower than after it
    assert 0 < late < made.since
    assert np.abs(track.position - free.position).max() < 0.012


def test_right_side_turns_left_and_squirts_left(launcher: Launcher) -> None:
    right, left = strike(launcher, 2.0, 0.010), strike(launcher, 2.0, -0.010)
    assert right.spin[2] > 40
    assert right.squirt > np.radians(1.0)
    assert right.spin[0] > 0, "the axis of side spin is tilted with the cue"
    mirror = dataclasses.replace(
        left, velocity=left.velocity * [1, -1, 1], spin=left.spin * [-1, 1, -1], squirt=-left.squirt
    )
    for name in ("velocity", "spin", "squirt", "cue_speed", "tip_force", "contact_time"):
        assert getattr(right, name) == pytest.approx(getattr(mirror, name), rel=1e-3, abs=2e-3), name


def test_the_aim_turns_everything_with_it(launcher: Launcher) -> None:
    angle = 2.2
    turned = strike(launcher, 1.5, 0.006, 0.006, azimuth=angle, place=(0.3, -0.2))
    here = strike(launcher, 1.5, 0.006, 0.006)
    c, s = np.cos(angle), np.sin(angle)
    about = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert turned.velocity == pytest.approx(about @ here.velocity, abs=2e-3)
    assert turned.spin == pytest.approx(about @ here.spin, abs=0.1)
    assert turned.squirt == pytest.approx(here.squirt, abs=1e-3)


def test_more_end_mass_squirts_more() -> None:
    squirts = [strike(machine(end_mass=m), 1.5, 0.01).squirt for m in (0.004, 0.007, 0.012)]
    assert np.all(np.diff(squirts) > np.radians(0.4))


def test_beyond_the_cone_of_friction_it_miscues(launcher: Launcher) -> None:
    limit = cueing.miscue_limit(TIP_FRICTION) * (BALL.radius + TIP_RADIUS)
    inside, outside = strike(launcher, 1.5, 0.9 * limit), strike(launcher, 1.5, 1.12 * limit)
    assert not inside.miscue
    assert outside.miscue
    assert outside.velocity[0] < 0.85 * inside.velocity[0]
    assert strike(machine(tip_friction=0.15), 1.5, 0.012).miscue, "without chalk"


def test_the_fastest_string_is_within_the_torque(launcher: Launcher) -> None:
    whole = strike(launcher, 2.75, follow_through=True)
    assert whole.cue_speed == pytest.approx(2.75, rel=5e-3)
    assert whole.torque < stroke.MOTOR_RATING["peak torque"] - 0.05
    assert whole.motor_speed * stroke.RPM_PER_RAD_S < stroke.MOTOR_RATING["speed"]
    assert whole.travel < 0.355, "it stops before its end"
    ideal = stroke.closed_form(launcher, 2.75)
    upto = strike(launcher, 2.75)
    assert upto.rack_force == pytest.approx(ideal["force"], rel=0.05)
    assert upto.torque == pytest.approx(ideal["torque"], rel=0.1)
    assert upto.power == pytest.approx(ideal["power"], rel=0.1)
    assert whole.rack_force < ideal["pull"]


def test_a_stroke_is_the_same_every_time(launcher: Launcher) -> None:
    shots = [(1.0, 0.004, -0.006), (2.0, 0.0, 0.01)]
    one, many = (launcher.strike_all({"white": SPOT}, 0.0, shots, threads=n) for n in (1, 2))
    for a, b in zip(one, many, strict=True):
        assert a.velocity.tobytes() + a.spin.tobytes() == b.velocity.tobytes() + b.spin.tobytes()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((4.0,), r"cue_speed is 4\.0 m/s; the drive allows 0\.2 to 3\.2"),
        ((float("nan"),), "cue_speed is nan"),
        ((1.0, 0.03), r"side is 0\.03 m; the stage travels \+-0\.0250 m"),
        ((1.0, 0.0, -0.0249), r"height is -0\.0249 m; the stage travels \+-0\.0248 m"),
        ((1.0, 0.025, 0.0248), None),
    ],
)
def test_a_stroke_that_cannot_be_says_why(
    launcher: Launcher, arguments: tuple[float, ...], message: str | None
) -> None:
    if message is None:  # in reach, so it is played, however badly
        assert strike(launcher, *arguments).miscue
        return
    with pytest.raises(BadInput, match=message):
        strike(launcher, *arguments)


def test_an_aim_that_is_none_says_why(launcher: Launcher) -> None:
    with pytest.raises(BadInput, match="azimuth is nan"):
        strike(launcher, 1.0, azimuth=float("nan"))


@pytest.mark.slow
def test_the_command_compares_and_sizes_the_drive(tmp_path: Path) -> None:
    out = tmp_path / "strokes.csv"
    command = [sys.executable, "-m", "models.mujoco.stroke", "--out", str(out)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    assert "it can: within peak torque and top speed" in run.stdout
    assert len(out.read_text().splitlines()) == 1 + len(stroke.SMALL_GRID)


@pytest.mark.gl
def test_the_command_draws_the_launcher(tmp_path: Path) -> None:
    out = tmp_path / "launcher.png"
    command = [sys.executable, "-m", "models.mujoco.stroke", "--picture", str(out), "--width", "320"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    assert out.read_bytes().startswith(b"\x89PNG")
