"""Service of a port's holder for other programs: a stop, the launcher's status, its own name.

In: the port's name, and a function that answers requests. Out: a local socket, named after the port, that exists as
long as the link; one JSON object answers each line. Other programs use `ask`, which returns None if nothing holds the
port.

A stop never depends on it: `robot stop` first writes its byte to the port (robot/device/past_lock.py). But two readers
of one port take each other's bytes, so the holder is asked to read the answer. Sockets are in Linux's abstract
namespace, which leaves no files; on other systems no holder is found, and the stop reads the answer itself.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import struct
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

STOP, STATUS, WHO = "stop", "status", "who"
MAX_BYTES = 4096  # longest request or answer
Answer = Callable[[str, str], dict[str, Any]]  # (request, name of the asking program) -> answer


@dataclass(frozen=True)
class Holder:
    """The program that holds a port, and its answer."""

    process: int
    title: str  # beginning of its command line
    answer: dict[str, Any] | None = field(default=None)  # None: it did not answer in time

    def __str__(self) -> str:
        """For a message."""
        return f"{self.title} (process {self.process})"


def _names(device: str) -> list[bytes]:
    """Addresses of a port: by its name, and by the device that it links to."""
    if sys.platform != "linux":
        return []
    paths = dict.fromkeys((os.path.abspath(device), os.path.realpath(device)))
    return [b"\0cuelab-launcher:" + path.encode()[-80:] for path in paths]


class Relay:
    """Answers other programs while a port is held."""

    def __init__(self, device: str, answer: Answer) -> None:
        """Start listening, in its own threads."""
        self._answer = answer
        self._serving: list[threading.Thread] = []
        self._woken, self._wake = socket.socketpair()
        self._listening = []
        for name in _names(device):
            listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                listening.bind(name)
                listening.listen(8)
            except OSError:  # belongs to another program, for a terminal that had this number before
                listening.close()
            else:
                self._listening.append(listening)
        self._thread = threading.Thread(target=self._accept, name="relay", daemon=True)
        self._thread.start()

    def close(self, wait_s: float = 2.0) -> None:
        """Stop listening and free the names; pending questions are answered."""
        self._wake.send(b"x")
        self._thread.join(wait_s)
        for thread in self._serving:
            thread.join(wait_s)
        for end in (*self._listening, self._woken, self._wake):
            end.close()

    def _accept(self) -> None:
        while True:
            ready, _, _ = select.select([*self._listening, self._woken], [], [])
            for end in ready:
                if end is not self._woken:
                    thread = threading.Thread(target=self._serve, args=(end.accept()[0],), name="relay", daemon=True)
                    thread.start()
                    self._serving = [t for t in self._serving if t.is_alive()] + [thread]
            if ready == [self._woken]:
                return

    def _serve(self, connection: socket.socket) -> None:
        with connection, contextlib.suppress(OSError):
            connection.settimeout(1.0)
            request, _, by = _line(connection).partition(" ")
            connection.sendall(json.dumps(self._answer(request, by)).encode() + b"\n")


@dataclass(frozen=True)
class Asked:
    """A pending question to the holder of a port."""

    process: int
    title: str
    _connection: socket.socket

    def answered(self, timeout_s: float) -> Holder:
        """The holder, with its answer if that comes in time."""
        with self._connection:
            self._connection.settimeout(timeout_s)
            try:
                answer = json.loads(_line(self._connection))
            except (OSError, ValueError):  # it hangs, or ends
                answer = None
        return Holder(self.process, self.title, answer if isinstance(answer, dict) else None)


def begin(device: str, request: str, by: str) -> Asked | None:
    """Ask the holder of a port without waiting; None if no program answers to this name."""
    for name in _names(device):
        asking = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            asking.setblocking(False)  # a holder with too many pending questions counts as hung
            asking.connect(name)
            process = struct.unpack("3i", asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))[0]
            asking.sendall(f"{request} {by}\n".encode())
        except OSError:
            asking.close()
            continue
        return Asked(process, _title(process), asking)
    return None


def ask(device: str, request: str, by: str, timeout_s: float) -> Holder | None:
    """Ask the holder of a port, and wait for the answer; None if there is no holder."""
    asked = begin(device, request, by)
    return None if asked is None else asked.answered(timeout_s)


def _line(connection: socket.socket) -> str:
    """A line from the other end; OSError if it takes too long."""
    data = b""
    while not data.endswith(b"\n") and len(data) < MAX_BYTES and (more := connection.recv(MAX_BYTES)):
        data += more
    return data.decode(errors="replace").strip()


def this_program() -> str:
    """This process's name for other programs."""
    return str(Holder(os.getpid(), _title(os.getpid())))


def _title(process: int) -> str:
    """The first words of a process's command line, without the interpreter and paths."""
    try:
        words = [w for w in Path(f"/proc/{process}/cmdline").read_text(errors="replace").split("\0") if w]
    except OSError:
        return "a program"
    if words and Path(words[0]).name.startswith("python"):
        words = [w for w in words[1:] if w != "-m"]
    if not words or words[0].startswith("-"):
        return "a Python program"
    return " ".join([Path(words[0]).name.replace("robot.cli", "robot"), *words[1:2]])
