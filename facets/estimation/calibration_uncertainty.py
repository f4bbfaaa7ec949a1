"""What of a calibration's uncertainty goes into a pose.

The parameters are off by the same amount in every sample: what is added here does not average out.
What the model misses beside (`MISFIT`) differs from place to place, and counts with them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.names import FINE_UNITS
from ..core.units import Floats
from ..detectors.calibrated import LIGHT_CENTRE, MISFIT
from ..detectors.correction import NAMES, correction_slopes
from ..detectors.noise import standard_deviations
from ..model.arrays import EFFECTS, effect_jacobian, jacobian, parameter_jacobian, readings
from ..model.beam_shape import SHAPE, shape_derivatives
from ..optics.parameters import PARAMETERS

if TYPE_CHECKING:
    from ..core.sensor import Calibration, Sensor


#: How many samples at once: 5 kB each.
PART = 2000


def covariances(
    sensor: Sensor,
    known: Calibration,
    states: Floats,
    used: NDArray[np.bool_],
    free: NDArray[np.int64],
    weights: Floats,
) -> Floats:
    """Of states (n, 8) by the calibration alone: (n, 8, 8), zero where a state is not finite.

    used: (n, 3) detectors.  free, weights: the unknowns that were solved for, out of the state and
    the power, and one over the sigmas of what was known of bx, by and the power.
    """
    if len(states) > PART:
        parts = [slice(first, first + PART) for first in range(0, len(states), PART)]
        found = [covariances(sensor, known, states[p], used[p], free, weights) for p in parts]
        return np.concatenate(found)
    seen = readings(sensor, states)
    weigh = np.repeat(used, 3, axis=1) / standard_deviations(sensor, seen)
    by_state = np.zeros((len(states), 9, 9))
    by_state[:, :, :8] = jacobian(sensor, states)
    by_state[:, 2::3, 8] = seen[:, 2::3] / sensor.beam.power
    rows = np.nan_to_num(by_state[:, :, free] * weigh[:, :, None])
    off = np.nan_to_num(parameter_derivatives(sensor, known, states, seen) * weigh[:, :, None])
    before = np.zeros(9)
    before[6:] = weights**2
    units = np.array([*FINE_UNITS, 1e-3])[free]
    rows *= units
    inner = np.swapaxes(rows, 1, 2) @ rows + np.diag(before[free] * units**2)
    good = np.isfinite(states).all(axis=1)
    inner[~good] = np.eye(len(free))
    moved = np.linalg.solve(inner, np.swapaxes(rows, 1, 2) @ off) * units[:, None]
    whole = np.zeros((len(states), 9, len(known.names)))
    whole[:, free] = moved
    whole[~good] = 0.0
    added: Floats = whole @ np.array(known.covariance) @ np.swapaxes(whole, 1, 2)
    return added[:, :8, :8]


def parameter_derivatives(
    sensor: Sensor, known: Calibration, states: Floats, seen: Floats
) -> Floats:
    """How far model and reading part for each unit of what was calibrated: (n, 9, p)."""
    whole = parameter_jacobian(sensor, states)
    blocks = {
        PARAMETERS: whole,
        NAMES: -correction_slopes(sensor, seen),
        MISFIT: misfit(len(states)),
    }
    if any(name in SHAPE for name in known.names):
        blocks[SHAPE] = shape_derivatives(sensor, states, whole)
    if any(name in LIGHT_CENTRE for name in known.names):
        blocks[LIGHT_CENTRE] = jacobian(sensor, states)[:, :, 6:]
    if any(name in EFFECTS for name in known.names):
        blocks[EFFECTS] = effect_jacobian(sensor, states)
    names = [name for block in blocks for name in block]
    every = np.concatenate(list(blocks.values()), axis=2)
    parted: Floats = every[:, :, [names.index(name) for name in known.names]]
    return parted


def misfit(count: int) -> Floats:
    """The derivative of `MISFIT`: each adds to its own reading. (n, 9, 9)"""
    return np.broadcast_to(np.eye(9), (count, 9, 9))
