"""The installed libraries work together: dm_control breaks whenever MuJoCo drops a field that it lists."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, requires, version

import dm_control.mujoco
import mujoco
import mujoco.batch
import numpy as np
import pytest

from models.mjcf.gl import GL_OFF, choose_backend

FALLING = """
<mujoco>
  <option timestep="0.001"/>
  <worldbody>
    <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" type="sphere" size="0.026" mass="0.14"/></body>
  </worldbody>
</mujoco>
"""
STEPS = 100
DROP = -9.81 / 2 * (STEPS * 0.001) ** 2  # [m]
TOLERANCE = 1e-3  # of the integrator's step [m]


def numbers(release: str) -> tuple[int, ...]:
    """The leading numbers of a version."""
    return tuple(int(part) for part in re.findall(r"\d+", release)[:3])


def test_versions_are_in_the_supported_range() -> None:
    assert (3, 17) <= numbers(mujoco.__version__) < (4,)
    assert version("mujoco") == mujoco.__version__
    assert version("dm-control") == "1.0.50"


def test_dm_control_has_all_it_needs_but_labmaze() -> None:
    """From Python 3.13 on pyproject.toml lists dm_control's requirements itself."""
    missing = []
    for line in requires("dm-control") or []:
        if "extra ==" in line:
            continue
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        try:
            version(name)
        except PackageNotFoundError:
            missing.append(name)
    assert set(missing) <= {"labmaze"}


def test_mujoco_steps() -> None:
    model = mujoco.MjModel.from_xml_string(FALLING)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, STEPS)
    assert data.qpos[2] == pytest.approx(1 + DROP, abs=TOLERANCE)


def test_batch_steps() -> None:
    model = mujoco.MjModel.from_xml_string(FALLING)
    batch = mujoco.batch.Batch(model, nsim=3, nthread=2)
    height = batch.bind("qpos")[:, 2]
    height[:] = [1, 2, 3]
    batch.step(nstep=STEPS)
    assert np.allclose(batch.bind("qpos")[:, 2], np.array([1, 2, 3]) + DROP, atol=TOLERANCE)


def test_dm_control_steps() -> None:
    physics = dm_control.mujoco.Physics.from_xml_string(FALLING)
    physics.step(STEPS)
    assert physics.named.data.qpos.shape == (7,)
    assert physics.named.data.xpos["ball", "z"] == pytest.approx(1 + DROP, abs=TOLERANCE)


def test_backend_is_chosen_before_mujoco_is_imported() -> None:
    assert choose_backend() in ("egl", "osmesa", "glfw", "", *GL_OFF)


@pytest.mark.gl
def test_mujoco_and_dm_control_draw() -> None:
    model = mujoco.MjModel.from_xml_string(FALLING)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, height=48, width=64) as renderer:
        renderer.update_scene(data)
        assert np.ptp(renderer.render()) > 0
    physics = dm_control.mujoco.Physics.from_xml_string(FALLING)
    assert physics.render(height=48, width=64).shape == (48, 64, 3)
