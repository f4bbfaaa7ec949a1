"""Convert the readings of detectors that are read one after the other to one instant, and back.

A converter's channels may be read some microseconds apart. At 10 mm/s and 0.1 rad/s, 10 us is ten
times the noise in x and y where the beam is known.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Sensor
from ..core.units import Floats

Times = NDArray[np.floating[Any]]

#: A pause of this many usual steps separates recordings: no derivative is taken across it.
LONGEST_PAUSE = 10.0


def slopes(time: Times, values: Floats) -> Floats:
    """Derivatives by time (s) of rows of values (n, m): (n, m), per s.

    The mean of the difference quotients to the rows before and after; one of them if the other is
    unknown; 0 if both are, because of a value that is not finite, a pause or equal times.
    """
    out = np.zeros_like(values)
    if len(time) < 2:
        return out
    step = np.diff(time)
    usual = np.median(step[step > 0]) if (step > 0).any() else 0.0
    sound = (step > 0) & (step <= LONGEST_PAUSE * usual)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        each = np.where(sound[:, None], np.diff(values, axis=0) / step[:, None], np.nan)
    known = np.isfinite(each)
    total, count = np.zeros_like(values), np.zeros(values.shape)
    for rows in (slice(None, -1), slice(1, None)):
        total[rows] += np.where(known, each, 0.0)
        count[rows] += known
    return np.divide(total, count, out=out, where=count > 0)


def align(sensor: Sensor, time: Times, readings: Floats) -> Floats:
    """Convert readings (n, 9) to those at `time` (n,), s; each detector's came later by its delay
    (`sensor.light.delays`).

    The readings run in time; a single one is unchanged.
    """
    delays = np.repeat(sensor.light.delays, 3)
    if not delays.any():
        return readings
    fixed: Floats = readings - delays * slopes(time, readings)
    return fixed


def delay_states(time: Times, states: Floats, delay: float) -> Floats:
    """States (n, 8) of a motion, later by `delay`, s."""
    moved: Floats = states + delay * slopes(time, states)
    return moved
