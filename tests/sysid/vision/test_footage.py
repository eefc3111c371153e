"""Frame times: from containers that round them, from names and files beside pictures; what cannot be read."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from sysid.vision.frames import open_footage


def video(path: Path, rate: float, count: int = 40) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), rate, (64, 48))
    for k in range(count):
        writer.write(np.full((48, 64, 3), k, np.uint8))
    writer.release()
    return path


def pictures(folder: Path, numbers: range | list[int]) -> Path:
    folder.mkdir()
    for k in numbers:
        cv2.imwrite(str(folder / f"{k:04d}.png"), np.full((8, 8, 3), k, np.uint8))
    return folder


@pytest.mark.parametrize("rate", [25.0, 59.94, 60.0, 119.88, 120.0, 180.0, 240.0])
@pytest.mark.parametrize("kind", ["mkv", "avi"])
def test_an_even_rate_is_known_though_stamps_are_rounded(tmp_path: Path, rate: float, kind: str) -> None:
    found = open_footage(video(tmp_path / f"v.{kind}", rate))
    frames = list(found)
    assert found.fps == pytest.approx(rate, rel=1e-6)
    assert [f.time for f in frames] == pytest.approx(np.arange(40) / rate, abs=1e-9)
    assert [int(f.picture[0, 0, 0]) for f in frames] == list(range(40)), "every frame, lossless"
    assert f"{rate:.6g}/s" in found.assumed[0]


def test_slow_motion_is_stretched_to_the_rate_it_was_taken_at(tmp_path: Path) -> None:
    found = open_footage(video(tmp_path / "v.avi", 30.0), fps=240.0)
    assert [f.time for f in found] == pytest.approx(np.arange(40) / 240.0)
    assert "240" in " ".join(found.assumed)


def test_pictures_take_their_times_from_the_user_their_names_or_a_file(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "p", [1, 2, 3, 5, 6])
    with pytest.raises(BadInput, match="--fps"):
        open_footage(folder)
    assert [f.time for f in open_footage(folder, 100.0)] == pytest.approx([0, 0.01, 0.02, 0.04, 0.05])
    (folder / "times.csv").write_text("0.5\n0.51\n0.53\n0.54\n0.56\n")
    assert [f.time for f in open_footage(folder)] == pytest.approx([0, 0.01, 0.03, 0.04, 0.06])


def test_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "broken.mp4").write_bytes(b"no video")
    (tmp_path / "empty").mkdir()
    for name in ("broken.mp4", "empty", "absent.mp4"):
        with pytest.raises(BadInput, match=name.split(".")[0]) as caught:
            open_footage(tmp_path / name)
        assert "\n" not in str(caught.value)
    with pytest.raises(BadInput, match="above 0"):
        open_footage(video(tmp_path / "v.avi", 30.0), fps=-1.0)
