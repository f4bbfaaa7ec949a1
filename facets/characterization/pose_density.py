"""One-sided density of a pose's noise at rest, and its Allan deviation.

The noise of the readings is multiplied by the gains of the estimator (`resolution`). With white
noise of the density variance / bandwidth and the slow noise of `Sensor.drift`, an axis has the
density

    S(f) = white + flicker / f + walk / f^2,

and for averages over tau, which are long compared with a sample, the Allan variance (IEEE 1139)

    white / (2 tau) + 2 ln(2) flicker + (2 pi^2 / 3) walk tau.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.rigid_body import MeasuredObject, displacement_slopes
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.drift import flicker_densities
from ..detectors.noise import variances
from ..detectors.temperature import PLACES
from ..model.arrays import jacobian, readings
from .resolution import Estimator, estimator_gains

#: Frequencies at which densities are stated, Hz, and averaging times of Allan deviations, s.
FREQUENCIES = {"10mhz": 0.01, "1hz": 1.0, "100hz": 100.0}
AVERAGING_TIMES = {"1s": 1.0, "100s": 100.0, "1000s": 1000.0}


class PoseDensity(NamedTuple):
    """Parts (6,) of the density of the axes' noise, mm^2/Hz and rad^2/Hz at 1 Hz."""

    white: Floats
    flicker: Floats
    walk: Floats

    def amplitude(self, frequency: float) -> Floats:
        """Amplitude density (6,) at a frequency in Hz: mm/sqrt(Hz), rad/sqrt(Hz)."""
        root: Floats = np.sqrt(self.white + self.flicker / frequency + self.walk / frequency**2)
        return root

    def allan_deviation(self, tau: float) -> Floats:
        """Allan deviation (6,) of averages over tau, s: mm, rad."""
        root: Floats = np.sqrt(
            self.white / (2 * tau)
            + 2 * np.log(2) * self.flicker
            + 2 * np.pi**2 / 3 * self.walk * tau
        )
        return root


def density_at_rest(
    sensor: Sensor, how: Estimator, bandwidth: float, body: MeasuredObject | None = None
) -> PoseDensity:
    """Compute the density of the pose's noise at rest.

    bandwidth: that of the readings' white noise, Hz, which is the bandwidth of the electronics or
    half the sampling rate, whichever is less.  body: object whose displacement has these axes;
    None: the mirror.
    """
    rest = np.zeros((1, 8))
    reading = readings(sensor, rest)
    variance = variances(sensor, reading)[0].sum(axis=-1)
    sigma, slopes = np.sqrt(variance), jacobian(sensor, rest)
    rows, weighted = slopes / sigma[:, None], reading / sigma
    count = 8 if how.eight else 9
    gains = estimator_gains(sensor, rows, weighted, how.knowledge, how.eight)[0]
    gains = gains[:, :count] / sigma[:count]
    if body is not None:
        gains = displacement_slopes(rest[:, :6], body)[0] @ gains
    of_beam, warm = slopes[0, :, 6:], np.zeros(9)
    warm[PLACES] = sensor.thermal.places
    warm += of_beam @ np.array(sensor.thermal.beam)
    square, drift = gains**2, sensor.drift
    return PoseDensity(
        square @ variance[:count] / bandwidth,
        square @ flicker_densities(sensor, reading)[0, :count],
        ((gains @ of_beam[:count]) ** 2).sum(axis=1) * drift.pointing**2
        + (gains @ warm[:count]) ** 2 * drift.temperature**2,
    )
