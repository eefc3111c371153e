"""What other programs do to a launcher whose port this one holds: they stop it, and ask about it.

In: what the launcher says of a stop that this program did not send, and other programs' questions (relay.py). Out: who
stopped it, and the answers. A stop's byte arrives before its sender has said who it is, and so that is waited for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from robot.device.outcome import Stopped
from robot.device.protocol import LauncherError
from robot.device.relay import STATUS, STOP, Relay

UNNAMED = "another program, or by noise"
NAME_WAIT_S = 0.5  # for which who wrote a stop byte may take to say so; the launcher stands meanwhile


class Elsewhere:
    """Other programs, for the link that holds a port."""

    def __init__(self, stop: Callable[[], Stopped], status: Callable[[], str]) -> None:
        """Nobody is heard yet; `stop` stops the launcher, `status` asks it (LauncherError)."""
        self._stop, self._status = stop, status
        self._relay: Relay | None = None
        self._named = threading.Event()
        self._unnamed = False
        self._by = ""
        self.doing = ""  # what is in progress, for others

    def open(self, device: str | None) -> None:
        """Answer those who ask about a port; an emulated line has none."""
        if self._relay is None and device:
            self._relay = Relay(device, self._answer)

    def close(self) -> None:
        """Answer no more; answers under way are given."""
        if self._relay is not None:
            self._relay.close()
            self._relay = None

    def noticed(self) -> None:
        """The launcher was stopped, and not by this program."""
        self._unnamed = True

    def forget(self) -> None:
        """It was reset."""
        self._unnamed, self._by = False, ""
        self._named.clear()

    def stopped_by(self) -> str:
        """Who stopped the launcher from elsewhere; empty where nobody did."""
        if self._unnamed and not self._by and self._relay is not None:
            self._named.wait(NAME_WAIT_S)
            self._named.set()  # waited for once
        return self._by or (UNNAMED if self._unnamed else "")

    def _answer(self, request: str, by: str) -> dict[str, Any]:
        """To another program: what was in progress, and the result."""
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
