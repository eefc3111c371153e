"""One set: made, given to `discover`, its result written; `python -m tests.study.run NAME OUT SLOT` is one process.

A result is a small JSON file, whole or absent. It bears the fingerprint of the sources that made it and the options of
its set, by which an outdated one is known. What goes wrong is a result as well: the text of the error, and a miss.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from models.commands.console import write_json
from models.interrupts import given_up_when
from tests.study.plan import Entry, plan

ROOT: Final = Path(__file__).resolve().parents[2]
OUT: Final = ROOT / "out" / "study"
FORMAT: Final = "billiard-study/1"
SOURCES: Final = ("models", "sysid", "tests/truth")
LIMIT: Final = 900.0  # of a set, then it is a miss [s]
KEPT: Final = 4  # candidates of a round that a result lists, beside the hidden ones
CHANGED: Final = 3  # status of a process whose sources changed while it ran
ONE_THREAD: Final = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def fingerprint(root: Path = ROOT, folders: Sequence[str] = SOURCES) -> str:
    """What all sources that a result depends on say, in short."""
    seen = hashlib.sha256()
    for folder in folders:
        for path in sorted((root / folder).rglob("*.py")):
            seen.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return seen.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Of Python and what computes."""
    return {"python": platform.python_version()} | {k: version(k) for k in ("mujoco", "numba", "numpy", "scipy")}


def result_path(name: str, out: Path = OUT) -> Path:
    """Where a set's result is."""
    return out / "results" / f"{name}.json"


def read_result(name: str, out: Path = OUT) -> dict[str, Any] | None:
    """A set's result; None where there is none that can be read."""
    try:
        found = json.loads(result_path(name, out).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and found.get("format") == FORMAT else None


def valid(entry: Entry, result: dict[str, Any] | None, mark: str, keep: bool = False) -> bool:
    """Whether a result is of this set and these sources; with keep, of any sources."""
    if result is None or result.get("words") != list(entry.words()):
        return False
    return keep or result.get("fingerprint") == mark


def head(entry: Entry, mark: str) -> dict[str, Any]:
    """What every result says."""
    return {
        "format": FORMAT, "name": entry.name, "group": entry.group, "hidden": list(entry.hidden),
        "variation": entry.variation, "seed": entry.seed, "clips": entry.clips, "words": list(entry.words()),
        "fingerprint": mark, "versions": versions(),
    }  # fmt: skip


def failed(entry: Entry, mark: str, text: str, elapsed: float) -> dict[str, Any]:
    """The result of a set on which something went wrong."""
    return head(entry, mark) | {"error": " ".join(text.split()) or "no text", "elapsed_s": elapsed}


def made(entry: Entry, out: Path = OUT) -> Path:
    """The set's folder, made unless the generator of now has made it with the same options."""
    from tests.truth.__main__ import make, parser

    folder = out / "sets" / entry.name
    said = f"{fingerprint(folders=('tests/truth',))} {' '.join(entry.words())}\n"
    stamp = folder.with_name(f"{entry.name}.made")
    if folder.is_dir() and stamp.is_file() and stamp.read_text(encoding="utf-8") == said:
        return folder
    stamp.unlink(missing_ok=True)
    make(parser().parse_args([str(folder), "--force", *entry.words()]))
    stamp.write_text(said, encoding="utf-8")
    return folder


def short(found: dict[str, Any], hidden: Sequence[str]) -> dict[str, Any]:
    """A discovery's result without what the report has no use for."""
    keys = ("verdict", "unexplained", "noise_floor_m", "ladder", "parameters", "pruned", "converged", "doubtful")
    few = [[c for k, c in enumerate(r) if k < KEPT or c["effect"] in hidden] for r in found["rounds"]]
    wanted = ("effect", "delta_bic", "fitted", "converged", "predicted_improvement")
    rounds = [[{k: c[k] for k in wanted if k in c} for c in r] for r in few]
    return {k: found.get(k) for k in keys} | {"rounds": rounds, "discover_s": found["elapsed_s"]}


def study_one(entry: Entry, out: Path = OUT) -> dict[str, Any] | None:
    """A set's result; None where the sources changed meanwhile, so that nobody knows whose it is."""
    mark = fingerprint()
    began = time.perf_counter()
    try:
        from models.model_file import full_model
        from sysid.clips import read_clip_set
        from sysid.report.result_json import result_of
        from sysid.selection.discover import discover

        folder = made(entry, out)
        truth = json.loads(folder.with_name(f"{entry.name}.truth.json").read_text(encoding="utf-8"))
        clip_set = read_clip_set(folder)
        start = time.perf_counter()
        found = discover(clip_set, full_model(clip_set.table, clip_set.ball))
        told = short(result_of(found, time.perf_counter() - start), entry.hidden)
        result = head(entry, mark) | {"truth": truth["parameters"], "error": None} | told
        result["elapsed_s"] = time.perf_counter() - began
    except Exception as error:  # noqa: BLE001 (whatever the engine raises is this set's result)
        import traceback

        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name} line {last.lineno}"
        text = f"{type(error).__name__} in {place}: {error}"
        result = failed(entry, mark, text, time.perf_counter() - began)
    return result if fingerprint() == mark else None


def study_there(name: str, limit: float = LIMIT) -> dict[str, Any]:
    """A set's result from a worker of a cluster, which keeps no file of it."""
    entry, mark, began = next(e for e in plan() if e.name == name), fingerprint(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder, given_up_when(lambda: time.monotonic() - began > limit):
        return study_one(entry, Path(folder)) or failed(entry, mark, "the sources changed while it ran", 0.0)
    return failed(entry, mark, f"not done after {limit / 60:g} minutes", time.monotonic() - began)


class Running:
    """A set in a process of its own, with one thread on one core."""

    def __init__(self, entry: Entry, mark: str, out: Path = OUT, limit: float = LIMIT, slot: int = 0) -> None:
        """Start it; of those that run beside each other, every one has a `slot` of its own."""
        self.slot = slot
        self.entry, self.mark, self.out, self.limit = entry, mark, out, limit
        env = os.environ | dict.fromkeys(ONE_THREAD, "1")
        result_path(entry.name, out).unlink(missing_ok=True)
        self.errors = out / "results" / f".{entry.name}.stderr"
        self.errors.parent.mkdir(parents=True, exist_ok=True)
        self.began = time.monotonic()
        with self.errors.open("wb") as stderr:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.study.run", entry.name, str(out), str(slot)], cwd=ROOT, env=env,
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=stderr, start_new_session=True,
            )  # fmt: skip

    @property
    def elapsed(self) -> float:
        """Since its start [s]."""
        return time.monotonic() - self.began

    def done(self) -> bool:
        """Whether it has ended; one that takes too long is ended."""
        if self.process.poll() is None:
            if self.elapsed < self.limit:
                return False
            self.stop()
            self._miss(f"not done after {self.limit / 60:g} minutes")
        elif self.process.returncode not in (0, CHANGED) and not result_path(self.entry.name, self.out).is_file():
            said = self.errors.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            self._miss(f"its process ended with status {self.process.returncode}: {said[-1] if said else ''}")
        self.errors.unlink(missing_ok=True)
        return True

    def _miss(self, text: str) -> None:
        write_json(str(result_path(self.entry.name, self.out)), failed(self.entry, self.mark, text, self.elapsed))

    def stop(self) -> None:
        """End it now."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)  # and what it has begun aside
            self.process.wait()
        self.errors.unlink(missing_ok=True)


@contextmanager
def stopped_in_the_end(running: list[Running]) -> Iterator[list[Running]]:
    """None of these is left running, whatever happens."""
    try:
        yield running
    finally:
        for one in running:
            one.stop()


def main(argv: Sequence[str]) -> int:
    """Run one set, by name, with its files under a folder, on one core."""
    name, out, slot = argv[0], Path(argv[1]), int(argv[2])
    if sys.platform == "linux":  # elsewhere nothing is done aside
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[slot % len(cores)]})
    entry = next(e for e in plan() if e.name == name)
    result = study_one(entry, out)
    if result is None:
        return CHANGED
    path = result_path(name, out)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(str(path), result)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
