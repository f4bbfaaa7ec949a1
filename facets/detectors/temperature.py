"""Effects of the temperature on the readings and the beam, by the coefficients of `Thermal`.

A difference of temperatures `warmer` (n,) is that of samples from the reference temperature of the
calibration, K; None for a sensor that does not follow the temperature, or without a thermometer.
"""

from __future__ import annotations

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from .correction import correct

#: Which of nine readings are places, in the order of `Thermal.places`.
PLACES = [0, 1, 3, 4, 6, 7]


def warmer_than_reference(sensor: Sensor, temperature: Floats | None) -> Floats | None:
    """How much warmer than the reference a sensor at temperatures (n,) is: `warmer` (n,), K."""
    if temperature is None or not sensor.thermal.is_on:
        return None
    return temperature - sensor.thermal.reference


def beam_shift(sensor: Sensor, warmer: Floats) -> Floats:
    """By how much the beam's place differs from that at the reference temperature: (n, 2), mm."""
    return np.outer(warmer, sensor.thermal.beam)


def exact_readings(sensor: Sensor, raw: Floats, warmer: Floats | None = None) -> Floats:
    """Convert readings (n, 9) of one instant each to those that perfect detectors would give at the
    reference temperature, as the model has them."""
    exact = correct(sensor, raw)
    if warmer is not None:
        exact = exact.copy()
        exact[:, PLACES] -= np.outer(warmer, sensor.thermal.places)
    return exact
