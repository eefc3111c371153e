"""Injection of faults of the line and of the launcher, with a rate, kinds, and a seed.

In: a rate, the kinds of fault, random numbers. Out: each line after its fault, and `done`, the list of injected faults,
with which a test checks that all were noticed. A line to the launcher gets a fault with probability `rate`, drawn among
the applicable ones. Faults of a reply apply to the next reply. Left out: bursts; a line gets one fault, as with a
marginal cable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from robot.device.protocol import BEAT_BODY

REQUEST_FAULTS = ("silent-up", "garbage-up", "dropped-up", "flipped-up")  # to the launcher
REPLY_FAULTS = ("silent-down", "garbage-down", "partial-down", "dropped-down", "flipped-down", "slow")  # its reply
DEVICE_FAULTS = ("restart", "stuck", "pulled")
FAULT_KINDS = REQUEST_FAULTS + REPLY_FAULTS + DEVICE_FAULTS
REPLY_DELAY_S = (0.12, 0.8)  # delay of a reply
CABLE_OUT_S = (0.05, 1.0)  # duration of a disconnection
RESTART_DELAY_S = (0.0, 0.6)  # delay after the line, so that it may occur during a stroke


@dataclass(frozen=True)
class Fault:
    """An injected fault."""

    time: float  # [s]
    kind: str
    line: bytes  # the affected line


@dataclass(frozen=True)
class Spoiled:
    """A line after its fault, and further consequences."""

    data: bytes
    delay: float = 0.0  # [s]
    restart: float | None = None  # delay of a restart of the launcher [s]
    stuck: bool = False
    out: float = 0.0  # duration of a disconnection, from now [s]


class FaultInjection:
    """Draws faults; with `rate` 0 there are none, except those requested by `force`."""

    def __init__(self, rate: float, rng: np.random.Generator, kinds: Sequence[str] = FAULT_KINDS) -> None:
        """Set the rate per line, 0 to 1, and the possible kinds."""
        if not 0 <= rate <= 1:
            raise BadInput(f"rate of faults is {rate}; give 0 to 1")
        for kind in kinds:
            if kind not in FAULT_KINDS:
                raise BadInput(f"unknown fault {kind!r}; choose from {', '.join(FAULT_KINDS)}")
        self._rate, self._rng, self._kinds = rate, rng, tuple(kinds)
        self._forced: list[str] = []
        self._reply: str | None = None
        self.done: list[Fault] = []

    def force(self, *kinds: str) -> None:
        """Apply these faults in order, each to the next line to which it can apply."""
        self._forced.extend(kinds)

    def request(self, now: float, line: bytes) -> Spoiled:
        """Process a line to the launcher."""
        self._reply = None
        kind = self._draw(line)
        if kind is None:
            return Spoiled(line)
        self.done.append(Fault(now, kind, line))
        if kind in REPLY_FAULTS:
            self._reply = kind
            return Spoiled(line)
        if kind == "restart":
            return Spoiled(line, restart=self._rng.uniform(*RESTART_DELAY_S))
        if kind == "stuck":
            return Spoiled(line, stuck=True)
        if kind == "pulled":
            return Spoiled(b"", out=self._rng.uniform(*CABLE_OUT_S))
        return Spoiled(self._spoil(kind, line))

    def reply(self, line: bytes) -> Spoiled:
        """Process a line from the launcher."""
        kind, self._reply = self._reply, None
        if kind is None or not line:
            return Spoiled(line)
        return (
            Spoiled(line, delay=self._rng.uniform(*REPLY_DELAY_S))
            if kind == "slow"
            else Spoiled(self._spoil(kind, line))
        )

    def _draw(self, line: bytes) -> str | None:
        framed = line.startswith(b":")
        answered = framed and line[6:11] != BEAT_BODY.encode()
        moves = framed and line[6:10] in (b"MOVE", b"HOME")
        possible = [
            k
            for k in FAULT_KINDS
            if k in REQUEST_FAULTS or k in ("restart", "pulled") or (k in REPLY_FAULTS and answered) or moves
        ]
        if self._forced:
            return self._forced.pop(0) if self._forced[0] in possible else None
        possible = [k for k in possible if k in self._kinds]
        if not possible or not self._rng.random() < self._rate:
            return None
        return str(self._rng.choice(possible))

    def _spoil(self, kind: str, line: bytes) -> bytes:
        rng, what = self._rng, kind.split("-")[0]
        k = int(rng.integers(len(line)))
        if what == "silent":
            return b""
        if what == "partial":
            return line[:k]
        if what == "dropped":
            return line[:k] + line[k + 1 :]
        if what == "flipped":
            return line[:k] + bytes([line[k] ^ 1 << int(rng.integers(8))]) + line[k + 1 :]
        noise = rng.integers(256, size=int(rng.integers(1, 20)), dtype=np.uint8).tobytes()
        return line[:k] + noise + line[k:]
