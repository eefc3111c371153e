"""Nothing is lost, doubled or done wrong on a bad line, and every fault is told; how long a stop takes.

`python -m tests.robot.test_robot_faults [--exchanges 10000] [--rate 0.05] [--stops 100]` measures at length.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from robot.device.launcher import Launcher
from robot.device.link import Link
from robot.device.outcome import LauncherFault, StrokeUnknown
from robot.device.port import serial_opener
from robot.device.protocol import BUSY_STATES, LAUNCHER_STATES, LauncherStopped, frame, stroke_line
from robot.device.settings import PortSettings, Settings
from robot.emulator.faults import DEVICE_FAULTS, FAULT_KINDS, REPLY_FAULTS, REQUEST_FAULTS, FaultInjection
from robot.emulator.firmware import Firmware
from robot.emulator.launcher import Emulator, Pace
from tests.robot.bad_line import BAUD, Bench, campaign


@pytest.mark.parametrize("seed", range(3))
def test_on_a_clean_line_nothing_is_noted(seed: int) -> None:
    bench = Bench(0.0, seed)
    bench.recover()
    for _ in range(10):
        bench.cycle()
    assert bench.tally.strokes == 10
    assert [bench.tally.failures(), bench.tally.given_up, bench.link.incidents] == [[], 0, []]


@pytest.mark.parametrize("seed", range(5))
def test_two_thousand_exchanges_on_a_bad_line(seed: int) -> None:
    tally = campaign(2000, 0.05, seed)
    assert tally.failures() == []
    assert tally.strokes > 50
    assert {*tally.faults, "stuck"} == set(FAULT_KINDS)  # few lines move the stage


def test_one_in_four_lines_spoiled() -> None:
    tally = campaign(2000, 0.25, 5)
    assert tally.failures() == []
    assert tally.given_up > 10


def test_a_restart_after_the_last_command_is_seen() -> None:
    bench = Bench(0.0, 1)
    bench.recover()
    bench.faults.force("restart")
    bench.launcher.status()
    bench.last_look()
    assert [f.kind for f in bench.faults.done] == ["restart"] and bench.account().failures() == []


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_each_fault_alone_does_no_harm_and_is_told(kind: str) -> None:
    """The same fault on every line of a shot in turn."""
    for place in range(14):
        bench = Bench(0.0, place)
        bench.recover()
        sent = 0
        put = bench.line.put

        def counted(now: float, data: bytes, bench: Bench = bench, put: object = put, place: int = place) -> None:
            nonlocal sent
            if sent == place:
                bench.faults.force(kind)
            sent += 1
            put(now, data)  # type: ignore[operator]

        bench.line.put = counted  # type: ignore[method-assign]
        bench.cycle()
        bench.launcher.status()
        bench.clock.sleep(2.0)  # a restart may come that late
        bench.recover()
        assert [f.kind for f in bench.faults.done] in ([kind], []), place
        assert bench.account().failures() == [], (kind, place)
        if bench.faults.done and kind != "stuck":
            assert bench.link.incidents or bench.told, (kind, place)
    assert sent > 10


def test_a_restart_in_mid_stroke_is_not_known_and_not_repeated() -> None:
    bench = Bench(0.0, 1)
    bench.recover()
    send = bench.link.send_stroke

    def cut(string: int) -> bool:
        bench.device.restart(0.2)
        return send(string)

    bench.link.send_stroke = cut  # type: ignore[method-assign]
    with pytest.raises(StrokeUnknown, match="restarted in mid-stroke"):
        bench.launcher.strike("200p")
    assert len(bench.actions(0, "struck")) == 0
    assert bench.device.memory.begun == 1


def test_a_cable_that_stays_out_after_the_stroke_leaves_it_unknown() -> None:
    bench = Bench(0.0, 1)
    bench.recover()
    send = bench.link.send_stroke

    def cut(string: int) -> bool:
        sent = send(string)
        bench.clock.sleep(0.01)
        bench.line.pull(bench.clock.now(), 60.0)
        return sent

    bench.link.send_stroke = cut  # type: ignore[method-assign]
    with pytest.raises(StrokeUnknown, match="may have been made"):
        bench.launcher.strike("100p")
    bench.clock.sleep(60)
    assert [d.string for d in bench.actions(0, "struck")] == [100]
    bench.recover()
    with pytest.raises(StrokeUnknown):
        bench.launcher.strike("100p")
    assert len(bench.actions(0, "struck")) == 2, "each stroke asked for was made once"


def test_a_cable_back_in_time_tells_what_was_done() -> None:
    bench = Bench(0.0, 1)
    bench.recover()
    send = bench.link.send_stroke

    def cut(string: int) -> bool:
        sent = send(string)
        bench.clock.sleep(0.01)
        bench.line.pull(bench.clock.now(), 2.0)
        return sent

    bench.link.send_stroke = cut  # type: ignore[method-assign]
    done = bench.launcher.strike("100p")
    assert (done.string, done.number) == ("100p", 1)
    assert any(note.startswith("cable") for note in done.noted)


def test_a_stop_while_the_cable_is_out_goes_first_when_it_is_back() -> None:
    bench = Bench(0.0, 1)
    bench.recover()
    bench.line.pull(bench.clock.now(), 3.0)
    assert not bench.launcher.stop().confirmed
    bench.clock.sleep(3.0)
    with pytest.raises(LauncherStopped):
        bench.launcher.retract()
    assert bench.launcher.status().status.state == "STOPPED"


def test_lost_stop_bytes_are_sent_again() -> None:
    bench = Bench(0.0, 1)
    bench.recover()
    bench.faults.force("silent-up", "silent-up", "silent-up")
    stopped = bench.launcher.stop()
    assert stopped.confirmed
    assert stopped.bytes_sent == 4
    assert bench.device.status().state == "STOPPED"


def test_faults_are_drawn_at_their_rate_from_their_seed() -> None:
    drawn = []
    for _ in range(2):
        faults = FaultInjection(0.2, np.random.default_rng(4))
        for k in range(2000):
            faults.request(float(k), frame(":", 1, "MOVE 1 1"))
        drawn.append([(f.time, f.kind) for f in faults.done])
    assert drawn[0] == drawn[1]
    assert 330 < len(drawn[0]) < 470
    assert {kind for _, kind in drawn[0]} == set(FAULT_KINDS)
    line = FaultInjection(1.0, np.random.default_rng(0))
    for k in range(200):
        line.request(float(k), stroke_line(47))
    assert {f.kind for f in line.done} == {*REQUEST_FAULTS, *DEVICE_FAULTS} - {"stuck"}
    assert not set(REPLY_FAULTS) & {f.kind for f in line.done}


def stop_times(state: str, count: int) -> list[float]:
    """Seconds from the call of `stop` until the launcher commands no motion, in real time over a pseudo-terminal."""
    pace = Pace(200.0)
    device = Firmware(pace.now, np.random.default_rng(0), pace=pace.factor)
    times = []
    with Emulator(device, baud=BAUD) as emulator:
        settings = replace(Settings(), port=PortSettings(emulator.path, baud=BAUD))
        link = Link(serial_opener(settings.port), settings.timing, baud=BAUD)
        with Launcher(settings, link) as launcher:
            for _ in range(count):
                _bring(launcher, emulator, pace, state)
                with emulator.lock:
                    assert device.status().state == state
                    began = pace.now()
                real = time.monotonic()
                stopped = launcher.stop()
                taken = time.monotonic() - real
                with emulator.lock:
                    assert device.status().state not in BUSY_STATES
                    last = next(d for d in reversed(device.actions) if d.what == "stopped")
                times.append(last.time - began)
                assert stopped.confirmed
                assert taken < 0.5
                pace.set(200.0)
                launcher.reset()
    return times


def _bring(launcher: Launcher, emulator: Emulator, pace: Pace, state: str) -> None:
    """Into a state at speed, then in real time."""
    link, device = launcher._line, emulator.firmware
    pace.set(200.0)
    if state != "UNHOMED":
        launcher.home()
    if state == "FAULT":
        with emulator.lock:
            device.stick()
        with pytest.raises(LauncherFault):
            launcher.move_tip(5, 5)
    if state in ("EXTENDED", "RETRACTING"):
        pace.set(10.0)
        launcher.strike("047p")
    pace.set(1.0)
    if state == "MOVING":
        assert link.exchange("MOVE 9000 9000").body == "OK"
    if state == "RETRACTING":
        assert link.exchange("RETRACT").body == "OK"
    if state in ("ARMED", "STRIKING"):
        number = launcher.status().status.begun + 1
        assert link.exchange(f"ARM 200 {number}").body == "OK"
    if state == "STRIKING":
        link.send_stroke(200)
        time.sleep(0.02)
    if state == "STOPPED":
        launcher.stop()


@pytest.mark.parametrize("state", LAUNCHER_STATES)
def test_a_stop_takes_less_than_50_ms(state: str) -> None:
    assert max(stop_times(state, 5)) < 0.05


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m tests.robot.test_robot_faults", description=__doc__)
    parser.add_argument("--exchanges", type=int, default=10_000)
    parser.add_argument("--rate", type=float, default=0.05, help="faults a line")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--stops", type=int, default=0, help="in each state, in real time")
    given = parser.parse_args()
    began = time.monotonic()
    tally = campaign(given.exchanges, given.rate, given.seed)
    print(f"{tally.exchanges} exchanges, {tally.commands} commands, {tally.strokes} strokes told as done, "
          f"{time.monotonic() - began:.1f} s")  # fmt: skip
    print(f"faults {sum(tally.faults.values())}: {dict(sorted(tally.faults.items()))}")
    print(f"given up and said so {tally.given_up}, strokes told as unknown {tally.unknown}")
    print(f"lost {len(tally.lost)}, doubled {len(tally.doubled)}, wrong {len(tally.wrong)}, denied {len(tally.denied)}")
    print(f"faults not told {len(tally.silent)}")
    for failure in tally.failures():
        print("  ", failure)
    for state in LAUNCHER_STATES if given.stops else ():
        times = 1e3 * np.array(stop_times(state, given.stops))
        print(f"stop while {state:10}  median {np.median(times):5.2f} ms, worst {times.max():5.2f} ms of {given.stops}")
    return bool(tally.failures())


if __name__ == "__main__":
    sys.exit(main())
