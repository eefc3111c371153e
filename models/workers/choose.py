"""Choice of the workers: processes of this machine, or workers of a Dask cluster."""

from __future__ import annotations

import contextlib
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from models.interrupts import work_for_parent
from models.workers.group import Workers
from models.workers.order import Requirements, effects_digest


@contextlib.contextmanager
def open_workers(
    scheduler: str | None, jobs: int, folders: Sequence[str] = (), progress: Callable[[str], None] | None = None
) -> Iterator[Workers]:
    """Workers of a cluster if an address is given, else processes of this machine; all are ended afterwards.

    Args:
        scheduler: address of a Dask scheduler; None for processes of this machine.
        jobs: number of processes.
        folders: with the user's effects.
        progress: called with reports of a cluster's workers.
    """
    order = Requirements({}, tuple(str(Path(f).resolve()) for f in folders), effects_digest() if folders else "")
    if scheduler is not None:
        from models.workers.cluster import cluster

        with cluster(scheduler, order, progress) as workers:
            yield workers
        return
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=work_for_parent)
    try:
        remedy = f"--jobs {jobs}: a process was killed; give fewer if memory is short"
        yield Workers(pool, lambda: jobs, order, BrokenProcessPool, remedy)
        pool.shutdown()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
