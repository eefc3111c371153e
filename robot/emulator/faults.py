"""Faults of the line and of the launcher, injected on request: how often, which, and from which seed.

In: a rate, the kinds of fault, random numbers. Out: what is left of each line, and `done`, the list of injected faults,
with which a test checks that all were noticed. A line sent to the launcher suffers a fault with probability `rate`,
drawn among those that apply to it. Faults of the reply wait for the next reply. Leaves out bursts: one fault a line, as
a marginal cable gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from robot.device.protocol import BEAT

REQUEST_FAULTS = ("silent-up", "garbage-up", "dropped-up", "flipped-up")  # to the launcher
REPLY_FAULTS = ("silent-down", "garbage-down", "partial-down", "dropped-down", "flipped-down", "slow")  # its reply
DEVICE_FAULTS = ("restart", "stuck", "pulled")
FAULT_KINDS = REQUEST_FAULTS + REPLY_FAULTS + DEVICE_FAULTS
REPLY_DELAY_S = (0.12, 0.8)  # delay of a reply
CABLE_OUT_S = (0.05, 1.0)  # time for which a cable stays out
RESTART_DELAY_S = (0.0, 0.6)  # after the line, so that it may come in mid-stroke


@dataclass(frozen=True)
class Fault:
    """A fault that was injected."""

    time: float  # [s]
    kind: str
    line: bytes  # to which it was done


@dataclass(frozen=True)
class Spoiled:
    """What is left of a line, and what else happens."""

    data: bytes
    delay: float = 0.0  # [s]
    restart: float | None = None  # of the launcher, after that time [s]
    stuck: bool = False
    out: float = 0.0  # time for which the cable is out, from now [s]


class FaultInjection:
    """Draws faults; with `rate` 0 there are none, until one is asked for by `force`."""

    def __init__(self, rate: float, rng: np.random.Generator, kinds: Sequence[str] = FAULT_KINDS) -> None:
        """A rate a line, 0 to 1, and the kinds that may come."""
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
        """The next lines suffer these, in this order, each the first line that it possible befall."""
        self._forced.extend(kinds)

    def request(self, now: float, line: bytes) -> Spoiled:
        """A line on its way to the launcher."""
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
        """A line on its way back."""
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
        answered = framed and line[6:11] != BEAT.encode()
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
