"""Plans played on the emulated launcher at a table with hidden parameters: once, where they may be, and on record."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.analytic.cue_impulse import Constants, Geometry, launch
from models.errors import BadInput
from models.model_file import Model, full_model
from models.shot import Array, Ball, Shot
from models.simulation.simulate import simulate
from robot.device.outcome import StrokeUnknown
from robot.device.protocol import LauncherError
from robot.device.settings import Settings, SpeedTable
from robot.emulator.faults import FAULT_KINDS, REPLY_FAULTS, REQUEST_FAULTS, FaultInjection
from robot.emulator.firmware import Firmware
from robot.emulator.table import EmulatedOptions, EmulatedTable, emulated_launcher
from robot.order import check_scene, read_order
from robot.play import Played, play_plan, played_file
from sysid.clips import Observation, check_clip_set, read_clip_set
from tests.support.clip_samples import contents
from tests.support.robot_plans import BALL, MODEL, OURS, REST, TABLE, straight_plan, struck

PLAYED_KEYS = {
    "format", "plan", "stroke", "asked", "cue_ball", "object_ball", "struck", "done", "when", "clip", "cue_end",
    "object_end", "cue_fell", "potted", "pocket", "from_wanted", "noted",
}  # fmt: skip


def quiet(line: str) -> None:
    """Nobody listens."""


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    return straight_plan(tmp_path / "plan.json")


def emulated(plan: Path, model: Model = MODEL, seed: int = 0, **more: Any) -> EmulatedTable:
    """The plan's balls on a table, the stand turned as the plan asks."""
    order = read_order(plan, OURS)
    places = dict(zip(order.scene.names, map(tuple, order.scene.position.tolist()), strict=True))
    return EmulatedTable(model, places, math.radians(order.yaw_deg), seed, EmulatedOptions(**more))


def played(
    plan: Path, table: EmulatedTable, settings: Settings = OURS, *, faults: FaultInjection | None = None, **more: Any
) -> tuple[Played, Firmware]:
    launcher, device = emulated_launcher(settings, table.hit, np.random.default_rng(1), faults=faults, say=quiet)
    with launcher:
        return play_plan(plan, launcher, table, say=quiet, **more), device


def expected(plan: Path, table: EmulatedTable, times: Array) -> Array:
    """Where the balls are by the model alone, from what the tip gave: (n, nball, 2) [m].

    While the tip pushes, the ball is half as fast: it is where one is that starts so much later.
    """
    scene, made = read_order(plan, OURS).scene, table.made
    assert made is not None
    n = len(scene.names)
    v, w = np.zeros((n, 2)), np.zeros((n, 3))
    v[0], w[0] = made.velocity[:2], made.spin
    later = np.maximum(times - made.contact_time / 2, 0.0)
    start = np.concatenate([[0.0], later[later > 0]])
    [track] = simulate(MODEL, [Shot(scene.names, scene.position, v, w, start)], jaws=True)
    return np.asarray(track.position[np.maximum(np.arange(len(times)) - int(np.sum(later == 0)) + 1, 0)])


def test_one_call_makes_one_stroke_and_leaves_the_cue_back(plan: Path) -> None:
    table = emulated(plan)
    outcome, device = played(plan, table)
    assert [d.what for d in device.actions] == [
        "booted",
        "homed",
        "moved",
        "moved",
        "begun",
        "struck",
        "retracted",
    ]  # up to its place from below
    assert table.strokes == 1
    assert outcome.struck == "yes" and outcome.done is not None and outcome.done.number == 1
    assert device.status().state == "IDLE"


def test_the_ball_goes_where_the_model_says_within_the_noise(plan: Path, tmp_path: Path) -> None:
    table = emulated(plan, sigma=5e-4, yaw_sd=0.0)
    outcome, _ = played(plan, table, clips=tmp_path / "set")
    [clip] = read_clip_set(tmp_path / "set").clips
    times = clip.balls["white"].time
    away = clip.balls["white"].xy - expected(plan, table, times)[: len(times), 0]
    assert len(times) > 100
    assert np.std(away) == pytest.approx(5e-4, rel=0.1)
    assert np.abs(away).max() < 5.5 * 5e-4
    seen = clip.balls["red"]
    assert np.abs(seen.xy - expected(plan, table, times)[: len(seen.time), 1]).max() < 5.5 * 5e-4
    assert outcome.potted and outcome.pocket == "corner +x +y" and outcome.object_end is None


@pytest.mark.parametrize(("side", "height"), [(0.0, 0.0), (0.008, 0.0), (0.0, 0.009), (-0.006, -0.006)])
def test_the_planned_stroke_is_what_the_cue_ball_gets(tmp_path: Path, side: float, height: float) -> None:
    plan = straight_plan(tmp_path / "plan.json", side=side, height=height)
    table = emulated(plan, yaw_sd=0.0)
    _, device = played(plan, table)
    [action], told = struck(device), read_order(plan, OURS).cue
    assert table.made is not None
    velocity = table.made.velocity
    # What the planner's plain law leaves out, slate and damping, makes 3 %; the drive's ripple and scatter 1 % more.
    assert np.hypot(*velocity[:2]) == pytest.approx(told.speed, rel=0.05)
    assert math.atan2(velocity[1], velocity[0]) == pytest.approx(told.azimuth, abs=0.002)
    assert action.x * BALL.radius / (BALL.radius + 0.01) == pytest.approx(told.side, abs=1e-4)
    assert action.y * BALL.radius / (BALL.radius + 0.01) == pytest.approx(told.height, abs=1e-4)


def test_the_same_seed_gives_the_same_film(plan: Path, tmp_path: Path) -> None:
    for name, seed in (("one", 3), ("same", 3), ("other", 4)):
        played(plan, emulated(plan, seed=seed), clips=tmp_path / name)
    one, same, other = (contents(tmp_path / n)["clips/0001.csv"] for n in ("one", "same", "other"))
    assert one == same != other


def test_the_record_and_the_clip_tell_what_was_done(plan: Path, tmp_path: Path) -> None:
    outcome, device = played(plan, emulated(plan), clips=tmp_path / "set")
    assert check_clip_set(tmp_path / "set") == []
    found = read_clip_set(tmp_path / "set")
    [clip], [action] = found.clips, struck(device)
    stroke = json.loads(plan.read_text())["stroke"]
    assert clip.struck == "white" and clip.cue is not None and set(clip.balls) == {"white", "red", "blue"}
    assert dataclasses.asdict(clip.cue) == pytest.approx(stroke)
    assert (found.table, found.ball, found.fps, found.sigma) == (TABLE, BALL, 180.0, 5e-4)
    told = json.loads(played_file(plan).read_text())
    assert set(told) == PLAYED_KEYS
    assert told["format"] == "billiard-played/1" and told["plan"] == "plan.json" and told["struck"] == "yes"
    assert told["clip"] == {"folder": str(tmp_path / "set"), "file": "clips/0001.csv"}
    assert told["done"]["cue_speed"] == pytest.approx(action.speed, rel=0.005)
    end = clip.balls["white"].xy[-1]
    assert told["cue_end"] == pytest.approx(end, abs=0.003)
    assert told["from_wanted"] == pytest.approx(math.dist(end, REST) - 0.05, abs=0.003)
    assert told["potted"] is outcome.potted is True


def test_a_second_film_joins_the_clip_set_and_leaves_the_first(plan: Path, tmp_path: Path) -> None:
    played(plan, emulated(plan, seed=1), clips=tmp_path / "set")
    first = contents(tmp_path / "set")["clips/0001.csv"]
    played(plan, emulated(plan, seed=2), clips=tmp_path / "set")
    assert [c.file for c in read_clip_set(tmp_path / "set").clips] == ["clips/0001.csv", "clips/0002.csv"]
    assert contents(tmp_path / "set")["clips/0001.csv"] == first


def test_a_hidden_cloth_shows_in_the_film(tmp_path: Path) -> None:
    plan = straight_plan(tmp_path / "plan.json", speed=2.0, height=-0.012)
    rolls = float(MODEL.parameters()["decoupled_cloth.roll"])
    ran = []
    for model in (MODEL, MODEL.with_values({"decoupled_cloth.roll": 2 * rolls})):
        table = emulated(plan, model, yaw_sd=0.0)
        played(plan, table)
        white = table.track.position[:, 0] if table.track else np.zeros((1, 2))
        ran.append(math.dist(white[-1], white[np.argmax(white[:, 0])]))  # back from where it met the red
    assert ran[0] > 0.1
    assert 0.4 * ran[0] < ran[1] < 0.75 * ran[0]


def test_the_stand_serves_one_stroke(plan: Path) -> None:
    table = emulated(plan)
    table.hit(1.0, 0.0, 0.0)
    table.hit(1.0, 0.0, 0.0)
    assert table.film() and table.strokes == 1
    table.hit(1.0, 0.0, 0.0)
    assert not table.film() and table.strokes == 1
    table.turn_to(0.0)
    table.hit(1.0, 0.0, 0.0)
    assert table.film() and table.strokes == 2


@pytest.mark.parametrize("seed", range(6))
def test_a_bad_line_makes_one_stroke(plan: Path, seed: int) -> None:
    table = emulated(plan)
    faults = FaultInjection(0.05, np.random.default_rng(seed), REQUEST_FAULTS + REPLY_FAULTS)
    outcome, device = played(plan, table, faults=faults)
    assert len(struck(device)) == table.strokes == 1
    assert outcome.done is not None and outcome.struck == "yes"


@pytest.mark.parametrize("seed", range(8))
def test_no_fault_makes_two_strokes(plan: Path, seed: int) -> None:
    table = emulated(plan)
    launcher, device = emulated_launcher(
        OURS,
        table.hit,
        np.random.default_rng(1),
        say=quiet,
        faults=FaultInjection(0.15, np.random.default_rng(seed), FAULT_KINDS),
    )
    try:
        with launcher:
            outcome = play_plan(plan, launcher, table, say=quiet)
        assert outcome.struck == "yes" and len(struck(device)) == 1
    except LauncherError as error:
        table.film()
        assert len(struck(device)) == table.strokes <= 1
        told = json.loads(played_file(plan).read_text())["struck"] if played_file(plan).exists() else None
        assert told == ("unknown" if isinstance(error, StrokeUnknown) else None)


def test_an_unknown_stroke_is_said_and_what_was_seen_is_kept(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = emulated(plan)
    launcher, device = emulated_launcher(OURS, table.hit, np.random.default_rng(1), say=quiet)
    real = launcher.strike

    def lost(string: str | int) -> Any:
        real(string)
        raise StrokeUnknown("stroke 1 may have been made")

    with launcher:
        monkeypatch.setattr(launcher, "strike", lost)
        with pytest.raises(StrokeUnknown):
            play_plan(plan, launcher, table, clips=tmp_path / "set", say=quiet)
        assert device.status().state == "EXTENDED"  # nothing more has moved
    told = json.loads(played_file(plan).read_text())
    assert told["struck"] == "unknown" and told["done"] is None and told["potted"] is True
    assert told["noted"] == ["stroke 1 may have been made"]
    assert len(read_clip_set(tmp_path / "set").clips) == 1


def test_a_stroke_whose_record_is_lost_is_said_to_be_made(plan: Path, tmp_path: Path) -> None:
    played_file(plan).mkdir()
    outcome, device = played(plan, emulated(plan), clips=tmp_path / "set")
    assert len(struck(device)) == 1 and outcome.struck == "yes" and outcome.potted is True
    assert outcome.noted[-1].startswith("the record is lost: ") and "is a folder" in outcome.noted[-1]
    assert len(read_clip_set(tmp_path / "set").clips) == 1


def test_without_a_camera_nothing_is_known_of_the_balls(plan: Path) -> None:
    table = emulated(plan)
    launcher, device = emulated_launcher(OURS, table.hit, np.random.default_rng(1), say=quiet)
    with launcher:
        outcome = play_plan(plan, launcher, None, say=quiet)
    assert len(struck(device)) == 1 and outcome.struck == "yes"
    assert (outcome.potted, outcome.cue_end, outcome.cue_fell, outcome.from_wanted) == (None,) * 4


def test_a_ball_lost_from_sight_is_no_pot(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = emulated(plan)
    whole = table.film

    def shorter() -> dict[str, Observation]:
        film = whole()
        red = film["red"]
        return film | {"red": Observation(red.time[:20], red.xy[:20], red.theta[:20])}

    monkeypatch.setattr(table, "film", shorter)
    outcome, _ = played(plan, table)
    assert (outcome.potted, outcome.pocket, outcome.object_end) == (None, None, None)
    assert outcome.cue_end is not None and outcome.cue_fell is False


def refused(plan: Path, settings: Settings = OURS, table: EmulatedTable | None = None, **more: Any) -> str:
    """The message of a plan that is refused before anything moves or is written."""
    before = contents(plan.parent)
    hits: list[Any] = []
    launcher, device = emulated_launcher(settings, lambda *hit: hits.append(hit), np.random.default_rng(1), say=quiet)
    with launcher, pytest.raises(BadInput) as caught:
        play_plan(plan, launcher, table, say=quiet, **more)
    assert [d.what for d in device.actions] == ["booted"] and not hits
    assert contents(plan.parent) == before
    text = str(caught.value)
    assert text.isprintable()
    return text


def test_another_scene_is_refused_by_the_ball_that_lies_wrong(plan: Path) -> None:
    order = read_order(plan, OURS)
    places = dict(zip(order.scene.names, order.scene.position.tolist(), strict=True))

    def at(**change: Any) -> EmulatedTable:
        moved = {n: xy for n, xy in (places | change).items() if xy is not None}
        return EmulatedTable(MODEL, moved, 0.0, options=EmulatedOptions(sigma=0.0))

    x, y = places["red"]
    assert "ball red is 12.0 mm from its place in the plan" in refused(plan, table=at(red=(x - 0.012, y)))
    assert "ball blue is not seen" in refused(plan, table=at(blue=None))
    assert "ball pink is at 0.0000, 0.0000, but not in the plan" in refused(plan, table=at(pink=(0.0, 0.0)))
    check_scene(order.scene, at(red=(x - 0.0049, y)).look(), plan)
    with pytest.raises(BadInput, match="ball red"):
        check_scene(order.scene, at(red=(x - 0.0051, y)).look(), plan)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"string": "001p", "cue_speed": 2.75}, "string 001p gives a cue speed of 2.75 m/s; the limits are 0.3 to 2.2"),
        ({"x0_mm": 15.0, "y0_mm": 15.0}, "stay within 0.5"),
        ({"theta_deg": 170.0}, "yaw is 170.0 degrees; the stand's range is -90.0 to 90.0"),
        ({"string": "47p"}, "give three digits"),
        ({"x0_mm": None}, "x0_mm of its launcher is None"),
        ({"cue_speed": 3.2}, "cue speed is 3.2 m/s"),
    ],
)
def test_what_is_beyond_the_launcher_is_refused(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    limits = dataclasses.replace(OURS.limits, cue_speed=(0.3, 2.2), yaw_deg=(-90.0, 90.0))
    plan = straight_plan(tmp_path / "plan.json", **change)
    assert said in refused(plan, dataclasses.replace(OURS, limits=limits))


def test_plans_that_are_none_are_refused(plan: Path) -> None:
    data = json.loads(plan.read_text())
    for change, said in (
        ({"stroke": None, "why": "no way lies open"}, "holds no stroke (no way lies open)"),
        ({"stroke": {"speed": math.nan}}, "speed of its stroke is nan"),
        ({"scene": {}}, "plan.json scene"),
        ({"format": "billiard-plan/9"}, "billiard-plan/9"),
    ):
        plan.write_text(json.dumps(data | change))
        assert said in refused(plan)


def test_settings_and_clips_of_another_ball_are_refused(plan: Path, tmp_path: Path) -> None:
    other = dataclasses.replace(OURS, stage=dataclasses.replace(OURS.stage, ball_radius_mm=28.575))
    assert "radius of 26.25 mm" in refused(plan, other)
    played(plan, emulated(plan), clips=tmp_path / "set")
    played_file(plan).unlink()
    said = refused(plan, table=emulated(plan, fps=60.0), clips=tmp_path / "set")
    assert "its fps is 180.0, but this camera's is 60.0" in said


def test_a_calibrated_launcher_gets_the_string_that_gives_the_planned_speed(plan: Path) -> None:
    told = json.loads(plan.read_text())["launcher"]
    slower = dataclasses.replace(OURS, calibration=SpeedTable((1, 200), (2.5, 0.2), "test"))
    outcome, device = played(plan, emulated(plan), slower)
    assert outcome.done is not None and outcome.done.string != told["string"]
    assert outcome.done.asked_speed == pytest.approx(told["cue_speed"], abs=0.007)
    assert struck(device)[0].speed == pytest.approx(told["cue_speed"], rel=0.03)
    assert any("instead" in line for line in outcome.noted)


def test_tables_that_cannot_be_played_are_refused() -> None:
    with pytest.raises(BadInput, match="position is empty"):
        EmulatedTable(MODEL, {}, 0.0)
    with pytest.raises(BadInput, match="lacks ball_impact, cushion_impact, decoupled_cloth"):
        EmulatedTable(Model(TABLE, BALL), {"white": (0.0, 0.0)}, 0.0)


def test_balls_of_any_size_are_struck() -> None:
    pool = EmulatedTable(full_model(TABLE, Ball(0.05715, 0.17)), {"white": (0.0, 0.0)}, 0.0)
    pool.hit(1.0, 0.0, 0.0)
    told = launch(Constants(), Geometry(pool.ball), np.ones(1), np.zeros(1), np.zeros(1))[0][0, 0]
    assert len(pool.film()["white"].time) > 50 and pool.made is not None
    assert pool.made.velocity[0] == pytest.approx(told, rel=0.01)


def test_no_yes_is_no_stroke(plan: Path) -> None:
    asked: list[str] = []
    table = emulated(plan)

    def no(what: str) -> bool:
        asked.append(what)
        return False

    with pytest.raises(BadInput, match="nothing was struck"):
        played(plan, table, confirm=no)
    assert table.film() == {} and not played_file(plan).exists()
    assert "yaw 45.00 degrees" in asked[0] and json.loads(plan.read_text())["launcher"]["string"] in asked[0]
    played(plan, table, confirm=lambda what: True)
    assert table.strokes == 1
