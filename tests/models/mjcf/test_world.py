"""The MJCF: it compiles, touches where it should, carries the mapped friction, loads anywhere, and can be drawn."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from models.errors import BadInput
from models.mjcf import gl
from models.mjcf.native import Native, solref
from models.mjcf.world import build_spec, pockets, rails
from models.shot import NOSE_COSINE, NOSE_HEIGHT, Ball, Table

ROOT = Path(__file__).resolve().parents[3]
FULL, TEN_BY_FIVE, CAROM = Table(3.569, 1.778), Table(2.959, 1.473), Table(2.84, 1.42, pockets=False)
SNOOKER, LARGE = Ball(0.0525, 0.1406), Ball(0.0615, 0.21)
WORLDS = [(FULL, SNOOKER), (TEN_BY_FIVE, SNOOKER), (CAROM, LARGE)]
NAMES = ("white", "yellow", "red 1")


def native_model(table: Table, ball: Ball, names: tuple[str, ...] = NAMES, native: Native | None = None) -> Any:
    """The world with MuJoCo's own contacts."""
    return build_spec(table, ball, names, (native or Native(),)).compile()


def place(model: Any, xy: Any, z: float) -> Any:
    """Fresh data with the balls at these places."""
    data = mujoco.MjData(model)
    data.qpos.reshape(-1, 7)[:, :2] = xy
    data.qpos.reshape(-1, 7)[:, 2] = z
    return data


@pytest.mark.parametrize(("table", "ball"), WORLDS)
@pytest.mark.parametrize("furnished", [False, True])
def test_every_table_compiles(table: Table, ball: Ball, furnished: bool) -> None:
    model = build_spec(table, ball, NAMES, (Native(),), furnished=furnished).compile()
    assert model.nq == 7 * len(NAMES)
    assert model.npair == len(NAMES) * (1 + len(rails(table))) + 3
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    mass = [model.body(name).mass[0] for name in NAMES]
    inertia = [model.body(name).inertia.tolist() for name in NAMES]
    assert mass == [ball.mass] * 3
    assert inertia == [[ball.inertia] * 3] * 3


@pytest.mark.parametrize(("table", "ball"), WORLDS)
def test_what_is_only_seen_changes_no_motion(table: Table, ball: Ball) -> None:
    seen = []
    for furnished in (False, True):
        model = build_spec(table, ball, NAMES, (Native(),), furnished=furnished).compile()
        data = place(model, [(0, 0), (0.3, 0.01), (-0.5, 0.3)], ball.radius)
        data.qvel[:2] = [1.5, 0.1]
        mujoco.mj_step(model, data, 4000)
        seen.append(data.qpos.tobytes() + data.qvel.tobytes())
    assert seen[0] == seen[1]


@pytest.mark.parametrize(("table", "count"), [(FULL, 6), (TEN_BY_FIVE, 6), (CAROM, 4)])
def test_cushions_are_six_between_pockets_and_four_without(table: Table, count: int) -> None:
    assert len(rails(table)) == count
    assert len(pockets(table)) == (6 if table.pockets else 0)
    for rail in rails(table):
        along = np.subtract(rail.end, rail.start)
        assert abs(along @ rail.outward) < 1e-12
        across = np.array(rail.start) @ rail.outward
        assert across == pytest.approx((table.length if rail.side[1] == "x" else table.width) / 2)


@pytest.mark.parametrize(("table", "ball"), WORLDS)
def test_a_ball_meets_the_nose_where_it_should(table: Table, ball: Ball) -> None:
    model = native_model(table, ball, ("white",))
    depth, reach = 1e-5, table.centre_limits(ball)
    for rail in rails(table):
        inward = -rail.outward
        middle = (np.array(rail.start) + rail.end) / 2
        side = np.abs(rail.outward) @ reach
        xy = middle - (middle @ rail.outward - side - depth) * rail.outward
        data = place(model, [xy], ball.radius)
        mujoco.mj_forward(model, data)
        bed = model.geom("bed").id
        hits = [c for c in data.contact if bed not in (c.geom1, c.geom2)]
        assert len(hits) == 1
        normal = hits[0].frame[:3] * np.sign(hits[0].frame[:2] @ inward)
        assert normal[:2] @ inward == pytest.approx(NOSE_COSINE, abs=1e-3)
        assert -normal[2] == pytest.approx(0.4, abs=1e-3), "sin(theta) = 2/5, the nose above the centre"
        assert hits[0].pos[2] == pytest.approx(NOSE_HEIGHT * ball.radius, abs=1e-5)
        assert hits[0].pos[:2] @ rail.outward == pytest.approx(middle @ rail.outward, abs=1e-5), "the nose line"
        assert hits[0].dist == pytest.approx(-depth * NOSE_COSINE, abs=1e-7)


def test_friction_of_the_cloth_is_mapped_to_one_contact() -> None:
    native = Native(slide=0.21, roll=0.0127, spin=22.0)
    model = native_model(FULL, SNOOKER, NAMES, native)
    beds = [k for k in range(model.npair) if model.geom("bed").id in (model.pair_geom1[k], model.pair_geom2[k])]
    assert len(beds) == 3
    for k in beds:
        assert model.pair_dim[k] == 6
        # Slide mu_s, torsional 2/5 R^2 alpha / g = 6.181e-4 m, rolling 7/5 mu_r R = 4.667e-4 m.
        assert model.pair_friction[k] == pytest.approx([0.21, 0.21, 6.181e-4, 4.667e-4, 4.667e-4], rel=1e-3)


def test_restitution_of_impacts_is_mapped_to_stiffness_and_damping() -> None:
    stiffness, damping = (-value for value in solref(0.89))
    assert damping / (2 * np.sqrt(stiffness)) == pytest.approx(0.0380, abs=3e-4), "damping ratio for e = 0.89"
    model = native_model(CAROM, LARGE)
    other = [k for k in range(model.npair) if model.pair_dim[k] == 3]
    assert np.all(model.pair_solref[other] < 0)
    data = place(model, [(-0.062, 0), (0, 0), (0.9, 0.5)], LARGE.radius)
    data.qvel[0] = 1.0
    mujoco.mj_step(model, data, 50)
    speed = data.qvel.reshape(-1, 6)[:, 0]
    assert (speed[1] - speed[0]) == pytest.approx(0.92, abs=0.03), "the cloth takes a little meanwhile"


def test_only_a_table_of_snooker_has_a_baulk_line() -> None:
    for ball, drawn in ((SNOOKER, True), (Ball(0.05715, 0.163), False)):
        model = build_spec(Table(2.54, 1.27), ball, NAMES, (Native(),), furnished=True).compile()
        assert (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "baulk line") >= 0) == drawn


def test_default_classes_are_named() -> None:
    spec = build_spec(FULL, SNOOKER, NAMES, furnished=True)
    for name in ("bed", "cushion", "ball", "fixture", "ball_bed", "ball_ball", "ball_cushion"):
        assert spec.find_default(name) is not None, name
    assert {pair.classname.name for pair in spec.pairs} == {"ball_bed", "ball_ball", "ball_cushion"}
    assert all(geom.name for geom in spec.geoms)
    for geom in spec.geoms:
        assert geom.contype == geom.conaffinity == 0, "contacts are declared pair by pair"


@pytest.mark.parametrize(("table", "ball"), WORLDS)
def test_ten_seconds_raise_no_warning(table: Table, ball: Ball) -> None:
    noise = np.random.default_rng(3)
    model = native_model(table, ball, tuple(f"red {k}" for k in range(5)))
    model.opt.timestep = 5e-4
    data = place(model, [(-0.8, 0.2), (-0.3, -0.4), (0.1, 0.1), (0.5, 0.4), (0.9, -0.2)], ball.radius)
    data.qvel.reshape(-1, 6)[:, :2] = noise.uniform(-1.5, 1.5, (5, 2))
    data.qvel.reshape(-1, 6)[:, 3:] = noise.uniform(-40, 40, (5, 3))
    half = np.array([table.length, table.width]) / 2
    for _ in range(200):
        mujoco.mj_step(model, data, 100)
        if not table.pockets:
            position = data.qpos.reshape(-1, 7)
            assert np.all(np.abs(position[:, :2]) < half), "nothing leaves the table"
            assert np.all(np.abs(position[:, 2] - ball.radius) < 0.01)
    assert [warning.number for warning in data.warning] == [0] * len(data.warning)
    assert data.time == pytest.approx(10.0)


@pytest.mark.parametrize("target", [(0.0, 0.889), (1.7845, 0.889)], ids=["middle", "corner"])
def test_a_ball_rolled_into_a_pocket_falls(target: tuple[float, float]) -> None:
    model = native_model(FULL, SNOOKER, ("white",))
    start = np.array(target) - [0.3 if target[0] else 0.0, 0.3]
    data = place(model, [start], SNOOKER.radius)
    data.qvel[:2] = (np.array(target) - start) * 4
    for _ in range(80):
        mujoco.mj_step(model, data, 100)
        if data.qpos[2] < -0.1:
            return
    pytest.fail(f"the ball is still at {data.qpos[:3]}")


@pytest.mark.gl
def test_the_picture_shows_the_balls() -> None:
    from models.mjcf.render import render
    from models.table.snooker import racked

    places = racked(FULL, SNOOKER)
    assert len(places) == 22
    gaps = [np.hypot(*(a - b)) for a, b in itertools.combinations(places.values(), 2)]
    assert min(gaps) > SNOOKER.diameter
    names, xy = tuple(places), np.array(list(places.values()))
    picture = render(FULL, SNOOKER, names, xy, camera="overhead", size=(640, 360)).astype(int)
    assert picture.shape == (360, 640, 3)
    assert picture.std() > 20
    red, green, blue = np.moveaxis(picture, -1, 0)
    rack = (slice(120, 240), slice(400, 520))  # pixels
    cloth = np.sum((green > red + 40) & (green > blue + 20))
    reds = np.sum((red > green + 80)[rack])
    assert cloth > 0.25 * red.size
    assert reds > 150
    for present in ((red > 190) & (green > 190) & (blue > 170), (red > 170) & (green > 130) & (blue < 90)):
        assert present.sum() > 5, "white and yellow"
    assert np.sum((blue > red + 60) & (blue > green + 60)) > 5, "blue"
    gone = np.where(np.array([n.startswith("red") for n in names])[:, None], np.nan, xy)
    without = render(FULL, SNOOKER, names, gone, camera="overhead", size=(640, 360)).astype(int)
    left = (without[..., 0] > without[..., 1] + 80)[rack]
    assert left.sum() < 0.1 * reds, "potted balls are not drawn"


@pytest.mark.gl
def test_a_picture_that_cannot_be_drawn_says_why() -> None:
    from models.mjcf.render import render

    with pytest.raises(ValueError, match=r"ceiling.*choose from .*corner"):
        render(FULL, SNOOKER, ("white",), np.zeros((1, 2)), camera="ceiling")
    with pytest.raises(ValueError, match=r"positions has shape \(3,\); 1 balls need \(1, 2\)"):
        render(FULL, SNOOKER, ("white",), np.zeros(3))


def test_without_opengl_one_line_names_the_packages(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(BadInput, match="libegl1 libgl1"):
        gl.require_rendering()
    command = [sys.executable, "-m", "models.mjcf.render", str(tmp_path / "out.png")]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr.count("\n") == 1
    assert "libegl1 libgl1" in run.stderr
    assert not (tmp_path / "out.png").exists()


@pytest.mark.gl
def test_the_command_draws_the_picture_of_the_readme(tmp_path: Path) -> None:
    out = tmp_path / "table.png"
    command = [sys.executable, "-m", "models.mjcf.render", str(out), "--width", "320"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    assert out.read_bytes().startswith(b"\x89PNG")
    assert (ROOT / "models" / "mjcf" / "table.png").stat().st_size < 300_000
