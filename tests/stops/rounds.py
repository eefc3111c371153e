"""One series of strokes on an emulated launcher in real time, stopped from outside at a random moment.

In: a way to stop it and a random generator. Out: a `Round`: when the launcher stood, strokes after that, what was said.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from models.mjcf.stroke import BRAKING_DECELERATION
from robot.device.protocol import GUARDED_STATES
from robot.emulator.faults import REPLY_FAULTS, REQUEST_FAULTS, FaultInjection
from robot.emulator.firmware import Firmware
from robot.emulator.launcher import Emulator, Pace
from robot.emulator.mechanism import ExecutedAction
from robot.emulator.stroke_motion import paper_law

ROOT = Path(__file__).parents[2]
BAUD = 19200
STRINGS = ("1", "100", "200")  # the fastest stroke, a usual one, the longest
REPEATS = "4"
BEGINS_WITHIN_S, ENDS_WITHIN_S = 30.0, 6.0  # of the controller
SERIES_S = 8.0  # of which a moment is drawn; the series takes twice as long
STANDS_WITHIN_S = 0.5  # after the controller's end
CABLE_OUT_S = 2.0
LINE_FAULTS = (*REQUEST_FAULTS, *REPLY_FAULTS)


@dataclass(frozen=True)
class Round:
    """What became of a series that was stopped."""

    way: str
    state: str  # of the launcher when it was stopped
    stopped: bool  # rather than at the end of its motion
    stood_s: float  # after which nothing moved any more [s]
    later: int  # strokes begun after that
    said: str  # by what stopped it
    status: int | None  # of the controller; None where it went on, as the launcher had not been stopped
    told: tuple[str, ...]  # by the controller in its end

    @property
    def confirmed(self) -> bool:
        """Whether the stop was, and what it interrupted was named."""
        return "stopped, confirmed" in self.said and "robot calibrate (process" in self.said


@dataclass
class Series:
    """A controller that strikes again and again, and the launcher that it strikes with."""

    emulator: Emulator
    clock: Pace
    controller: subprocess.Popen[str]
    before_s: float  # of waiting, from the homing on

    def wait_for_moment(self) -> bool:
        """Until the drawn moment; False where the series has ended by itself before."""
        until = time.monotonic() + BEGINS_WITHIN_S
        while self.state == "UNHOMED" and time.monotonic() < until and self.controller.poll() is None:
            time.sleep(0.005)
        time.sleep(self.before_s)
        return self.controller.poll() is None

    @property
    def state(self) -> str:
        """Of the launcher."""
        with self.emulator.lock:
            return self.emulator.firmware.status().state

    def stop(self) -> str:
        """`robot stop` from another shell; returns what it says."""
        words = [sys.executable, "-m", "robot.cli", "stop", "--port", self.emulator.path]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=ENDS_WITHIN_S, check=False)
        return done.stdout + done.stderr

    def send(self, number: signal.Signals) -> str:
        """A signal to the controller."""
        self.controller.send_signal(number)
        return ""

    def suspend_and_stop(self) -> str:
        """Suspend the controller, stop the launcher from another shell, let the controller go on."""
        self.send(signal.SIGSTOP)
        said = self.stop()
        self.send(signal.SIGCONT)
        return said

    def suspend(self) -> str:
        """Suspend the controller for longer than the launcher waits."""
        self.send(signal.SIGSTOP)
        time.sleep(2 * STANDS_WITHIN_S)
        return self.send(signal.SIGCONT)

    def pull(self) -> str:
        """Pull the cable."""
        self.emulator.pull(CABLE_OUT_S)
        return ""


WAYS: dict[str, Callable[[Series], str]] = {
    "stop": Series.stop,
    "stop of a suspended one": Series.suspend_and_stop,
    "KILL": lambda series: series.send(signal.SIGKILL),
    "QUIT": lambda series: series.send(signal.SIGQUIT),
    "cable out": Series.pull,
    "suspended": Series.suspend,
}
FROM_ELSEWHERE = ("stop", "stop of a suspended one")
MAY_GO_ON = ("cable out", "suspended")  # where nothing moved for longer than the silence


def play(way: str, rng: np.random.Generator, rate: float = 0.0) -> Round:
    """A series, stopped in that way; another one where faults of the line end it before."""
    while True:
        if (done := _played(way, rng, rate)) is not None:
            return done


def _played(way: str, rng: np.random.Generator, rate: float) -> Round | None:
    clock = Pace(1.0)
    of_device, of_faults, of_moment = rng.spawn(3)
    device = Firmware(clock.now, of_device, pace=clock.factor)
    faults = FaultInjection(rate, of_faults, LINE_FAULTS) if rate else None
    with tempfile.TemporaryDirectory(prefix="stops-") as folder, Emulator(device, baud=BAUD, faults=faults) as emulator:
        words = ["calibrate", "--port", emulator.path, "--yes", "--out", str(Path(folder, "new.toml"))]
        words += ["--strings", *STRINGS, "--repeats", REPEATS]
        controller = subprocess.Popen(
            [sys.executable, "-m", "robot.cli", *words], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
        )  # fmt: skip
        series = Series(emulator, clock, controller, float(of_moment.uniform(0.0, SERIES_S)))
        try:
            if not series.wait_for_moment():
                return None
            state, began = series.state, clock.now()
            said = WAYS[way](series)
            time.sleep(max(began + STANDS_WITHIN_S - clock.now(), 0.0))
            moving = series.state in GUARDED_STATES
            try:
                told, status = controller.communicate(timeout=ENDS_WITHIN_S)[1], controller.returncode
            except subprocess.TimeoutExpired:
                told, status = "", None
            time.sleep(2 * STANDS_WITHIN_S)  # whatever may still come, comes
            with emulator.lock:
                actions, interrupted = list(device.actions), device.memory.interrupted
        finally:
            controller.kill()
            controller.communicate()
        stood, stopped, later = _judged(began, actions, interrupted, goes_on=status is None)
        lines = tuple(line for line in told.splitlines() if "of 12: " not in line)  # without its progress
        return Round(way, state, stopped, np.inf if moving else stood, later, said, status, lines)


def _judged(began: float, actions: list[ExecutedAction], interrupted: str, goes_on: bool) -> tuple[float, bool, int]:
    """When the launcher stood [s], whether it was stopped, and strokes begun after that."""
    stops = [d.time for d in actions if d.what in ("stopped", "silenced")]
    begun = [d for d in actions if d.what == "begun"]
    if not stops:  # what moved had come to its end
        return 0.0, False, 0 if goes_on else sum(d.time > began + STANDS_WITHIN_S for d in begun)
    stood = stops[0] - began
    if interrupted == "STRIKING":  # it braked from its full speed, at most
        stood += paper_law([d for d in begun if d.time <= stops[0]][-1].string) / BRAKING_DECELERATION
    return max(stood, 0.0), True, sum(d.time > stops[0] for d in begun)
