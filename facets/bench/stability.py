"""Errors of readings far off the beam and under large tilts, and the steps to their poses."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..estimation.solver import solve
from ..model.arrays import readings
from .head import SENSOR, SIGMA
from .studies import Row, errors, reference


def stability(quick: bool, seed: int) -> list[Row]:
    """Measure errors of readings over apex offset (sigmas) and tilt; poses from zero, and steps.

    The reference has one more digit for each leading zero of the least power.
    """
    offsets = [0, 0.01, 0.3, 0.6, 1, 1.5, 2, 3, 4, 6, 8, 10]
    tilts = [0, 1, 5, 10, 20, 50]
    if quick:
        offsets, tilts = offsets[::2], tilts[::4]
    rng = np.random.default_rng(seed)
    rows = []
    for offset, tilt in product(offsets, tilts):
        states = np.zeros((2 if quick else 4, 8))
        turn = 2 * np.pi * rng.random(len(states))
        states[:, 0] = offset * SIGMA * np.cos(turn)
        states[:, 1] = offset * SIGMA * np.sin(turn)
        states[:, 3:6] = 1e-3 * tilt * rng.uniform(-1, 1, (len(states), 3))
        values = readings(SENSOR, states)
        place, power = errors(values, reference(states, 40 + int(offset**2 / 4)))
        solution = solve(SENSOR, values)
        rows.append(
            {
                "offset_sigma": offset,
                "tilt_mrad": tilt,
                "place_error_mm": place,
                "power_error": power,
                "solved": int(solution.converged.sum()),
                "most_steps": int(solution.iterations[solution.converged].max(initial=0)),
            }
        )
    return rows
