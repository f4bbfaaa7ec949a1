"""Allan deviation of a signal with gaps, with confidence intervals.

The overlapping estimate of the variance for averages over tau (IEEE 1139) is half the mean square
of the differences of neighbouring averages. Its equivalent degrees of freedom follow the
approximations of NIST SP 1065, table 5, for white, flicker or random-walk noise, whichever fits the
slope of the deviations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.units import Floats

#: Number of averaging times per decade.
TIMES_PER_DECADE = 6

#: Largest relative error of a recording's clock: a time this close outside the computed averaging
#: times still has a deviation.
CLOCK_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Allan:
    """Averaging times (n,), s; deviations (n,) and the ends of their confidence intervals."""

    tau: Floats
    deviation: Floats
    low: Floats
    high: Floats

    def interpolate(self, tau: float) -> float:
        """Interpolate the deviation at an averaging time, s; NaN outside the computed times."""
        factor = 1 + CLOCK_TOLERANCE
        if not self.tau[0] / factor <= tau <= self.tau[-1] * factor:
            return math.nan
        return float(np.exp(np.interp(np.log(tau), np.log(self.tau), np.log(self.deviation))))


def allan(signal: Floats, rate: float, level: float = 0.95) -> Allan:
    """Compute the Allan deviations of a signal.

    signal: (n,) evenly spaced; NaN in gaps, which no average spans.  rate: of sampling, Hz.  level:
    probability that a confidence interval holds, above 0 and below 1.
    """
    from scipy.special import gammaincinv

    is_finite = np.isfinite(signal)
    total = np.concatenate(
        [[0.0], np.cumsum(np.where(is_finite, signal - np.nanmean(signal), 0.0))]
    )
    count = np.concatenate([[0], np.cumsum(is_finite)])
    decades = np.log10(max(1.0, len(signal) / 4))
    lengths = np.unique(np.logspace(0, decades, int(TIMES_PER_DECADE * decades) + 1).astype(int))
    rows = []
    for m in lengths.tolist():
        mean = (total[m:] - total[:-m]) / m
        is_complete = count[m:] - count[:-m] == m
        steps = (mean[m:] - mean[:-m])[is_complete[m:] & is_complete[:-m]]
        if len(steps) < 2:
            continue
        rows.append((m, float(np.sqrt(np.mean(steps**2) / 2)), len(steps)))
    m, deviation, difference_counts = np.array(rows).T
    slope = np.gradient(np.log(np.maximum(deviation, 1e-300)), np.log(m)) if len(m) > 1 else [-0.5]
    freedom = np.array([
        degrees_of_freedom(differences + 2 * int(m_), int(m_), float(s))
        for m_, differences, s in zip(m, difference_counts, slope, strict=True)
    ])  # fmt: skip
    low = deviation * np.sqrt(freedom / (2 * gammaincinv(freedom / 2, (1 + level) / 2)))
    high = deviation * np.sqrt(freedom / (2 * gammaincinv(freedom / 2, (1 - level) / 2)))
    return Allan(m / rate, deviation, low, high)


def degrees_of_freedom(points: float, m: int, slope: float) -> float:
    """Degrees of freedom of the overlapping estimate for averages over m samples.

    points: number of points of the summed signal.  slope: of the deviation over the averaging time,
    both as logarithms: -1/2 for white noise, 0 for flicker noise, 1/2 for a random walk.
    """
    n = float(points)
    if slope < -0.25:
        freedom = (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5)
    elif slope < 0.25:
        freedom = 2 * (n - 2) ** 2 / (2.3 * n - 4.9) if m == 1 else 5 * n**2 / (4 * m * (n + 3 * m))
    else:
        freedom = (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2) / (n - 3) ** 2
    return max(1.0, freedom)
