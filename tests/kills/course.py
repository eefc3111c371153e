"""One command, killed at random moments until it ends by itself, and what was lost or left on the way.

In: a `Work` and a random generator. Out: a `Tally` of kills and of what is wrong, beside the same work undisturbed.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.kills.works import Work, films, in_session, lines_of, results, start

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGQUIT)
BEGUN_S = 0.5  # before which Python itself may not have begun
GONE_WITHIN_S, STOPS_WITHIN_S = 10.0, 60.0
ENDED = (0, 1)  # 1: a finding


@dataclass
class Tally:
    """Kills so far, by signal, and what was wrong."""

    kills: Counter[str] = field(default_factory=Counter)
    ended: int = 0  # courses that came to their end
    wrong: list[str] = field(default_factory=list)


class Course:
    """The folders of one command: one in which it is killed, one in which it is not."""

    def __init__(self, name: str, work: Work, place: Path) -> None:
        """Lay out the inputs, and time the command undisturbed."""
        self.name, self.work = name, work
        self.inputs, self.killed, self.whole = place / "inputs", place / "killed", place / "whole"
        self.inputs.mkdir(parents=True)
        if name == "track":
            films(self.inputs)
        self._expected: dict[str, dict[str, Any]] = {}
        begun = time.monotonic()
        self.expected(work)
        self.takes_s = time.monotonic() - begun  # undisturbed

    def expected(self, work: Work) -> dict[str, Any]:
        """What the command comes to undisturbed."""
        key = " ".join(work.words)
        if key not in self._expected:
            shutil.rmtree(self.whole, ignore_errors=True)
            shutil.copytree(self.inputs, self.whole)
            if start(work, self.whole).wait() not in ENDED:
                raise RuntimeError((self.whole / "said").read_text())
            self._expected[key] = results(self.whole / work.out)
        return self._expected[key]

    def kill(self, number: signal.Signals, after: float, tally: Tally) -> bool:
        """Begin or continue, and signal after some seconds; whether the command had ended before."""
        before = self.work.finished(self.killed / self.work.out)
        process = start(self.work, self.killed)
        time.sleep(after)
        if process.poll() is not None:
            if process.returncode not in ENDED:
                tally.wrong.append(f"status {process.returncode}: {(self.killed / 'said').read_text()[-300:]}")
            return True
        tally.kills[number.name] += 1
        process.send_signal(number)
        try:
            status = process.wait(timeout=STOPS_WITHIN_S)
        except subprocess.TimeoutExpired:
            tally.wrong.append(f"not stopped {STOPS_WITHIN_S:.0f} s after {number.name}")
            process.kill()
            status = process.wait()
        else:
            if status not in (-number, 128 + number, *ENDED):
                tally.wrong.append(f"status {status} after {number.name}")
        end = time.monotonic() + GONE_WITHIN_S
        while (left := in_session(process.pid)) and time.monotonic() < end:
            time.sleep(0.1)
        if left:
            tally.wrong.append(f"{len(left)} processes live on after {number.name}")
        now = self.work.finished(self.killed / self.work.out)
        if now < before:
            tally.wrong.append(f"{before} parts were finished, {now} are after {number.name}")
        return status in ENDED

    def run(self, kills: int, rng: np.random.Generator, tally: Tally, signals: Sequence[signal.Signals]) -> None:
        """Kill the command so often at most, or until it ends; then let it end, and compare with the undisturbed."""
        shutil.rmtree(self.killed, ignore_errors=True)
        shutil.copytree(self.inputs, self.killed)
        found = list(tally.wrong)
        for k in range(kills):
            if self.kill(signals[k % len(signals)], float(rng.uniform(BEGUN_S, self.takes_s)), tally):
                break
        if b"Traceback" in (self.killed / "said").read_bytes():
            tally.wrong.append("traceback")
        out, work = self.killed / self.work.out, self.work
        if self.name == "campaign":  # every run plays so many more: the same number of shots then
            count = str(max(lines_of(out) - 1, 1))
            work = Work((*work.words[:-1], count), work.out, work.finished)
        elif start(work, self.killed).wait() not in ENDED:
            tally.wrong.append((self.killed / "said").read_text()[-300:])
        if out.exists() and results(out) != self.expected(work):
            tally.wrong.append("other results than undisturbed")
        tally.ended += found == tally.wrong
