"""How `planner study` grows with the workers of a Dask cluster on this machine: scenes are long, and small to send.

The workers wait before the command begins, as on a real cluster, and are new: each has its own start to do (imports,
laying out the model), which is in the figures.
"""

from __future__ import annotations

import logging
import os
import tempfile
from pathlib import Path

from tests.bench.growth import measured

WORKERS = (1, 2, 4)
SCENES = 24  # of the search over errors alone: pieces that are nearly even, so that their end costs little


def scene_seconds(workers: int, folder: Path) -> float:
    """Time of a study with so many workers of one thread [s]."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
    ) as cluster:
        words = ["planner.cli", "study", "--quiet", "--method", "risk", "--scenes", str(SCENES)]
        words += ["--out", str(folder / str(workers))]
        return measured([*words, "--scheduler", cluster.scheduler_address])[0]


def worker_growth() -> tuple[list[tuple[str, ...]], dict[str, str]]:
    """Rows for people, and the figures that are noted; none where Dask is absent."""
    try:
        import distributed  # noqa: F401
    except ImportError:
        return [("workers: not measured, no Dask (the extra cluster)", "")], {}
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with tempfile.TemporaryDirectory(prefix="cuelab-bench-") as place:
        took = [scene_seconds(count, Path(place)) for count in WORKERS]
    shares = [took[0] / t / min(count, cores) for t, count in zip(took, WORKERS, strict=True)]
    rows = [
        (f"growth of a study of {SCENES} scenes with workers", "s", f"of one worker's rate, a core ({cores} cores)"),
        (
            f"  {', '.join(map(str, WORKERS))} workers", ", ".join(f"{t:.0f}" for t in took),
            ", ".join(f"{share:.2f}" for share in shares),
        ),
    ]  # fmt: skip
    return rows, {"4 workers over 1, a core": f"{shares[-1]:.2f}"}
