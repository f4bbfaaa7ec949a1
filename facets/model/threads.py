"""Rows shared among threads, and memory that they do not share.

Compiled kernels let go of the interpreter's lock.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, wraps
from itertools import pairwise
from typing import Any, Generic, TypeVar

from ..core.errors import InputError

T = TypeVar("T")


class Pool(Generic[T]):
    """Memory that compiled code works in, each piece for one call at a time.

    A call takes one out and puts it back, or drops it where it fails. Both are single steps of the
    interpreter, so that no two calls have the same one: neither of threads, nor of a signal's
    handler and what it interrupts, nor after a fork.
    """

    def __init__(self, make: Callable[[], T]) -> None:
        self._make = make
        self._idle: list[T] = []
        self.put_back, self._take = self._idle.append, self._idle.pop

    def take(self) -> T:
        try:
            return self._take()
        except IndexError:
            return self._make()


def once(make: Callable[..., T]) -> Callable[..., T]:
    """`make`, whose result for each arguments is made once, while other threads that ask for the
    same wait for it.

    `functools.cache` alone lets each of them make its own.
    """
    kept: dict[tuple[Any, ...], T] = {}
    locks: dict[tuple[Any, ...], Any] = {}

    @cache
    @wraps(make)
    def call(*arguments: Any) -> T:
        with locks.setdefault(arguments, threading.RLock()):
            if arguments not in kept:
                kept[arguments] = make(*arguments)
            return kept[arguments]

    return call


def run_side_by_side(makers: Iterable[Callable[[], Any]]) -> None:
    """Calls functions that compile, in two threads: while one has LLVM's code made, for which
    llvmlite lets one thread in at a time, the other writes its text."""
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda make: make(), makers))


#: Fewest rows whose work is worth the start of a thread.
MIN_ROWS_PER_THREAD = 1000


def cores() -> int:
    """The processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share(run: Callable[[slice], Any], rows: int, threads: int) -> None:
    """Calls `run` with slices that cover all rows, `threads` of them at once; 0 means all cores."""
    if threads < 0:
        raise InputError(f"threads is {threads}; allowed: 1 or more, or 0 for all cores")
    count = 1
    if rows >= 2 * MIN_ROWS_PER_THREAD:
        count = min(threads or cores(), rows // MIN_ROWS_PER_THREAD)
    if count == 1:
        run(slice(0, rows))
        return
    edges = [rows * k // count for k in range(count + 1)]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(run, parts))


def part_of(array: Any, part: Any, rows: int) -> Any:
    """The rows of an array that has one a sample; an array that all samples share as it is."""
    return array[part] if len(array) == rows else array
