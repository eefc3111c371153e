"""One suite for driver and launcher: on the virtual line, on a pseudo-terminal, and on a real port where one is named.

CUELAB_PORT names the port of a real launcher; then what moves nothing is run on it, and what moves it too with
CUELAB_ALLOW_MOTION=1. Take the ball away first: the launcher strikes.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from robot.device.launcher import Launcher
from robot.device.link import Link
from robot.device.outcome import Refused, StrokeUnknown
from robot.device.port import serial_opener
from robot.device.protocol import LauncherStopped, LinkLost
from robot.device.settings import PortSettings, Settings
from robot.emulator.launcher import serve
from robot.emulator.stage import BACKLASH_UM
from tests.support.virtual_port import BAUD, Bench, ready, terminal, virtual

PLACES = ("virtual", "terminal", "port")
MOVES = os.environ.get("CUELAB_ALLOW_MOTION") == "1"


@contextlib.contextmanager
def port(log: Path) -> Iterator[Bench]:
    ours = replace(Settings(), port=PortSettings(os.environ["CUELAB_PORT"]))
    link = Link(serial_opener(ours.port), ours.timing, baud=ours.port.baud, log=log)
    with Launcher(ours, link) as launcher:
        yield Bench(launcher, link, log)


@pytest.fixture(params=PLACES)
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bench]:
    """The three in turn; the real one only where it is named, and moved only where that is allowed."""
    if request.param == "port":
        if "CUELAB_PORT" not in os.environ:
            pytest.skip("CUELAB_PORT names no launcher")
        if "still" not in request.fixturenames and not MOVES:
            pytest.skip("this moves the launcher: set CUELAB_ALLOW_MOTION=1")
    with {"virtual": virtual, "terminal": terminal, "port": port}[request.param](tmp_path / "log.jsonl") as made:
        yield made


@pytest.fixture
def still() -> None:
    """For tests that move nothing; see `bench`."""


def records(bench: Bench) -> list[dict[str, object]]:
    return [json.loads(line) for line in bench.log.read_text().splitlines()]


def sent(bench: Bench) -> list[object]:
    return [r["sent"] for r in records(bench) if "sent" in r and r["sent"] not in ("STATUS", "VERSION")]


def test_a_question_moves_nothing_and_is_logged(bench: Bench, still: None) -> None:
    before = bench.launcher.status()
    bench.launcher.force()
    after = bench.launcher.status()
    assert before.status == after.status
    assert before.noted == ()
    assert [r["sent"] for r in records(bench)] == ["VERSION", "STATUS", "STATUS", "FORCE", "STATUS"]
    assert all({"utc", "event", "began", "seconds", "reply", "retries"} <= r.keys() for r in records(bench))


def test_bad_input_reaches_no_launcher(bench: Bench, still: None) -> None:
    count = bench.link.exchanges
    for wrong in (
        lambda: bench.launcher.strike("47p"),
        lambda: bench.launcher.strike(0),
        lambda: bench.launcher.move_tip(15, 15),
        lambda: bench.launcher.move_tip(float("nan"), 0),
    ):
        with pytest.raises(BadInput):
            wrong()
    assert bench.link.exchanges == count


def test_a_shot_comes_back_as_it_was_done(bench: Bench) -> None:
    ready(bench)
    placed = bench.launcher.move_tip(-6.0, 5.0)
    done = bench.launcher.strike("047p")
    assert (placed.x0_mm, placed.y0_mm) == pytest.approx((-6, 5), abs=0.011)
    assert (done.x0_mm, done.y0_mm) == (placed.x0_mm, placed.y0_mm)
    assert done.string == "047p"
    assert done.asked_speed == pytest.approx(2.1837, abs=1e-4)
    assert done.cue_speed == pytest.approx(done.asked_speed, rel=0.05)
    assert done.retries == 0
    assert bench.launcher.retract().status.state == "IDLE"
    assert bench.launcher.force()[1] == pytest.approx(done.peak_force)
    if bench.hits is not None:
        ((speed, side, height),) = bench.hits
        assert done.cue_speed == pytest.approx(speed, rel=0.005)
        assert (1e3 * side, 1e3 * height) == pytest.approx((-6, 5), abs=0.011)
    if bench.emulator is None and bench.device is not None:
        assert [d.number for d in bench.device.actions if d.what == "struck"] == [done.number] == [1]


def test_a_stroke_is_refused_before_the_retract(bench: Bench) -> None:
    ready(bench)
    bench.launcher.strike(200)
    with pytest.raises(Refused, match="retract first"):
        bench.launcher.strike(200)
    with pytest.raises(Refused, match="retract first"):
        bench.launcher.move_tip(0, 0)
    before = bench.launcher.status().status
    bench.launcher.retract()
    assert bench.launcher.strike(200).number == before.begun + 1


def test_after_a_stop_only_a_reset_and_a_homing_let_it_go_on(bench: Bench) -> None:
    ready(bench)
    stopped = bench.launcher.stop()
    assert stopped.confirmed
    verbs: tuple[Callable[[], object], ...] = (
        bench.launcher.home,
        bench.launcher.retract,
        lambda: bench.launcher.move_tip(0, 0),
        lambda: bench.launcher.strike(200),
    )
    for verb in verbs:
        with pytest.raises(LauncherStopped):
            verb()
    assert bench.launcher.status().status.state == "STOPPED"
    assert bench.launcher.reset().status.state == "UNHOMED"
    with pytest.raises(Refused, match="home it first"):
        bench.launcher.move_tip(0, 0)
    assert bench.launcher.home().status.state == "IDLE"


def test_a_reset_does_not_undo_a_stop_that_it_has_not_seen(bench: Bench) -> None:
    bench.launcher.stop()
    ask = bench.link.exchange

    def late(body: str, *, through_stop: bool = False) -> object:
        if body.startswith("RESET"):
            bench.launcher.stop()
        return ask(body, through_stop=through_stop)

    bench.link.exchange = late  # type: ignore[method-assign, assignment]
    with pytest.raises(Refused, match="stopped again meanwhile"):
        bench.launcher.reset()
    assert bench.launcher.status().status.state == "STOPPED"
    bench.link.exchange = ask  # type: ignore[method-assign]
    assert bench.launcher.reset().status.state == "UNHOMED"


def test_the_next_session_gets_its_own_replies(bench: Bench) -> None:
    ready(bench)
    bench.link.close()
    assert bench.launcher.connect().status.state == "IDLE"
    bench.launcher.move_tip(1, 1)
    bench.link.close()
    assert bench.launcher.connect().status.x_um == 1000


def test_the_tip_comes_from_below_to_where_it_was_sent(tmp_path: Path) -> None:
    with virtual(tmp_path / "log") as made:
        ready(made)
        rng = np.random.default_rng(8)
        for x, y in rng.uniform(-9, 9, (30, 2)):
            made.launcher.move_tip(float(x), float(y))
            assert made.device is not None
            tip = 1e3 * np.array(made.device.tip())
            assert np.abs(tip - (x, y)).max() < 0.011
        slack = made.launcher.settings
        made.launcher.settings = replace(slack, stage=replace(slack.stage, takeup_mm=0.0))
        made.launcher.move_tip(5, 5)
        made.launcher.move_tip(0, 0)
        assert 1e6 * made.device.tip()[0] == pytest.approx(BACKLASH_UM[0], abs=11)


def test_a_dry_run_says_what_would_be_sent_and_sends_nothing(tmp_path: Path) -> None:
    said: list[str] = []
    dry = Launcher(Settings(), None, dry_run=True, say=said.append)
    with virtual(tmp_path / "log") as made:
        for launcher in (made.launcher, dry):
            launcher.home()
            launcher.move_tip(2, -3)
            done = launcher.strike("150p")
            launcher.retract()
            launcher.move_tip(1, 1)
        assert said == [f"would send {line}" for line in sent(made)]
    assert done.dry
    assert np.isnan(done.cue_speed)
    with pytest.raises(BadInput):
        dry.strike("201p")
    with pytest.raises(BadInput, match="dry_run"):
        Launcher(Settings(), None)


def test_a_hung_motion_is_stopped(tmp_path: Path) -> None:
    with virtual(tmp_path / "log") as made:
        ready(made)
        ours = made.launcher.settings
        made.launcher.settings = replace(ours, timing=replace(ours.timing, motion_s=0.2))
        with pytest.raises(LauncherStopped, match=r"more than 0\.2 s"):
            made.launcher.move_tip(9, 9)
        assert made.launcher.status().status.state == "STOPPED"


@pytest.mark.parametrize(("after", "begun", "error"), [(0.03, 0, LauncherStopped), (0.4, 1, StrokeUnknown)])
def test_a_stop_from_another_thread_ends_a_stroke(
    tmp_path: Path, after: float, begun: int, error: type[Exception]
) -> None:
    """Before it was begun, or on the way to the ball: the driver says what is known."""
    with terminal(tmp_path / "log", pace=1.0) as made:
        made.launcher.home()
        timer = threading.Timer(after, made.launcher.stop)
        timer.start()
        with pytest.raises(error):
            made.launcher.strike(200)
        timer.join()
        assert made.launcher.status().status.state == "STOPPED"
        made.launcher.reset()
        assert made.launcher.status().status.begun == begun
        assert made.hits == []


def test_a_pulled_cable_is_found_again(tmp_path: Path) -> None:
    with terminal(tmp_path / "log") as made:
        assert made.emulator is not None
        made.launcher.home()
        threading.Timer(0.05, lambda: made.emulator and made.emulator.pull(0.3)).start()
        moved = made.launcher.move_tip(12, 12)
        assert any(note.startswith("cable") for note in moved.noted)
        assert (moved.x0_mm, moved.y0_mm) == pytest.approx((12, 12), abs=0.011)


def test_a_cable_that_stays_out_is_said(tmp_path: Path) -> None:
    with terminal(tmp_path / "log", reconnect_s=0.2) as made:
        assert made.emulator is not None
        made.launcher.home()
        made.emulator.pull(1.0)
        time.sleep(0.05)
        with pytest.raises(LinkLost, match="cable is out"):
            made.launcher.strike(100)
        assert not made.launcher.stop().confirmed
        time.sleep(1.0)
        assert made.launcher.status().status.state in ("IDLE", "STOPPED")
        assert made.hits == []


def test_a_port_that_is_taken_or_missing_is_bad_input(tmp_path: Path) -> None:
    with terminal(tmp_path / "log") as made:
        second = Link(serial_opener(made.launcher.settings.port), Settings().timing, baud=BAUD)
        with pytest.raises(BadInput, match="cannot be opened"):
            second.open()
    missing = Link(serial_opener(PortSettings(str(tmp_path / "none"))), Settings().timing, baud=BAUD)
    with pytest.raises(BadInput, match="plug the cable in"):
        missing.open()
    with pytest.raises(BadInput, match="cannot be written"), virtual(tmp_path / "no" / "log"):
        pass


def test_the_emulator_serves_until_told_to_end() -> None:
    said: list[str] = []
    ending = threading.Event()
    thread = threading.Thread(target=lambda: serve(pace=100.0, seed=1, say=said.append, until=ending))
    thread.start()
    while not said:
        time.sleep(0.01)
    ours = replace(Settings(), port=PortSettings(said[0], baud=BAUD))
    with Launcher(ours, Link(serial_opener(ours.port), ours.timing, baud=BAUD)) as launcher:
        launcher.home()
        launcher.strike("100p")
        launcher.retract()
    time.sleep(0.1)
    ending.set()
    thread.join()
    assert not Path(said[0]).exists()
    assert any("100p  cue 1.5" in line for line in said)
    with pytest.raises(BadInput, match="pace"):
        serve(pace=0)
