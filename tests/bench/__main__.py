"""`python -m tests.bench`: one table of figures, each measured in this run beside what it is compared with."""

from __future__ import annotations

import os
import platform
import sys
import time
from pathlib import Path

from models.console import table
from tests.bench import peers
from tests.bench.accuracy import cloth_rows, hidden_rows
from tests.bench.speed import jacobian_rows, peak_memory_mb, shot_rows
from tests.bench.video import video_rows

ROOT = Path(__file__).resolve().parents[2]


def data_folder() -> Path:
    """$CUELAB_DATA, or ../shared/data beside the checkout."""
    return Path(os.environ.get("CUELAB_DATA") or ROOT.parent / "shared" / "data")


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
    print(f"peak memory {peak_memory_mb():.0f} MB; all of this took {time.perf_counter() - began:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
