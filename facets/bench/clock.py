"""Timing of contenders in turn, in one run, so that a noisy machine affects all alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Contender:
    """A method to compare.  poses: number per round; work: function of the inputs."""

    name: str
    work: Callable[[Any], Any]
    poses: int


@dataclass(frozen=True)
class Timing:
    """Seconds per pose: median over the rounds, and the quartiles around it."""

    median: float
    low: float
    high: float


def alternate(contenders: Sequence[Contender], inputs: Any, rounds: int) -> list[Timing]:
    """Time each contender in each round; contenders that take over 2 s, only in the first round."""
    taken: list[list[float]] = [[] for _ in contenders]
    for contender in contenders:
        if contender.poses >= 100:
            contender.work(inputs[: contender.poses])  # compiles for this shape, imports
    for _ in range(rounds):
        for times, contender in zip(taken, contenders, strict=True):
            if times and times[0] * contender.poses > 2:
                continue
            start = time.perf_counter()
            contender.work(inputs[: contender.poses])
            times.append((time.perf_counter() - start) / contender.poses)
    return [Timing(*np.quantile(times, [0.5, 0.25, 0.75])) for times in taken]
