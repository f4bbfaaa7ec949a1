"""Allan deviation of a signal with gaps, with confidence intervals.

The overlapping estimate for averages over tau (IEEE 1139) is half the mean square of the difference
of neighbouring averages. Its equivalent degrees of freedom are the approximations of NIST SP 1065,
table 5, for white, flicker and random-walk noise, chosen by the slope of the deviations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.units import Floats

#: Number of averaging times for each factor of ten.
TIMES_PER_DECADE = 6

#: Largest relative error of a recording's clock for which a time still counts as a computed one.
CLOCK_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Allan:
    """Averaging times (n,), s; deviations (n,) and the ends of their confidence intervals."""

    tau: Floats
    deviation: Floats
    low: Floats
    high: Floats

    def interpolate(self, tau: float) -> float:
        """The deviation at an averaging time, s, between the computed ones; NaN outside them."""
        factor = 1 + CLOCK_TOLERANCE
        if not self.tau[0] / factor <= tau <= self.tau[-1] * factor:
            return math.nan
        return float(np.exp(np.interp(np.log(tau), np.log(self.tau), np.log(self.deviation))))


def allan(signal: Floats, rate: float, level: float = 0.95) -> Allan:
    """Compute the Allan deviations of a signal.

    signal: (n,) evenly spaced; NaN in gaps, which no average spans.  rate: Hz.  level: confidence.
    """
    from scipy.special import gammaincinv

    there = np.isfinite(signal)
    total = np.concatenate([[0.0], np.cumsum(np.where(there, signal - np.nanmean(signal), 0.0))])
    count = np.concatenate([[0], np.cumsum(there)])
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
    m, deviation, used = np.array(rows).T
    slope = np.gradient(np.log(np.maximum(deviation, 1e-300)), np.log(m)) if len(m) > 1 else [-0.5]
    freedom = np.array([
        degrees_of_freedom(used_ + 2 * int(m_), int(m_), float(s))
        for m_, used_, s in zip(m, used, slope, strict=True)
    ])  # fmt: skip
    low = deviation * np.sqrt(freedom / (2 * gammaincinv(freedom / 2, (1 + level) / 2)))
    high = deviation * np.sqrt(freedom / (2 * gammaincinv(freedom / 2, (1 - level) / 2)))
    return Allan(m / rate, deviation, low, high)


def degrees_of_freedom(points: float, m: int, slope: float) -> float:
    """Degrees of freedom of the overlapping estimate over m samples.

    points: number of points of the summed signal.  slope: slope of the deviation's logarithm: -1/2
    for white noise, 0 for flicker, 1/2 for a random walk.
    """
    n = float(points)
    if slope < -0.25:
        freedom = (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m**2 / (4 * m**2 + 5)
    elif slope < 0.25:
        freedom = 2 * (n - 2) ** 2 / (2.3 * n - 4.9) if m == 1 else 5 * n**2 / (4 * m * (n + 3 * m))
    else:
        freedom = (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m**2) / (n - 3) ** 2
    return max(1.0, freedom)
