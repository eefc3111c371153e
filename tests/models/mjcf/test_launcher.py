"""The launcher: it loads alone, its gears and stage do what they should, and its strokes follow the cueing model."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from models.analytic import cueing
from models.errors import BadInput
from models.mjcf import launcher, stroke
from models.mjcf.launcher import (
    CUE_TILT,
    DEVICE_FILE,
    GEAR_RATIO,
    PINION_RADIUS_M,
    STAGE_TRAVEL_M,
    LauncherScene,
    build_scene,
    strike,
    strike_all,
)
from models.shot import Ball, Table

ROOT = Path(__file__).resolve().parents[3]
TABLE, BALL, SPOT = Table(3.569, 1.778), Ball(0.0525, 0.1406), np.array([-1.23, 0.1])


@pytest.fixture(scope="module")
def device() -> Any:
    """The device alone."""
    return mujoco.MjModel.from_xml_path(str(DEVICE_FILE))


@pytest.fixture(scope="module")
def scene() -> LauncherScene:
    """The device at the table."""
    return build_scene(TABLE, BALL, ("white",), SPOT, 0.0)


@pytest.fixture(scope="module")
def afloat() -> LauncherScene:
    """The same without a slate under the ball."""
    return build_scene(TABLE, BALL, ("white",), SPOT, 0.0, slate=False)


def test_the_device_loads_alone_without_a_word(capfd: pytest.CaptureFixture[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spec = mujoco.MjSpec.from_file(str(DEVICE_FILE))
        model = spec.compile()
    assert capfd.readouterr() == ("", "")
    assert [model.actuator(k).name for k in range(model.nu)] == ["stage x", "stage y", "servo"]
    assert all(geom.name for geom in spec.geoms)
    assert np.all(model.geom_contype == 0)
    assert np.all(model.geom_conaffinity == 0)
    text = DEVICE_FILE.read_text(encoding="utf-8")
    assert max(map(len, text.splitlines())) <= 120
    assert "\t" not in text


def test_what_code_states_is_what_the_file_holds(device: Any) -> None:
    cue = [device.body(name).mass[0] for name in ("cue", "shaft end", "tip")]
    assert sum(cue) == pytest.approx(launcher.CUE_MASS)
    assert cue[1] + cue[2] == pytest.approx(launcher.END_MASS)
    assert device.geom("tip").size[0] == launcher.TIP_RADIUS
    assert device.eq_data[device.equality("gearbox").id, 1] * GEAR_RATIO == pytest.approx(1.0)
    assert device.eq_data[device.equality("mesh").id, 1] == pytest.approx(PINION_RADIUS_M)
    assert device.joint("stage x").range[1] == STAGE_TRAVEL_M
    assert device.actuator("servo").forcerange[1] == stroke.MOTOR_RATING["peak torque"]
    data = mujoco.MjData(device)
    mujoco.mj_forward(device, data)
    axis = data.body("chassis").xmat.reshape(3, 3)[:, 0]
    assert axis == pytest.approx([np.cos(CUE_TILT), 0, -np.sin(CUE_TILT)], abs=1e-8)
    assert np.cross(data.site("tip").xpos, axis) == pytest.approx(0, abs=1e-8), "the cue points at the origin"


def test_a_second_of_random_control_raises_no_warning(device: Any) -> None:
    noise = np.random.default_rng(5)
    data = mujoco.MjData(device)
    low, high = device.actuator_ctrlrange.T
    for _ in range(100):
        data.ctrl[:] = noise.uniform(low, high)
        mujoco.mj_step(device, data, 100)
    assert [warning.number for warning in data.warning] == [0] * len(data.warning)
    assert data.time == pytest.approx(1.0)
    assert -0.002 < data.joint("rack").qpos[0] < 0.362


@pytest.mark.parametrize(("side", "height"), [(0.012, -0.012), (-0.013, 0.013), (0.0, 0.02)])
def test_the_stage_moves_the_tip_by_what_it_is_told(device: Any, side: float, height: float) -> None:
    data = mujoco.MjData(device)
    mujoco.mj_step(device, data)
    start = data.site("tip").xpos.copy()
    for k in range(60):  # as a stepper goes there, not at a jump
        data.ctrl[:2] = np.array([side, height]) * min(k / 40, 1.0)
        mujoco.mj_step(device, data, 50)
    rack = data.joint("rack").qpos[0]
    moved = data.site("tip").xpos - start - rack * np.array([np.cos(CUE_TILT), 0, -np.sin(CUE_TILT)])
    assert moved[1:] == pytest.approx([-side, height], abs=6e-5), "right is -y"


def test_gears_hold_while_the_servo_pulls(device: Any) -> None:
    data = mujoco.MjData(device)
    for k in range(600):
        data.ctrl[2] = 300 * min(k / 400, 1.0)
        mujoco.mj_step(device, data)
    motor, pinion, rack = (data.joint(name) for name in ("motor", "pinion", "rack"))
    assert rack.qpos[0] > 0.05
    assert motor.qpos[0] / pinion.qpos[0] == pytest.approx(3.0, rel=2e-3)
    assert rack.qpos[0] == pytest.approx(PINION_RADIUS_M * pinion.qpos[0], abs=1e-4)
    assert rack.qvel[0] == pytest.approx(PINION_RADIUS_M * motor.qvel[0] / 3, rel=5e-3)


@pytest.mark.parametrize("cue_speed", [0.5, 2.0])
def test_a_centre_ball_leaves_as_the_formula_says(
    scene: LauncherScene, afloat: LauncherScene, cue_speed: float
) -> None:
    ideal = cueing.ball_speed(cue_speed, 0, 0, BALL, stroke.ANALYTIC_CUE)
    free = strike(afloat, cue_speed)
    assert free.cue_speed == pytest.approx(cue_speed, rel=5e-3), "constant speed through the stroke"
    assert np.linalg.norm(free.velocity) == pytest.approx(ideal * free.cue_speed / cue_speed, rel=0.01)
    assert BALL.radius * np.linalg.norm(free.spin) < 0.005 * ideal
    assert free.contact_time == pytest.approx(1e-3, rel=0.1)
    assert not free.miscue
    held = strike(scene, cue_speed)
    assert held.velocity[0] == pytest.approx(ideal, rel=0.02)
    assert abs(held.velocity[2]) < 0.01 * ideal, "the slate holds it up"
    assert 0 <= BALL.radius * held.spin[1] < 0.08 * ideal, "nothing beyond the slate's rub"
    assert abs(held.spin[[0, 2]]).max() < 0.05
    assert held.slip < 5e-5


def test_right_side_turns_left_and_squirts_left(scene: LauncherScene) -> None:
    right, left = strike(scene, 2.0, 0.010), strike(scene, 2.0, -0.010)
    assert right.spin[2] > 40
    assert right.squirt > np.radians(1.0)
    assert right.spin[0] > 0, "the axis of side spin is tilted with the cue"
    mirror = dataclasses.replace(
        left, velocity=left.velocity * [1, -1, 1], spin=left.spin * [-1, 1, -1], squirt=-left.squirt
    )
    for name in ("velocity", "spin", "squirt", "cue_speed", "tip_force", "contact_time"):
        assert getattr(right, name) == pytest.approx(getattr(mirror, name), rel=1e-3, abs=2e-3), name


def test_the_aim_turns_everything_with_it(scene: LauncherScene) -> None:
    angle = 2.2
    turned = strike(build_scene(TABLE, BALL, ("white",), np.array([0.3, -0.2]), angle), 1.5, 0.006, 0.006)
    here = strike(scene, 1.5, 0.006, 0.006)
    c, s = np.cos(angle), np.sin(angle)
    about = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert turned.velocity == pytest.approx(about @ here.velocity, abs=2e-3)
    assert turned.spin == pytest.approx(about @ here.spin, abs=0.1)
    assert turned.squirt == pytest.approx(here.squirt, abs=1e-3)


def test_strokes_follow_the_cueing_model(afloat: LauncherScene) -> None:
    shots = [(1.0, 0.006, 0.0), (2.5, 0.012, 0.0), (1.5, 0.0, 0.012), (1.5, 0.0, -0.012), (2.0, 0.012, -0.012)]
    wrong = stroke.errors(afloat, shots, strike_all(afloat, shots))
    assert np.abs(wrong[:, 0]).max() < 1.0, "ball speed [%]"
    assert np.abs(wrong[:2, 1]).max() < 2.0, "side spin [% of roll]"
    assert np.abs(wrong[2:, 1]).max() < 8.0, "the end mass takes topspin too, which the model leaves out"
    assert np.abs(wrong[:, 2]).max() < 0.25, "squirt [degrees]"


def test_more_end_mass_squirts_more() -> None:
    squirts = [
        strike(build_scene(TABLE, BALL, ("white",), SPOT, 0.0, end_mass=m, slate=False), 1.5, 0.01).squirt
        for m in (0.004, 0.007, 0.012)
    ]
    assert np.all(np.diff(squirts) > np.radians(0.4))


def test_beyond_the_cone_of_friction_it_miscues(scene: LauncherScene) -> None:
    limit = cueing.miscue_limit(launcher.TIP_FRICTION) * (BALL.radius + launcher.TIP_RADIUS)
    inside, outside = strike(scene, 1.5, 0.9 * limit), strike(scene, 1.5, 1.12 * limit)
    assert not inside.miscue
    assert outside.miscue
    assert outside.velocity[0] < 0.85 * inside.velocity[0]
    slick = build_scene(TABLE, BALL, ("white",), SPOT, 0.0, tip_friction=0.15)
    assert strike(slick, 1.5, 0.012).miscue, "without chalk"


def test_the_fastest_string_is_within_the_torque(scene: LauncherScene) -> None:
    whole = strike(scene, 2.75, follow_through=True)
    assert whole.cue_speed == pytest.approx(2.75, rel=5e-3)
    assert whole.torque < stroke.MOTOR_RATING["peak torque"] - 0.05
    assert whole.motor_speed * stroke.RPM_PER_RAD_S < stroke.MOTOR_RATING["speed"]
    assert whole.travel < 0.355, "it stops before its end"
    ideal = stroke.closed_form(scene, 2.75)
    upto = strike(scene, 2.75)
    assert upto.rack_force == pytest.approx(ideal["force"], rel=0.05)
    assert upto.torque == pytest.approx(ideal["torque"], rel=0.1)
    assert upto.power == pytest.approx(ideal["power"], rel=0.1)
    assert whole.rack_force < ideal["pull"]


def test_a_stroke_is_the_same_every_time(scene: LauncherScene) -> None:
    shots = [(1.0, 0.004, -0.006), (2.0, 0.0, 0.01)]
    one, many = strike_all(scene, shots, threads=1), strike_all(scene, shots, threads=2)
    for a, b in zip(one, many, strict=True):
        assert a.velocity.tobytes() + a.spin.tobytes() == b.velocity.tobytes() + b.spin.tobytes()
    found = stroke.grid(scene, (1.0,), np.array([0.004]), np.array([-0.006]))
    assert found["spin"].shape == (1, 1, 1, 3)
    assert found["squirt"][0, 0, 0] == one[0].squirt


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
    scene: LauncherScene, arguments: tuple[float, ...], message: str | None
) -> None:
    if message is None:  # in reach, so it is played, however badly
        assert strike(scene, *arguments).miscue
        return
    with pytest.raises(BadInput, match=message):
        strike(scene, *arguments)


def test_a_scene_that_cannot_be_says_why() -> None:
    with pytest.raises(BadInput, match=r"ball 'white' is at \[1\.78, 0\.0\]; keep it within"):
        build_scene(TABLE, BALL, ("white",), np.array([1.78, 0.0]), 0.0)
    with pytest.raises(BadInput, match=r"others has shape \(0, 2\); 2 balls need \(1, 2\)"):
        build_scene(TABLE, BALL, ("white", "red"), SPOT, 0.0)
    with pytest.raises(BadInput, match=r"end_mass is 1 kg; give 0\.002 to 0\.1"):
        build_scene(TABLE, BALL, ("white",), SPOT, 0.0, end_mass=1)
    with pytest.raises(BadInput, match="tip_friction is 0"):
        build_scene(TABLE, BALL, ("white",), SPOT, 0.0, tip_friction=0)
    with pytest.raises(BadInput, match="azimuth is nan"):
        build_scene(TABLE, BALL, ("white",), SPOT, float("nan"))


@pytest.mark.slow
def test_the_command_compares_and_sizes_the_drive(tmp_path: Path) -> None:
    out = tmp_path / "strokes.csv"
    command = [sys.executable, "-m", "models.mjcf.stroke", "--out", str(out)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    assert "it can: within peak torque and top speed" in run.stdout
    assert len(out.read_text().splitlines()) == 1 + len(stroke.SMALL_GRID)


@pytest.mark.gl
def test_the_command_draws_the_launcher(tmp_path: Path) -> None:
    out = tmp_path / "launcher.png"
    command = [sys.executable, "-m", "models.mjcf.stroke", "--picture", str(out), "--width", "320"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    assert out.read_bytes().startswith(b"\x89PNG")
