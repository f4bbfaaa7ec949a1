"""Cost of the light of a bench: a pose with it and with ideal light, in turn in one run.

Times are processor times, as in `calls`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..config.loading import load
from ..core.sensor import Sensor
from ..core.units import Floats
from ..estimation.solver import solve
from ..model.arrays import derivatives, jacobian, parameter_jacobian, readings
from .calls import least
from .clock import Contender
from .head import SENSOR, states_in_range

Row = dict[str, Any]

#: The same sensor with ideal light, and with the shipped light of a bench.
IDEAL = SENSOR
LIT = replace(IDEAL, light=load("bench-light").sensor.light)

#: Tasks, and the factor by which each has fewer poses than the readings.
TASKS: dict[str, tuple[Callable[[Sensor, Floats, Floats], Any], int]] = {
    "readings": (lambda sensor, s, _: readings(sensor, s), 1),
    "near Jacobian": (lambda sensor, s, _: derivatives(sensor, s), 2),
    "exact Jacobian": (lambda sensor, s, _: jacobian(sensor, s), 4),
    "by 30 parameters": (lambda sensor, s, _: parameter_jacobian(sensor, s), 10),
    "pose with a free beam": (lambda sensor, _, r: solve(sensor, r), 4),
    "pose with a known beam": (lambda sensor, _, r: solve(sensor, r, beam="known"), 4),
    "pose with a free beam from near": (
        lambda sensor, s, r: solve(sensor, r, start=s + 1e-6, covariance=False), 4
    ),
}  # fmt: skip
#: Share of the range around its middle in which hardly a pose leaves its block.
SHARE = 0.5


def light(quick: bool, seed: int) -> list[Row]:
    """Measure each task: us per pose with ideal light, with a bench's light, and their ratio.

    Poses are estimated from noisy readings.
    """
    poses = 2_000 if quick else 20_000
    rng = np.random.default_rng(seed)
    states = SHARE * states_in_range(poses, seed)
    noise = IDEAL.noise.position * rng.standard_normal((poses, 9)) * np.tile([1.0, 1.0, 0.0], 3)
    rows = []
    for name, (task, fewer) in TASKS.items():
        some = states[: poses // fewer]
        if name == "pose with a known beam":
            some = some * [1, 1, 1, 1, 1, 1, 0, 0]
        pair = [contender(sensor, task, some, noise[: len(some)]) for sensor in (IDEAL, LIT)]
        ideal, lit = least(pair, some, 3 if quick else 9)
        rows.append(
            {
                "task": name,
                "ideal_us": 1e6 * ideal,
                "bench_us": 1e6 * lit,
                "ratio": lit / ideal,
            }
        )
    return rows


def contender(
    sensor: Sensor, task: Callable[[Sensor, Floats, Floats], Any], states: Floats, noise: Floats
) -> Contender:
    seen = readings(sensor, states) + noise
    return Contender("", lambda s: task(sensor, s, seen[: len(s)]), len(states))
