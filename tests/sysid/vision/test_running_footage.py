"""A film that begins in mid-motion gives a running clip, tracked as if its strike had been seen."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from sysid.cli import main
from sysid.clips import Clip, read_clip_set
from tests.footage.__main__ import main as film
from tests.footage.scenes import Scene, scenes
from tests.truth.__main__ import main as generate

FPS = 100.0
SHOTS = ("--clips", "2", "--seconds", "1.2", "--fps", "100", "--length", "1.1", "--width", "0.6", "--no-cue")
MAX_ERROR_M = 1e-3  # rms, half a pixel


def trimmed(video: Path, out: Path, first: int) -> None:
    """A film from a frame on, without loss."""
    source, target, frame = cv2.VideoCapture(str(video)), None, 0
    while True:
        there, picture = source.read()
        if not there:
            break
        if frame >= first:
            if target is None:
                size = picture.shape[1], picture.shape[0]
                target = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"FFV1"), FPS, size)
            target.write(picture)
        frame += 1
    assert target is not None
    target.release()


def error(clip: Clip, scene: Scene, began: float) -> float:
    """Rms distance of a clip's tracks from the truth, its time 0 at a time of the recording [m]."""
    away = [seen.xy - scene.places(name, seen.time + began) for name, seen in clip.balls.items()]
    return float(np.sqrt(np.nanmean(np.sum(np.concatenate(away) ** 2, axis=1))))


@pytest.mark.slow
def test_a_film_that_begins_in_mid_motion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    played, video, camera = tmp_path / "played", tmp_path / "film.mkv", tmp_path / "film.camera.toml"
    assert generate([str(played), "--seed", "5", *SHOTS, "--kind", "cut,stun"]) == 0
    assert film([str(played), str(video), "--size", "520x320"]) == 0
    first = scenes(played)[3][0]
    begin = round((first.struck + 0.3) * FPS)
    late, sheet = tmp_path / "late.mkv", tmp_path / "shots.png"
    trimmed(video, late, begin)
    words = ["track", str(late), "--camera", str(camera), "--out", str(tmp_path / "out")]
    assert main([*words, "--sheet", str(sheet), "--json", str(tmp_path / "told.json")]) == 0
    said = capsys.readouterr().out
    assert "in mid-motion at frame" in said
    assert "already moving when the video begins" in said
    assert sheet.stat().st_size > 10_000
    clips = read_clip_set(tmp_path / "out").clips
    told = json.loads((tmp_path / "told.json").read_text())["clips"]
    assert [bool(clip.running) for clip in clips] == [True, False]
    assert [one["struck"] is None for one in told] == [True, False]
    assert told[0]["running"] == list(clips[0].running)
    assert "running clip" in clips[0].note
    began = (begin + told[0]["frames"][0]) / FPS
    ends = began + np.array([0.0, 0.01])  # short, as it slides at 2 m/s^2
    speed = float(np.hypot(*np.diff(first.places(clips[0].struck, ends), axis=0)[0]) / 0.01)
    assert told[0]["speed"] == pytest.approx(speed, rel=0.1)
    assert error(clips[0], first, began) < MAX_ERROR_M
    assert float(clips[0].balls[clips[0].struck].time[-1]) > 0.6
