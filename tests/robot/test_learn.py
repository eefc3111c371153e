"""The loop's parts: when it ends, films up to the jaws, a launcher's constants from films, refits whole or absent."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robot.learning.loop
from models.analytic.cue_impulse import CONSTANT_NAMES
from models.analytic.pocket import pockets_of
from models.errors import BadInput
from models.model_file import read_model
from models.shot import Array, Ball, Session, Shot, Table, Track
from models.simulation.simulate import simulate
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.launcher.cueing_map import CueingMap
from planner.launcher.mapped import with_map
from planner.launcher.stroke import LauncherModel as Strokes
from planner.launcher.stroke import stroke_terms
from robot.cueing.map_fit import PRIOR_SD
from robot.device.settings import Settings
from robot.emulator.table import EmulatedOptions, EmulatedTable, emulated_launcher
from robot.learning.ending import why_ended
from robot.learning.history import History, fit_folder, read_history
from robot.learning.loop import begin
from robot.learning.refit import MIN_STROKES, Learnt, learn_launcher, with_commands
from sysid.cli.common import Start
from sysid.clips import Clip, ClipSet, CueCommand, Observation, write_clip_set
from sysid.clips.jaws import JAW_MARGIN_M, MIN_CLIP_SAMPLES, before_jaws
from tests.support.pocket_shots import into_pockets
from tests.support.series_samples import COURSE, MAP, MODEL, RESULT, TRUE, shot, story

TIMES = np.arange(0.0, 3.0, 1 / 180)
JAWS = pockets_of(SNOOKER_TABLE, SNOOKER_BALL).jaws


def test_a_series_goes_on_while_it_learns() -> None:
    for blocks in ((0.1,), (0.02, 0.02), (0.1, 0.05, 0.02), (0.1, 0.06, 0.058), (0.2, 0.1, 0.1, 0.05)):
        assert why_ended(story(blocks), 4) == "", blocks


def test_a_series_ends_where_the_miss_is_what_the_plans_foresee() -> None:
    assert "nothing is left to learn" in why_ended(story((0.1, 0.022, 0.021)), 4)
    assert "miss is 21 mm (median of 4), predicted 18 mm" in why_ended(story((0.1, 0.022, 0.021)), 4)
    assert why_ended(story((0.1, 0.026, 0.0241)), 4) == "", "more than 1.3 times that, and it has just fallen before"


def test_a_series_ends_where_the_miss_does_not_fall_any_more() -> None:
    assert "has not fallen in two refits" in why_ended(story((0.1, 0.102, 0.101)), 4)
    assert "has not fallen in two refits" in why_ended(story((0.4, 0.1, 0.102, 0.101)), 4)
    assert why_ended(story((0.101, 0.102, 0.09)), 4) == ""


def test_a_series_goes_on_after_another_verdict_or_without_refits() -> None:
    flat = (0.1, 0.022, 0.021)
    tilt, nap = ("table_tilt",), ("cloth_nap",)
    assert why_ended(story(flat, verdicts=[tilt, tilt, nap]), 4) == ""
    assert why_ended(story(flat, verdicts=[nap, tilt, tilt]), 4) != ""
    assert why_ended(dataclasses.replace(story(flat), refits=story(flat).refits[:2]), 4) == ""
    assert why_ended(History({}, (), (), ""), 4) == ""


def test_balls_in_pockets_have_no_miss() -> None:
    seen = story((0.1, 0.022, 0.021))
    lost = tuple(shot(s.number, math.nan) if s.number % 4 == 0 else s for s in seen.shots)
    assert "nothing is left" in why_ended(dataclasses.replace(seen, shots=lost), 4)
    none = tuple(shot(s.number, math.nan) for s in seen.shots)
    assert why_ended(dataclasses.replace(seen, shots=none), 4) == "", "nothing is said of what nobody saw"


def film(track: Track, file: str = "clips/1.csv") -> Clip:
    """A track as a camera without noise sees it."""
    balls = {}
    for k, name in enumerate(track.names):
        rows = np.flatnonzero(np.isfinite(track.position[:, k, 0]))
        balls[name] = Observation(track.times[rows], track.position[rows, k], np.full(rows.size, math.nan))
    return Clip(file, track.names[0], balls)


def clip_set(*clips: Clip, table: Table = SNOOKER_TABLE, ball: Ball = SNOOKER_BALL) -> ClipSet:
    return ClipSet(table, ball, 180.0, clips, 5e-4, Path("unused"))


@cache
def at_pockets() -> tuple[Track, ...]:
    """Two balls, the second sent at a pocket; some drop clean, some off a jaw, some come out again."""
    shots = [dataclasses.replace(s, times=TIMES) for s in into_pockets(60, 8, 2)]
    return tuple(simulate(MODEL, shots, jaws=True))


def gap(xy: Array) -> Array:
    """How far places (n, 2) are from the nearest jaw [m]."""
    return np.asarray((np.hypot(*(xy[:, None] - JAWS[None, :, :2]).transpose(2, 0, 1)) - JAWS[:, 2]).min(axis=1))


def fate(track: Track) -> str:
    """What became of the second ball, where it alone came to a pocket."""
    met = [name for k, name in enumerate(track.names) if gap(film(track).balls[name].xy).min() < JAW_MARGIN_M]
    if met not in ([], ["b"]):
        return "both"
    fell = any(e.kind == "pocket" and e.balls[0] == "b" for e in track.events)
    if not met:
        return "clean" if fell else "away"
    return "off a jaw" if fell else "rattled"


def by_fate(kind: str) -> list[Track]:
    found = [track for track in at_pockets() if fate(track) == kind]
    assert found, f"no shot of these is {kind}"
    return found


def test_nothing_is_left_beyond_a_jaw() -> None:
    for track in at_pockets():
        for clip in before_jaws(clip_set(film(track))).clips:
            for name, seen in clip.balls.items():
                moved = np.ptp(film(track).balls[name].xy, axis=0).max() > JAW_MARGIN_M
                assert not moved or gap(seen.xy[1:]).min(initial=1.0) >= JAW_MARGIN_M


def test_a_clip_ends_where_a_ball_rattles() -> None:
    for track in by_fate("rattled"):
        whole = film(track)
        touch = whole.balls["b"].time[np.argmax(gap(whole.balls["b"].xy) < JAW_MARGIN_M)]
        [clip] = before_jaws(clip_set(whole)).clips
        for name, seen in clip.balls.items():
            assert seen.time[-1] < touch, "it may meet the others after that"
            assert np.array_equal(seen.xy, whole.balls[name].xy[whole.balls[name].time < touch])


def test_the_commands_look_up_to_the_jaws_and_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = film(by_fate("rattled")[0], "clips/0001.csv")
    write_clip_set(clip_set(whole), tmp_path / "set")
    assert len(Start(tmp_path / "set").load()[0].clips[0].balls["b"].time) < len(whole.balls["b"].time)
    told = capsys.readouterr().out
    assert "note: clips/0001.csv is used up to where a ball touches a pocket's jaws" in told
    clean = film(by_fate("clean")[0], "clips/0001.csv")
    write_clip_set(clip_set(clean), tmp_path / "clean")
    Start(tmp_path / "clean").load()
    assert "jaws" not in capsys.readouterr().out


def test_a_ball_that_drops_off_a_jaw_leaves_the_others_their_samples() -> None:
    for track in by_fate("off a jaw"):
        whole = film(track)
        [clip] = before_jaws(clip_set(whole)).clips
        touch = whole.balls["b"].time[np.argmax(gap(whole.balls["b"].xy) < JAW_MARGIN_M)]
        assert clip.balls["b"].time[-1] < touch
        assert np.array_equal(clip.balls["a"].xy, whole.balls["a"].xy)


def test_a_clean_drop_and_a_shot_away_from_pockets_keep_all() -> None:
    struck = Shot(
        ("a", "b"), np.array([[-0.5, 0.0], [0.3, 0.4]]), np.array([[0.8, 0.1], [0, 0]]), np.zeros((2, 3)), TIMES
    )
    away = simulate(MODEL, [struck], jaws=True)[0]
    assert fate(away) == "away"
    for track in (away, *by_fate("clean")):
        whole = film(track)
        assert before_jaws(clip_set(whole)).clips == (whole,)


def test_a_clip_of_which_next_to_nothing_is_left_is_left_out() -> None:
    whole = film(by_fate("rattled")[0])
    touch = int(np.argmax(gap(whole.balls["b"].xy) < JAW_MARGIN_M))
    for keep in (MIN_CLIP_SAMPLES - 1, MIN_CLIP_SAMPLES):
        first = whole.balls["a"].time[touch - keep]
        late = {
            n: Observation(o.time[o.time >= first], o.xy[o.time >= first], o.theta[o.time >= first])
            for n, o in whole.balls.items()
        }
        left = before_jaws(clip_set(dataclasses.replace(whole, balls=late))).clips
        assert len(left) == (keep == MIN_CLIP_SAMPLES)


def test_without_pockets_and_with_unknown_ones_clips_stay() -> None:
    whole = film(by_fate("rattled")[0])
    for table, ball in ((Table(3.569, 1.778, pockets=False), SNOOKER_BALL), (SNOOKER_TABLE, Ball(0.095, 0.8))):
        given = clip_set(whole, table=table, ball=ball)
        assert before_jaws(given) is given


def test_a_balls_columns_are_cut_with_it() -> None:
    whole = film(by_fate("rattled")[0])
    seen = whole.balls["b"]
    marked = dataclasses.replace(seen, extra={"quality": tuple(str(k) for k in range(len(seen.time)))})
    [clip] = before_jaws(clip_set(dataclasses.replace(whole, balls={**whole.balls, "b": marked}))).clips
    left = clip.balls["b"]
    assert left.extra["quality"] == tuple(str(k) for k in range(len(left.time)))


@cache
def strokes(count: int = 30) -> tuple[ClipSet, tuple[dict[str, Any], ...]]:
    """The cue ball alone, struck all over it as planned with the start map; and the records of what was told."""
    rng, ours = np.random.default_rng(5), Settings()
    launcher = with_map(Strokes(), MAP, SNOOKER_BALL)
    clips, records = [], []
    for k in range(count):
        turn, off = (
            rng.uniform(-math.pi, math.pi),
            0.95 * launcher.offset * SNOOKER_BALL.radius * math.sqrt(rng.random()),
        )
        q = np.array([[rng.uniform(0.5, 1.6), rng.uniform(-0.3, 0.3), off * math.cos(turn), off * math.sin(turn)]])
        q = launcher.playable(q, SNOOKER_BALL)[0]
        asked = launcher.command(MODEL, q)
        table = EmulatedTable(
            MODEL, {"white": (-1.2, 0.0)}, math.radians(asked["theta_deg"]), k, EmulatedOptions(constants=TRUE)
        )
        device, _ = emulated_launcher(ours, table.hit, np.random.default_rng([k, 1]), say=lambda line: None)
        with device:
            device.home()
            device.move_tip(asked["x0_mm"], asked["y0_mm"])
            done = device.strike(asked["string"])
        terms = stroke_terms(launcher, q)
        cue = CueCommand(**{n: terms[n] for n in ("speed", "azimuth", "side", "height", "elevation")})
        clips.append(Clip(f"clips/{k + 1:04d}.csv", "white", table.film(), cue, session=Session(k / (count - 1))))
        records.append({"asked": asked, "done": dataclasses.asdict(done), "clip": {"file": clips[-1].file}})
    return clip_set(*clips), tuple(records)


@cache
def learnt(count: int) -> CueingMap:
    clips, records = strokes()
    some = before_jaws(dataclasses.replace(clips, clips=clips.clips[:count]))
    return learn_launcher(some, records, MODEL, MAP)


def test_a_launchers_constants_come_back_from_films() -> None:
    made = learnt(30)
    sds = dict(zip(CONSTANT_NAMES, np.sqrt(np.diag(made.covariance)), strict=True))
    for name, sd in sds.items():
        assert 0 < sd < 1.2 * PRIOR_SD[name]
        assert abs(getattr(made.constants, name) - getattr(TRUE, name)) < 4 * sd, name
    assert (made.shots, made.left_out) == (30, 0)
    # What thirty strokes tell: the start misses the truth by many of its standard deviations.
    assert sds["aim_zero"] < 1e-3 < abs(TRUE.aim_zero)
    assert sds["end_mass"] < 5e-4 < abs(TRUE.end_mass - MAP.constants.end_mass)


def test_a_learnt_launcher_is_told_what_it_needs() -> None:
    """Speed and direction of strokes, by what was learnt and by the start, against the truth."""
    side, height = (v.ravel() for v in np.meshgrid([-0.01, 0.0, 0.01], [-0.008, 0.0, 0.008]))
    truth, start, made = (
        np.array(one.forward(np.full(side.size, 0.9), side, height)[:2])
        for one in (dataclasses.replace(MAP, constants=TRUE), MAP, learnt(30))
    )
    speed, turn = (np.abs(v) for v in made - truth)
    assert (speed / truth[0]).max() < 0.025  # ripple of the rack is a part of the strings' speeds that nobody tells
    assert speed.mean() < 0.6 * np.abs(start - truth)[0].mean()
    assert turn.max() < 2e-3
    assert turn.mean() < 0.35 * np.abs(start - truth)[1].mean()


def test_commands_are_what_a_map_makes_of_what_was_told() -> None:
    """With the true map a clip's command is what the ball got, but for what does not repeat."""
    clips, records = strokes()
    true_map = dataclasses.replace(MAP, constants=TRUE)
    for one, usual, record in zip(
        with_commands(clips, records, true_map).clips, with_commands(clips, records, MAP).clips, records, strict=True
    ):
        track = one.balls["white"]
        assert one.cue is not None and usual.cue is not None and usual.cue.elevation == MAP.geometry.elevation
        told = record["done"]
        place = (np.array([v]) for v in (told["asked_speed"], 1e-3 * told["x0_mm"], 1e-3 * told["y0_mm"]))
        speed, turned, side, height = (float(v[0]) for v in true_map.forward(*place))
        assert (one.cue.speed, one.cue.side, one.cue.height) == pytest.approx((speed, side, height))
        assert one.cue.azimuth == pytest.approx(math.radians(record["asked"]["theta_deg"]) + turned)
        assert np.array_equal(track.xy, usual.balls["white"].xy) and one.cue != usual.cue


def test_too_few_strokes_leave_the_map_as_it_was() -> None:
    assert learnt(MIN_STROKES - 1) is MAP
    told = Learnt(MODEL, MAP, {}).launcher()
    assert list(told) == list(CONSTANT_NAMES)
    assert told["end_mass"]["value"] == MAP.constants.end_mass and math.isnan(told["end_mass"]["sd"])


@pytest.fixture
def simple(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refits that find the same without a look at any film."""
    better = MODEL.with_values({"decoupled_cloth.roll": 0.0125})
    monkeypatch.setattr(robot.learning.loop, "films", lambda folder, count: (clip_set(), []))
    monkeypatch.setattr(robot.learning.loop, "relearn", lambda *_: Learnt(better, MAP, RESULT))


def test_a_refit_is_there_with_the_last_of_its_files(
    simple: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin(tmp_path, COURSE)
    out = fit_folder(tmp_path, 4)
    for name in ("write_model", "write_map", "write_json"):
        real = getattr(robot.learning.loop, name)

        def broken(*given: Any, real: Any = real) -> None:
            real(*given)
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(robot.learning.loop, name, broken)
            with pytest.raises(KeyboardInterrupt):
                robot.learning.loop._refit(tmp_path, COURSE, 4, lambda line: None)
        assert not (out / "fit.json").exists() and read_history(tmp_path).refits == ()
    said = robot.learning.loop._refit(tmp_path, COURSE, 4, lambda line: None)
    assert "learnt from 4 shots: table_tilt" in said
    [found] = read_history(tmp_path).refits
    assert (found.shots, found.verdict, found.unexplained) == (4, ("table_tilt",), "")
    assert math.isnan(found.held_rms) and found.values["decoupled_cloth.roll"] == (0.0125, 1e-5)
    assert math.isnan(found.launcher["end_mass"][1])
    model, cueing_map = robot.learning.loop.latest(tmp_path, COURSE, 4)
    assert model.parameters()["decoupled_cloth.roll"] == 0.0125 and cueing_map.constants == MAP.constants
    assert robot.learning.loop.latest(tmp_path, COURSE, 0) == (MODEL, MAP)


def test_a_folder_is_one_series(tmp_path: Path) -> None:
    folder = tmp_path / "series"
    begin(folder, COURSE)
    begin(folder, dataclasses.replace(COURSE, shots=60, stops=False))  # these may change
    assert read_model(folder / "start.toml").parameters() == MODEL.parameters()
    other_map = dataclasses.replace(MAP, constants=TRUE)
    for change, says in (
        ({"seed": 1}, "another seed"), ({"every": 5}, "another number of shots between refits"),
        ({"balls": 3}, "another number of balls"), ({"chosen": 0}, "another number of chosen shots"),
        ({"model": MODEL.with_values({"decoupled_cloth.roll": 0.01})}, "another start model"),
        ({"cueing_map": other_map}, "another cueing map"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=says):
            begin(folder, dataclasses.replace(COURSE, **change))
    full = tmp_path / "full"
    full.mkdir()
    (full / "thesis.txt").write_text("mine")
    with pytest.raises(BadInput, match="holds no series"):
        begin(full, COURSE)
    assert (full / "thesis.txt").read_text() == "mine"


@pytest.mark.parametrize("change", [{"shots": 0}, {"shots": 10_000}, {"every": 3}, {"every": 1001}])
def test_what_is_no_series_is_named(change: dict[str, int]) -> None:
    with pytest.raises(BadInput, match=f"{next(iter(change.values()))}.*; give 1 to 9999, and 4 to 1000"):
        dataclasses.replace(COURSE, **change)


def test_shots_that_are_chosen_leave_one_to_be_played() -> None:
    with pytest.raises(BadInput, match="4 chosen shots of 4 between refits; give 0 to 3"):
        dataclasses.replace(COURSE, chosen=4)
