"""A campaign at a table that is drawn: the launcher behind a pseudo-terminal, its camera's pictures rendered."""

from __future__ import annotations

import contextlib
import io
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from models.analytic.cue_impulse import Constants, Geometry, ball_speed_and_squirt
from models.model_file import full_model
from models.shot import Table
from models.table.snooker import SNOOKER_BALL, spots
from robot.camera.live import CameraOptions, LiveCamera
from robot.cli.verbs import main
from robot.cueing.campaign import read_campaign
from robot.emulator.firmware import Firmware
from robot.emulator.launcher import Emulator, Pace
from robot.emulator.table import EmulatedOptions, EmulatedTable
from tests.footage.film import Look, _picture, developed
from tests.footage.motion import Motion, motion_of
from tests.robot.align_pictures import LOOK, Stick, bare, camera_over, empty, picture

Picture = NDArray[np.uint8]
TABLE, SIZE, FPS = Table(2.0, 1.0), (840, 630), 15.0  # small, and slowly filmed: drawing takes long
BROWN = spots(TABLE)["brown"]
NOISY = Look(noise=2.0, blur=0.6)
SEED = 12  # of a campaign that begins with a slow stroke below the centre, so that the film is short
AIM_RAD = 6e-4  # of the stand, which is not quite aligned


class DrawnTable:
    """A source of pictures of a table on which the emulated launcher plays."""

    fps = FPS

    def __init__(self) -> None:
        self.camera = camera_over()
        self.rng, self.ground = np.random.default_rng(1), empty(self.camera)
        place = (float(BROWN[0]), float(BROWN[1]))
        drawn = bare(self.camera, self.ground, {"white": place})
        self.resting = [picture(self.camera, Stick(place, AIM_RAD), drawn, 2.0, self.rng) for _ in range(3)]
        options = EmulatedOptions(yaw_sd=0.0)
        self.table = EmulatedTable(full_model(TABLE, SNOOKER_BALL), {"white": place}, AIM_RAD, 0, options)
        self.taken, self.began = 0, 0  # pictures; before the stroke
        self.motion: Motion | None = None

    def read(self) -> tuple[float, Picture] | None:
        """The next picture: at rest until the stroke, then the shot, then at rest again."""
        self.taken += 1
        self.table.look()  # plays what was struck
        if self.table.track is None:
            time.sleep(0.5 / FPS)
            return self.taken / FPS, self.resting[self.taken % 3]
        if self.motion is None:
            self.motion, self.began = motion_of(self.table.track), self.taken
        at = min((self.taken - self.began + 0.4) / FPS, float(self.motion.times[-1]))
        light = _picture(self.camera, self.motion, at, LOOK, self.ground)
        return self.taken / FPS, developed(light, NOISY, self.rng)

    def newest(self) -> tuple[float, Picture] | None:
        """The present picture."""
        if self.motion is not None:
            return self.read()
        self.taken += 1
        return self.taken / FPS, self.resting[self.taken % 3]

    def close(self) -> None:
        """Nothing to release."""


@pytest.mark.slow
def test_a_stroke_of_a_campaign_is_played_filmed_and_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.robot.align_pictures.TABLE", TABLE)
    monkeypatch.setattr("tests.robot.align_pictures.SIZE", SIZE)
    drawn, out = DrawnTable(), tmp_path / "c.csv"

    def opened(name: str, path: Path, folder: Path, options: CameraOptions) -> LiveCamera:
        return LiveCamera(drawn, drawn.camera, folder, options)

    monkeypatch.setattr("robot.camera.live.LiveCamera.open", opened)
    monkeypatch.setattr("builtins.input", lambda prompt: "yes")
    clock = Pace(20.0)
    firmware = Firmware(clock.now, np.random.default_rng(0), pace=clock.factor, on_strike=drawn.table.hit)
    said, wrong = io.StringIO(), io.StringIO()
    with Emulator(firmware, baud=19200) as emulator:
        words = ["campaign", out, "--most", 1, "--seed", SEED, "--port", emulator.path, "--camera", "cam.toml"]
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(wrong):
            status = main([*map(str, words), "--video", "0", "--films", str(tmp_path / "films")])
    assert status == 0, (said.getvalue(), wrong.getvalue())
    [shot] = read_campaign(out)
    [struck] = [action for action in firmware.actions if action.what == "struck"]
    speed, squirt = ball_speed_and_squirt(
        Constants(), Geometry(SNOOKER_BALL), *(np.array([v]) for v in (struck.speed, struck.x, struck.y))
    )
    assert shot.ball_speed == pytest.approx(speed[0], rel=0.04)
    assert shot.squirt_rad == pytest.approx(squirt[0], abs=0.02), "a pixel is 3 mm, on a path of 0.2 m"
    assert not shot.miscue and (tmp_path / "films" / "film-0001.mkv").is_file()
