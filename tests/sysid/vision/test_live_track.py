"""Footage in the viewer while it is tracked: frames and the balls found in them, as often as the clock allows."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest

import models.recording.live
from models.recording.live import LiveTrack
from sysid.cli import main
from sysid.vision.balls.detect import Detector
from sysid.vision.camera.projection import write_camera
from sysid.vision.film import _show
from sysid.vision.frames import Footage
from sysid.vision.tracks.track import track
from tests.support.followed_balls import BALL, CAMERA, NAMES, TABLE, Drawn, Knowing, Recording
from tests.support.live_feed import FileFeed
from tests.support.reviewed_clips import column, read


@pytest.mark.parametrize("interval", [0.0, 1e9])
def test_frames_are_shown_with_the_balls_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interval: float
) -> None:
    monkeypatch.setattr(models.recording.live, "SHOWN_INTERVAL_S", interval)
    made = Recording().wait(0.1).shot((1.2, 0.45), seconds=0.1)
    footage, detector, feed = Drawn(made), Knowing(made), FileFeed(tmp_path)
    live = LiveTrack(feed, "game.mp4", TABLE, BALL.diameter)
    watch = partial(_show, live, CAMERA)
    track(cast(Footage, footage), CAMERA, cast(Detector, detector), {"white": 1}, watch=watch)
    live.said(0.1, "shot 1")
    found = read(feed.files()[0])
    pictures = column(found["/picture/video"], "EncodedImage:blob")
    assert len(pictures) == (footage.count if interval == 0 else 1)
    size = cv2.imdecode(np.array(pictures[0][0], np.uint8), cv2.IMREAD_COLOR).shape
    assert size == (CAMERA.size[1] // 2, CAMERA.size[0] // 2, 3)
    places = column(found["/top/found"], "Points2D:positions")
    assert np.sort(np.array(places[0]), axis=0) == pytest.approx(np.sort(footage.position[0], axis=0), abs=0.002)
    assert set(column(found["/top/found"], "Points2D:labels")[0]) == set(NAMES)
    assert column(found["/log"], "TextLog:text") == [["shot 1"]]
    if interval == 0:
        stamps = [row for one in found["/top/found"] for row in one["frame"].to_pylist()]
        assert stamps == list(range(footage.count))


def test_workers_elsewhere_cannot_be_watched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_camera(tmp_path / "c.toml", CAMERA)
    words = ["track", "v.mkv", "--camera", str(tmp_path / "c.toml"), "--out", str(tmp_path / "set")]
    assert main([*words, "--live", "--scheduler", "tcp://nowhere:1"]) == 2
    assert "--live shows tracking on this machine only; omit it" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()
