"""One changed command in a process of its own, and what is wrong with how it ended.

A process is forked from one that has imported everything. What counts as a defect: a traceback, a status that no
command has, an end by a signal, a hang, too much memory, more on standard error than lines of ours, a line too long or
unprintable, a file that nobody asked for, an input that was changed.
"""

from __future__ import annotations

import importlib
import os
import re
import resource
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from models.files.limits import MAX_PICTURE_PIXELS
from models.workers import threads
from tests.fuzz.verbs import SEEDS, Command, program_of

LIMIT_S, LIMIT_WAITING_S = 60.0, 300.0  # of processor time; of the clock, since other work may have the processor
LIMIT_MEMORY_KB = 2 << 20
LIMIT_ADDRESS_SPACE = 24 << 30  # so that what would fill the memory ends before it does
MAX_LINE_CHARS = 620
STATUSES = (0, 1, 2)
PROGRESS = re.compile(r"^ *\d+ s  ")
OWN_LINE = re.compile(r"^(sysid|planner|robot)( [a-z-]+)?: |^warning: ")
TRACEBACK_STATUS = 99
MODULES = (
    "matplotlib.backends.backend_agg", "planner.planning", "planner.cli", "robot.cueing.map_fit", "robot.play",
    "robot.cli", "sysid.prepare", "sysid.residuals.compare", "sysid.selection.diagnose",
    "sysid.vision.tracks.track", "sysid.cli",
)  # fmt: skip


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int  # minus the signal, where one ended it
    out: str
    err: str
    memory_kb: int
    strays: tuple[str, ...]  # files that nobody asked for, or that were changed

    @property
    def defect(self) -> str:
        """What is wrong; "" for nothing."""
        lines = [line for line in self.err.splitlines() if line.strip() and not PROGRESS.match(line)]
        long = [line for line in lines if len(line) > MAX_LINE_CHARS or not line.isprintable()]
        foreign = [line for line in lines if not OWN_LINE.match(line)]
        if self.status == TRACEBACK_STATUS or "Traceback" in self.err:
            frames = [line.strip() for line in lines if line.lstrip().startswith("File ")]
            return f"traceback: {lines[-1][:150] if lines else ''} | {frames[-1] if frames else ''}"
        if self.status in (-signal.SIGALRM, -signal.SIGPROF):
            return "hang"
        if self.status not in STATUSES:
            return f"status {self.status}"
        if self.memory_kb > LIMIT_MEMORY_KB:
            return f"memory {self.memory_kb >> 10} MB"
        if long:
            return f"line too long or unprintable: {long[0][:40]!a}"
        if foreign:
            return f"foreign line: {foreign[0][:80]!a}"
        if self.status == 2 and not lines and not self.out:
            return "no message"
        return f"stray file: {', '.join(self.strays[:3])}" if self.strays else ""


def prepare() -> None:
    """Import and compile what the commands need, so that a fork begins at once."""
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PICTURE_PIXELS))  # OpenCV reads it once
    import cv2

    import sysid.prepare

    for name in MODULES:
        importlib.import_module(name)
    cv2.setNumThreads(1)
    sysid.prepare.prepare()
    threads._pool.cache_clear()  # threads do not survive a fork
    threads._cores.cache_clear()


def tried(command: Command, folder: Path) -> Ended:
    """Run a command in `folder`, which is filled anew."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(SEEDS, folder / "in")
    for name, content in command.files.items():
        (folder / "in" / name).write_bytes(content)
    before = _contents(folder / "in")
    own = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() // 1024  # a fork begins with it
    child = os.fork()
    if child == 0:
        _run(command, folder)
    _, code, used = os.wait4(child, 0)
    out, err = ((folder / name).read_bytes().decode("utf-8", "replace") for name in ("stdout", "stderr"))
    after = _contents(folder / "in")
    changed = {name for name in before | after if before.get(name) != after.get(name)}
    status = os.waitstatus_to_exitcode(code)
    allowed = ("out", *(command.verb.writes if status != 2 else ()))
    if command.words != tuple(command.verb.words):  # options were changed as well: any of them may name a file
        allowed = (*allowed, "")
    if command.verb.draws:
        changed = {name for name in changed if not name.endswith(".png")}
    strays = tuple(sorted(name for name in changed if status == 2 or not name.startswith(allowed)))
    return Ended(status, out, err, max(used.ru_maxrss - own, 0), strays)


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def _run(command: Command, folder: Path) -> None:
    """The child: never returns."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (LIMIT_ADDRESS_SPACE, LIMIT_ADDRESS_SPACE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
        signal.setitimer(signal.ITIMER_REAL, LIMIT_WAITING_S)

    names = ("/dev/null", str(folder / "stdout"), str(folder / "stderr"))
    streams = [os.open(name, os.O_RDWR | os.O_CREAT, 0o644) for name in names]
    become(command.words, folder / "in", streams, limit)


def become(words: Sequence[str], folder: Path, streams: Sequence[int], limit: Callable[[], None]) -> NoReturn:
    """Make this forked process a command in a folder, with these standard streams, and end with its status.

    Args:
        words: program and arguments.
        folder: in which it runs.
        streams: descriptors for input, output and errors.
        limit: sets its limits, just before it begins.
    """
    status = TRACEBACK_STATUS
    try:
        if hasattr(os, "sched_setaffinity"):  # one thread: others are left to whoever works here
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        for number, to in enumerate(streams):
            os.dup2(to, number)
        sys.stdin, sys.stdout, sys.stderr = (os.fdopen(k, mode) for k, mode in enumerate("rww"))
        os.chdir(folder)
        limit()
        main: Any = program_of(words[0])
        sys.argv = list(words)
        status = main()
    except BaseException:  # noqa: BLE001 (whatever it is, it is what we look for)
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError):
                status = TRACEBACK_STATUS
        os._exit(status)
