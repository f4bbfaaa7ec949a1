"""Sharing of rows among threads, and memory for one call at a time.

Compiled kernels release the interpreter's lock.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from functools import cache, wraps
from itertools import pairwise
from typing import Any, Generic, TypeVar

from ..core.errors import InputError

T = TypeVar("T")


class Pool(Generic[T]):
    """Pieces of memory for compiled code, each used by one call at a time.

    A call takes a piece and puts it back, or drops it if the call fails. Both are single steps of
    the interpreter, so that no two calls use the same piece: neither two threads, nor a signal's
    handler and the code that it interrupts, nor a forked process.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._idle: list[T] = []
        self.put_back, self._take = self._idle.append, self._idle.pop

    def take(self) -> T:
        """Take an object from the pool, or make one if it is empty."""
        try:
            return self._take()
        except IndexError:
            return self._make()


def once(make: Callable[..., T]) -> Callable[..., T]:
    """Cache `make` by its arguments; other threads wait while one thread computes a result.

    With `functools.cache`, each thread would compute its own result.
    """
    results: dict[tuple[Any, ...], T] = {}
    locks: dict[tuple[Any, ...], Any] = {}

    @cache
    @wraps(make)
    def call(*arguments: Any) -> T:
        """The result for these arguments, computed on the first call."""
        with locks.setdefault(arguments, threading.RLock()):
            if arguments not in results:
                results[arguments] = make(*arguments)
            return results[arguments]

    return call


#: Smallest number of rows for a thread, which are poses of 12 ms. A thread costs 0.3 ms of
#: processor time, and brings no gain while other programs use the cores.
MIN_ROWS_PER_THREAD = 50_000


def cores() -> int:
    """The number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share(run: Callable[[slice], Any], rows: int, threads: int) -> None:
    """Call `run` with slices that cover all rows, `threads` of them at once; 0 means all cores.
    Raises `InputError` for a negative number."""
    if threads < 0:
        raise InputError(f"threads is {threads}; allowed: 1 or more, or 0 for all cores")
    count = 1
    if rows >= 2 * MIN_ROWS_PER_THREAD:
        count = min(threads or cores(), rows // MIN_ROWS_PER_THREAD)
    if count == 1:
        run(slice(0, rows))
        return
    from concurrent.futures import ThreadPoolExecutor

    edges = [rows * k // count for k in range(count + 1)]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(run, parts))


def part_of(array: Any, part: Any, rows: int) -> Any:
    """The rows `part` of an array with one row per sample; other arrays, which all samples share,
    are returned unchanged."""
    return array[part] if len(array) == rows else array
