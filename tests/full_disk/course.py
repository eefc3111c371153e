"""One command on disks of different room, and what is wrong with how it ended.

A process is forked from one that has imported everything (tests/fuzz/trial.py). Wrong are: a hang, a traceback, another
status than that of bad input where it failed, a line that is not ours, no line that names a place and the remedy, a
file that is not whole, a file that the undisturbed command does not leave; and, once there is room again, that the same
command does not end as if nothing had been.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from tests.full_disk.disk import disk, leave_room, limit_files, used
from tests.full_disk.known import keep_results
from tests.full_disk.whole import broken
from tests.full_disk.works import NOTED
from tests.fuzz import trial
from tests.fuzz.verbs import SEEDS

LIMIT_S = 120
REMEDY = re.compile(r": (.+) (cannot be (written|made)|not written)|no room for temporary files")
KEPT = {"unfinished.jsonl"}  # what an undisturbed command takes away in the end
ROOM_BEYOND = 1.15  # of what a command leaves, up to which rooms are drawn: it needs more on the way
AGAIN_EVERY = 5  # points after which the command is given again, with room


@dataclass
class Tally:
    """Points so far, and what was wrong at them."""

    ended: Counter[int] = field(default_factory=Counter)  # by exit status
    wrong: list[str] = field(default_factory=list)


class NotHere(Exception):
    """A command that does not run on this machine, undisturbed as it is: a picture without a driver to draw it."""


def prepare() -> None:
    """Import what the commands need, so that a fork begins at once."""
    trial.prepare()
    import rerun
    import rerun.blueprint  # noqa: F401


class Course:
    """A command in a folder of its own."""

    def __init__(self, line: str, place: Path, *, mounted: bool) -> None:
        """Run the command undisturbed, once."""
        self.words, self.place, self.mounted, self._said = line.split(), place, mounted, ""
        shutil.rmtree(place, ignore_errors=True)
        (place / "known").mkdir(parents=True)
        keep_results(place / "known")
        with self._disk() as folder:
            before = used(folder) if mounted else 0
            self.status = self._run(folder)
            if self.status not in (0, 1):
                raise NotHere(" ".join(self._said[-300:].split()))
            left = files(folder)
            self.room = used(folder) - before if mounted else 0
            self.largest = max((len(content) for content in left.values()), default=1)
            self.names = set(left)

    def _disk(self) -> _Filled:
        return _Filled(self.place / "disk", self.mounted)

    def points(self, count: int, rng: np.random.Generator, tally: Tally, say: Callable[[str], None] = print) -> None:
        """Try the command at so many random points: rooms of the disk, and sizes of files."""
        for number in range(count):
            again = number % AGAIN_EVERY == 0
            if self.mounted and number % 2 == 0:
                self.point(int(rng.integers(0, int(ROOM_BEYOND * self.room) + 1)), None, again, tally, say)
            else:
                self.point(None, int(rng.integers(0, self.largest)), again, tally, say)

    def point(
        self, room: int | None, largest: int | None, again: bool, tally: Tally, say: Callable[[str], None]
    ) -> None:
        """Try it with so much room [bytes], or files of that size at most."""
        with self._disk() as folder:
            before = files(folder)
            if room is not None:
                leave_room(folder, room)
            status = self._run(folder, largest)
            tally.ended[status] += 1
            after = files(folder)
            wrong = self._wrong(status, before, after, folder)
            if room is not None:
                leave_room(folder, None)
            if again and not wrong and status == 2:
                status = self._run(folder)
                if status != self.status or set(files(folder)) != self.names:
                    odd = set(files(folder)) ^ self.names
                    wrong = [f"with room again: status {status}, {sorted(odd)}: {self._said[-300:]}"]
            for text in wrong:
                tally.wrong.append(text)
                say(f"{' '.join(self.words[:2])}, room {room}, largest file {largest}: {text}")

    def _wrong(self, status: int, before: dict[str, bytes], after: dict[str, bytes], folder: Path) -> list[str]:
        """What is wrong after a command that had too little room."""
        said = self._said
        lines = [line for line in said.splitlines() if line.strip() and not trial.PROGRESS.match(line)]
        if status == -signal.SIGALRM:
            return [f"hang; {said[-300:]}"]
        if status == trial.TRACEBACK_STATUS or "Traceback" in said:
            return [f"traceback: {' | '.join(lines[-3:])}"]
        wrong = [f"foreign line: {line[:200]}" for line in lines if not trial.OWN_LINE.match(line)]
        noted = " ".join(self.words[:2]) in NOTED
        if status not in (self.status, 2, *([1] if noted else [])):
            wrong.append(f"status {status}")
        if status == 2 and not any(REMEDY.search(line) for line in lines):
            wrong.append(f"no place or no remedy: {lines}")
        changed = {name for name in after if before.get(name) != after[name]}
        wrong += [f"{name}: {what}" for name in sorted(changed) if (what := broken(folder / name))]
        stray = {name for name in changed - self.names if Path(name).name not in KEPT}
        wrong += [f"{name}: stays behind" for name in sorted(stray)]
        return wrong

    def _run(self, folder: Path, largest: int | None = None) -> int:
        """The exit status of the command; minus a signal's number."""
        reads, writes = os.pipe()  # no file: its size is not limited
        child = os.fork()
        if child == 0:
            self._become(folder, writes, largest)
        os.close(writes)
        with os.fdopen(reads, "rb") as said:
            self._said = said.read().decode(errors="replace")
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

    def _become(self, folder: Path, errors: int, largest: int | None) -> NoReturn:
        """The child."""

        def limit() -> None:
            signal.alarm(LIMIT_S)
            if largest is not None:
                limit_files(largest)

        nowhere = os.open(os.devnull, os.O_RDWR)
        trial.become(self.words, folder, (nowhere, nowhere, errors), limit)


class _Filled:
    """A disk that holds the inputs and an empty folder `out`, while it is entered."""

    def __init__(self, folder: Path, mounted: bool) -> None:
        self.folder, self._disk = folder, disk(folder, mounted=mounted)

    def __enter__(self) -> Path:
        self._disk.__enter__()
        shutil.copytree(SEEDS, self.folder, dirs_exist_ok=True)
        (self.folder / "out").mkdir()
        return self.folder

    def __exit__(self, *error: object) -> None:
        self._disk.__exit__(*error)
        shutil.rmtree(self.folder, ignore_errors=True)


def files(folder: Path) -> dict[str, bytes]:
    """Content of all files below a folder, by relative path."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
