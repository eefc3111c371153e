"""Matrices on one core while constants are fitted: so they round alike on any machine."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
Result = TypeVar("Result")


def on_one_blas_thread(function: Callable[P, Result]) -> Callable[P, Result]:
    """The function with BLAS on one thread; shots are spread over the cores in any case."""

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> Result:
        from threadpoolctl import threadpool_limits  # it sets a variable of the environment as it is imported

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return call
