"""Processor time of contenders, measured in turn so that other work on the machine matters
little."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..core.units import Floats

#: Seconds of a round above which a contender has no further round.
LONG_ROUND_S = 2.0


@dataclass(frozen=True)
class Contender:
    """A method to compare.  work: its function of rows (n, 17), which are readings and states.
    poses: number of rows in a round."""

    name: str
    work: Callable[[Floats], Any]
    poses: int


def cpu_seconds(
    contenders: Sequence[Contender], rows: Floats, rounds: int
) -> list[tuple[float, float]]:
    """Return for each contender its processor seconds a pose, all threads and child processes
    together, and their spread.

    The seconds are those of the fastest round, after a first row that compiles and imports. The
    spread is the fraction by which the median round takes longer. It is NaN for a single round,
    also of a contender that took more than 2 s and was not repeated.
    """
    times: list[list[float]] = [[] for _ in contenders]
    for contender in contenders:
        contender.work(rows[:1])
    for _ in range(rounds):
        for contender, durations in zip(contenders, times, strict=True):
            if not durations or min(durations) <= LONG_ROUND_S:
                start = processor_seconds()
                contender.work(rows[: contender.poses])
                durations.append(processor_seconds() - start)
    return [
        (min(durations) / contender.poses, spread_of(durations))
        for contender, durations in zip(contenders, times, strict=True)
    ]


def processor_seconds() -> float:
    """Seconds of this process and of its child processes that have ended."""
    return time.process_time() + sum(os.times()[2:4])


def spread_of(times: list[float]) -> float:
    """Fraction by which the median of times exceeds the shortest; NaN for a single time."""
    median = sorted(times)[len(times) // 2]
    return median / min(times) - 1 if len(times) > 1 else float("nan")
