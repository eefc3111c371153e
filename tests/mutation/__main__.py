"""Break formulas one at a time, run the tests, and list what no test noticed: `python -m tests.mutation`.

Each mutant lives in a copy of the checkout. The tests of the formulas run first, as plain Python, which takes seconds;
a mutant that survives them is compiled, and meets the tests of `models/`, then all that `make test` runs. Results are
kept as they come (results.jsonl); the same command goes on where it was interrupted.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.mutation.mutants import Mutant, sample

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("models", "sysid", "planner", "robot", "tests", "pyproject.toml", "README.md")
PLAIN_TESTS = ("tests/models/analytic", "tests/models/effects/test_effects.py")
STAGES = (("tests/models",), ("tests",))  # compiled, one after another
PLAIN_LIMIT_S, STAGE_LIMIT_S = 300, 1800
SCORE_WANTED = 0.9


class Workshop:
    """A copy of the checkout in which formulas are broken and tests run."""

    def __init__(self, folder: Path, skipped: tuple[str, ...]) -> None:
        self.folder, self.skipped = folder, skipped
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, folder / name)

    def pytest(self, paths: tuple[str, ...], limit: float, *, plain: bool, first_only: bool = True) -> tuple[int, str]:
        """Run tests here: exit status, and what was printed; 1 when time is up."""
        words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "0", "-m", "not slow", *paths]
        words += [f"--deselect={test}" for test in self.skipped if plain]
        env = os.environ | {
            "PYTHONPATH": str(self.folder), "NUMBA_CACHE_DIR": str(self.folder / ".numba"), "OPENBLAS_NUM_THREADS": "1",
            "CUELAB_DATA": os.environ.get("CUELAB_DATA", str(ROOT.parent / "shared" / "data")),
        }  # fmt: skip
        if plain:
            env["NUMBA_DISABLE_JIT"] = "1"
        try:
            done = subprocess.run(
                [*words, *(["-x"] if first_only else [])], cwd=self.folder, env=env, text=True, timeout=limit,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return 1, "time is up"
        return done.returncode, done.stdout

    def try_out(self, mutant: Mutant, stages: int) -> tuple[str, str]:
        """Which stage caught a mutant ("" if none), and by which test."""
        path = self.folder / mutant.file
        whole = path.read_text(encoding="utf-8")
        try:
            path.write_text(mutant.text, encoding="utf-8")
            status, text = self.pytest(PLAIN_TESTS, PLAIN_LIMIT_S, plain=True)
            if status:
                return "plain", culprit(text)
            for paths in STAGES[:stages]:
                status, text = self.pytest(paths, STAGE_LIMIT_S, plain=False)
                if status:
                    return paths[0], culprit(text)
            return "", ""
        finally:
            path.write_text(whole, encoding="utf-8")


def culprit(text: str) -> str:
    """The first test that failed."""
    failed = [line.split(" - ")[0] for line in text.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0] if failed else text.splitlines()[-1] if text else ""


def main() -> int:
    """Run, and print the score and the mutants that no test noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=main.__doc__, allow_abbrev=False)
    parser.add_argument("--count", type=int, default=80, help="mutants (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="side by side (default: %(default)s)")
    parser.add_argument(
        "--stages", type=int, default=2, choices=(0, 1, 2), help="after plain Python: models, all tests"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutation", help="results and copies")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    results = args.out / "results.jsonl"
    known = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    print("which tests need compiled code", flush=True)
    first = Workshop(args.out / "copy0", ())
    _, text = first.pytest(PLAIN_TESTS, 3 * PLAIN_LIMIT_S, plain=True, first_only=False)
    skipped = tuple(line.split()[1] for line in text.splitlines() if line.startswith(("FAILED", "ERROR")))
    free = [Workshop(args.out / f"copy{k}", skipped) for k in range(args.jobs)]
    lock = threading.Lock()

    def run(mutant: Mutant) -> None:
        with lock:
            shop = free.pop()
        began = time.monotonic()
        stage, test = shop.try_out(mutant, args.stages)
        with lock:
            free.append(shop)
            known.append({"mutant": mutant.name, "caught": stage, "test": test})
            with results.open("a") as file:
                file.write(json.dumps(known[-1]) + "\n")
            print(f"{time.monotonic() - began:5.0f} s  {stage or 'SURVIVED':14s} {mutant.name[:110]}", flush=True)

    wanted = sample(ROOT, args.count, args.seed)
    names = {one["mutant"] for one in known}
    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(run, [mutant for mutant in wanted if mutant.name not in names]))
    ours = {mutant.name for mutant in wanted}
    judged = [one for one in known if one["mutant"] in ours]
    caught = sum(bool(one["caught"]) for one in judged)
    print(f"\n{caught} of {len(judged)} caught: {100 * caught / len(judged):.0f} %")
    for one in judged:
        if not one["caught"]:
            print(f"survived: {one['mutant']}")
    return 0 if caught >= SCORE_WANTED * len(judged) else 1


if __name__ == "__main__":
    sys.exit(main())
