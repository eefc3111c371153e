"""Checks and execution of a task in a worker.

In: an order, a function of this package and its arguments. Out: the function's result, or `BadInput` if this process
would compute something else: with other sources, other versions, or other effects of the user.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import pickle
import platform
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from models.errors import BadInput
from models.interrupts import go_on
from models.workers.threads import on_one_thread

PACKAGES = ("models", "sysid", "planner", "robot")
SOURCE_SUFFIXES = (".py", ".xml", ".toml")
COMPUTING_LIBRARIES = ("numpy", "scipy", "numba", "mujoco", "opencv-python-headless")  # on which figures depend


@cache
def source_stamp() -> dict[str, str]:
    """The dependences of figures, by name: a digest of the sources, and the versions of Python and libraries."""
    root, seen = Path(__file__).resolve().parents[2], hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            if path.suffix in SOURCE_SUFFIXES:
                seen.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    found = {"cuelab": seen.hexdigest()[:12], "Python": ".".join(platform.python_version_tuple()[:2])}
    for name in COMPUTING_LIBRARIES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def processor() -> str:
    """The processor for which code is compiled here."""
    from llvmlite import binding

    return str(binding.get_host_cpu_name())


_report: ContextVar[Callable[[str], None] | None] = ContextVar("report", default=None)


@contextlib.contextmanager
def reporting_to(listener: Callable[[str], None]) -> Iterator[None]:
    """Within this context reported lines go to a listener."""
    token = _report.set(listener)
    try:
        yield
    finally:
        _report.reset(token)


def report(line: str) -> None:
    """Report a worker's current step; raises `Abandoned` if its work is no longer needed."""
    go_on()
    if (listener := _report.get()) is not None:
        listener(line)


def difference(here: dict[str, str], there: dict[str, str]) -> str:
    """The first difference between two stamps in words; "" if they are equal."""
    for name, value in here.items():
        if there.get(name) != value:
            return f"{name} is {there.get(name, 'absent')} there and {value} here; install the same on both"
    return ""


@dataclass(frozen=True)
class Requirements:
    """The conditions that a worker checks before it computes."""

    stamp: dict[str, str] = field(default_factory=dict)  # of the sources; empty on the same machine
    folders: tuple[str, ...] = ()  # with the user's effects
    effects: str = ""  # a digest of these

    def check(self) -> None:
        """Add the user's effects to the catalogue; BadInput if anything differs."""
        from models.effect_catalogue import add_folder

        if self.stamp and (text := difference(self.stamp, source_stamp())):
            raise BadInput(f"worker on {platform.node()}: {text}")
        for folder in self.folders:
            try:
                add_folder(folder)
            except BadInput as error:
                raise BadInput(f"worker on {platform.node()}: {error}") from None
        if self.folders and self.effects != effects_digest():
            raise BadInput(
                f"worker on {platform.node()}: {', '.join(self.folders)} holds different effects there; "
                "copy them, or share the folder"
            )


def effects_digest() -> str:
    """A digest of the user's effects in the catalogue."""
    from models.effect_catalogue import own_texts

    return hashlib.sha256(b"\0".join(own_texts())).hexdigest()[:12]


def perform(order: Requirements, packed: bytes) -> Any:
    """Check the order, then call the function; effects must be known before arguments are unpickled."""
    order.check()
    with on_one_thread():
        function, arguments = pickle.loads(packed)
        return function(*arguments)
