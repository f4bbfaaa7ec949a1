"""What the uncertainty of a pose consists of: noise, and what noise is not.

The noise of the readings differs from sample to sample, so that a mean over n samples has 1 / n of
its variance. The calibrated parameters are off by the same amount in every sample: a mean keeps
their part, and a difference of two poses has that of the difference between their derivatives. What
is known of beam and power beforehand (a prior) stays in a mean, too, but for the laser's pointing
jitter and power noise, which differ from sample to sample as the readings' noise does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.names import FINE_UNITS
from ..core.units import Floats
from ..detectors.calibrated import LIGHT_CENTRE, MISFIT, MODEL_ERROR, TEMPERATURE
from ..detectors.correction import NAMES, correction_slopes
from ..detectors.noise import standard_deviations
from ..model.arrays import EFFECTS, effect_jacobian, jacobian, parameter_jacobian, readings
from ..model.beam_shape import SHAPE, shape_derivatives
from ..optics.parameters import PARAMETERS

if TYPE_CHECKING:
    from ..core.sensor import Calibration, Sensor
    from .plan import Plan


#: How many samples at once: 5 kB each.
PART_SAMPLES = 2000


def slices_of(count: int) -> list[slice]:
    """Slices of some samples, each few enough to be propagated at once."""
    return [slice(first, first + PART_SAMPLES) for first in range(0, count, PART_SAMPLES)]


class Propagation(NamedTuple):
    """How solved states (n, 8) follow what is not known; NaN where a state is not finite.

    noise: (n, 8, 8) covariance by the readings' noise.  statistical: that by the priors of beam
    and power included.  slopes: (n, 8, p) derivatives by the calibrated parameters, or None without
    a calibration.  readings: (n, 9) of the model.  priors: (n, 8, 3) what one standard deviation of
    the lasting error of the priors of bx, by and the power does to the state, so that statistical
    is noise + priors priors'.
    """

    noise: Floats
    statistical: Floats
    slopes: Floats | None
    readings: Floats
    priors: Floats


class UncertaintyParts(NamedTuple):
    """Covariances (n, 8, 8) of states by the readings' noise and by the calibration; NaN where a
    state is not finite.  degrees_of_freedom: of the calibration; NaN: unknown."""

    noise: Floats
    calibration: Floats
    degrees_of_freedom: float


def uncertainty_parts(
    sensor: Sensor,
    states: Floats,
    used: NDArray[np.bool_],
    plan: Plan,
    warmer: Floats | None = None,
) -> UncertaintyParts:
    """Of states (n, 8) of a sensor with a calibration; other arguments as of `propagate`."""
    assert sensor.calibration is not None
    noise, calibration = np.empty((len(states), 8, 8)), np.empty((len(states), 8, 8))
    for part in slices_of(len(states)):
        found = propagate(
            sensor, sensor.calibration, states[part], used[part], plan,
            None if warmer is None else warmer[part],
        )  # fmt: skip
        noise[part] = found.noise
        calibration[part] = carry_over(sensor.calibration, found.slopes)
    known = sensor.calibration.degrees_of_freedom
    return UncertaintyParts(noise, calibration, np.nan if known is None else known)


def carry_over(known: Calibration, slopes: Floats | None) -> Floats:
    """The covariance (n, 8, 8) of states whose derivatives by the parameters are (n, 8, p)."""
    assert slopes is not None
    covariance: Floats = slopes @ np.array(known.covariance) @ np.swapaxes(slopes, 1, 2)
    return covariance


def propagate(
    sensor: Sensor,
    known: Calibration | None,
    states: Floats,
    used: NDArray[np.bool_],
    plan: Plan,
    warmer: Floats | None = None,
) -> Propagation:
    """How solved states (n, 8) follow noise, priors and the parameters that are `known`.

    used: (n, 3) detectors.  plan: the unknowns that were solved for, and what was known of bx, by
    and the power.
    warmer: (n,) than the reference temperature of the calibration, K; None where it is not known.
    """
    seen, free, weights = readings(sensor, states), plan.free, plan.weights
    weigh = np.repeat(used, 3, axis=1) / standard_deviations(sensor, seen)
    by_state = np.zeros((len(states), 9, 9))
    by_state[:, :, :8] = jacobian(sensor, states)
    by_state[:, 2::3, 8] = seen[:, 2::3] / sensor.beam.power
    rows = np.nan_to_num(by_state[:, :, free] * weigh[:, :, None])
    before = np.zeros(9)
    before[6:] = weights**2
    units = np.array([*FINE_UNITS, 1e-3])[free]
    rows *= units
    across = np.swapaxes(rows, 1, 2)
    information = across @ rows
    inner = information + np.diag(before[free] * units**2)
    good = np.isfinite(states).all(axis=1)
    inner[~good] = np.eye(len(free))
    inverse = np.linalg.inv(inner)
    scale = np.outer(units, units)

    def state_part(part: Any, places: tuple[Any, ...], shape: tuple[int, ...]) -> Floats:
        """Rows or rows and columns of the unknowns as those of the state; 0 of what is known."""
        whole = np.zeros((len(states), *shape))
        whole[(slice(None), *places)] = part
        whole[~good] = np.nan
        return whole[:, :8]

    square, both = (9, 9), np.ix_(free, free)
    share = jitter_share(sensor, before)
    random = information + np.diag((before * share)[free] * units**2)
    lasting = inverse * (np.sqrt(before * (1 - share))[free] * units) * units[:, None]
    noise = state_part(inverse @ random @ inverse * scale, both, square)
    statistical = state_part(inverse * scale, both, square)
    priors = state_part(lasting, both, square)[:, :, 6:]
    slopes = None
    if known is not None:
        off = parameter_derivatives(sensor, known, states, seen, warmer)
        off = np.nan_to_num(off * weigh[:, :, None])
        moved = np.linalg.solve(inner, across @ off) * units[:, None]
        slopes = state_part(moved, (free,), (9, off.shape[2]))
    return Propagation(noise[:, :, :8], statistical[:, :, :8], slopes, seen, priors)


def jitter_share(sensor: Sensor, before: Floats) -> Floats:
    """The share (9,) of the priors' variances that the laser's pointing jitter and power noise are.

    before: (9,) one over these variances, 0 where there is no prior. These errors of a prior differ
    from sample to sample; the rest of it is the same in all.
    """
    variances = np.zeros(9)
    if sensor.electronics is not None:
        variances[6:8] = sensor.electronics.pointing**2
        variances[8] = (sensor.electronics.power_noise * sensor.beam.power) ** 2
    return np.minimum(variances * before, 1.0)


def parameter_derivatives(
    sensor: Sensor,
    known: Calibration,
    states: Floats,
    seen: Floats,
    warmer: Floats | None = None,
) -> Floats:
    """How far model and reading part for each unit of what was calibrated: (n, 9, p).

    warmer: (n,) than the reference temperature of the calibration, K.
    """
    whole = parameter_jacobian(sensor, states)
    identity = np.broadcast_to(np.eye(9), (len(states), 9, 9))  # each adds to its own reading
    blocks = {
        PARAMETERS: whole,
        NAMES: -correction_slopes(sensor, seen),
        MISFIT: identity,
        MODEL_ERROR: identity,
    }
    if any(name in SHAPE for name in known.names):
        blocks[SHAPE] = shape_derivatives(sensor, states, whole)
    if any(name in LIGHT_CENTRE for name in known.names):
        blocks[LIGHT_CENTRE] = jacobian(sensor, states)[:, :, 6:]
    if any(name in TEMPERATURE for name in known.names):
        blocks[TEMPERATURE] = temperature_derivatives(sensor, states, warmer)
    if any(name in EFFECTS for name in known.names):
        blocks[EFFECTS] = effect_jacobian(sensor, states, names=known.names)
    names = [name for block in blocks for name in block]
    every = np.concatenate(list(blocks.values()), axis=2)
    parted: Floats = every[:, :, [names.index(name) for name in known.names]]
    return parted


def temperature_derivatives(sensor: Sensor, states: Floats, warmer: Floats | None) -> Floats:
    """The derivatives by `TEMPERATURE` (n, 9, 8), of readings at temperatures (n,) K above the
    reference."""
    slopes = np.zeros((len(states), 9, len(TEMPERATURE)))
    if warmer is not None:
        slopes[:, :, :2] = jacobian(sensor, states)[:, :, 6:]
        slopes[:, [0, 1, 3, 4, 6, 7], np.arange(2, len(TEMPERATURE))] = 1.0
        slopes *= warmer[:, None, None]
    return slopes
