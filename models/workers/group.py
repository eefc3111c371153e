"""A group of workers, on this machine or elsewhere: it takes tasks, and yields results as they are finished."""

from __future__ import annotations

import pickle
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass
from typing import Any

from models.errors import BadInput
from models.workers.order import Requirements, perform

TASKS_PER_WORKER = 2  # tasks submitted for each worker: one in progress, one waiting
POLL_S = 1.0  # interval at which new workers get tasks


@dataclass(frozen=True)
class Workers:
    """A group of workers, with the order that each of them checks."""

    executor: Executor
    count: Callable[[], int]  # how many compute at a time, now
    order: Requirements
    lost: type[Exception]  # raised where work has ended its worker
    remedy: str  # for that
    max_losses: int = 0  # of a piece of work, that is then given out again

    def as_they_come(self, function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """Yield indices and results of tasks, which are arguments of a module's function.

        Raises:
            BadInput: work ends its worker every time, or the workers cannot be contacted.
        """
        losses, waiting, running = Counter[int](), deque(range(len(tasks))), dict[Future[Any], int]()
        try:
            while waiting or running:
                # Only a few in advance, so that waiting tasks are not pickled yet.
                room = TASKS_PER_WORKER * self.count() - len(running) if waiting else 0
                for number in [waiting.popleft() for _ in range(min(room, len(waiting)))]:
                    running[self._submit(function, tasks[number])] = number
                if not running:  # no workers yet
                    time.sleep(POLL_S)
                for future in wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    try:
                        result = future.result()
                    except self.lost:
                        losses[number] += 1
                        if losses[number] > self.max_losses:
                            raise BadInput(self.remedy) from None
                        waiting.appendleft(number)
                        continue
                    yield number, result
        except ImportError as error:
            raise BadInput(
                f"a worker has no cuelab, or another version ({error}); install the same everywhere"
            ) from None
        except CancelledError:  # not cancelled by us
            raise BadInput(self.remedy) from None
        finally:
            for future in running:
                future.cancel()

    def in_turn(self, function: Callable[..., Any], tasks: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
        """Yield results of the tasks in order, each as soon as those before it are finished; see `as_they_come`."""
        found, turn = dict[int, Any](), 0
        for number, result in self.as_they_come(function, tasks):
            found[number] = result
            while turn in found:
                yield found.pop(turn)
                turn += 1

    def _submit(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Future[Any]:
        return self.executor.submit(perform, self.order, pickle.dumps((function, arguments)))
