"""Commands of the robot at a virtual port, under an emulated camera."""

from __future__ import annotations

import contextlib
import io
import math
import re
from collections.abc import Iterator, Mapping
from functools import partialmethod
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.errors import BadInput
from models.shot import Array
from robot.cli.verbs import main
from robot.emulator.firmware import Firmware
from robot.emulator.launcher import Emulator, Pace
from robot.emulator.table import CAMERA_FPS, PLACE_SIGMA_M, EmulatedTable, emulated_launcher
from robot.order import read_order
from sysid.vision import CueLine
from tests.support.commands import Said
from tests.support.robot_plans import OURS, struck
from tests.support.series_samples import MODEL

LAID = re.compile(r"(\w+) ([\d.]+) cm from the ([+-])x cushion and ([\d.]+) cm from the ([+-])y cushion")


def run(*words: str | Path | float) -> Said:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main([str(w) for w in words])
    return Said(status, out.getvalue(), err.getvalue())


def refused(said: Said, verb: str, part: str) -> None:
    assert said.status == 2 and re.fullmatch(rf"robot {verb}: .*{re.escape(part)}.*\n", said.err), said


class Eye:
    """A camera over an emulated table; notes what it is asked for, and how many strokes had been made by then."""

    fps, sigma, seen_with, filmed, doubts = CAMERA_FPS, PLACE_SIGMA_M, "camera", None, ()

    def __init__(self, plan: Path) -> None:
        scene = read_order(plan, OURS).scene
        self.plan, self.table, self.ball = plan, scene.table, scene.ball
        self.devices, self.asked, self.said = list[Firmware](), list[tuple[str, int]](), list[str]()
        self.off, self.blind = 0.0, False  # of the cue from its azimuth [rad]; films nothing
        self.put(dict(zip(scene.names, scene.position, strict=True)))

    def put(self, laid: Mapping[str, Any]) -> None:
        self.empty = not laid
        self.now = EmulatedTable(MODEL, laid or {"white": (0.0, 0.0)}, 0.0, len(self.asked))

    def note(self, what: str) -> None:
        self.asked.append((what, self.strokes))

    @property
    def strokes(self) -> int:
        return sum(len(struck(device)) for device in self.devices)

    def look(self) -> Mapping[str, Array]:
        if self.empty:
            raise BadInput("the camera's picture: no ball is seen")
        return self.now.look()

    arm, pictures = partialmethod(note, "armed"), staticmethod(tuple)

    def film(self) -> Mapping[str, Any]:
        self.note("filmed")
        return {} if self.blind else self.now.film()

    def align(self, frames: Any, camera: Any, wanted: float, ball_xy: Array | None = None, **rest: Any) -> CueLine:
        """In place of the operator: the stand is turned."""
        assert camera == "camera"
        assert ball_xy is None or ball_xy == pytest.approx(self.look()["white"], abs=1e-3), "told where the ball lies"
        self.note(f"aligned to {math.degrees(wanted):.2f}{', ball told' * (ball_xy is not None)}")
        self.now.turn_to(wanted)
        return CueLine(wanted + self.off, 1e-4, 0.0, 1.0)

    def connect(self) -> Any:
        rng = np.random.default_rng(len(self.devices))
        launcher, device = emulated_launcher(OURS, self.now.hit, rng, say=str)
        self.devices.append(device)
        return launcher


@contextlib.contextmanager
def at_port(eye: Eye, pace: float, baud: int) -> Iterator[tuple[str, ...]]:
    """The options of a launcher behind a pseudo-terminal that strikes the balls under a camera."""
    clock = Pace(pace)
    device = Firmware(clock.now, np.random.default_rng(0), pace=clock.factor, on_strike=lambda *how: eye.now.hit(*how))
    eye.devices.append(device)
    with Emulator(eye.devices[0], baud=baud) as emulator:
        yield "--port", emulator.path, "--camera", "cam.toml", "--video", "0"


def by_the_words(text: str) -> dict[str, Array]:
    """Balls laid by somebody who knows nothing but what was said."""
    half = np.array([MODEL.table.length, MODEL.table.width]) / 2
    signed = ((name, np.array([float(sx + x), float(sy + y)])) for name, x, sx, y, sy in LAID.findall(text))
    return {name: np.copysign(half, cm) - 1e-2 * cm for name, cm in signed}
