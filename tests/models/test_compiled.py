"""Compiled code that is kept on disk."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCE = """
from typing import NamedTuple

from models.compiled import compiled


class NAME(NamedTuple):
    one: float


@compiled
def more(of):
    return of.one + 1.0


print(more(NAME(2.0)))
"""


def test_what_is_kept_of_an_older_version_is_no_obstacle(tmp_path: Path) -> None:
    """A type that is named otherwise since, as after an update in place."""
    for name in ("Older", "Newer", "Newer"):
        (tmp_path / "renamed.py").write_text(SOURCE.replace("NAME", name))
        path = os.pathsep.join([str(tmp_path), str(ROOT)])
        said = subprocess.run(
            [sys.executable, "-B", "-c", "import renamed"], env={**os.environ, "PYTHONPATH": path}, cwd=tmp_path,
            capture_output=True, text=True,
        )  # fmt: skip
        assert (said.returncode, said.stdout) == (0, "3.0\n"), said.stderr
    assert list((tmp_path / "__pycache__" / "compiled").glob("*.nbi"))
