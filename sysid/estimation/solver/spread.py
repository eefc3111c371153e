"""Problems of a fit distributed over workers: each gets some problems with only their own measurements.

In: a function of many problems whose answer for each depends on that problem alone, to the last bit. Out: the same
answer, wherever it is computed. A few problems are computed locally, since sending them takes longer.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from models.workers import Workers

Array = NDArray[np.float64]
MIN_PROBLEMS_SENT = 16  # fewest problems sent at a time: sending takes as long as playing one shot some hundred times
PARTS_PER_WORKER = 2  # parts for each worker, so that a slow one delays the others less


class Divisible(Protocol):
    """An objective of many problems that can be divided among processes."""

    def only(self, rows: NDArray[np.int64]) -> Divisible | None:
        """The objective of some problems, without data of the others; None if it cannot leave this process."""


_workers: ContextVar[Workers | None] = ContextVar("workers", default=None)


@contextlib.contextmanager
def spread_over(workers: Workers | None) -> Iterator[None]:
    """Within this context workers compute the fits; with None this process does."""
    token = _workers.set(workers)
    try:
        yield
    finally:
        _workers.reset(token)


def by_parts(
    function: Callable[..., tuple[Array, ...]], objective: Divisible, x: Array, c: Array, which: NDArray[np.int64],
    *more: Any,
) -> tuple[Array, ...]:  # fmt: skip
    """The result of function(objective, x, c, which, *more): arrays with a row for each problem.

    Args:
        function: defined at module level.
        objective: of all problems.
        x: (k, ...) initial states.
        c: (q,) constants.
        which: (k,) numbers of the problems.
        more: further arguments.
    """
    workers = _workers.get()
    count = 0 if workers is None else min(PARTS_PER_WORKER * workers.count(), len(x) // MIN_PROBLEMS_SENT)
    if workers is None or count < 2 or objective.only(which[:1]) is None:
        return function(objective, x, c, which, *more)
    tasks = []
    for k in np.array_split(np.arange(len(x)), count):
        some, place = np.unique(which[k], return_inverse=True)  # a problem may occur several times
        tasks.append((objective.only(some), x[k], c, place, *more))
    found = workers.in_turn(function, tasks)
    return tuple(np.concatenate(rows) for rows in zip(*found, strict=True))
