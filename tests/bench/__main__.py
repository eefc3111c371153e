"""`python -m tests.bench`: one table of figures, each measured in this run beside what it is compared with.

Then how cost grows; `--note` adds those figures as a dated row to docs/benchmarks.md.
"""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

from models.commands.console import table
from tests.bench import peers
from tests.bench.accuracy import cloth_rows, hidden_rows
from tests.bench.growth import clip_growth, noted, shot_growth
from tests.bench.speed import jacobian_rows, peak_memory_mb, shot_rows
from tests.bench.video import video_rows
from tests.bench.workers import worker_growth

ROOT = Path(__file__).resolve().parents[2]


def data_folder() -> Path:
    """$CUELAB_DATA, or ../shared/data beside the checkout."""
    return Path(os.environ.get("CUELAB_DATA") or ROOT.parent / "shared" / "data")


def version() -> str:
    """The commit that is measured."""
    told = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True)
    return told.stdout.strip() or "unknown"


def main() -> int:
    """Measure and print."""
    began = time.perf_counter()
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, {platform.machine()}\n", flush=True)
    for rows in (cloth_rows, shot_rows, jacobian_rows, video_rows, peers.rows):
        print(table(rows()) + "\n", flush=True)
    print(peers.note() + "\n", flush=True)
    hidden = data_folder() / "hidden" / "set-11"
    if hidden.is_dir():
        print(table(hidden_rows(hidden)) + "\n", flush=True)
    else:
        print("hidden set: no data at $CUELAB_DATA or ../shared/data, so not fitted\n")
    figures: dict[str, str] = {}
    for growth in (shot_growth, clip_growth, worker_growth):
        rows, more = growth()
        print(table(rows) + "\n", flush=True)
        figures |= more
    if "--note" in sys.argv[1:]:
        noted(figures, datetime.date.today(), version())
    print(f"peak memory {peak_memory_mb():.0f} MB; all of this took {time.perf_counter() - began:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
