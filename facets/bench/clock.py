"""Processor time of contenders in turn, so that other work on the machine matters little."""

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
    """A method to compare.  work: function of rows (n, 17), readings and then states.  poses:
    number of rows in a round."""

    name: str
    work: Callable[[Floats], Any]
    poses: int


def cpu_seconds(
    contenders: Sequence[Contender], rows: Floats, rounds: int
) -> list[tuple[float, float]]:
    """Return for each contender its processor seconds a pose, all threads and child processes
    together, and their spread.

    The seconds are the least of the rounds, after a first row that compiles and imports; the spread
    is the share by which the middle round takes longer, NaN of a single round.
    """
    times: list[list[float]] = [[] for _ in contenders]
    for contender in contenders:
        contender.work(rows[:1])
    for _ in range(rounds):
        for contender, own in zip(contenders, times, strict=True):
            if not own or min(own) <= LONG_ROUND_S:
                start = processor_seconds()
                contender.work(rows[: contender.poses])
                own.append(processor_seconds() - start)
    return [
        (min(own) / contender.poses, spread_of(own))
        for contender, own in zip(contenders, times, strict=True)
    ]


def processor_seconds() -> float:
    """Seconds of this process and of its child processes that have ended."""
    return time.process_time() + sum(os.times()[2:4])


def spread_of(times: list[float]) -> float:
    """The share by which the middle one of times exceeds the least; NaN of a single one."""
    least, middle = min(times), sorted(times)[len(times) // 2]
    return middle / least - 1 if len(times) > 1 else float("nan")
