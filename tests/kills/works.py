"""Commands that continue, on tiny inputs; what of their work is finished, and what they came to."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
WITHOUT_TIMES = ("elapsed_s", "seconds")
TOLD_BY_TIME = (".played.json", "fit.json", "clips/clips.toml")  # files that hold moments and durations throughout


@dataclass(frozen=True)
class Work:
    """A command that continues, in its folder."""

    words: tuple[str, ...]
    out: str  # what it fills
    finished: Callable[[Path], int]  # parts of it that are finished


def lines_of(path: Path) -> int:
    """Lines of a file; 0 where there is none."""
    return path.read_bytes().count(b"\n") if path.exists() else 0


def discovered(out: Path) -> int:
    """Fits of a discovery that are kept."""
    return 10**6 if (out / "result.json").exists() else lines_of(out / "unfinished.jsonl")


def videos_of(out: Path) -> int:
    """Films of a clip set that are tracked."""
    return (out / "clips.toml").read_text().count("[[videos]]") if (out / "clips.toml").exists() else 0


WORKS = {
    "discover": Work(("sysid", "discover", str(ROOT / "sysid" / "example"), "--out", "out"), "out", discovered),
    "campaign": Work(("robot", "campaign", "out.csv", "--most", "60"), "out.csv", lines_of),
    "study": Work(("planner", "study", "--out", "out", "--scenes", "2", "--jobs", "2"), "out",
                  lambda out: len(list(out.glob("scenes/*.json")))),
    "learn": Work(("robot", "learn", "--out", "out", "--shots", "5", "--every", "4", "--repeats", "3"), "out",
                  lambda out: len(list(out.glob("shots/*.played.json")))),
    "track": Work(("sysid", "track", "one.mkv", "two.mkv", "--camera", "camera.toml", "--out", "out"), "out",
                  videos_of),
}  # fmt: skip


def start(work: Work, folder: Path) -> subprocess.Popen[bytes]:
    """A command in its folder and in a session of its own; what it says is added to the file `said`."""
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
