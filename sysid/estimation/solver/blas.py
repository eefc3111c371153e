"""BLAS limited to one core during fits, so that results round alike on any machine."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
Result = TypeVar("Result")


def on_one_blas_thread(function: Callable[P, Result]) -> Callable[P, Result]:
    """The function, run with BLAS on one thread; shots are distributed over the cores anyway."""

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> Result:
        from threadpoolctl import threadpool_limits  # importing it sets an environment variable

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return call
