"""The launcher's protocol, its settings, and the emulated microcontroller: pure parts, on a clock of their own."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from models.mjcf.stroke import RUN_UP_M
from planner.launcher import stroke as planned
from robot.device import protocol
from robot.device.protocol import LauncherStatus, Message, Reader, StopByte, StrokeLine, frame, stroke_line, unframe
from robot.device.settings import SpeedTable
from robot.emulator import mechanism
from robot.emulator.firmware import Firmware
from robot.emulator.paper import PaperFirmware
from robot.emulator.stage import BACKLASH_UM
from robot.emulator.stroke_motion import paper_law

BODIES = st.text("ABCXYZ0123456789.- ", min_size=1, max_size=80)
GARBAGE = st.binary(max_size=60)


class Hand:
    """A firmware with a clock turned by hand, and a host that numbers its requests."""

    def __init__(self, seed: int = 0, kind: type[Firmware] = Firmware, **options: object) -> None:
        self.time, self.sequence = 0.0, 0
        self.hits: list[tuple[float, float, float]] = []
        self.device = kind(
            lambda: self.time,
            np.random.default_rng(seed),
            on_strike=lambda *hit: self.hits.append(hit),
            **options,  # type: ignore[arg-type]
        )

    def ask(self, body: str) -> str:
        self.sequence = protocol.next_sequence(self.sequence)
        got = unframe(self.device.receive(frame(":", self.sequence, body)).rstrip(b"\n"))
        assert got is not None
        assert got.sequence == self.sequence
        return got.body

    def wait(self, seconds: float = 10.0, *, silent: bool = False) -> LauncherStatus:
        """Let time pass, as a controller that waits or as one that is gone."""
        end = self.time + seconds
        while not silent and self.time + protocol.BEAT_S < end:
            self.time += protocol.BEAT_S
            self.device.receive(frame(":", protocol.UNSOLICITED_SEQUENCE, protocol.BEAT_BODY))
        self.time = end
        return self.device.status()

    def ready(self) -> None:
        assert self.ask("HOME") == "OK"
        assert self.wait().state == "IDLE"

    def strike(self, string: int, number: int) -> None:
        assert self.ask(f"ARM {string} {number}") == "OK"
        self.device.receive(stroke_line(string))
        assert self.wait().state == "EXTENDED"

    def bring(self, state: str, string: int = 47) -> None:
        """Into that state, from new."""
        if state == "UNHOMED":
            return
        self.ready()
        if state in ("MOVING", "FAULT"):
            if state == "FAULT":
                self.device.stick()
            self.ask("MOVE 9000 0")
        elif state in ("ARMED", "STRIKING", "EXTENDED", "RETRACTING"):
            self.ask(f"ARM {string} 1")
            if state != "ARMED":
                self.device.receive(stroke_line(string))
                self.time += 0.05
        elif state == "STOPPED":
            self.device.receive(b"!")
        if state in ("FAULT", "EXTENDED", "RETRACTING"):
            self.wait()
        if state == "RETRACTING":
            self.ask("RETRACT")


def struck(hand: Hand) -> list[int]:
    return [d.string for d in hand.device.actions if d.what == "struck"]


@given(st.integers(0, 0xFFFF), BODIES)
def test_a_frame_comes_back_as_it_went(sequence: int, body: str) -> None:
    line = frame(":", sequence, body)
    assert unframe(line[:-1]) == Message(sequence, body)
    assert not {b"!"[0], b"p"[0]} & set(line)


@given(st.integers(0, 0xFFFF), BODIES, st.data())
def test_up_to_three_wrong_bits_are_found(sequence: int, body: str, data: st.DataObject) -> None:
    line = bytearray(frame("=", sequence, body)[:-1])
    places = st.lists(st.integers(0, 8 * len(line) - 1), min_size=1, max_size=3, unique=True)
    for bit in data.draw(places):
        line[bit // 8] ^= 1 << bit % 8
    assert unframe(bytes(line)) is None


@given(GARBAGE, BODIES)
def test_after_any_garbage_the_next_frame_is_read(garbage: bytes, body: str) -> None:
    for lead, commands in ((":", True), ("=", False)):
        found = Reader(lead, commands=commands).feed(garbage + frame(lead, 7, body))
        assert found[-1] == Message(7, body)


@given(GARBAGE, st.integers(0, 40))
def test_every_stop_byte_counts_wherever_it_stands(garbage: bytes, cut: int) -> None:
    clean = garbage.replace(b"!", b"")
    found = Reader(":", commands=True).feed(clean + frame(":", 1, "MOVE 100 -100")[:cut] + b"!")
    assert found[-1] == StopByte()


@given(st.binary(max_size=200))
def test_a_reader_counts_every_byte_that_it_throws_away(data: bytes) -> None:
    reader = Reader(":", commands=True)
    used = sum(
        {StopByte: 1, StrokeLine: 4}.get(type(a), 0) or len(frame(":", a.sequence, a.body))  # type: ignore[union-attr]
        for a in reader.feed(data)
    )
    reader.forget()
    assert reader.dropped + used == len(data)


@given(st.lists(st.integers(-(10**6), 10**6), min_size=13, max_size=13), st.sampled_from(protocol.LAUNCHER_STATES))
def test_a_status_comes_back_as_it_went(numbers: list[int], state: str) -> None:
    status = LauncherStatus(state, *numbers)
    body = protocol.status_body(status)
    assert protocol.parse_status(body) == status
    assert protocol.parse_status(body + " 0") is None
    assert protocol.parse_status(body.replace(state, "ASLEEP")) is None


@hypothesis_settings(max_examples=60)
@given(GARBAGE, st.integers(1, 200))
def test_garbage_never_strikes(garbage: bytes, string: int) -> None:
    """Armed with one string, no other makes a stroke, and the right one makes a single stroke."""
    hand = Hand()
    hand.ready()
    assert hand.ask(f"ARM {string} 1") == "OK"
    safe = garbage.replace(b"!", b"").replace(b"p", b"")
    hand.device.receive(safe + b"\n" + stroke_line(string) * 3)
    hand.wait()
    assert struck(hand) == [string]


def test_checksum_is_the_published_one() -> None:
    assert protocol.checksum(b"123456789") == 0x29B1  # CRC-16/IBM-3740, also called CCITT-FALSE


def test_strings_of_the_paper() -> None:
    assert stroke_line(1) == b"001p"
    assert protocol.string_number("200p") == 200
    assert SpeedTable().cue_speed(1) == 2.75
    assert SpeedTable().cue_speed(200) == 0.30
    launcher = planned.LauncherModel()
    for n in range(1, 201):
        assert SpeedTable().cue_speed(n) == pytest.approx(launcher.cue_speed(n))
        assert paper_law(n) == pytest.approx(launcher.cue_speed(n))


@pytest.mark.parametrize("line", [b"47p", b"0047p", b"9047p", b"047P", b"04 7p", b"000p", b"201p", b"047", b"048p"])
def test_what_is_not_the_armed_string_does_not_strike(line: bytes) -> None:
    hand = Hand()
    hand.bring("ARMED")
    hand.device.receive(line)
    assert hand.device.status().state == "ARMED"
    hand.device.receive(b"\n047p")
    assert hand.device.status().state == "STRIKING"


def test_a_stroke_needs_arming_and_uses_it_up() -> None:
    hand = Hand()
    hand.ready()
    hand.device.receive(b"047p")
    assert struck(hand) == []
    hand.strike(47, 1)
    hand.device.receive(b"047p")  # doubled
    assert hand.ask("RETRACT") == "OK"
    hand.wait()
    hand.device.receive(b"047p")  # late
    assert hand.ask("ARM 47 1") == "NO NUMBER"
    hand.wait()
    assert struck(hand) == [47]
    assert hand.device.status().refused == 3


def test_an_unused_arming_lapses() -> None:
    hand = Hand()
    hand.bring("ARMED")
    assert hand.wait(mechanism.ARMED_TIMEOUT_S + 0.01).state == "IDLE"
    hand.device.receive(b"047p")
    hand.wait()
    assert struck(hand) == []


def test_a_repeated_number_does_nothing_twice() -> None:
    hand = Hand()
    hand.ready()
    line = frame(":", 77, "MOVE 5000 0")
    first = hand.device.receive(line)
    hand.wait()
    moves = len(hand.device.actions)
    assert hand.device.receive(line) == first
    hand.wait()
    assert len(hand.device.actions) == moves
    assert b"NO SEQUENCE" in hand.device.receive(frame(":", 77, "MOVE 0 0"))


def test_a_stroke_number_outlasts_a_restart() -> None:
    hand = Hand()
    hand.bring("STRIKING")
    hand.device.restart()
    status = hand.wait()
    assert (status.state, status.boots, status.begun, status.done) == ("UNHOMED", 2, 1, 0)
    assert status.troubles() == ("restarted in mid-stroke",)
    hand.ready()
    assert hand.ask("ARM 47 1") == "NO NUMBER"
    assert hand.ask("ARM 47 2") == "OK"


@pytest.mark.parametrize("state", protocol.LAUNCHER_STATES)
def test_the_stop_byte_ends_every_state_and_only_a_reset_leaves_it(state: str) -> None:
    hand = Hand()
    hand.bring(state)
    assert hand.device.status().state == state
    stops = hand.device.status().stops
    hand.device.receive(frame(":", 9000, "MOVE 0 0")[:11] + b"!")
    for _ in range(2):
        assert hand.device.status().state == "STOPPED"
        for body in ("HOME", "RETRACT", "MOVE 0 0", "ARM 47 1", "ARM 47 2"):
            assert hand.ask(body) == "NO STOPPED"
        hand.device.receive(b"047p")
        assert hand.wait().state == "STOPPED"
        hand.device.restart()  # a loss of power does not leave it either
        hand.wait()
    assert hand.ask(f"RESET {stops}") == "NO STOPS"
    assert hand.ask(f"RESET {stops + 1}") == "OK"
    assert hand.device.status().state == "UNHOMED"


@pytest.mark.parametrize("state", protocol.LAUNCHER_STATES)
def test_a_silent_controller_stops_what_moves_or_may(state: str) -> None:
    hand = Hand()
    hand.bring(state, 200)  # a stroke of 0.8 s
    before = hand.device.status()
    guarded = state in protocol.GUARDED_STATES
    after = hand.wait(protocol.SILENCE_S, silent=True)
    assert (after.stops - before.stops, bool(after.faults & protocol.SILENCE_BIT)) == (guarded, guarded)
    if not guarded:
        assert after.state == state
        return
    assert after.state == "STOPPED" and hand.device.memory.interrupted == state
    assert any("silent" in trouble for trouble in after.troubles())
    hand.device.receive(b"200p")
    strokes = struck(hand)
    hand.device.restart()  # it is still said after a loss of power
    assert hand.wait().faults & protocol.SILENCE_BIT
    assert hand.ask(f"RESET {before.stops}") == "NO STOPS"
    assert hand.ask(f"RESET {after.stops}") == "OK"
    assert hand.device.status().troubles() == () and struck(hand) == strokes


def test_the_answer_to_a_stop_names_the_state_that_the_first_one_ended() -> None:
    hand = Hand()
    hand.bring("RETRACTING")
    for stops in (1, 2):
        got = unframe(hand.device.receive(b"!").rstrip(b"\n"))
        assert got == Message(0, f"STOPPED {stops} RETRACTING")
        assert protocol.interrupted_state(got) == "RETRACTING"
    assert protocol.interrupted_state(Message(1, "STOPPED 1 IDLE")) is None
    assert protocol.interrupted_state(Message(0, "STOPPED 1")) == ""


def test_a_beat_has_no_answer_and_forgets_nothing() -> None:
    hand = Hand()
    hand.ready()
    line = frame(":", 77, "MOVE 5000 0")
    first = hand.device.receive(line)
    assert hand.device.receive(frame(":", 0, protocol.BEAT_BODY)) == b""
    assert hand.device.receive(line) == first
    hand.wait()
    assert [d.x for d in hand.device.actions if d.what == "moved"] == [pytest.approx(0.005)]


def test_a_launcher_of_the_paper_strikes_without_arming_and_stops_for_nothing() -> None:
    hand = Hand(kind=PaperFirmware)
    assert hand.device.receive(b"047p") == b""
    hand.time += 0.1
    assert hand.device.receive(b"048p!" + frame(":", 0, "VERSION")) == b""
    hand.wait(silent=True)
    hand.device.receive(b"100p")
    hand.wait(silent=True)
    assert struck(hand) == [47, 100] and hand.device.status().state == "IDLE"


@pytest.mark.parametrize("state", protocol.LAUNCHER_STATES)
def test_what_each_state_allows(state: str) -> None:
    allowed = {
        "HOME": ("UNHOMED", "IDLE", "EXTENDED"),
        "MOVE 100 100": ("IDLE",),
        "ARM 47 1": ("IDLE",),
        "RETRACT": ("IDLE", "EXTENDED"),
    }
    for body, states in allowed.items():
        hand = Hand()
        hand.bring(state)
        assert (hand.ask(body) == "OK") == (state in states), body
    assert hand.ask("STATUS").startswith("OK ")


def test_speed_ripples_by_a_hundredth_and_is_measured_closely() -> None:
    hand = Hand(seed=3)
    hand.ready()
    for number in range(1, 61):
        hand.strike(100, number)
        told = hand.device.status()
        assert told.cue_speed == pytest.approx(hand.hits[-1][0], rel=5 * mechanism.ENCODER_SPEED_SD)
        assert hand.ask("RETRACT") == "OK"
        hand.wait()
    speeds = np.array([hit[0] for hit in hand.hits]) / paper_law(100) - 1
    assert 0.002 < speeds.std() < 0.016
    assert abs(speeds).max() < mechanism.SPEED_RIPPLE + 5 * mechanism.SPEED_SCATTER


def test_a_fast_stroke_takes_as_long_as_its_run_up_and_level_stroke() -> None:
    hand = Hand(ripple=0.0)
    hand.bring("ARMED")
    hand.device.receive(b"047p")
    v = paper_law(47)
    takes = 2 * RUN_UP_M / v + (mechanism.BALL_DISTANCE_M - RUN_UP_M) / v
    hand.wait(takes * 0.98)
    assert hand.hits == []
    hand.wait(takes * 0.04)
    assert len(hand.hits) == 1


def test_a_stop_in_mid_stroke_slows_the_cue_or_spares_the_ball() -> None:
    speeds = []
    for after in np.linspace(0.0, 0.2, 21):
        hand = Hand(ripple=0.0)
        hand.bring("ARMED")
        hand.device.receive(b"047p")
        hand.time += float(after)
        hand.device.receive(b"!!")  # doubled: a coasting cue coasts on
        assert hand.wait().state == "STOPPED"
        speeds.append(hand.hits[0][0] if hand.hits else 0.0)
    assert speeds[0] == 0
    assert speeds[-1] == pytest.approx(paper_law(47), rel=0.02)
    assert any(0 < v < 0.95 * speeds[-1] for v in speeds)
    assert all(b >= a - 0.05 for a, b in pairwise(speeds))


def test_the_stage_lags_after_a_reversal() -> None:
    hand = Hand()
    hand.ready()
    places = []
    for x in (3000, 6000, 3000, 2900, 3000):
        assert hand.ask(f"MOVE {x} 0") == "OK"
        hand.wait()
        places.append(round(hand.device.tip()[0] * 1e6))
    play = BACKLASH_UM[0]
    assert places == [3000, 6000, 3000 + play, 2900 + play, 3000 + play - 100]
