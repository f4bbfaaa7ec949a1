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


def alternate(contenders: Sequence[Contender], inputs: Any, rounds: int) -> list[float]:
    """Median seconds a pose of each contender; one that takes over 2 s runs only once."""
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
    return [float(np.median(times)) for times in taken]
