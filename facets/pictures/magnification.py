"""By how much a motion or a range is drawn larger than it is, so that it can be seen."""

from __future__ import annotations

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import half_sizes, readings

#: A spot's centroid stays so far inside its detector, shares of the half size, and a detector gets
#: at least such a share of the light, in a motion that is drawn larger.
INSIDE, LEAST = 0.80, 0.06


def round_down(factor: float) -> float:
    """The largest of 1, 2, 5, 10, ... (or 0.5, 0.2, ...) that is not larger."""
    power = 10.0 ** np.floor(np.log10(factor) + 1e-12)
    return float(max(n * power for n in (1, 2, 5) if n * power <= factor * (1 + 1e-12)))


def motion_factor(sensor: Sensor, states: Floats, largest: float = 1000.0) -> float:
    """The largest round factor, 1 or more, by which states (n, 8) may be multiplied with all three
    spots on their detectors and light on each; so a larger motion is one that could be."""
    some = states[:: max(1, len(states) // 100)]
    factor = 1.0
    for more in (2, 5, 10, 20, 50, 100, 200, 500, 1000):
        if more > largest or not kept(sensor, more * some):
            break
        factor = float(more)
    return factor


def kept(sensor: Sensor, states: Floats) -> bool:
    """Whether all spots are well on their detectors in all states."""
    reading = readings(sensor, states)
    power = reading[:, 2::3]
    if not (power > LEAST * sensor.beam.power).all():
        return False
    places = np.stack([reading[:, 0::3], reading[:, 1::3]], axis=-1)
    return bool((np.abs(places) < INSIDE * half_sizes(sensor)).all())


def times(factor: float) -> str:
    """ "drawn 20 times larger", nothing for 1."""
    if factor == 1:
        return ""
    return f"motion drawn {factor:g} times larger"
