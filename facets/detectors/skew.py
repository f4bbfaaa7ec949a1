"""Convert the readings of detectors that are read one after the other to one instant, and back.

A converter's channels may be read some microseconds apart. With a known beam, at 10 mm/s and 0.1
rad/s, a delay of 10 us causes errors in x and y of ten times their noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import readings

Times = NDArray[np.floating[Any]]

#: A time step longer than this many times the step on the other side of its row is a pause between
#: recordings: no derivative is taken across it.
LONGEST_PAUSE = 10.0


def slopes(time: Times, values: Floats) -> Floats:
    """Time derivatives (n, m), per s, of values (n, m) at times (n,), s.

    A derivative is the mean of the difference quotients with the rows before and after. A quotient
    across a pause, between equal times or with a value that is not finite is omitted; without
    both, the derivative is 0.
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
    """Extrapolate readings (n, 9) to their nominal times (n,), s, which ascend.

    Each detector was read later by its delay (`sensor.light.delays`). A single reading, which has
    no derivative, is unchanged.
    """
    delays = np.repeat(sensor.light.delays, 3)
    if not delays.any():
        return readings
    fixed: Floats = readings - delays * slopes(time, readings)
    return fixed


def delay_states(time: Times, states: Floats, delay: float) -> Floats:
    """Extrapolate the states (n, 8) of a motion at times (n,), s, by `delay`, s."""
    moved: Floats = states + delay * slopes(time, states)
    return moved


def delayed_readings(sensor: Sensor, time: Times, motion: Floats, states: Floats) -> Floats:
    """Readings (n, 9) at states (n, 8), where each detector is read later by its delay.

    time: (n,) s.  motion: (n, 8) states without their noise, from which velocities are computed.
    """
    exact = readings(sensor, states)
    for k, delay in enumerate(sensor.light.delays):
        if delay:
            late = readings(sensor, states + delay_states(time, motion, delay) - motion)
            exact[:, 3 * k : 3 * k + 3] = late[:, 3 * k : 3 * k + 3]
    return exact
