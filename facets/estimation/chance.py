"""The largest residual that noise alone leaves, by the number of redundant readings.

The numbers of a reading and the priors in excess of the unknowns check the pose. The squared
residual of a right model follows the chi-square distribution with so many degrees of freedom; noise
alone leaves more than the limit with a chance of `FALSE_ALARM_RATE`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.calibrated import MISFIT, MODEL_ERROR
from ..detectors.noise import standard_deviations
from ..model.arrays import readings

#: The chance that the residual of a right pose is beyond its limit.
FALSE_ALARM_RATE = 1e-4
#: The residuals, in standard deviations, that noise exceeds at FALSE_ALARM_RATE with 0 to 9
#: degrees of freedom. Numbers, because the library that has the distribution loads slowly.
LIMITS = np.array([
    np.inf, 3.8905918864130937, 4.291932052578694, 4.594291399787372, 4.848993962152442,
    5.073936534787943, 5.277910688521919, 5.466031824754125, 5.641598000678736, 5.806888016740519,
])  # fmt: skip


def count_checks(detectors: int, free: NDArray[np.int64], weights: Floats) -> int:
    """The number of readings of the detectors and priors in excess of the unknowns.

    free: numbers of the unknowns.  weights: (3,) of the priors of bx, by and the power.
    """
    priors = sum(bool(weights[c - 6] > 0) for c in free.tolist() if c >= 6)
    return 3 * detectors + priors - len(free)


class Chance(NamedTuple):
    """The limits of residuals for one request.

    none: `count_checks` without a detector.  widening: see `widening_of`.
    """

    none: int
    widening: float

    def checks(self, used: NDArray[np.bool_]) -> NDArray[np.int8]:
        """The number of redundant readings of each pose (...), from the detectors used (..., 3)."""
        if used.all():  # counting takes longer than a step of the estimate
            return np.full(used.shape[:-1], max(9 + self.none, 0), np.int8)
        found = np.maximum(3 * np.count_nonzero(used, axis=-1) + self.none, 0)
        return np.asarray(found, np.int8)

    def limits(self, checks: NDArray[np.int8]) -> Floats:
        """The residuals (...) that noise alone hardly exceeds; infinite without redundancy."""
        return np.asarray(self.widening * LIMITS.take(checks))

    @property
    def limit(self) -> float:
        """The limit of a pose from all three detectors."""
        return float(self.widening * LIMITS[max(9 + self.none, 0)])


def widening_of(sensor: Sensor) -> float:
    """The factor by which a calibrated sensor's residuals exceed the noise."""
    known = sensor.calibration
    if known is None or not any(name in (*MISFIT, *MODEL_ERROR) for name in known.names):
        return 1.0
    kept: float | None = sensor.__dict__.get("_widening")
    if kept is None:
        kept = sensor.__dict__["_widening"] = measure_widening(sensor)
    return kept


def measure_widening(sensor: Sensor) -> float:
    assert sensor.calibration is not None
    noise, known = standard_deviations(sensor, readings(sensor, np.zeros(8))), sensor.calibration
    missed = {name: known.covariance[n][n] for n, name in enumerate(known.names)}
    over = [
        sum(missed.get(name, 0.0) for name in names) / s**2
        for *names, s in zip(MISFIT, MODEL_ERROR, noise, strict=True)
    ]
    return float(np.sqrt(1 + np.nanmax(over)))
