"""Copies of the checkout in which formulas are broken and tests run.

A copy takes the compiled code of the checkout along (its cache knows paths within the package only), so a mutant of an
effect compiles that effect alone. A mutant of a compiled source compiles the engine anew, since the cache is stamped
with the text of all compiled sources (models/compiled.py). Caches of other programs are kept in the copy.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.mutants import Mutant

ROOT = Path(__file__).resolve().parents[2]
MANUAL_FILES = (
    "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "CITATION.cff", "docs", "mkdocs.yml", "Makefile", "constraints.txt",
    "architecture.svg", ".ci",
)  # fmt: skip
COPIED = ("models", "sysid", "planner", "robot", "tests", "pyproject.toml", *MANUAL_FILES)
PLAIN_TESTS = ("tests/models/analytic", "tests/models/engine/test_impacts.py")
PLAIN_SOURCES = ("models/analytic/", "models/engine/impacts.py")  # compiled ones that these are about
LATE_TESTS = ("tests/models/mjcf", "tests/models/recording", "tests/models/report", "tests/models/commands")
PLAIN_LIMIT_S, STAGE_LIMIT_S = 120, 1200
SLOW_PLAIN_S = 1.5  # of a test as plain Python, from which on it is left to compiled code
NO_TESTS = 5  # pytest's exit status where none is chosen
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+?(?:\[.*?\])?)(?: - .*)?$", re.MULTILINE)
SLOW = re.compile(r"^([\d.]+)s call +(\S.*)$", re.MULTILINE)


def is_compiled(file: str) -> bool:
    """Whether a source holds functions that numba compiles, other than hooks of effects."""
    return "\n@compiled" in (ROOT / file).read_text(encoding="utf-8")


def test_files(folder: str) -> list[str]:
    """The files of tests below a folder of the checkout, those that draw and write last."""
    found = [str(path.relative_to(ROOT)) for path in (ROOT / folder).rglob("test_*.py")]
    return sorted(found, key=lambda name: (name.startswith(LATE_TESTS), not name.startswith("tests/models"), name))


def near_tests(file: str) -> list[str]:
    """The files of tests that name a source, its module or its effect: those of the lowest package that has any."""
    stem = Path(file).stem
    word = stem if file.startswith("models/effects") else ".".join(Path(file).with_suffix("").parts)
    sought = re.compile(rf"\b{re.escape(word)}\b")
    found = [name for name in test_files("tests") if sought.search((ROOT / name).read_text(encoding="utf-8"))]
    for package in ("models", "sysid", "planner", "robot"):
        if near := [name for name in found if name.startswith(f"tests/{package}/")]:
            return near
    return []


@dataclass(frozen=True)
class Workshop:
    """One copy."""

    folder: Path
    skipped: tuple[str, ...] = ()  # tests that fail or are slow as plain Python

    def fill(self, source: Path) -> None:
        """Make the copy of a checkout, or of another copy, with its compiled code."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        for name in (*COPIED, ".numba"):
            if (source / name).is_dir():
                shutil.copytree(source / name, self.folder / name, ignore=shutil.ignore_patterns("*.pyc"))
            elif (source / name).exists():
                shutil.copy2(source / name, self.folder / name)

    def run(self, words: list[str], limit: float, *, plain: bool = False) -> tuple[int, str]:
        """Run Python here: exit status and what was printed; 1 when time is up."""
        env = os.environ | {
            "PYTHONPATH": str(self.folder), "NUMBA_CACHE_DIR": str(self.folder / ".numba"), "OPENBLAS_NUM_THREADS": "1",
            "CUELAB_DATA": os.environ.get("CUELAB_DATA", str(ROOT.parent / "shared" / "data")),
            "NUMBA_DISABLE_JIT": "1" if plain else "0",
        }  # fmt: skip
        try:
            done = subprocess.run(
                [sys.executable, *words], cwd=self.folder, env=env, text=True, timeout=limit,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return 1, "time is up"
        return done.returncode, done.stdout

    def pytest(self, paths: list[str], limit: float, *options: str, plain: bool = False) -> tuple[int, str]:
        """Run tests here."""
        words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "0", "-m", "not slow", *options, *paths]
        words += [f"--deselect={test}" for test in self.skipped if plain]
        return self.run(words, limit, plain=plain)

    def imports_itself(self) -> bool:
        """Whether what runs here is this copy, not an installed checkout."""
        _, text = self.run(
            ["-c", "import models, tests.mutation as m; print(models.__file__, m.__file__)"], PLAIN_LIMIT_S
        )
        return text.count(str(self.folder.resolve()) + "/") == 2

    def unfit_as_plain_python(self) -> tuple[str, ...]:
        """The tests that fail without compiling although nothing is broken, or take too long."""
        _, text = self.pytest([*PLAIN_TESTS], 5 * PLAIN_LIMIT_S, "--durations=0", plain=True)
        slow = (test for seconds, test in SLOW.findall(text) if float(seconds) > SLOW_PLAIN_S)
        return tuple(sorted({*FAILED.findall(text), *slow}))

    def try_out(self, mutant: Mutant, stages: int) -> tuple[str, str]:
        """Which stage caught a mutant ("" if none), and by which test."""
        path = self.folder / mutant.file
        whole = path.read_text(encoding="utf-8")
        near = near_tests(mutant.file)
        models = [name for name in test_files("tests/models") if name not in near]
        others = [name for name in test_files("tests") if name not in near and name not in models]
        try:
            path.write_text(mutant.text, encoding="utf-8")
            if is_compiled(mutant.file) and mutant.file.startswith(PLAIN_SOURCES):
                status, text = self.pytest([*PLAIN_TESTS], PLAIN_LIMIT_S, "-x", plain=True)
                if status:
                    return "plain", culprit(text)
            if mutant.file.startswith("models/effects"):
                status, text = self.pytest(near, STAGE_LIMIT_S, "-x", "-k", Path(mutant.file).stem)
                if status not in (0, NO_TESTS):
                    return "named", culprit(text)
            # One run for both: what is near comes first, and nothing is compiled twice.
            for stage, paths in (("models", near + models), ("all", others))[:stages]:
                status, text = self.pytest(paths, STAGE_LIMIT_S, "-x")
                if status:
                    return stage, culprit(text)
            return "", ""
        finally:
            path.write_text(whole, encoding="utf-8")


def culprit(text: str) -> str:
    """The first test that failed."""
    failed = FAILED.findall(text)
    return failed[0] if failed else text.splitlines()[-1] if text else ""
