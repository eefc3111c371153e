"""Workers of a Dask cluster: connection, check of versions, reports, and clean-up.

In: the address of a scheduler, as `dask scheduler` prints it. Out: `Workers`. Needs the extra
`cluster` of this package. Security of the network, including TLS, is configured in Dask.
"""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import platform
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from typing import Any

from models.errors import BadInput
from models.interrupts import given_up_when
from models.workers.group import Workers
from models.workers.order import Requirements, difference, processor, reporting_to, source_stamp

CONNECT_TIMEOUT_S = 10
MAX_LOSSES = 5  # repetitions of lost work; before each, Dask has tried several workers itself
log = logging.getLogger(__name__)


class ClusterExecutor(Executor):
    """Dask's executor, whose workers report lines under a topic and end abandoned work."""

    def __init__(self, client: Any, topic: str) -> None:
        """Take a client's executor."""
        self._dask, self._topic = client.get_executor(pure=False), topic

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        """Submit a call of a module's function."""
        found: Future[Any] = self._dask.submit(on_worker, self._topic, function, *arguments)
        return found

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Cancel unfinished work."""
        self._dask.shutdown(wait=False)


def on_worker(topic: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function on a worker of the cluster."""
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()

    def is_abandoned() -> bool:
        task = worker.state.tasks.get(key)
        return task is None or task.state == "cancelled"

    with given_up_when(is_abandoned), reporting_to(lambda line: worker.log_event(topic, line)):
        return function(*arguments)


def condition() -> tuple[dict[str, str], str, str]:
    """A worker's stamp, its machine's name and its processor."""
    return source_stamp(), platform.node(), processor()


@contextlib.contextmanager
def cluster(address: str, order: Requirements, progress: Callable[[str], None] | None) -> Iterator[Workers]:
    """The workers of a cluster, including later ones; BadInput if it cannot be contacted, or has other versions."""
    try:
        import dask
        from distributed import Client, KilledWorker
    except ImportError:
        raise BadInput(
            f"--scheduler {address}: needs Dask; install it with: .venv/bin/python -m pip install "
            "--constraint constraints.txt --editable '.[cluster]'"
        ) from None
    for name in ("distributed", "distributed.client"):  # replaced by our own messages
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    start = "start one with: dask scheduler"
    try:
        dask.config.set({"distributed.admin.large-graph-warning-threshold": "1GB"})  # clips are no graph
        client = Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False, name="cuelab")
    except (OSError, ValueError, ImportError, TypeError) as error:
        text = " ".join(str(error).split())
        raise BadInput(f"--scheduler {address}: no scheduler answers ({text}); name its address, or {start}") from None
    topic = f"cuelab-{uuid.uuid4().hex}"
    executor = ClusterExecutor(client, topic)
    try:
        check_workers(client, address)
        if progress is not None:
            client.subscribe_topic(topic, lambda event: progress(event[1]))
        order = dataclasses.replace(order, stamp=source_stamp())
        remedy = (
            f"--scheduler {address}: the scheduler or every worker that was given one task was lost; check their "
            "logs and memory, then run the same command again"
        )

        def count() -> int:
            try:
                return sum(client.nthreads().values())
            except OSError:
                raise BadInput(remedy) from None

        yield Workers(executor, count, order, KilledWorker, remedy, MAX_LOSSES)
    finally:
        executor.shutdown()
        client.close(timeout=CONNECT_TIMEOUT_S)


def check_workers(client: Any, address: str) -> None:
    """Compare the versions of scheduler and workers with those here; workers that join later are compared by each task.

    Raises:
        BadInput: one of them has another version, or none.
    """
    found = client.run(condition, on_error="return")
    if not found:
        log.info("%s has no workers yet; waiting for: dask worker %s", address, address)
    try:
        found["scheduler"] = client.run_on_scheduler(condition)
    except (ImportError, AttributeError) as error:
        found["scheduler"] = error
    for worker, answer in sorted(found.items()):
        if isinstance(answer, OSError):  # the worker was lost meanwhile
            continue
        who = f"--scheduler {address}: {worker if worker == 'scheduler' else f'worker {worker}'}"
        if isinstance(answer, Exception):
            raise BadInput(f"{who} has no cuelab, or another version ({answer}); install the same everywhere")
        stamp, name, chip = answer
        if text := difference(source_stamp(), stamp):
            raise BadInput(f"{who} on {name}: {text}")
        if chip != processor():
            log.warning(
                "worker %s computes on %s, this machine on %s: last digits may differ", worker, chip, processor()
            )
