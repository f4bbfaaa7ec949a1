"""Effects of the temperature on the readings and the beam, by the coefficients of `Thermal`.

`warmer` (n,) is the samples' temperature minus the calibration's reference temperature, K; None if
the sensor has no temperature coefficients or the samples have no temperature.
"""

from __future__ import annotations

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from .correction import correct

#: Indices of the positions in a reading, in the order of `Thermal.places`.
PLACES = [0, 1, 3, 4, 6, 7]


def warmer_than_reference(sensor: Sensor, temperature: Floats | None) -> Floats | None:
    """Difference (n,) of temperatures (n,), degrees Celsius, from the reference temperature, K."""
    if temperature is None or not sensor.thermal.is_on:
        return None
    return temperature - sensor.thermal.reference


def beam_shift(sensor: Sensor, warmer: Floats) -> Floats:
    """Shift of the beam's position (n, 2), mm, from its position at the reference temperature."""
    return np.outer(warmer, sensor.thermal.beam)


def exact_readings(sensor: Sensor, raw: Floats, warmer: Floats | None = None) -> Floats:
    """Convert raw readings (n, 9) to readings of perfect detectors at the reference temperature,
    which the model describes.  warmer: (n,), K; None: no correction for the temperature."""
    exact = correct(sensor, raw)
    if warmer is not None:
        exact = exact.copy()
        exact[:, PLACES] -= np.outer(warmer, sensor.thermal.places)
    return exact
