"""Problems of a fit spread over workers: each gets some of them, with what was measured of these alone.

In: a function of many problems, whose answer for each depends on that problem alone, to the last bit. Out: the same
answer, whoever computes it. Few problems are computed here: sending them takes longer.
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
MIN_PROBLEMS_SENT = 16  # at a time: the way takes as long as it takes to play one shot some hundred times
PARTS_PER_WORKER = 2  # so that one that is slower holds up the others less


class Divisible(Protocol):
    """An objective of many problems, of which other processes may get some."""

    def only(self, rows: NDArray[np.int64]) -> Divisible | None:
        """That of some problems, with nothing of the others; None where it cannot leave this process."""


_workers: ContextVar[Workers | None] = ContextVar("workers", default=None)


@contextlib.contextmanager
def spread_over(workers: Workers | None) -> Iterator[None]:
    """Fits inside are computed by workers; None for this process alone."""
    token = _workers.set(workers)
    try:
        yield
    finally:
        _workers.reset(token)


def by_parts(
    function: Callable[..., tuple[Array, ...]], objective: Divisible, x: Array, c: Array, which: NDArray[np.int64],
    *more: Any,
) -> tuple[Array, ...]:  # fmt: skip
    """What function(objective, x, c, which, *more) gives: arrays with a row for each problem.

    Args:
        function: of a module.
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
        some, place = np.unique(which[k], return_inverse=True)  # a problem may be asked for several times
        tasks.append((objective.only(some), x[k], c, place, *more))
    found = workers.in_turn(function, tasks)
    return tuple(np.concatenate(rows) for rows in zip(*found, strict=True))
