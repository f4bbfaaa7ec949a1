"""Outlying dwells of an axis, and drift during a test.

Dwells at one position, approached from one side, differ by the axis's scatter, by drift, and by
disturbances. Drift is a polynomial in time that is fitted together with a mean for each position
and side, so that drift and error motions are not confused. A dwell is an outlier if its distance
from a fit without it is beyond chance (Student's t); drift is reported if it explains more than
chance does (F test).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core import Booleans, Floats, Integers
from .error_motions import ErrorMotions, Visits

#: Probability of reporting an outlier, and of reporting drift, in a test without any.
CHANCE = 1e-4
#: Highest order of the drift's polynomial, and the degrees of freedom that each order requires.
MAX_ORDER, FREEDOM_PER_ORDER = 4, 6
#: Largest number of outliers that are sought; also at most an eighth of all dwells.
MAX_FAR = 20
#: Variances below this are rounding errors: it is that of a picometre or a nanoradian.
LEAST_VARIANCE = 1e-18


class Disturbances(NamedTuple):
    """Outliers and drift among the k dwells of a test.

    distances: (k, 6) distance of each outlier from the other dwells, in the error motion that shows
    it; else 0.  trend: (k, 6) drift of each error motion; 0 without drift.  errors: (6, draws, k)
    draws of the trend's errors.
    """

    distances: Floats
    trend: Floats
    errors: Floats

    @property
    def is_far(self) -> Booleans:
        """Whether each dwell is an outlier: (k,)."""
        return np.asarray(self.distances.any(axis=1))


def find_disturbances(visits: Visits, motions: ErrorMotions) -> Disturbances:
    """Find outlying dwells, and the drift of each error motion without them.

    Parameters
    ----------
    visits, motions
        The dwells of a test and its error motions.

    Returns
    -------
    Disturbances
        In mm and rad.
    """
    from scipy.special import fdtrc

    place = (..., visits.target, visits.direction, visits.run)
    values, sides = motions.values[place].T, 2 * visits.target + visits.direction
    distances = find_outliers(values, sides, visits.time)
    rest = ~distances.any(axis=1)
    fit = fit_drift(values[rest], sides[rest], visits.time[rest])
    orders = max(1, len(fit.sizes))
    variance = np.maximum((fit.residuals**2).sum(axis=0) / max(1, fit.freedom), LEAST_VARIANCE)
    ratio = (fit.sizes**2).sum(axis=0) / orders / variance
    is_drift = values.shape[1] * fdtrc(orders, fit.freedom, ratio) < CHANCE
    trend, errors = np.zeros_like(values), np.zeros_like(motions.draws[place])
    trend[rest] = fit.functions @ (fit.sizes * is_drift)
    random = np.random.default_rng(1).standard_normal((*errors.shape[:2], len(fit.sizes)))
    errors[..., rest] = (is_drift * np.sqrt(variance))[:, None, None] * random @ fit.functions.T
    return Disturbances(distances, trend, errors)


class DriftFit(NamedTuple):
    """Polynomials in time, fitted to n values (k, n) together with a mean for each side.

    functions: (k, q) the polynomials, orthogonal.  sizes: (q, n) their coefficients in the values;
    they are independent and have the variance of a value.  residuals: (k, n).  fraction: (k,)
    fraction of a dwell's own deviation that remains in its residual; infinite for one of only two
    dwells, because it is unknown which of the two deviates.  freedom: degrees of freedom of the
    residuals.
    """

    functions: Floats
    sizes: Floats
    residuals: Floats
    fraction: Floats
    freedom: int


def fit_drift(values: Floats, sides: Integers, time: Floats) -> DriftFit:
    """Fit a drift to values (k, n) at times (k,); sides: (k,) numbers of position and direction."""
    member = np.unique(sides)[:, None] == sides
    side, dwells = member.argmax(axis=0), member.sum(axis=1)

    def subtract_means(x: Floats) -> Floats:
        """Columns (n, ...) less their means over the dwells of each position and direction."""
        return np.asarray(x - (member @ x / dwells[:, None])[side])

    freedom = len(time) - len(dwells)
    orders = min(MAX_ORDER, freedom // FREEDOM_PER_ORDER)
    scaled = np.interp(time, [time.min(), time.max()], [-1, 1])
    powers = np.asarray(np.polynomial.legendre.legvander(scaled, orders)[:, 1:], dtype=float)
    across, triangle = np.linalg.qr(subtract_means(powers))
    sizes = across.T @ values
    fraction = np.where(dwells > 2, 1 - 1 / dwells, np.inf)[side] - (across**2).sum(axis=1)
    residuals = subtract_means(values) - across @ sizes
    return DriftFit(powers @ np.linalg.pinv(triangle), sizes, residuals, fraction, freedom - orders)


def find_outliers(values: Floats, sides: Integers, time: Floats) -> Floats:
    """The distances (k, 6) of outlying dwells, in the value that shows it; else 0.

    The dwell with the largest deviation is removed, one after the other; all up to the last one
    beyond chance are outliers, because outliers mask each other (Rosner's generalised test). The
    arguments are those of `fit_drift`.
    """
    from scipy.special import stdtr

    rest, suspects, count = np.arange(len(time)), [], 0
    for _ in range(min(MAX_FAR, len(time) // 8)):
        fit = fit_drift(values[rest], sides[rest], time[rest])
        freedom = max(1, fit.freedom - 1)
        squares = fit.residuals**2 / fit.fraction[:, None]
        others = (fit.residuals**2).sum(axis=0) - squares
        ratios = squares / np.maximum(others / freedom, LEAST_VARIANCE)
        worst, component = np.unravel_index(ratios.argmax(), ratios.shape)
        suspects.append((rest[worst], component))
        if stdtr(freedom, -np.sqrt(ratios[worst, component])) * 2 * ratios.size < CHANCE:
            count = len(suspects)
        rest = np.delete(rest, worst)
    distances = np.zeros_like(values)
    for dwell, component in suspects[:count]:
        alike = values[sides == sides[dwell], component]
        distances[dwell, component] = values[dwell, component] - np.median(alike)
    return distances
