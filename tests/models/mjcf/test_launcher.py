"""The launcher's MJCF: it loads alone, and its gears and stage do what they should."""

from __future__ import annotations

import warnings
from typing import Any

import mujoco
import numpy as np
import pytest

from models.errors import BadInput
from models.mjcf import launcher
from models.mjcf.launcher import (
    DEVICE_FILE,
    GEAR_RATIO,
    PINION_RADIUS_M,
    STAGE_TRAVEL_M,
    CueProperties,
    attach_launcher,
)
from models.mjcf.stroke import CUE_TILT
from models.mjcf.world import build_spec
from models.mujoco.stroke import MOTOR_RATING
from models.shot import Ball, Table

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)


@pytest.fixture(scope="module")
def device() -> Any:
    """The device alone."""
    return mujoco.MjModel.from_xml_path(str(DEVICE_FILE))


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
    assert device.actuator("servo").forcerange[1] == MOTOR_RATING["peak torque"]
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


def test_the_leather_of_the_file_is_that_of_the_usual_cue(device: Any) -> None:
    spec = build_spec(TABLE, BALL, ("white",))
    attach_launcher(spec, "white", BALL)
    world = spec.compile()
    for axis in "xyz":
        own, attached = device.joint(f"leather {axis}"), world.joint(f"launcher/leather {axis}")
        assert attached.stiffness[0] == pytest.approx(own.stiffness[0], rel=2e-3)
        assert attached.damping[0] == pytest.approx(own.damping[0], rel=2e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"end_mass": 1.0}, r"end_mass is 1\.0 kg; give 0\.002 to 0\.1"),
        ({"cue_mass": 0.0}, r"cue_mass is 0\.0 kg"),
        ({"tip_restitution": 1.0}, r"tip_restitution is 1\.0"),
        ({"tip_friction": 0.0}, r"tip_friction is 0\.0"),
    ],
)
def test_a_cue_that_cannot_be_says_why(change: dict[str, float], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        attach_launcher(build_spec(TABLE, BALL, ("white",)), "white", BALL, CueProperties(**change))
