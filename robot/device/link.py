"""The link to the launcher: one request at a time, repeated when unanswered, and a stop that never waits.

In: an opener of the port, time-outs, request bodies. Out: reply bodies, the incidents on the line, and a log.

A request is sent and its reply awaited; after `reply_s` of silence, or a damaged reply, the same line is sent again,
which the launcher answers without repeating the action (robot/device/protocol.py). If the cable was disconnected, the
port is reopened within `reconnect_s`. Anything unusual is noted (`incidents`); every exchange is a line of the log.

The stop has its own path: `halt` takes no lock that is held while waiting, discards queued output, writes the byte and
wakes the reading thread. From then on every other thread gets LauncherStopped until a reset. If the cable is out, the
byte is the first to be sent when it is back. Signals (robot/device/signals.py), an exception and the end of the program
also stop the launcher. Other programs stop it without this link: the answer to their byte halts it
(robot/device/elsewhere.py).

A killed controller is silent, and the launcher then stops on its own; one that waits for a late reply sends beats, in
the waiting thread, so that a hung thread sends none.
"""

from __future__ import annotations

import atexit
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from models.errors import BadInput
from robot.device.elsewhere import Elsewhere
from robot.device.exchange_log import ExchangeLog
from robot.device.outcome import Incident, Reply, Stopped
from robot.device.port import PORT_ERRORS, READ_SLICE_S, Port, PortHeld
from robot.device.protocol import (
    BEAT_BODY,
    BEAT_S,
    MAX_FRAME_BYTES,
    STOP_BYTE,
    UNSOLICITED_SEQUENCE,
    LauncherStopped,
    LinkLost,
    Message,
    Reader,
    frame,
    interrupted_state,
    next_sequence,
    stroke_line,
)
from robot.device.settings import Clock, RealClock, Timing
from robot.device.signals import StopOnSignals

QUIET_BEFORE_RETRY_S = 0.02  # silence before a line is sent again [s], so that the rest of the last reply has passed
MAX_STOP_TRIES, STOP_WAIT_S = 10, 0.06  # most stop bytes until one is answered; wait after each


class Link:
    """A link to one launcher; `with Link(...)` opens it, and stops the launcher if the block raises an exception."""

    def __init__(
        self,
        open_port: Callable[[], Port],
        timing: Timing,
        *,
        baud: int,
        clock: Clock | None = None,
        log: Path | str | None = None,
        answers: bool = True,
    ) -> None:
        """Create a link that is not open yet.

        Args:
            open_port: opens the port, initially and after a disconnected cable.
            timing: time-outs and retries.
            baud: of the port [bit/s].
            clock: by default the machine's.
            log: file to which every exchange is appended as a line of JSON.
            answers: whether to answer other programs while it is open, as the holder of the port.
        """
        self._open_port, self.timing, self.clock, self._answers = open_port, timing, clock or RealClock(), answers
        self._byte_s = 10.0 / baud  # start bit, eight bits, stop bit
        self._turn = threading.RLock()  # held during an exchange
        self._swap = threading.RLock()  # held while the port changes; never while waiting for anything
        self._halted = threading.Event()
        self._port: Port | None = None
        self._reader = Reader("=", commands=False)
        self._sequence = UNSOLICITED_SEQUENCE
        self._notices = 0  # number of answers to stop bytes
        self._interrupted = ""  # state named by the last of them
        self._sent_at = 0.0  # time at which the last line was sent [s]
        self.elsewhere = Elsewhere(self.stop, lambda: self.exchange("STATUS", through_stop=True).body)
        self._overdue = 0  # late replies that may still arrive, to lines that were sent again
        self._signals = StopOnSignals(self.halt)
        self.incidents: list[Incident] = []
        self.exchanges = 0
        self._log = ExchangeLog(log, self.clock, self.note)

    def __enter__(self) -> Link:
        """Open, and make the signals that end a program stop the launcher."""
        self.open()
        self._signals.install()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Stop after any exception except bad input, which never reached the launcher; then close."""
        try:
            if error is not None and not isinstance(error, BadInput):
                stopped = self.stop()
                if isinstance(error, KeyboardInterrupt):
                    said = "was stopped, reset and home it" if stopped.confirmed else "did not confirm a stop: check it"
                    error.add_note(f"the launcher {said}")
        finally:
            self._signals.remove()
            self.close()

    def open(self) -> None:
        """Open the port and greet; BadInput if it cannot be opened, LinkLost if nothing answers."""
        with self._turn:
            if self._port is None:
                try:
                    port = self._open_port()
                    self._take(port)
                except PortHeld as error:
                    raise BadInput(f"the port cannot be opened: {error}") from None
                except (*PORT_ERRORS, ValueError) as error:
                    raise BadInput(
                        f"the port cannot be opened ({error}); plug the cable in, or correct [port]"
                    ) from None
                try:
                    self._log.open()
                except BadInput:
                    self._drop()
                    raise
                if self._answers:
                    self.elsewhere.open(port.name)
                atexit.register(self._at_exit)

    def greet(self) -> Reply:
        """Query the launcher's version, which also clears the last request of an earlier connection."""
        with self._turn:
            self._sequence = UNSOLICITED_SEQUENCE
            return self._exchange(UNSOLICITED_SEQUENCE, "VERSION", through_stop=True)

    def close(self) -> None:
        """Close the port; a moving launcher then stops on its own."""
        self.elsewhere.close()
        with self._turn, self._swap:
            self._drop()
            atexit.unregister(self._at_exit)
            self._log.close()

    def _at_exit(self) -> None:
        self.halt()  # the program ended without closing

    def exchange(self, body: str, *, through_stop: bool = False) -> Reply:
        """Send a request, and wait for the reply.

        Args:
            body: of the request.
            through_stop: whether it may be sent while the launcher is stopped; for queries, not for motions.

        Raises:
            LauncherStopped: a stop was sent, by any thread.
            LinkLost: no answer to any attempt.
        """
        with self._turn:
            self._sequence = next_sequence(self._sequence)
            return self._exchange(self._sequence, body, through_stop)

    def send_stroke(self, string: int) -> bool:
        """Write an 'NNNp', once; False if the port failed, so that it may have been sent or not."""
        with self._turn:
            self._check(through_stop=False)
            began, line, fault = self.clock.now(), stroke_line(string), ""
            try:
                self._clear(0.0)
                self._check(through_stop=False)
                self._send(line)
            except PORT_ERRORS as error:
                fault = str(error)
                self._broken(error)
            self._log.write("stroke", began, sent=line.decode(), error=fault)
            return not fault

    def halt(self) -> bool:
        """Send the stop byte now; safe in any thread and in a signal handler. False if it could not be written."""
        self._halted.set()
        with self._swap:
            try:
                if self._port is None:
                    return False  # it will be sent first when the port is open again
                self._port.cancel_read()
                self._port.reset_output_buffer()
                self._port.write(STOP_BYTE)
            except PORT_ERRORS:
                return False
        return True

    def stop(self) -> Stopped:
        """Stop the launcher, and repeat the byte until it is confirmed, ten times at most."""
        began, seen, sent = self.clock.now(), self._notices, 0
        self.note("stop", "stop sent")
        while sent < MAX_STOP_TRIES and self._notices == seen:
            self.halt()
            sent += 1
            until = self.clock.now() + STOP_WAIT_S + MAX_FRAME_BYTES * self._byte_s
            if self._turn.acquire(timeout=STOP_WAIT_S):  # the reading thread releases it as soon as it wakes
                try:
                    if self._port is None:
                        self._take(self._open_port())  # which sends the byte
                    while self._notices == seen and self.clock.now() < until:
                        self._listen()
                except PORT_ERRORS as error:
                    self._broken(error)
                    self.clock.sleep(STOP_WAIT_S)
                finally:
                    self._turn.release()
        confirmed = self._notices > seen
        report = Stopped(confirmed, sent, self.clock.now() - began, self._interrupted if confirmed else "")
        self._log.write("stop", began, confirmed=report.confirmed, bytes=sent)
        return report

    def release(self) -> None:
        """Allow motions again, once the launcher has confirmed a reset."""
        self.elsewhere.forget()
        self._halted.clear()

    def note(self, kind: str, detail: str) -> None:
        """Note an unusual event."""
        self.incidents.append(Incident(self.clock.now(), kind, detail))

    def _check(self, through_stop: bool) -> None:
        if self._halted.is_set() and not through_stop:
            by = self.elsewhere.stopped_by()
            raise LauncherStopped(f"the launcher was stopped{by and f' by {by}'}; check it, then reset and home it")

    def _exchange(self, sequence: int, body: str, through_stop: bool) -> Reply:
        line = frame(":", sequence, body)
        began = self.clock.now()
        patience = self.timing.reply_s + (len(line) + MAX_FRAME_BYTES) * self._byte_s
        self.exchanges += 1
        silent = 0
        for attempt in range(self.timing.retries + 1):
            self._check(through_stop)
            try:
                if self._port is None:
                    self._reopen()
                self._clear(QUIET_BEFORE_RETRY_S if attempt else 0.0)
                self._check(through_stop)
                sent_at = self.clock.now()
                self._send(line)
                got = self._await(sequence, sent_at + patience, through_stop)
            except PORT_ERRORS as error:
                self._broken(error)
                continue
            now = self.clock.now()
            if got is not None:
                usual = (len(line) + len(got) + 12) * self._byte_s + 0.4 * self.timing.reply_s
                if now - sent_at > usual:
                    self.note("slow", f"{body.split(' ')[0]} answered after {now - sent_at:.3f} s")
                if self._overdue:  # replies keep their order, so earlier ones will not arrive any more
                    self.note("lost", f"{self._overdue} earlier lines or their replies were lost")
                self._overdue = silent
                self._log.write("exchange", began, sequence=sequence, sent=body, reply=got, retries=attempt)
                return Reply(got, attempt, now - began)
            silent += 1
            self.note("silence", f"{body.split(' ')[0]} unanswered, attempt {attempt + 1}")
        self._log.write("exchange", began, sequence=sequence, sent=body, reply=None, retries=self.timing.retries)
        raise LinkLost(f"no answer to {body!r} in {self.timing.retries + 1} attempts; check the cable and the power")

    def _await(self, sequence: int, until: float, through_stop: bool) -> str | None:
        """Body of the reply with this number; None if it does not arrive in time."""
        while self.clock.now() < until:
            for got in self._listen():
                if got.sequence == sequence:
                    return got.body
                self._came_late(got)
            self._check(through_stop)
            self._beat()
        return None

    def _beat(self) -> None:
        """Send a beat to the launcher, if nothing was sent for a while."""
        if self.clock.now() - self._sent_at >= BEAT_S:
            self._send(frame(":", UNSOLICITED_SEQUENCE, BEAT_BODY))

    def _came_late(self, reply: Message) -> None:
        self._overdue = max(self._overdue - 1, 0)
        self.note("stale", f"a second reply to {reply.sequence:04X} came late")

    def _listen(self) -> list[Message]:
        """Frames that arrive within READ_SLICE_S; empty on a disconnected port."""
        if (port := self._port) is None:
            self.clock.sleep(READ_SLICE_S)
            return []
        data = port.read(1)
        waiting = port.in_waiting
        return self._sort(data + port.read(waiting) if waiting else data)

    def _sort(self, data: bytes) -> list[Message]:
        """The frames in these bytes; counts answers to a stop, and notes noise."""
        before = self._reader.dropped
        found = [a for a in self._reader.feed(data) if isinstance(a, Message)]
        if self._reader.dropped > before:
            self.note("junk", f"{self._reader.dropped - before} bytes discarded")
        states = [(f, interrupted_state(f)) for f in found]
        for state in (state for _, state in states if state is not None):
            self._notices, self._interrupted = self._notices + 1, state
            if not self._halted.is_set():
                self.elsewhere.noticed()
                self.note("stopped", "from elsewhere")
                self._halted.set()
        return [f for f, state in states if state is None]

    def _clear(self, quiet: float) -> None:
        """Discard and note late replies until the line has been quiet for a time [s]."""
        port, until = self._port, self.clock.now() + 0.2
        while port is not None and self.clock.now() < until:
            waiting = port.in_waiting
            data = port.read(waiting) if waiting else b""
            for late in self._sort(data):
                self._came_late(late)
            if data or quiet > 0:
                self._beat()
            if not data:
                if quiet <= 0:
                    break
                self.clock.sleep(quiet)
                quiet = 0.0 if not port.in_waiting else quiet
        if self._reader.waiting:
            self._reader.forget()
            self.note("junk", "half a reply discarded")

    def _send(self, data: bytes) -> None:
        if self._port is None:
            raise OSError("the port is closed")
        self._sent_at = self.clock.now()
        self._port.write(data)

    def _broken(self, error: Exception) -> None:
        self.note("cable", " ".join(str(error).split()) or type(error).__name__)
        with self._swap:
            self._drop()

    def _drop(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            try:
                port.close()
            except PORT_ERRORS as error:
                self.note("cable", f"closing: {error}")

    def _take(self, port: Port) -> None:
        """Use this port; a pending stop is sent first."""
        with self._swap:
            self._port = port
            self._reader.forget()
            if self._halted.is_set():
                port.write(STOP_BYTE)

    def _reopen(self) -> None:
        began = self.clock.now()
        while True:
            try:
                self._take(self._open_port())
            except PORT_ERRORS as error:
                with self._swap:
                    self._drop()
                if self.clock.now() - began >= self.timing.reconnect_s:
                    raise LinkLost(f"the cable is out ({error}); plug it in and connect again") from error
                self.clock.sleep(min(0.1, self.timing.reconnect_s))
            else:
                return self.note("cable", f"open again after {self.clock.now() - began:.1f} s")
