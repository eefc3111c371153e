"""Distribution of work over threads, processes of this machine, or a Dask cluster, these two with one interface.

In: functions of this package, by name, with plain arguments. Out: their results, as they arrive or in order. Workers
are a `concurrent.futures.Executor`. Each computes on one thread, since there are several. Arguments are pickled between
processes of one run; data from a file are never unpickled.

threads     rows of one computation over the threads of a process
order       what a worker checks and computes
group       submits tasks, collects results, and repeats work that was lost
cluster     the workers of a Dask cluster
choose      the workers from the options of a command
"""

from models.workers.choose import open_workers
from models.workers.group import Workers

__all__ = ["Workers", "open_workers"]
