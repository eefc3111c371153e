"""How far places are told to be off, and the parts of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.shot import Table
from sysid.vision.camera.projection import read_camera, write_camera
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.places import CENTRE_ERROR_PX, PlaceError, place_error
from tests.footage.cameras import overhead

CAMERA = overhead(Table(1.2, 0.65), 0.0523, (640, 380), 1.5, 1.36)
PERIOD, SPEED = 1 / 30, 0.9


def told(y: float, readout: float = math.nan, speed: float = SPEED) -> PlaceError:
    """Of a ball that moves along x, a place y across the table."""
    n = 20
    time = np.arange(n) * PERIOD
    xy = np.column_stack([-0.3 + speed * time, np.full(n, y)])
    pixels, radius = CAMERA.outline(xy), CAMERA.radius_px(xy)
    track = BallTrack("white", np.arange(n), time, pixels, xy, np.full(n, 0.1), radius, np.full(n, np.nan))
    camera = replace(CAMERA, readout=readout, place_sd_m=4e-4)
    return place_error([{"white": (track, np.arange(n))}], camera, 2e-4, PERIOD)


def test_parts_are_what_they_say() -> None:
    found = told(0.2)
    assert found.noise == pytest.approx(math.sqrt(2) * 2e-4)
    assert found.camera == 4e-4
    scale = CAMERA.radius / float(CAMERA.radius_px(np.array([[0.0, 0.2]]))[0])
    assert found.centre == pytest.approx(CENTRE_ERROR_PX * scale, rel=0.02)
    assert found.rms == pytest.approx(math.hypot(found.noise, found.camera, found.centre, found.readout))
    assert found.text().startswith(f"positions within {1e3 * found.rms:.2f} mm rms: unknown readout")


def test_an_unknown_readout_counts_by_speed_and_by_distance_from_the_middle_row() -> None:
    """A readout of any length up to the period is as likely: its root of the mean square is the period over root 3."""
    row = float(CAMERA.outline(np.array([[0.0, 0.2]]))[0, 1])
    expected = SPEED * PERIOD * abs(row / 379 - 0.5) / math.sqrt(3)
    assert told(0.2).readout == pytest.approx(expected, rel=0.03)
    assert told(0.2, speed=0.0).readout == pytest.approx(0.0, abs=1e-9)
    assert told(0.2, readout=0.0).readout == 0.0
    assert "readout" not in told(0.2, readout=0.01).text()


def test_a_camera_file_tells_a_known_readout_from_an_unknown_one(tmp_path: Path) -> None:
    file = tmp_path / "cam.toml"
    for readout in (math.nan, 0.0, 0.012):
        write_camera(file, replace(CAMERA, readout=readout, place_sd_m=3e-4))
        again = read_camera(file)
        assert again.readout == pytest.approx(readout, nan_ok=True)
        assert again.place_sd_m == 3e-4
        assert again.row_delay(379.0) == pytest.approx((0.0 if math.isnan(readout) else readout) / 2)
