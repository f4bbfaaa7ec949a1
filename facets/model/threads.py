"""A kernel's rows shared among threads; compiled kernels let go of the interpreter's lock."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

from ..core.errors import InputError

#: Rows that a thread is worth starting for: a millisecond of work.
WORTHWHILE = 1000


def cores() -> int:
    """The processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share(run: Callable[[slice], Any], rows: int, threads: int) -> None:
    """Calls `run` with slices that cover all rows, `threads` of them at once; 0 means all cores."""
    if threads < 0:
        raise InputError(f"threads is {threads}; allowed: 1 or more, or 0 for all cores")
    count = 1
    if rows >= 2 * WORTHWHILE:
        count = min(threads or cores(), rows // WORTHWHILE)
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
