"""Several videos in one clip set, strikes that were hidden, and stamps that are wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from sysid.clips import read_clip_set, write_clip_set
from sysid.vision.frames import Frame
from sysid.vision.sheet import TEXT_PX, TEXT_SCALE, wrapped
from sysid.vision.tracks.clips import clip_set
from sysid.vision.tracks.recordings import check_camera, finished, joined, names_of, of_video, videos_in
from sysid.vision.tracks.times.stamps import PictureChange, doubled, is_doubled, marked, missing
from tests.footage.cameras import overhead
from tests.support.followed_balls import BALL, CAMERA, FPS, Recording, tracked_of


def test_clips_of_two_videos_are_in_one_set(tmp_path: Path) -> None:
    made = Recording().wait(0.5).shot((1.2, 0.45)).wait(0.6)
    so_far = None
    for name, noise in (("one", 0.1), ("two", 0.3)):
        found = tracked_of(made, noise=noise)
        clips = of_video(clip_set(found, CAMERA, BALL.mass, FPS), name, found)
        so_far = joined(so_far, clips)
        write_clip_set(so_far, tmp_path / "set")
        so_far = finished(tmp_path / "set")
    assert so_far is not None
    assert set(videos_in(so_far)) == {"one", "two"}
    assert [clip.file for clip in so_far.clips] == [f"clips/{name}-{round(1e3 * t):06d}ms.csv" for name, t in (
        ("one", found_time(made, 0.1)), ("two", found_time(made, 0.3)))]  # fmt: skip
    sigmas = [told["sigma"] for told in videos_in(so_far).values()]
    assert so_far.sigma == pytest.approx(np.sqrt(np.mean(np.square(sigmas))), rel=0.05), "as many samples of each"
    assert read_clip_set(tmp_path / "set").clips[1].extra["video"] == "two"
    check_camera(so_far, CAMERA, tmp_path)
    other = overhead(CAMERA.table, 0.06, (480, 320), 1.6, 1.2, (0.0, 0.0))
    with pytest.raises(BadInput, match="choose another folder"):
        check_camera(so_far, other, tmp_path)


def found_time(made: Recording, noise: float) -> float:
    return tracked_of(made, noise=noise).shots[0].time


def test_videos_are_told_apart_by_name() -> None:
    assert names_of(["a/game 1.mp4", "b/two.mkv"]) == {"game_1": "a/game 1.mp4", "two": "b/two.mkv"}
    with pytest.raises(BadInput, match="rename one"):
        names_of(["a/one.mp4", "b/one.mp4"])


def test_a_strike_hidden_for_some_frames_is_bridged() -> None:
    """The hand covers the ball until it has gone 15 cm: its path leads back to where it rested."""
    made = Recording().wait(0.5).shot((1.2, 0.45)).wait(0.6)
    made.rows[0][-6:, 0] = np.nan
    made.rows[1][:14, 0] = np.nan
    found = tracked_of(made)
    assert [shot.struck for shot in found.shots] == ["white"], found.left_out
    assert found.shots[0].time == pytest.approx(made.struck[0], abs=0.012)
    assert any("hidden for" in text for text in found.shots[0].remarks)


def test_a_picture_stored_twice_is_known_by_its_small_change() -> None:
    means = (0.0, 1.0, 1.1, 0.9, 0.02, 1.2, 1.0, 1.1, 1.0)
    changes = [PictureChange(mean, 50.0 * (mean > 0.1)) for mean in means]
    assert [is_doubled(changes, k) for k in range(9)] == [k == 4 for k in range(9)]
    assert not any(is_doubled([PictureChange(0.9, 50.0)] * 20, k) for k in range(20))


def test_a_noisy_picture_stored_twice_is_known_as_nothing_moves_in_it() -> None:
    """What moves before and after it stands still; before a strike, or after all has come to rest, nothing did."""
    rng = np.random.default_rng(1)

    def seen(step: int, k: int) -> Frame:
        picture = rng.normal(90.0, 6.0, (120, 200, 3))
        picture[40:70, 20 + 12 * step : 50 + 12 * step] += 100
        return Frame(k, 0.1 * k, picture.clip(0, 255).astype(np.uint8))

    frames = [seen(min(max(k - 6, 0), 10), k) for k in range(24)]  # at rest until frame 6 and from frame 16 on
    stored = frames[11].picture.astype(float)
    again = (stored + rng.normal(0.0, 3.0, stored.shape)).clip(0, 255).astype(np.uint8)
    found = list(marked([*frames[:12], Frame(99, 1.15, again), *frames[12:]]))
    assert [frame.index for frame, twice in found if twice] == [99]
    pause = [seen(5, 99) for _ in range(5)]
    assert not any(twice for _, twice in marked([*frames[:12], *pause, *frames[12:]])), "a pause is no copy"


def test_pictures_in_flickering_light_are_not_taken_for_the_ones_before() -> None:
    """A lamp on the mains, filmed at 30 a second, gives pairs of pictures that are equally bright."""
    rng = np.random.default_rng(2)
    cloth = cv2.resize(rng.uniform(40.0, 140.0, (6, 10, 3)), (200, 120), interpolation=cv2.INTER_CUBIC)

    def seen(k: int) -> Frame:
        picture = cloth.copy()
        picture[40:60, 10 + 5 * k : 30 + 5 * k] = 230.0
        picture = picture * (1 + 0.1 * np.sin(2.1 * k)) + rng.normal(0.0, 1.5, cloth.shape)
        return Frame(k, k / 30, picture.clip(0, 255).astype(np.uint8))

    frames = [seen(k) for k in range(30)]
    assert not any(twice for _, twice in marked(frames))
    stored = frames[11].picture.astype(float)
    again = (stored + rng.normal(0.0, 0.5, stored.shape)).clip(0, 255).astype(np.uint8)
    found = list(marked([*frames[:12], Frame(99, 0.38, again), *frames[12:]]))
    assert [frame.index for frame, twice in found if twice] == [99]


@pytest.mark.parametrize("count", [0, 1, 3, 30])
def test_frames_come_in_order_each_marked_where_it_is_the_one_before(count: int) -> None:
    """Of a film with half as many pictures as frames, every other is a repetition."""
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 255, (40, 40, 3)).astype(np.uint8) for _ in range(count)]
    frames = [Frame(k, 0.1 * k, pictures[k // 2]) for k in range(count)]
    found = list(marked(frames))
    assert [frame.index for frame, _ in found] == list(range(count))
    if count > 3:
        assert [again for _, again in found] == [k % 2 == 1 for k in range(count)]


def test_a_picture_compressed_twice_is_known_by_balls_that_stand_still() -> None:
    """Its change is as large as that of others, but a ball that moves on does not rest for a frame."""
    made = Recording().wait(0.5).shot((0.8, 0.2), seconds=1.0)
    true = tracked_of(made, noise=0.02)
    assert not doubled(true.scene.tracks, true.scene.frames, true.scene.sigma).any()
    rows = made.rows[1]
    made.rows[1] = np.concatenate([rows[:20], rows[19:35], rows[34:]])
    twice = tracked_of(made, noise=0.02)
    first = len(made.rows[0])
    found = doubled(twice.scene.tracks, twice.scene.frames, twice.scene.sigma)
    assert twice.scene.frames[found].tolist() == [first + 20, first + 36]


def test_pictures_missing_at_even_stamps_are_counted() -> None:
    made = Recording().wait(0.5).shot((0.8, 0.2), seconds=1.0)
    true = tracked_of(made, noise=0.02)
    scene, period = true.scene, float(np.median(np.diff(true.scene.times)))
    assert missing(scene.tracks, scene.frames, period, scene.sigma) == {}
    rows = made.rows[1]
    made.rows[1] = np.concatenate([rows[:20], rows[23:]])
    short = tracked_of(made, noise=0.02)
    gaps = missing(short.scene.tracks, short.scene.frames, period, short.scene.sigma)
    assert gaps == {len(made.rows[0]) + 20: 3}
    first = len(made.rows[0]) + 20
    told = [replace(t, time=t.time + 3 * period * (t.frame >= first)) for t in short.scene.tracks]
    assert missing(told, short.scene.frames, period, short.scene.sigma) == {}, "the stamps tell of them"


def test_words_of_a_sheet_are_broken_between_words_and_fit() -> None:
    note = "shot 1 at 0.45 s; cut short at 2.92 s, where white jumps; cue tip 0.600 +- 0.001 m/s at -25.69 +- 0.00 deg"
    lines = wrapped([note, "", "a.csv"])
    assert " ".join(lines[:-2]) == note and lines[-2:] == ["", "a.csv"]
    width = max(cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, TEXT_SCALE, 1)[0][0] for line in wrapped([20 * note]))
    assert width < TEXT_PX - 10
