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
from ..model.arrays import readings

Times = NDArray[np.floating[Any]]

#: A step longer than this many times the step on a row's other side is a pause between recordings:
#: no derivative is taken across it.
LONGEST_PAUSE = 10.0


def slopes(time: Times, values: Floats) -> Floats:
    """Derivatives by time (s) of rows of values (n, m): (n, m), per s.

    A slope is the mean of the difference quotients to the rows before and after, or one of them if
    the other is unknown. It is 0 if both are unknown, because of a value that is not finite, a
    pause or equal times.
    """
    ends = np.full((1, *values.shape[1:]), np.nan)
    step = np.concatenate([[np.nan], np.diff(time), [np.nan]])
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        step[step <= 0] = np.nan
        quotients = np.concatenate([ends, np.diff(values, axis=0), ends]) / step[:, None]
        sides = np.stack([quotients[:-1], quotients[1:]])
        steps = np.stack([step[:-1], step[1:]])
    sides[steps > LONGEST_PAUSE * steps[::-1]] = np.nan
    is_known = np.isfinite(sides)
    total: Floats = np.where(is_known, sides, 0.0).sum(axis=0)
    mean: Floats = total / np.maximum(is_known.sum(axis=0), 1)
    return mean


def align(sensor: Sensor, time: Times, readings: Floats) -> Floats:
    """Convert readings (n, 9) to those at `time` (n,), s; each detector's readings came later by
    its delay (`sensor.light.delays`).

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


def delayed_readings(sensor: Sensor, time: Times, motion: Floats, states: Floats) -> Floats:
    """Readings (n, 9) at states (n, 8), each detector's later by its delay.

    time: (n,) s.  motion: (n, 8) the states without the noise from sample to sample.
    """
    exact = readings(sensor, states)
    for k, delay in enumerate(sensor.light.delays):
        if delay:
            late = readings(sensor, states + delay_states(time, motion, delay) - motion)
            exact[:, 3 * k : 3 * k + 3] = late[:, 3 * k : 3 * k + 3]
    return exact
