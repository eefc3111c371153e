"""From sightings to a clip set: shots split rightly, what is no shot left out and told, the noise known."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path as File

import numpy as np
import pytest

from models.errors import BadInput
from sysid.clips import check_clip_set, read_clip_set, write_clip_set
from sysid.vision.tracks.clips import Extra, clip_set
from sysid.vision.tracks.following.follow import BallTrack, Follower
from sysid.vision.tracks.moves import TrackedScene
from sysid.vision.tracks.noise import Noise, estimate_noise, residuals
from sysid.vision.tracks.shots.clip_extent import balls_there
from sysid.vision.tracks.track import tracked
from tests.support.followed_balls import (
    BALL,
    CAMERA,
    FPS,
    HOME,
    NAMES,
    TABLE,
    Recording,
    random_tracks,
    sightings,
    tracked_of,
)

PLACE = CAMERA.radius / float(CAMERA.radius_px(np.zeros((1, 2)))[0])  # size of a pixel on the table [m]


def test_several_shots_are_split(tmp_path: File) -> None:
    made = Recording().wait(0.5).shot((1.2, 0.45)).wait(0.6).shot((-0.9, 0.1)).wait(0.4).shot((0.8, -0.5), ball=1)
    made.wait(0.5).put(0, (-0.5, 0.2)).wait(0.5).shot((-0.2, 0.3)).wait(0.5)
    found = tracked_of(made, drop=0.02)
    assert found.doubts == ()
    assert found.left_out == ()
    assert [shot.struck for shot in found.shots] == ["white", "white", "red", "white"]
    assert [shot.time for shot in found.shots] == pytest.approx(made.struck, abs=2e-3)
    speeds = [np.hypot(1.2, 0.45), np.hypot(0.9, 0.1), np.hypot(0.8, 0.5), np.hypot(0.2, 0.3)]
    assert [shot.speed for shot in found.shots] == pytest.approx(speeds, abs=0.06)  # the cloth slows a sliding ball
    clips = clip_set(found, CAMERA, BALL.mass, FPS)
    write_clip_set(clips, tmp_path / "set")
    assert check_clip_set(tmp_path / "set") == []
    clips = read_clip_set(tmp_path / "set")
    for clip in clips.clips:
        seen = clip.balls[clip.struck]
        assert next(iter(clip.balls)) == clip.struck
        assert seen.time[0] == 0.0
        speed = np.hypot(*np.diff(seen.xy[:4], axis=0).T) / np.diff(seen.time[:4])
        assert speed[0] > 0.9 * speed[-1], "a clip begins after the strike"
        resting = [o for name, o in clip.balls.items() if name != clip.struck]
        assert all(np.ptp(o.xy[-10:], axis=0).max() < 2e-3 for o in (seen, *resting)), "and ends when all rest"
    assert {len(clip.balls) for clip in clips.clips} == {3}
    assert clips.clips[1].note == f"shot 2 at {made.struck[1]:.2f} s; 3 balls"


def test_the_noise_is_known() -> None:
    made = Recording().wait(0.5).shot((1.2, 0.45)).wait(0.6).shot((-0.9, 0.1)).wait(0.5)
    for noise in (0.05, 0.2, 0.5):
        found = tracked_of(made, noise=noise)
        assert found.noise.moving == pytest.approx(noise * PLACE, rel=0.1)
        assert found.noise.resting == pytest.approx(noise * PLACE, rel=0.1)
        assert clip_set(found, CAMERA, BALL.mass, FPS).sigma == found.noise.sigma
        assert len(found.shots) == 2


def test_noise_that_nothing_shows_is_not_printed_as_a_number() -> None:
    still = tracked_of(Recording().wait(1.0)).noise
    assert still.text() == f"noise {1e3 * still.resting:.3f} mm resting"
    assert Noise(math.nan, math.nan).text() == "noise unknown: too few frames show a ball"


@pytest.mark.slow
def test_fifty_random_shots_of_three_balls() -> None:
    """Every one is found, of the ball that was struck, however it collides."""
    rng = np.random.default_rng(1)
    for true in random_tracks(120, 50, 4.0):
        position = np.concatenate([np.repeat(true.position[:1], 40, axis=0), true.position])
        follower = Follower(CAMERA)
        for index, some in enumerate(sightings(position, ("white", "red", "red"), rng, drop=0.02)):
            follower.update(index, index / FPS, some)
        frames = np.arange(len(position))
        found = tracked(follower.tracks(), frames, frames / FPS, CAMERA)
        assert [shot.struck for shot in found.shots] == ["white"], (found.left_out, true.events)
        assert found.shots[0].time == pytest.approx(40 / FPS, abs=1.01 / FPS)
        assert len(found.shots[0].balls) == 3


def test_a_ball_that_was_taken_away_on_its_way_sets_nothing_in_motion() -> None:
    made = Recording().wait(0.5).shot((0.9, -0.2), ball=1, seconds=0.5)
    made.now = made.now.copy()
    made.now[1] = np.nan
    made.wait(1.5).shot((0.8, 0.3)).wait(0.5)
    assert [shot.struck for shot in tracked_of(made).shots] == ["red", "white"]


@pytest.mark.parametrize("late", [4, 6, 8])
def test_one_frame_that_is_taken_late_is_no_hand_that_pushes(late: int) -> None:
    """The step after it seems twice as fast."""
    made, follower = Recording(fps=30.0).wait(0.5).shot((1.6, 0.3), seconds=1.5).wait(0.5), Follower(CAMERA)
    position = np.concatenate(made.rows)
    for index, some in enumerate(sightings(position, NAMES, np.random.default_rng(0))):
        follower.update(index, index / made.fps, some)
    frames, struck = np.arange(len(position)), round(made.struck[0] * made.fps)
    times = frames / made.fps
    times[struck + late] += 0.5 / made.fps
    found = tracked([dataclasses.replace(t, time=times[t.frame]) for t in follower.tracks()], frames, times, CAMERA)
    assert found.left_out == ()
    assert [shot.struck for shot in found.shots] == ["white"]


@pytest.mark.parametrize("noise", [3e-4, 5e-4])
def test_a_ball_that_slides_and_then_rolls_makes_no_noise_in_a_few_frames(noise: float) -> None:
    """At 25 frames a second some of them show two motions, and a film holds few."""
    told = []
    for seed in range(20):
        rng, time, tracks = np.random.default_rng(seed), np.arange(22) / 25, []
        for ball, slides in enumerate((0.25, 0.4, 0.5)):
            way = 1.2 * time - 0.05 * time**2 - 0.95 * np.minimum(time - slides, 0.0) ** 2
            xy = np.column_stack([way - 0.5, np.full(22, 0.2 * ball)]) + rng.normal(0, noise, (22, 2))
            even = np.ones(22)
            tracks.append(BallTrack(f"ball {ball}", np.arange(22), time, xy, xy, even, even, even))
        told.append(estimate_noise(TrackedScene(tracks, np.arange(22), time, TABLE, BALL.radius, noise)).moving)
    assert np.median(told) == pytest.approx(noise, rel=0.1)
    assert np.ptp(np.quantile(told, [0.05, 0.95])) < 0.5 * noise


def test_errors_that_change_slowly_count_as_noise() -> None:
    """Marks that turn with a ball draw its outline to and fro: neighbouring frames err alike."""
    made, sway = Recording().wait(0.5).shot((1.2, 0.45)).wait(0.6).shot((-0.9, 0.1)).wait(0.5), 0.3
    for rows in made.rows:
        way = np.cumsum(np.linalg.norm(np.diff(rows[:, 0], axis=0, prepend=rows[:1, 0]), axis=1))
        rows[:, 0] += sway * PLACE * 2**0.5 * np.column_stack([f(way / BALL.radius) for f in (np.cos, np.sin)])
    found = tracked_of(made, noise=0.05)
    assert found.noise.moving == pytest.approx(sway * PLACE, rel=0.4)
    assert found.noise.resting < 0.07 * PLACE


def test_balls_that_touch_at_the_start() -> None:
    start = HOME.copy()
    start[1] = start[0] + BALL.diameter * np.array([np.cos(0.3), np.sin(0.3)])
    made = Recording(start).wait(0.5).shot((1.0, 0.1)).wait(0.5)
    (shot,) = tracked_of(made).shots
    assert shot.struck == "white"
    assert set(shot.balls) == set(NAMES)
    # The clip begins with the last frame at rest, so that the other ball is seen where it lay.
    assert shot.first == round(0.5 * FPS) - 1
    made = Recording(start).wait(0.5).shot((-0.3, 0.8), ball=1).wait(0.5)
    (shot,) = tracked_of(made).shots
    assert shot.struck == "red"


def test_a_potted_ball_ends_at_its_pocket() -> None:
    start = HOME.copy()
    start[1] = [0.85, 0.36]
    way = np.array([1.0, 0.5]) - start[1]
    start[0] = start[1] - 0.4 * way / np.linalg.norm(way)
    made = Recording(start).wait(0.4).shot(1.2 * way / np.linalg.norm(way)).wait(1.5)
    assert np.isnan(made.now[1]).all()
    found = tracked_of(made)
    (shot,) = found.shots
    assert "red" in shot.potted
    assert "red potted" in shot.remarks
    assert found.left_out == ()
    path, rows = found.found[0]["red"]
    assert np.linalg.norm(np.abs(path.xy[rows]) - [1.0, 0.5], axis=1).min() > 0.045
    assert found.doubts == ()


def test_hands_are_no_cues() -> None:
    made = Recording().wait(0.5).push(1, (0.3, 0.3)).wait(0.5).shot((1.2, 0.45)).wait(0.5).put(0, (-0.7, 0.3)).wait(0.5)
    made.push(0, (-0.5, 0.0), 0.5).wait(0.4).shot((0.9, 0.3)).wait(0.5)
    found = tracked_of(made)
    assert [shot.time for shot in found.shots] == pytest.approx(made.struck, abs=2e-3)
    assert len(found.left_out) == 2
    assert all("as if moved by hand" in text for text in found.left_out)
    assert "red" in found.left_out[0]


def test_shots_without_their_beginning_or_end() -> None:
    made = Recording().shot((1.2, 0.45)).wait(0.5).shot((-0.9, 0.1)).wait(0.5).shot((1.0, 0.0))
    made.rows[0] = made.rows[0][10:]
    made.rows[-1] = made.rows[-1][:60]
    found = tracked_of(made)
    assert found.left_out == ()
    assert [shot.running for shot in found.shots] == [("white",), (), ()]
    begins = "begins in mid-motion at frame 0, white moving: white was already moving when the video begins"
    assert found.shots[0].remarks == (begins,)
    assert found.shots[1].remarks == ()
    assert "ends with the video" in found.shots[2].remarks
    clips = clip_set(found, CAMERA, BALL.mass, FPS).clips
    assert [clip.running for clip in clips] == [("white",), (), ()]
    assert clips[0].note == f"running clip 1 at 0.00 s; 3 balls; {begins}"
    assert clips[1].note.startswith("shot 2 at")


def test_two_balls_on_their_way_when_the_video_begins(tmp_path: File) -> None:
    start = HOME.copy()
    start[0] = start[1] - [0.3, 0.02]
    made = Recording(start).shot((1.4, 0.15)).wait(0.5)
    met = int(np.flatnonzero(np.hypot(*(made.rows[0][:, 1] - start[1]).T) > 1e-3)[0])
    made.rows[0] = made.rows[0][met - 2 :]  # the impact is in the first frames
    found = tracked_of(made)
    (shot,) = found.shots
    assert set(shot.running) == {"white", "red"}
    assert 2 <= shot.first <= 6
    write_clip_set(clip_set(found, CAMERA, BALL.mass, FPS), tmp_path / "set")
    (clip,) = read_clip_set(tmp_path / "set").clips
    assert clip.running == shot.running
    for name, row in (("white", 0), ("red", 1)):
        seen = clip.balls[name]
        speed = np.hypot(*(seen.xy[6] - seen.xy[0])) / (seen.time[6] - seen.time[0])
        true = made.rows[0][shot.first : shot.first + 7, row]
        assert speed == pytest.approx(np.hypot(*(true[6] - true[0])) / (6 / FPS), rel=0.08)


def test_a_strike_hidden_for_too_long_leaves_a_running_clip() -> None:
    made = Recording().wait(0.6).shot((1.2, 0.45)).wait(0.5)
    made.rows[0][-30:, 0] = np.nan
    made.rows[1][:60, 0] = np.nan
    (shot,) = tracked_of(made).shots
    assert shot.running[0] == "white"
    assert shot.first == pytest.approx(0.6 * FPS + 60, abs=3)
    assert "white was set in motion unseen" in shot.remarks[0]


def test_a_few_frames_of_rest_are_enough_to_see_a_strike() -> None:
    made = Recording().wait(8 / FPS).shot((1.2, 0.45)).wait(0.5)
    (shot,) = tracked_of(made).shots
    assert (shot.struck, shot.running) == ("white", ())
    assert shot.time == pytest.approx(made.struck[0], abs=1e-3)


@pytest.mark.parametrize("rest", [1, 3])  # frames before the strike
def test_a_video_that_begins_just_before_the_strike_gives_a_running_clip(rest: int) -> None:
    made = Recording().wait(rest / FPS).shot((1.2, 0.45)).wait(0.5)
    (shot,) = tracked_of(made).shots
    assert (shot.running, set(shot.balls)) == (("white",), set(NAMES))
    assert rest - 1 <= shot.first <= rest + 0.2 * FPS
    assert shot.speed == pytest.approx(np.hypot(1.2, 0.45), rel=0.1)


def test_a_ball_that_a_hand_moves_when_the_video_begins_is_left_out() -> None:
    made = Recording().push(1, (0.3, 0.3)).wait(0.5).shot((1.2, 0.45)).wait(0.5)
    made.rows[0] = made.rows[0][20:]
    found = tracked_of(made)
    assert [shot.running for shot in found.shots] == [()]
    (line,) = found.left_out
    assert "red was already moving when the video begins; red gains speed, as if moved by hand" in line


def test_too_little_motion_at_the_beginning_is_left_out() -> None:
    made = Recording().shot((0.3, 0.1))
    made.rows[0] = made.rows[0][-8:]
    made.wait(0.5).shot((1.2, 0.45)).wait(0.5)
    found = tracked_of(made)
    assert [shot.running for shot in found.shots] == [()]


def test_two_shots_in_one() -> None:
    """A ball struck while another still rolls: what rolls cannot be part of a clip."""
    made = Recording().wait(0.5).shot((1.2, 0.45))
    made.rows[-1] = made.rows[-1][:120]
    made.now = made.rows[-1][-1]
    rest = made.now.copy()
    made.shot((0.3, 0.9), ball=2)
    drift = np.cumsum(np.full((len(made.rows[-1]), 1), 0.15 / FPS), axis=0)[:60] * [1.0, 0.0]
    made.rows[-1][:60, 0] = rest[0] + drift
    made.rows[-1][60:, 0] = rest[0] + drift[-1]
    found = tracked_of(made.wait(0.5))
    assert [(shot.struck, shot.running) for shot in found.shots][:1] == [("white", ())]
    assert found.shots[0].last <= round(made.struck[1] * FPS) + 1
    struck = [shot for shot in found.shots[1:] if not shot.running]
    assert struck == [], "a shot is that of one ball, the others at rest"
    assert all(shot.first > made.struck[1] * FPS for shot in found.shots[1:])


def test_a_ball_hidden_during_a_shot_leaves_a_gap() -> None:
    made = Recording().wait(0.5).shot((1.2, 0.45)).wait(0.5)
    made.rows[1][100:160, 2] = np.nan
    found = tracked_of(made)
    assert len(found.shots) == 1
    path, rows = found.found[0]["yellow"]
    frames = path.frame[rows]
    assert not ((frames >= 160) & (frames < 220)).any()
    assert frames[-1] > 300


def test_a_struck_ball_lost_half_the_time_is_not_to_be_trusted() -> None:
    made = Recording().wait(0.5).shot((1.2, 0.45)).wait(0.5)
    made.rows[1][60:, 0] = np.nan
    made.rows[2][:, 0] = np.nan
    found = tracked_of(made)
    assert any("white was lost in" in text for text in found.doubts)


def test_a_ball_that_flies_over_the_cushion_at_once_costs_no_other_shot(tmp_path: File) -> None:
    """Of the whole film no clip was written, as one had two samples of its struck ball."""
    made = Recording().put(0, (0.93, 0.0)).wait(0.5).shot((3.0, 0.0)).wait(0.6).shot((-0.9, 0.2), ball=1).wait(0.5)
    for rows in made.rows[2:]:
        rows[:, 0] = np.nan
    made.rows[2][:4, 0, 0], made.rows[2][:4, 0, 1] = (0.945, 0.97, 0.995, 1.02), 0.0
    found = tracked_of(made)
    assert [shot.struck for shot in found.shots] == ["red"]
    assert any("beyond the cushions" in text for text in found.doubts)
    write_clip_set(clip_set(found, CAMERA, BALL.mass, FPS), tmp_path / "set")


def test_a_ball_that_was_taken_away_in_motion_sets_nothing_in_motion_later() -> None:
    made = Recording().wait(0.5).shot((0.8, 0.4)).wait(2.0).shot((-0.9, 0.2), ball=1).wait(0.5)
    made.rows[1][40:, 0] = np.nan
    for rows in made.rows[2:]:
        rows[:, 0] = np.nan
    found = tracked_of(made)
    assert [shot.struck for shot in found.shots] == ["white", "red"], found.left_out


def test_late_rows_and_slow_cameras() -> None:
    camera = dataclasses.replace(CAMERA, readout=0.015)
    made = Recording(fps=30.0).wait(0.7).shot((1.0, 0.35), late=0.9).wait(0.7).shot((-0.9, 0.2), late=0.2).wait(0.7)
    found = tracked_of(made, camera=camera)
    assert [shot.struck for shot in found.shots] == ["white", "white"]
    assert [shot.time for shot in found.shots] == pytest.approx(made.struck, abs=0.01)
    clips = clip_set(found, camera, BALL.mass, 30.0)
    times = {name: seen.time[0] for name, seen in clips.clips[0].balls.items()}
    assert min(times.values()) == 0.0
    assert max(times.values()) > 0.001


def test_what_pictures_tell_goes_into_the_clip() -> None:
    found = tracked_of(Recording().wait(0.5).shot((1.2, 0.45)).wait(0.5))
    count = found.found[0]["white"][1].size
    extra = Extra({"white": np.arange(count, dtype=float)}, "cue tip 1.43 +- 0.01 m/s at 34.2 deg")
    (clip,) = clip_set(found, CAMERA, BALL.mass, FPS, [extra]).clips
    assert clip.note.endswith("; 3 balls; cue tip 1.43 +- 0.01 m/s at 34.2 deg")
    assert clip.balls["white"].theta[-1] == count - 1
    assert np.isnan(clip.balls["red"].theta).all()


def test_nothing_to_see() -> None:
    found = tracked_of(Recording().wait(1.0))
    assert found.shots == ()
    assert "no shot was found" in found.doubts[0]
    with pytest.raises(BadInput, match="holds no shot"):
        clip_set(found, CAMERA, BALL.mass, FPS)


def test_residuals_are_the_noise() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(2000) / FPS
    xy = np.column_stack([0.5 * time, 0.1 * time**2]) + 1e-4 * rng.standard_normal((2000, 2))
    off = residuals(time, xy)
    assert np.sqrt(np.nanmean(off**2)) == pytest.approx(1e-4 * np.sqrt(2 * (1 + 34 / 36)), rel=0.05)
    late = np.delete(time, 1000)
    assert np.isnan(residuals(late, np.delete(xy, 1000, axis=0))[998:1002]).all()


def test_a_moving_ball_that_no_frame_of_a_clip_shows_makes_none() -> None:
    scene = tracked_of(Recording().wait(0.5).shot((0.8, 0.2), seconds=0.5)).scene
    seen, why = balls_there(scene, ("white",), 20, 19, [])
    assert seen is None
    assert why == "white is not seen in the clip"


def test_the_speed_of_a_ball_that_is_stopped_at_once_is_that_before() -> None:
    """It tells how far a ball may reach between two frames; the mean over its first steps would not."""
    at = np.array([0.0, 0.0, 0.0, 0.0, 0.09, 0.18, 0.18, 0.18, 0.18])
    track = tracked_of(Recording().wait(0.5)).scene.tracks[0]
    track = dataclasses.replace(
        track.without(np.arange(len(track.time)) >= 9), time=np.arange(9) / 30, xy=np.column_stack([at, 0 * at])
    )
    (move,) = TrackedScene([track], np.arange(9), np.arange(9) / 30, TABLE, BALL.radius, 1e-4).moves
    assert move.velocity == pytest.approx([2.7, 0.0], rel=0.02)


def test_a_ball_at_rest_whose_fits_jump_between_two_places_is_at_rest() -> None:
    """It seemed on its way when the video began, so that its shot was lost."""
    made = Recording().wait(0.6).shot((1.2, 0.45)).wait(0.5)
    runs = np.repeat([0, 1, 0, 1, 0, 1, 0, 1, 0], [5, 2, 12, 5, 4, 1, 8, 7, 99])[: len(made.rows[0])]
    made.rows[0][:, 0, 1] += 1.5e-3 * runs
    found = tracked_of(made)
    assert found.left_out == ()
    (shot,) = found.shots
    assert (shot.struck, shot.running) == ("white", ())
    assert shot.time == pytest.approx(made.struck[0], abs=1.5 / FPS)
