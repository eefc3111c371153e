"""Clips that begin in mid-motion: read from where their motion is told, told apart from shots, written as they are."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest

from sysid.cli import main
from sysid.clips import ClipSet, Observation, read_clip_set, write_clip_set
from sysid.clips.running import SMOOTH_SAMPLES
from sysid.clips.segments import cuts_of, split_all
from sysid.clips.tracker.noise import position_noise
from tests.support.clip_samples import ROWS, contents, edit, make, refusal
from tests.support.running_clips import cut, cut_in_motion, written_running
from tests.truth.__main__ import main as generate

MOVES_M = 0.02  # in the first tenth of a second and more, of a ball that runs


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> ClipSet:
    folder = tmp_path_factory.mktemp("running") / "whole"
    words = ("--seed", "3", "--clips", "12", "--seconds", "2.5", "--kind", "cut,cut_side,cushion,long", "--no-cue")
    assert generate([str(folder), *words]) == 0
    return read_clip_set(folder)


@pytest.fixture(scope="module")
def cut_set(whole: ClipSet, tmp_path_factory: pytest.TempPathFactory) -> ClipSet:
    return written_running(cut_in_motion(whole, 7), tmp_path_factory.mktemp("running") / "cut")


def test_the_balls_that_move_at_the_beginning_are_known(whole: ClipSet, cut_set: ClipSet) -> None:
    assert any(len(clip.running) > 1 for clip in cut_set.clips)
    for clip, uncut in zip(cut_set.clips, whole.clips, strict=True):
        assert clip.struck == clip.running[0]
        assert clip.order_of_balls[: len(clip.running)] == clip.running
        began = clip.origin - uncut.origin
        for name in clip.balls:
            seen = uncut.balls[name]
            way = np.hypot(*(np.ptp(np.interp([began, began + 0.1], seen.time, seen.xy[:, k])) for k in (0, 1)))
            assert way > 2e-3 if name in clip.running else way < MOVES_M, (clip.file, name)


def test_a_running_clip_begins_clear_of_impacts(cut_set: ClipSet) -> None:
    sigma = position_noise(cut_set)
    for clip in cut_set.clips:
        for name in clip.running:
            cuts = cuts_of(name, dict(clip.balls), cut_set.table, cut_set.ball, sigma)
            assert min((one.sample for one in cuts), default=99) >= SMOOTH_SAMPLES - 1


def test_cut_just_before_an_impact_it_begins_after_it(whole: ClipSet, tmp_path: Path) -> None:
    sigma, clip = position_noise(whole), whole.clips[0]
    red = clip.balls["red"]
    hit = float(red.time[int(np.argmax(np.hypot(*(red.xy - red.xy[0]).T) > 6 * sigma))])
    early = cut(clip, 0.0)
    balls = {}
    for name, seen in early.balls.items():
        keep = seen.time > hit - 0.02
        balls[name] = Observation(seen.time[keep], seen.xy[keep], seen.theta[keep])
    one = dataclasses.replace(whole, clips=(dataclasses.replace(early, balls=balls),))
    (found,) = written_running(one, tmp_path / "set").clips
    assert set(found.running) == {"cue", "red"}
    assert hit <= found.origin < hit + 0.1


def test_written_and_read_again_it_is_the_same(cut_set: ClipSet, tmp_path: Path) -> None:
    write_clip_set(cut_set, tmp_path / "one")
    again = read_clip_set(tmp_path / "one")
    assert [clip.running for clip in again.clips] == [clip.running for clip in cut_set.clips]
    write_clip_set(again, tmp_path / "two")
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_segments_know_no_strike(cut_set: ClipSet) -> None:
    sigma = position_noise(cut_set)
    segments = split_all(cut_set.clips, cut_set.table, cut_set.ball, sigma, cut_set.fps)
    assert "start" in {s.before for s in segments}
    assert "strike" not in {s.before for s in segments}
    starts = {(s.clip, s.ball) for s in segments if s.before == "start"}
    assert starts == {(k, name) for k, clip in enumerate(cut_set.clips) for name in clip.running}


def test_check_tells_how_many_begin_in_mid_motion(
    cut_set: ClipSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_clip_set(cut_set, tmp_path / "set")
    assert main(["check", str(tmp_path / "set")]) == 0
    assert "note: 12 of 12 clips begin in mid-motion, without a strike" in capsys.readouterr().out


ROLLS = "t,ball,x,y,theta\n" + "".join(
    f"{k / 120:.6f},red,0.5,0.2,\n{k / 120:.6f},cue,{0.1 + 0.008 * k:.6f},0.2,\n" for k in range(40)
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The first of two clips runs."""
    made = make(tmp_path / "set")
    edit(made / "clips.toml", "cue = { speed = 1.9, azimuth = 0.5, side = 0.004 }", "running = true")
    (made / "clips/1.csv").write_text(ROLLS)
    return made


@pytest.mark.parametrize("struck", ['struck = "cue"\n', 'struck = "red"\n', ""])
def test_the_struck_ball_of_a_running_clip_need_not_be_known(folder: Path, struck: str) -> None:
    edit(folder / "clips.toml", 'struck = "cue"\n', struck)
    one, other = read_clip_set(folder).clips
    assert (one.struck, one.running) == ("cue", ("cue",))
    assert (other.struck, other.running) == ("cue", ())


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("running = true", "running = true\ncue = { speed = 1.9, azimuth = 0.5 }", 20, ("cue", "no", "remove one")),
        ("running = true", "running = 1", 19, ("running = 1", "true or false")),
        ("running = true", "runing = true", 19, ("'runing'", "did you mean 'running'")),
        ('struck = "cue"', 'struck = "blue"', 17, ("'blue'", "'red', 'cue'")),
    ],
)
def test_a_fault_of_a_running_clip_is_named(
    folder: Path, old: str, new: str, line: int, words: tuple[str, ...]
) -> None:
    edit(folder / "clips.toml", old, new)
    message = refusal(lambda: read_clip_set(folder))
    assert message.startswith(f"clips.toml, line {line}: ")
    assert [word for word in words if word not in message] == []


def test_a_running_clip_in_which_nothing_moves_is_refused(folder: Path) -> None:
    lines = [line for line in ROLLS.splitlines() if "cue" not in line]
    (folder / "clips/1.csv").write_text("\n".join(lines) + "\n")
    edit(folder / "clips.toml", 'struck = "cue"\n', "")
    assert "running = true, but no ball moves for 12 samples" in refusal(lambda: read_clip_set(folder))
    (folder / "clips/1.csv").write_text(ROWS.splitlines()[0] + "\n")
    assert "holds no samples" in refusal(lambda: read_clip_set(folder))


@pytest.mark.slow
def test_a_long_recording_of_balls_at_rest_is_refused_soon(folder: Path) -> None:
    lines = [f"{k / 120:.6f},{ball},{x},0.2," for k in range(60_000) for ball, x in (("red", 0.5), ("cue", 0.1))]
    (folder / "clips/1.csv").write_text("t,ball,x,y,theta\n" + "\n".join(lines) + "\n")
    began = time.process_time()
    assert "no ball moves" in refusal(lambda: read_clip_set(folder))
    assert time.process_time() - began < 30
