"""Kills at random moments: finished work stays, no process does, and the same command ends as if nothing had been.

Each command runs on tiny inputs in a session of its own, gets a signal after a random time, and is then given again
until it ends by itself.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
GONE_WITHIN_S = 10.0
WITHOUT_TIMES = ("elapsed_s", "seconds")
TOLD_BY_TIME = (".played.json", "fit.json", "clips/clips.toml")  # files that hold moments and durations throughout
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc"),
]


@dataclass(frozen=True)
class Work:
    """A command that continues, in its folder."""

    words: tuple[str, ...]
    out: str  # what it fills
    finished: Callable[[Path], int]  # parts of it that are finished
    longest_s: float  # after which it is killed


def lines_of(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.exists() else 0


def discovered(out: Path) -> int:
    return 10**6 if (out / "result.json").exists() else lines_of(out / "unfinished.jsonl")


def videos_of(out: Path) -> int:
    return (out / "clips.toml").read_text().count("[[videos]]") if (out / "clips.toml").exists() else 0


WORKS = {
    "discover": Work(("sysid", "discover", str(ROOT / "sysid" / "example"), "--out", "out"), "out", discovered, 12.0),
    "campaign": Work(("robot", "campaign", "out.csv", "--most", "60"), "out.csv", lines_of, 6.0),
    "study": Work(("planner", "study", "--out", "out", "--scenes", "2", "--jobs", "2"), "out",
                  lambda out: len(list(out.glob("scenes/*.json"))), 25.0),
    "learn": Work(("robot", "learn", "--out", "out", "--shots", "5", "--every", "4", "--repeats", "3"), "out",
                  lambda out: len(list(out.glob("shots/*.played.json"))), 40.0),
    "track": Work(("sysid", "track", "one.mkv", "two.mkv", "--camera", "camera.toml", "--out", "out"), "out",
                  videos_of, 15.0),
}  # fmt: skip


def start(work: Work, folder: Path) -> subprocess.Popen[bytes]:
    program, *words = work.words
    with (folder / "said").open("ab") as said:
        return subprocess.Popen(
            [sys.executable, "-m", f"{program}.cli", *words], cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True,
        )  # fmt: skip


def in_session(leader: int) -> list[int]:
    """Living processes of a session."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, session = path.read_text().rsplit(")", 1)[1].split()[:4]
        except OSError:
            continue
        if int(session) == leader and state != "Z":
            found.append(int(path.parent.name))
    return found


def films(folder: Path) -> None:
    """Two films of two short shots each, and the camera."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    sizes = ["--length", "1.881", "--width", "0.943", "--diameter", "0.0615"]

    def run(*words: str) -> None:
        command = [sys.executable, "-m", *words]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False)
        assert done.returncode in (0, 1), done.stderr.decode()  # 1: a camera that is not to be trusted, of few frames

    for number, name in enumerate(("one", "two")):
        run("tests.truth", name, "--clips", "2", "--seconds", "1.0", "--fps", "60", "--kind", "roll", "--no-pockets",
            "--seed", str(number), *sizes)  # fmt: skip
        run("tests.footage", name, f"{name}.mkv")
    run("sysid.cli", "calibrate", "one.mkv", *sizes, "--no-pockets", "--out", "camera.toml")


def plain(data: Any) -> Any:
    """JSON without what tells the time."""
    if isinstance(data, dict):
        return {key: plain(value) for key, value in data.items() if key not in WITHOUT_TIMES}
    return [plain(value) for value in data] if isinstance(data, list) else data


def results(place: Path) -> dict[str, Any]:
    """What a command came to, without what tells the time or draws."""
    found: dict[str, Any] = {}
    for path in [place] if place.is_file() else sorted(place.rglob("*")):
        if str(path).endswith(TOLD_BY_TIME):
            continue
        if path.suffix == ".json":
            found[path.name] = plain(json.loads(path.read_text()))
        elif path.suffix in (".csv", ".toml"):
            found[path.name] = path.read_bytes()
    return found


@pytest.mark.parametrize("name", WORKS)
def test_kills_at_random_moments_lose_nothing(name: str, tmp_path: Path) -> None:
    work, rng = WORKS[name], np.random.default_rng([7, len(name)])
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    killed.mkdir()
    if name == "track":
        films(killed)
    shutil.copytree(killed, whole)
    before = 0
    for number in SIGNALS:
        process = start(work, killed)
        time.sleep(float(rng.uniform(0.5, work.longest_s)))
        ended = process.poll()
        process.send_signal(number)
        status = process.wait(timeout=60)
        if ended is None:
            assert status in (-number, 128 + number, 0, 1), (killed / "said").read_text()
        end = time.monotonic() + GONE_WITHIN_S
        while (left := in_session(process.pid)) and time.monotonic() < end:
            time.sleep(0.1)
        assert not left, f"{len(left)} processes live on after {number.name}"
        now = work.finished(killed / work.out)
        assert now >= before, f"{before} parts were finished, {now} are after {number.name}"
        before = now
        if ended is not None:
            break
    assert b"Traceback" not in (killed / "said").read_bytes()
    if name == "campaign":  # every run plays so many more: the same number of shots then
        count = str(lines_of(killed / work.out) - 1)
        work = Work((*work.words[:-1], count), work.out, work.finished, work.longest_s)
        killed_results = results(killed / work.out)
    else:
        assert start(work, killed).wait() in (0, 1), (killed / "said").read_text()
        killed_results = results(killed / work.out)
    assert start(work, whole).wait() in (0, 1), (whole / "said").read_text()
    assert killed_results == results(whole / work.out)
