"""Requests by other programs to a launcher whose port this one holds: stops and questions.

In: the launcher's report of a stop that this program did not send, and other programs' questions (relay.py). Out: who
stopped it, and the answers. A stop's byte arrives before its sender's name, so this waits for the name.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from robot.device.outcome import Stopped
from robot.device.protocol import LauncherError
from robot.device.relay import STATUS, STOP, Relay

UNKNOWN_SENDER = "another program, or by noise"
NAME_WAIT_S = 0.5  # longest wait for the name of a stop's sender; the launcher is stopped meanwhile


class Elsewhere:
    """Communication with other programs, for the link that holds a port."""

    def __init__(self, stop: Callable[[], Stopped], status: Callable[[], str]) -> None:
        """Start without a request; `stop` stops the launcher, `status` queries it (may raise LauncherError)."""
        self._stop, self._status = stop, status
        self._relay: Relay | None = None
        self._named = threading.Event()
        self._unnamed = False
        self._by = ""
        self.doing = ""  # the command in progress, for others

    def open(self, device: str | None) -> None:
        """Start answering questions about a port; an emulated line has none."""
        if self._relay is None and device:
            self._relay = Relay(device, self._answer)

    def close(self) -> None:
        """Stop answering; answers in progress are completed."""
        if self._relay is not None:
            self._relay.close()
            self._relay = None

    def noticed(self) -> None:
        """Record that the launcher was stopped by another program."""
        self._unnamed = True

    def forget(self) -> None:
        """Record that the launcher was reset."""
        self._unnamed, self._by = False, ""
        self._named.clear()

    def stopped_by(self) -> str:
        """The program that stopped the launcher; empty if none did."""
        if self._unnamed and not self._by and self._relay is not None:
            self._named.wait(NAME_WAIT_S)
            self._named.set()  # wait only once
        return self._by or (UNKNOWN_SENDER if self._unnamed else "")

    def _answer(self, request: str, by: str) -> dict[str, Any]:
        """The answer to another program: the command in progress, and the result."""
        doing = self.doing
        if request == STOP:
            self._by = by
            self._named.set()
            return {"doing": doing, **asdict(self._stop())}
        if request == STATUS:
            try:
                return {"doing": doing, "status": self._status()}
            except LauncherError as error:
                return {"doing": doing, "error": str(error)}
        return {"doing": doing}
