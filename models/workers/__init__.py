"""Work for other processes: those of this machine, or of a Dask cluster, by one interface.

In: functions of this package, by their names, with plain arguments. Out: their results, as they come or in their order.
Whoever works is a `concurrent.futures.Executor`. Each worker computes on one thread, since there are others beside it.
Arguments travel as pickles between processes of one run; nothing that is read from a file is ever unpickled.

order       what a worker makes sure of, and does
group       tasks given out, results taken, work that was lost given out again
cluster     the workers of a Dask cluster
choose      who works
"""

from models.workers.choose import open_workers
from models.workers.group import Workers

__all__ = ["Workers", "open_workers"]
