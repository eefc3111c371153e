"""Footage: every container's frames with their true times, and one line for what cannot be read."""

from __future__ import annotations

import resource
from pathlib import Path

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from sysid.vision.frames import open_footage
from sysid.vision.sources.pictures import Picture, read_picture

SIZE = (64, 48)
RATE = 119.88


def grey(level: int) -> Picture:
    return np.full((SIZE[1], SIZE[0], 3), level, np.uint8)


def video(path: Path, count: int, rate: float = RATE, code: str = "FFV1") -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), rate, SIZE)
    assert writer.isOpened()
    for k in range(count):
        writer.write(grey(2 * k))
    writer.release()
    return path


def stamped(path: Path, stamps: list[int]) -> Path:
    """A video whose frames carry these stamps [ms]."""
    wish = [getattr(cv2, "VIDEOWRITER_PROP_RAW_VIDEO", -1), 1]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"MJPG"), 1000.0, SIZE, wish)
    if not (hasattr(cv2, "VIDEOWRITER_PROP_PTS") and writer.isOpened()):
        pytest.skip("this OpenCV writes no stamps")
    for k, stamp in enumerate(stamps):
        writer.set(cv2.VIDEOWRITER_PROP_PTS, stamp)
        writer.write(cv2.imencode(".jpg", grey(8 * k))[1].reshape(1, -1))
    writer.release()
    return path


def folder(path: Path, names: list[str]) -> Path:
    path.mkdir()
    for k, name in enumerate(names):
        assert cv2.imwrite(str(path / name), grey(10 * k))
    return path


@pytest.mark.parametrize(("name", "code"), [("a.mkv", "FFV1"), ("a.avi", "FFV1"), ("a.avi", "MJPG"), ("a.mp4", "mp4v")])
def test_an_even_rate_is_kept_exactly(tmp_path: Path, name: str, code: str) -> None:
    footage = open_footage(video(tmp_path / name, 40, code=code))
    frames = list(footage)
    assert footage.size == SIZE
    assert footage.count == len(frames) == 40
    assert footage.fps == pytest.approx(RATE)
    # Matroska rounds its stamps to a millisecond.
    np.testing.assert_allclose([f.time for f in frames], np.arange(40) / RATE, atol=1e-9)
    assert footage.assumed == ("frame times from the container, 119.88/s",)
    assert [f.picture[0, 0, 0] // 2 for f in list(footage)[::7]] == pytest.approx(np.arange(0, 40, 7), abs=2)


def test_a_variable_rate_is_told_and_gaps_are_kept(tmp_path: Path) -> None:
    steps = [7, 9, 8, 10, 8, 6, 25, 9, 7, 8]
    footage = open_footage(stamped(tmp_path / "v.mp4", [0, *np.cumsum(steps).tolist()]))
    times = [f.time for f in footage]
    np.testing.assert_allclose(np.diff(times), np.array(steps) / 1e3, atol=1e-6)
    assert times[0] == 0
    assert "variable rate of about 125/s" in footage.assumed[0]
    assert "2 frames missing: left as gaps in time" in footage.assumed


def test_dropped_frames_of_an_even_rate_are_counted(tmp_path: Path) -> None:
    kept = [k for k in range(30) if k not in (7, 8, 20)]
    footage = open_footage(stamped(tmp_path / "d.mp4", [8 * k for k in kept]))
    assert [round(f.time * 125) for f in footage] == kept
    assert any("3 frames missing" in line for line in footage.assumed)


def test_slow_motion_is_taken_at_the_rate_given(tmp_path: Path) -> None:
    footage = open_footage(video(tmp_path / "slow.avi", 24, rate=30.0), fps=240.0)
    np.testing.assert_allclose([f.time for f in footage], np.arange(24) / 240)
    assert footage.fps == pytest.approx(240)
    assert any("8 times slower" in line for line in footage.assumed)


def test_a_sample_is_spread_over_all(tmp_path: Path) -> None:
    footage = open_footage(video(tmp_path / "a.mkv", 50))
    sample = footage.sample(5)
    assert [f.index for f in sample] == [0, 12, 24, 37, 49]
    np.testing.assert_allclose([f.time for f in sample], np.array([0, 12, 24, 37, 49]) / RATE, atol=1e-9)
    assert [int(f.picture[0, 0, 0]) for f in sample] == [0, 24, 48, 74, 98]
    assert len(footage.sample(500)) == 50


def test_a_long_video_is_sampled_by_jumps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sysid.vision.frames.SEEK_FRAMES", 20)
    sample = open_footage(video(tmp_path / "a.avi", 50)).sample(5)
    assert [(f.index, int(f.picture[0, 0, 0])) for f in sample] == [(k, 2 * k) for k in (0, 12, 24, 37, 49)]


def test_pictures_come_in_natural_order(tmp_path: Path) -> None:
    names = ["shot1_9.png", "shot1_10.png", "shot1_11.png", "shot1_13.png"]
    place = folder(tmp_path / "p", names)
    (place / "notes.txt").write_text("no picture")
    for what in (place, place / "shot1_%d.png", place / "shot1_*.png"):
        footage = open_footage(what, fps=100.0)
        frames = list(footage)
        assert [int(f.picture[0, 0, 0]) for f in frames] == [0, 10, 20, 30]
        np.testing.assert_allclose([f.time for f in frames], [0, 0.01, 0.02, 0.04])
        assert any("1 frame missing" in line for line in footage.assumed)


@pytest.mark.parametrize(
    "text", ["2.0\n2.01\n2.05\n", "frame,time\n7,2.0\n8,2.01\n9,2.05\n", "t;gain\n2;1\n2.01;1\n2.05;1\n"]
)
def test_times_beside_pictures_count(tmp_path: Path, text: str) -> None:
    place = folder(tmp_path / "p", ["a.png", "b.png", "c.png"])
    (place / "times.csv").write_text(text)
    footage = open_footage(place)
    np.testing.assert_allclose([f.time for f in footage], [0, 0.01, 0.05])
    assert "times.csv" in footage.assumed[0]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("0\n1e-2\n", "2 times for 3"),
        ("0\n2e-2\n1e-2\n", "must increase"),
        ("0\nx\n1\n", "seconds"),
        ("0\n8\n16\n", "in seconds"),
    ],
)
def test_wrong_times_are_named(tmp_path: Path, text: str, word: str) -> None:
    place = folder(tmp_path / "p", ["a.png", "b.png", "c.png"])
    (place / "timestamps.txt").write_text(text)
    with pytest.raises(BadInput, match=word) as caught:
        open_footage(place)
    assert "timestamps.txt" in str(caught.value)


@pytest.mark.parametrize(
    ("raw", "size", "word"), [(b"0\n\xff\n", 0, "UTF-8"), (b"0\n1\n", 64 << 20, "has 64 MB, the limit is 32: ")]
)
def test_a_file_of_times_is_a_text_of_some_length(tmp_path: Path, raw: bytes, size: int, word: str) -> None:
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), grey(9))
    with (tmp_path / "times.csv").open("wb") as file:
        file.write(raw)
        file.truncate(size or len(raw))
    with pytest.raises(BadInput, match=word):
        open_footage(str(tmp_path)).frame_times(None)


def test_an_unreadable_picture_is_left_out_and_told(tmp_path: Path) -> None:
    place = folder(tmp_path / "p", [f"{k}.png" for k in range(5)])
    (place / "2.png").write_bytes(b"nothing")
    cv2.imwrite(str(place / "4.png"), np.zeros((10, 10, 3), np.uint8))
    footage = open_footage(place, fps=50.0)
    assert [round(f.time * 50) for f in footage] == [0, 1, 3]
    assert any("2 frames unreadable" in line for line in footage.assumed)


def test_a_frame_at_which_opencv_fails_is_no_traceback(tmp_path: Path) -> None:
    path = video(tmp_path / "film.avi", 6, code="MJPG")
    raw = bytearray(path.read_bytes())
    at = [k for k in range(len(raw) - 8) if raw[k : k + 4] == b"00dc" and raw[k + 8 : k + 10] == b"\xff\xd8"]
    raw[at[1] + 4 : at[1] + 8] = (0x7FFFFFF0).to_bytes(4, "little")  # the second picture's length
    path.write_bytes(raw)
    footage = open_footage(path)
    assert 1 <= len(list(footage)) < 6


def test_a_picture_that_may_not_be_read_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object) -> None:
        raise PermissionError

    assert cv2.imwrite(str(tmp_path / "a.png"), grey(1))
    monkeypatch.setattr(Path, "open", forbidden)
    assert read_picture(tmp_path / "a.png") is None


def test_a_png_takes_no_more_memory_than_it_has(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "a.png"), grey(1))
    raw = bytearray((tmp_path / "a.png").read_bytes())
    at = raw.index(b"IDAT")
    (tmp_path / "b.png").write_bytes(raw[: at - 4] + (0x7FFFFFFF).to_bytes(4, "big") + raw[at:])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert read_picture(tmp_path / "a.png") is not None and read_picture(tmp_path / "b.png") is None
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + (1 << 19)


def test_bad_input_is_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = video(tmp_path / "a.mp4", 20, code="mp4v").read_bytes()
    bad = {
        "empty.mp4": b"",
        "noise.mp4": np.random.default_rng(0).bytes(3000),
        "half.mp4": whole[: len(whole) // 2],
        "text.avi": b"hello\n" * 99,
        "x.png": b"not a picture",
    }
    for name, content in bad.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "hollow").mkdir()
    for name in [*bad, "hollow", "missing.mp4", "no_%03d.png", "no*.jpg"]:
        with pytest.raises(BadInput) as caught:
            open_footage(tmp_path / name, fps=30.0)
        assert name in str(caught.value)
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_pictures_without_a_rate_are_refused(tmp_path: Path) -> None:
    place = folder(tmp_path / "p", ["a.png", "b.png"])
    with pytest.raises(BadInput, match="--fps"):
        open_footage(place)
    with pytest.raises(BadInput, match="above 0"):
        open_footage(place, fps=0.0)
