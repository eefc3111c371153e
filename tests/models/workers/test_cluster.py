"""A Dask cluster as who works: the same results, workers lost, other versions named, nothing left running."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from models.errors import BadInput
from models.workers import cluster as dask
from models.workers import open_workers
from models.workers.order import source_stamp
from tests.support.clip_samples import refusal
from tests.support.dask_cluster import pids, two_workers
from tests.support.worker_tasks import square, wait


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with two_workers() as made:
        yield made


def test_results_and_reports_come_from_all_workers(cluster: Any) -> None:
    lines: list[str] = []
    with open_workers(cluster.scheduler_address, 0, progress=lines.append) as workers:
        assert workers.count() == 2
        assert list(workers.in_turn(square, [(k, 0.05) for k in range(8)])) == [k * k for k in range(8)]
        until = time.monotonic() + 10
        while len(lines) < 8 and time.monotonic() < until:
            time.sleep(0.05)
    assert sorted(lines) == [f"squared {k}" for k in range(8)]


def test_what_a_worker_refuses_is_told_as_it_is(cluster: Any) -> None:
    with open_workers(cluster.scheduler_address, 0) as workers, pytest.raises(BadInput, match="no such folder"):
        from models.effect_catalogue import add_folder

        list(workers.in_turn(add_folder, [("/nowhere/at/all",)]))


def test_work_of_workers_that_are_killed_is_done_by_others(cluster: Any) -> None:
    before = set(pids(cluster))

    def kill() -> None:
        time.sleep(0.7)
        os.kill(pids(cluster)[0], signal.SIGKILL)

    with open_workers(cluster.scheduler_address, 0) as workers:
        threading.Thread(target=kill).start()
        assert list(workers.in_turn(square, [(k, 0.4) for k in range(8)])) == [k * k for k in range(8)]
    until = time.monotonic() + 30
    while set(pids(cluster)) == before and time.monotonic() < until:
        time.sleep(0.1)
    assert set(pids(cluster)) != before


def test_another_version_is_named(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    other = source_stamp() | {"numpy": "0.9"}
    with open_workers(cluster.scheduler_address, 0) as workers:
        monkeypatch.setattr(dask, "source_stamp", lambda: other)
        text = refusal(lambda: open_workers(cluster.scheduler_address, 0).__enter__())
        assert "worker tcp://" in text and f"numpy is {source_stamp()['numpy']} there and 0.9 here" in text
        monkeypatch.setattr(dask, "check_workers", lambda *_: None)  # as if the workers had joined later
        with open_workers(cluster.scheduler_address, 0) as late, pytest.raises(BadInput, match=r"0\.9 here"):
            list(late.in_turn(square, [(2,)]))
        assert list(workers.in_turn(square, [(2,)])) == [4]


def test_nothing_is_left_running(cluster: Any, tmp_path: Path) -> None:
    file, queued = tmp_path / "first", [tmp_path / f"more{k}" for k in range(6)]
    with pytest.raises(KeyboardInterrupt), open_workers(cluster.scheduler_address, 0) as workers:
        come = workers.as_they_come(wait, [(str(f), 60.0 if f is file else 0.01) for f in (file, *queued)])
        next(come)
        while not file.exists():
            time.sleep(0.05)
        raise KeyboardInterrupt
    until = time.monotonic() + 20
    while file.read_text() != "given up" and time.monotonic() < until:
        time.sleep(0.1)
    assert file.read_text() == "given up"


@pytest.mark.slow
def test_work_is_given_out_again_so_often_and_no_more(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A task that kills each worker it is given to."""
    monkeypatch.setattr(dask, "MAX_LOSSES", 0)
    with open_workers(cluster.scheduler_address, 0) as workers:
        text = refusal(lambda: list(workers.in_turn(os.abort, [()])))
    assert text.startswith(f"--scheduler {cluster.scheduler_address}: ") and "same command again" in text
