"""Processor time of contenders in turn, so that other work on the machine matters little."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..core.units import Floats

#: Seconds of a round above which a contender has no further round.
LONG_ROUND_S = 1.0


@dataclass(frozen=True)
class Contender:
    """A method to compare.  work: function of rows (n, 17), readings and then states.  poses:
    number of rows in a round."""

    name: str
    work: Callable[[Floats], Any]
    poses: int


def cpu_seconds(contenders: Sequence[Contender], rows: Floats, rounds: int) -> list[float]:
    """Return the processor seconds a pose of each contender, all threads together: the least over
    the rounds, after a first row that compiles and imports."""
    least = [float("inf")] * len(contenders)
    for contender in contenders:
        contender.work(rows[:1])
    for n in range(rounds):
        for k, contender in enumerate(contenders):
            if n and least[k] * contender.poses > LONG_ROUND_S:
                continue
            start = time.process_time()
            contender.work(rows[: contender.poses])
            least[k] = min(least[k], (time.process_time() - start) / contender.poses)
    return least


def first_cpu_seconds(expression: str) -> float:
    """Return the processor seconds of a new process with empty caches, imports included."""
    code = f"import facets; sensor = facets.Sensor(); {expression}"
    with tempfile.TemporaryDirectory() as empty:
        before = os.times()
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "FACETS_CACHE_DIR": empty},
            stderr=subprocess.DEVNULL, check=True,
        )  # fmt: skip
        after = os.times()
    return sum(after[2:4]) - sum(before[2:4])  # of child processes: in their code, in the system
