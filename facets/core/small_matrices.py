"""Linear algebra of a few hundred unknowns on one thread.

A product of such matrices takes some milliseconds on one core. On several threads it takes no less
time, and tens of times as long if other programs use a core, since all threads wait for the
slowest.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function so that its linear algebra runs on one thread."""

    @wraps(function)
    def run_on_one_thread(*args: P.args, **kwargs: P.kwargs) -> R:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return run_on_one_thread
