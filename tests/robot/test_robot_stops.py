"""What stops the launcher: other programs past the lock, a silent driver, and programs that end badly."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from robot.device.launcher import Launcher
from robot.device.link import Link
from robot.device.outcome import Stopped, StrokeUnknown
from robot.device.paper import PaperLauncher
from robot.device.past_lock import stop_past_lock
from robot.device.port import serial_opener
from robot.device.protocol import SILENCE_S, LauncherError, LauncherStopped
from robot.device.relay import WHO, Holder, Relay, begin
from robot.device.settings import PortSettings, Settings
from robot.emulator.faults import FaultInjection
from robot.emulator.firmware import Firmware
from robot.emulator.launcher import Emulator, Pace
from robot.emulator.line import Line, VirtualClock, WirePort
from robot.emulator.paper import PaperFirmware
from tests.support.virtual_port import BAUD, ready, terminal, virtual


def test_a_stop_from_another_program_goes_past_the_lock_and_says_what_it_interrupted(tmp_path: Path) -> None:
    with terminal(tmp_path / "log", pace=1.0) as made:
        made.launcher.home()
        found: list[tuple[Stopped, Holder | None]] = []
        elsewhere = threading.Thread(target=lambda: found.append(stop_past_lock(made.launcher.settings)))
        threading.Timer(0.3, elsewhere.start).start()
        with pytest.raises(LauncherStopped, match=r"stopped by .* \(process \d+\)"):
            made.launcher.move_tip(9, 9)
        elsewhere.join()
        [(stopped, holder)] = found
        assert stopped.confirmed and stopped.interrupted == "MOVING" and stopped.seconds < 0.5
        assert holder is not None and holder.process == os.getpid() and holder.answer is not None
        assert holder.answer["doing"] == "a move of the tip"
        assert made.launcher.status().status.state == "STOPPED"
        made.launcher.reset()
        made.launcher.home()


def test_a_byte_past_the_lock_ends_a_stroke_also_where_nobody_says_who_wrote_it(tmp_path: Path) -> None:
    with terminal(tmp_path / "log", pace=1.0) as made:
        assert made.emulator is not None
        made.launcher.home()
        with open(made.emulator.path, "wb", buffering=0) as past:
            threading.Timer(0.3, lambda: past.write(b"!")).start()
            with pytest.raises(StrokeUnknown, match="stopped by another program"):
                made.launcher.strike(200)
        with pytest.raises(LauncherStopped):
            made.launcher.retract()
        assert made.hits == []


def test_a_holder_that_ends_answers_who_has_asked_before(tmp_path: Path) -> None:
    port = str(tmp_path / "port")
    for _ in range(300):
        relay = Relay(port, lambda request, by: {"request": request, "by": by})
        asked = begin(port, WHO, "me")
        assert asked is not None and asked.process == os.getpid(), "the name of the last one is not free again"
        relay.close()
        assert asked.answered(1.0).answer == {"request": WHO, "by": "me"}
    assert begin(port, WHO, "me") is None


def test_a_holder_that_reads_nothing_is_stopped_all_the_same(tmp_path: Path) -> None:
    """As where it hangs: it answers neither the launcher nor the other program."""
    with terminal(tmp_path / "log", pace=1.0) as made:
        made.launcher.home()
        made.link.elsewhere.close()
        stopped, holder = stop_past_lock(made.launcher.settings)
        assert stopped.confirmed and holder is None
        with pytest.raises(LauncherStopped):
            made.launcher.move_tip(1, 1)


def test_a_driver_that_hangs_lets_the_launcher_stop_and_says_why(tmp_path: Path) -> None:
    with virtual(tmp_path / "log") as made:
        ready(made)
        sleep, hung = made.link.clock.sleep, [SILENCE_S + 0.1]
        made.link.clock.sleep = lambda seconds: sleep(hung.pop() if hung else seconds)  # type: ignore[method-assign]
        with pytest.raises(LauncherStopped, match=r"stopped by itself, its controller being silent for 0\.4 s"):
            made.launcher.move_tip(9, 9)


def test_late_and_lost_replies_do_not_count_as_silence(tmp_path: Path) -> None:
    for kinds in (["slow"], ["silent-down"] * 3, ["silent-up"] * 3, ["garbage-up", "slow", "silent-up"]):
        rng = np.random.default_rng(1)
        clock = VirtualClock()
        device, faults = Firmware(clock.now, rng), FaultInjection(0.0, rng)
        line = clock.line = Line(device, baud=BAUD, faults=faults)
        link = Link(lambda line=line, clock=clock: WirePort(line, clock), Settings().timing, baud=BAUD, clock=clock)  # type: ignore[misc]
        with Launcher(Settings(), link) as launcher:
            launcher.home()
            command = launcher._command

            def spoiled(job: object, body: str, command: object = command, faults: object = faults) -> None:
                command(job, body)  # type: ignore[operator]
                faults.force(*kinds)  # type: ignore[attr-defined] # noqa: B023 - called within the round

            launcher._command = spoiled  # type: ignore[method-assign, assignment]
            launcher.move_tip(9, 9)
        assert len(faults.done) >= len(kinds) and not [d for d in device.actions if d.what == "silenced"], kinds


def test_old_firmware_is_refused_with_what_it_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robot.device.protocol.PROTOCOL_VERSION", "CUELAB 1")
    with pytest.raises(LauncherError, match="load firmware that speaks CUELAB 2"), virtual(tmp_path / "log"):
        pass


def test_a_launcher_of_the_paper_is_struck_with_and_not_promised_anything(tmp_path: Path) -> None:
    clock, said = Pace(20.0), list[str]()
    device = PaperFirmware(clock.now, np.random.default_rng(0))
    with Emulator(device, baud=BAUD) as emulator:
        ours = replace(Settings(), port=PortSettings(emulator.path, "paper", BAUD))
        log = tmp_path / "log"
        with PaperLauncher(ours, serial_opener(ours.port), log=log, say=said.append) as launcher:
            assert launcher.move_tip(2, -3).status.x_um == 2000
            done = launcher.strike("047p")
            assert launcher.retract().status.state == "IDLE" and not launcher.stop().confirmed
            with pytest.raises(BadInput, match="home it at the launcher"):
                launcher.home()
        with emulator.lock:
            assert [d.string for d in device.actions if d.what == "struck"] == [47]
    assert "neither robot stop nor a silent controller stops it" in said[0] and "set the tip to +2.00" in said[1]
    assert np.isnan(done.cue_speed) and not done.dry and "not confirmed" in done.noted[0]
    assert [json.loads(line)["sent"] for line in log.read_text().splitlines()] == ["047p"]


WAYS = {
    "SIGTERM": "time.sleep(30)",
    "SIGQUIT": "time.sleep(30)",
    "SIGHUP": "time.sleep(30)",
    "SIGINT": "time.sleep(30)",
    "exception": "raise RuntimeError('lost my mind')",
    "forgotten": "launcher._line._signals.remove(); sys.exit(0)",
}
CHILD = """
import sys, time
from dataclasses import replace
from robot.device.launcher import Launcher
from robot.device.link import Link
from robot.device.port import serial_opener
from robot.device.settings import PortSettings, Settings
port = PortSettings(sys.argv[1], baud=19200)
launcher = Launcher(Settings(), Link(serial_opener(port), Settings().timing, baud=port.baud))
if sys.argv[2] == "forgotten":
    launcher.connect()
else:
    launcher.__enter__()
try:
    launcher.home()
    launcher._line.exchange("MOVE 20000 20000")
    print("moving", flush=True)
    BODY
except BaseException:
    if sys.argv[2] != "forgotten":
        launcher.__exit__(*sys.exc_info())
    raise
"""


@pytest.mark.parametrize("way", WAYS)
def test_a_program_that_ends_badly_stops_the_launcher(way: str) -> None:
    """By a signal, by an exception, or without closing the line."""
    clock = Pace(1.0)
    device = Firmware(clock.now, np.random.default_rng(0), pace=clock.factor)
    with Emulator(device, baud=BAUD) as emulator:
        code = CHILD.replace("BODY", WAYS[way])
        child = subprocess.Popen(
            [sys.executable, "-c", code, emulator.path, way], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert child.stdout is not None
        assert child.stdout.readline() == "moving\n"
        if way.startswith("SIG"):
            child.send_signal(signal.Signals[way])
        child.communicate(timeout=10)
        time.sleep(0.05)
        with emulator.lock:
            assert device.status().state == "STOPPED"
            assert next(d.what for d in device.actions if d.what in ("stopped", "silenced")) == "stopped"
