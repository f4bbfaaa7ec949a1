"""The magnification of a motion or a range in a picture, so that it is visible."""

from __future__ import annotations

import numpy as np

from ...core.sensor import Sensor
from ...core.units import Floats
from ...model.arrays import half_sizes, readings

#: Largest distance of a spot's centroid from its detector's axes, over half the detector's size,
#: and least share of the light on a detector, in a magnified motion.
INSIDE, LEAST = 0.80, 0.06
#: The largest rotation of a head in a picture, rad.
MAX_TURN_RAD = 0.3


def round_down(factor: float) -> float:
    """The largest of 1, 2, 3, 5, 10, ... (or 0.5, 0.3, ...) that is not larger."""
    power = 10.0 ** np.floor(np.log10(factor) + 1e-12)
    largest = max(n * power for n in (1, 2, 3, 5) if n * power <= factor * (1 + 1e-12))
    return float(f"{largest:.3g}")


def motion_factor(sensor: Sensor, states: Floats, largest: float = 1000.0) -> float:
    """The largest round factor, 1 or more, by which states (n, 8) may be multiplied with all three
    spots on their detectors and light on each; the larger motion is then possible."""
    some = states[:: max(1, len(states) // 100)]
    factor = 1.0
    for more in (2, 5, 10, 20, 50, 100, 200, 500, 1000):
        if more > largest or not stays_on_detectors(sensor, more * some):
            break
        factor = float(more)
    return factor


def stays_on_detectors(sensor: Sensor, states: Floats) -> bool:
    """Return whether all spots are well on their detectors in all states."""
    reading = readings(sensor, states)
    power = reading[:, 2::3]
    if not (power > LEAST * sensor.beam.power).all():
        return False
    places = np.stack([reading[:, 0::3], reading[:, 1::3]], axis=-1)
    return bool((np.abs(places) < INSIDE * half_sizes(sensor)).all())


def turning_factor(states: Floats) -> float:
    """The round factor by which the head's own rotation may be magnified further, up to about a
    tenth of a turn to either side, about its apex, which does not move."""
    largest = float(np.abs(states[:, 3:6]).max())
    return max(1.0, round_down(MAX_TURN_RAD / largest)) if largest > 0 else 1.0


def factor_in_words(factor: float, turning: float = 1.0) -> str:
    """The magnification in words: "motion drawn 20 times larger", or nothing for 1."""
    words = [f"motion drawn {factor:g} times larger"] if factor != 1 else []
    if turning != 1:
        words.append(f"the head's turning {factor * turning:g} times")
    return ", ".join(words)
