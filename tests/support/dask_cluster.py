"""A Dask cluster of two worker processes on this machine."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest


@contextmanager
def two_workers() -> Iterator[Any]:
    """Dask's `LocalCluster`, whose workers are begun anew when they end; the test is skipped where Dask is absent."""
    distributed = pytest.importorskip("distributed", reason="no Dask: pip install --editable '.[cluster]'")
    made = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=logging.CRITICAL
    )  # fmt: skip
    try:
        yield made
    finally:
        made.close()


def pids(cluster: Any) -> list[int]:
    """The processes of its workers."""
    return [nanny.pid for nanny in cluster.workers.values() if nanny.pid is not None]
