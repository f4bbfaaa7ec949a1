"""Digits lost over the domain, and number of steps in which poses are found."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from ..estimation.solver import solve
from ..model.arrays import readings
from . import rivals
from .studies import SENSOR, Row, errors, reference

EPSILON = float(np.finfo(float).eps)


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
        states[:, 0] = offset * rivals.SIGMA * np.cos(turn)
        states[:, 1] = offset * rivals.SIGMA * np.sin(turn)
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


def digits(quick: bool, seed: int) -> list[Row]:
    """Count the digits lost in the range by powers, and by positions relative to the 250 mm of
    their rays, in bins of a tenth of a digit: 0 is the last bit of a float.
    """
    states = rivals.states_in_range(40 if quick else 1000, seed)
    exact = reference(states).reshape(-1, 3, 3)
    away = np.abs(np.array(readings(SENSOR, states).reshape(-1, 3, 3) - exact)).astype(float)
    flight = SENSOR.psds[0].radius
    lost = {
        "powers": away[:, :, 2] / exact[:, :, 2].astype(float) / EPSILON,
        "places": away[:, :, :2] / flight / EPSILON,
    }
    bins = np.round(np.arange(-2, 2.01, 0.25), 2)
    rows: list[Row] = [{"digits_lost": float(low)} for low in bins[:-1]]
    for name, values in lost.items():
        found = np.log10(np.maximum(values, 1e-2)).ravel()
        counts, _ = np.histogram(np.clip(found, bins[0], bins[-1]), bins)
        for row, count in zip(rows, counts, strict=True):
            row[name] = int(count)
    return rows


def steps(quick: bool, seed: int) -> list[Row]:
    """Count the steps from zero to poses of the range, for exact and for noisy readings."""
    states = rivals.states_in_range(2_000 if quick else 100_000, seed)
    exact = readings(SENSOR, states)
    rng, noise = np.random.default_rng(seed), SENSOR.noise
    sigma = np.full(exact.shape, noise.power)
    sigma[:, 0::3] = sigma[:, 1::3] = noise.position * noise.at_power / exact[:, 2::3]
    noisy = exact + sigma * rng.standard_normal(exact.shape)
    found = [solve(SENSOR, xi, covariance=False) for xi in (exact, noisy)]
    most = max(int(solution.iterations.max()) for solution in found)
    counts: list[Any] = [np.bincount(s.iterations[s.converged], minlength=most + 1) for s in found]
    return [
        {"steps": n, "exact": int(counts[0][n]), "noisy": int(counts[1][n])}
        for n in range(most + 1)
        if counts[0][n] or counts[1][n]
    ]
