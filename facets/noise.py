"""Standard deviations of readings, and noise drawn from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .sensor import Sensor

Floats = NDArray[np.float64]


def standard_deviations(sensor: Sensor, reading: ArrayLike) -> Floats:
    """Of each number of readings (..., 9), 1 sigma: mm and mW; a centroid's grows as 1/power.

    NaN where the reading is.
    """
    exact = np.asarray(reading, dtype=float)
    sigma = exact * 0 + sensor.noise.power
    with np.errstate(divide="ignore"):
        place = sensor.noise.position * sensor.noise.at_power / exact[..., 2::3]
    sigma[..., 0::3] = sigma[..., 1::3] = place
    return sigma


def add_noise(sensor: Sensor, reading: ArrayLike, rng: np.random.Generator) -> Floats:
    """Readings (..., 9) with Gaussian noise, independent from number to number."""
    exact = np.asarray(reading, dtype=float)
    sigma = standard_deviations(sensor, exact)
    noisy: Floats = exact + sigma * rng.standard_normal(sigma.shape)
    return noisy
