"""The emulated microcontroller of the launcher: the protocol's other end.

In: bytes from the cable, and what moves the mechanics (mechanism.py). Out: reply bytes. It behaves like the device of
Robotic Billiards (2015), section V, with robot/device/protocol.py. It has no thread: each byte first advances the
mechanics to the clock's time.
"""

from __future__ import annotations

from robot.device import protocol
from robot.device.protocol import (
    BEAT_BODY,
    BUSY_STATES,
    SILENCE_BIT,
    SILENCE_S,
    UNSOLICITED_SEQUENCE,
    Arrival,
    LauncherStatus,
    Message,
)
from robot.emulator.mechanism import Mechanism

ARGUMENT_COUNTS = {
    "VERSION": 0,
    "STATUS": 0,
    "FORCE": 0,
    "HOME": 0,
    "RETRACT": 0,
    "DISARM": 0,
    "RESET": 1,
    "MOVE": 2,
    "ARM": 2,
}
LINE_GAP_S = 0.5  # silence that ends an incomplete line


class Firmware(Mechanism):
    """An emulated launcher."""

    _last: tuple[Message, str] | None  # the last request and its reply

    def receive(self, data: bytes) -> bytes:
        """Process bytes from the cable; returns the answer."""
        self.update()
        if self._time < self._deaf_until:
            return b""
        if self._reader.waiting and self._time - self._heard > LINE_GAP_S:
            self._reader.forget()
        self._heard = self._time
        return b"".join(self._answer(arrival) for arrival in self._reader.feed(data))

    def status(self) -> LauncherStatus:
        """The current status."""
        self.update()
        m = self.memory
        x, y = (round(v) for v in (self._stage.under_way(self._time) if self.state == "MOVING" else self._stage.motor))
        return LauncherStatus(
            self.state, m.boots, m.stops, m.begun, m.done, self._armed, x, y, m.string, round(m.speed * 1e6),
            round(m.force * 1e3), self._reader.dropped, self._refused, self._faults | SILENCE_BIT * m.silent,
        )  # fmt: skip

    def _answer(self, arrival: Arrival) -> bytes:
        if isinstance(arrival, protocol.StopByte):
            self._stop("stopped")
            return protocol.stop_notice(self.memory.stops, self.memory.interrupted)
        if isinstance(arrival, protocol.StrokeLine):
            self._stroke(arrival.string)
            return b""
        self._silent_at = self._time + SILENCE_S * self._pace()
        if arrival == Message(UNSOLICITED_SEQUENCE, BEAT_BODY):
            return b""
        return protocol.frame("=", arrival.sequence, self._reply(arrival))

    def _reply(self, request: Message) -> str:
        """A repeated number gets the stored reply, without repeating the action."""
        if request.sequence == UNSOLICITED_SEQUENCE:
            self._last = None
            return f"OK {protocol.PROTOCOL_VERSION}" if request.body == "VERSION" else "NO SEQUENCE"
        if self._last is not None and self._last[0].sequence == request.sequence:
            return self._last[1] if self._last[0] == request else "NO SEQUENCE"
        reply = self._obey(request.body)
        self._last = (request, reply)
        return reply

    def _obey(self, body: str) -> str:
        verb, *words = body.split(" ")
        if verb not in ARGUMENT_COUNTS:
            return "NO COMMAND"
        try:
            values = [int(word) for word in words]
        except ValueError:
            return "NO SYNTAX"
        if len(values) != ARGUMENT_COUNTS[verb]:
            return "NO SYNTAX"
        if verb == "VERSION":
            return f"OK {protocol.PROTOCOL_VERSION}"
        if verb == "STATUS":
            return protocol.status_body(self.status())
        if verb == "FORCE":
            return f"OK 0 {round(self.memory.force * 1e3)}"  # no force now; peak of the last stroke
        if verb == "RESET":
            return self._reset(values[0])
        if verb == "DISARM":
            if self.state == "ARMED":
                self.state, self._armed = "IDLE", 0
            return "OK"
        if self.state in (*BUSY_STATES, "ARMED", "STOPPED", "FAULT"):
            return f"NO {self.state}"
        if verb == "HOME":
            return self._home()
        if verb == "RETRACT":
            return self._retract()
        return self._move(*values) if verb == "MOVE" else self._arm(*values)

    def _reset(self, stops: int) -> str:
        if stops != self.memory.stops:
            return "NO STOPS"  # there was another stop that the sender does not know of
        if self.state in ("STOPPED", "FAULT"):
            self.memory.stopped, self._stuck, self._faults = False, False, 0
            self.memory.interrupted, self.memory.silent = "", False
            self.state = "UNHOMED"
            self._note("reset")
        return "OK"

    def _boot(self) -> None:
        self._reader = protocol.Reader(":", commands=True)
        self._last = None
        super()._boot()
