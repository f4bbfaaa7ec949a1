"""Stands of an axis that are far off the others, and drift during a test.

Stands at one position, approached from one side, differ by the axis's scatter, by a drift, and
where something went wrong. A drift is a polynomial in time that is fitted beside a mean for each
position and side, so that no error motion is taken for it, nor it for one. A stand is far off if
its distance from this fit, without it, is beyond chance (Student's t); a drift is one if it
explains more than chance does (F test).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core import Booleans, Floats, Integers
from .error_motions import ErrorMotions, Visits

#: Probability of a stand far off, and of a drift, in a test that has none.
CHANCE = 1e-4
#: Highest order of a drift's polynomial, and the statistical freedom that each order needs.
MAX_ORDER, FREEDOM_PER_ORDER = 4, 6
#: Most stands that are looked at as far off; also at most an eighth of all.
MAX_FAR = 20
#: A variance that rounding explains: of a picometre or a nanoradian.
LEAST_VARIANCE = 1e-18


class Disturbances(NamedTuple):
    """What disturbed the k stands of a test.

    distances: (k, 6) of stands that are far off, from the others in the error motion that shows it;
    else 0.  trend: (k, 6) the drift of each error motion, 0 without one.  errors: (6, draws, k)
    draws of the trend's errors.
    """

    distances: Floats
    trend: Floats
    errors: Floats

    @property
    def is_far(self) -> Booleans:
        """Whether a stand is far off (k,)."""
        return np.asarray(self.distances.any(axis=1))


def find_disturbances(visits: Visits, motions: ErrorMotions) -> Disturbances:
    """Find stands that are far off, and the drift of each error motion without them.

    Parameters
    ----------
    visits, motions
        The stands of a test and its error motions.

    Returns
    -------
    Disturbances
        In mm and rad.
    """
    from scipy.special import fdtrc

    place = (..., visits.target, visits.direction, visits.run)
    values, sides = motions.values[place].T, 2 * visits.target + visits.direction
    distances = find_far_stands(values, sides, visits.time)
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
    """Polynomials in time that are fitted to n values (k, n) beside a mean for each side.

    functions: (k, q).  sizes: (q, n) of these in the values; independent, with the variance of a
    value.  residuals: (k, n).  share: (k,) of a stand's own distance in its residual; infinite
    where nobody knows which of two stands is off.  freedom: degrees of freedom of the residuals.
    """

    functions: Floats
    sizes: Floats
    residuals: Floats
    share: Floats
    freedom: int


def fit_drift(values: Floats, sides: Integers, time: Floats) -> DriftFit:
    """Fit a drift to values (k, n) at times (k,); sides: (k,) numbers of position and direction."""
    member = np.unique(sides)[:, None] == sides
    side, stands = member.argmax(axis=0), member.sum(axis=1)

    def subtract_means(x: Floats) -> Floats:
        return np.asarray(x - (member @ x / stands[:, None])[side])

    freedom = len(time) - len(stands)
    orders = min(MAX_ORDER, freedom // FREEDOM_PER_ORDER)
    scaled = np.interp(time, [time.min(), time.max()], [-1, 1])
    powers = np.asarray(np.polynomial.legendre.legvander(scaled, orders)[:, 1:], dtype=float)
    across, triangle = np.linalg.qr(subtract_means(powers))
    sizes = across.T @ values
    share = np.where(stands > 2, 1 - 1 / stands, np.inf)[side] - (across**2).sum(axis=1)
    residuals = subtract_means(values) - across @ sizes
    return DriftFit(powers @ np.linalg.pinv(triangle), sizes, residuals, share, freedom - orders)


def find_far_stands(values: Floats, sides: Integers, time: Floats) -> Floats:
    """Distances (k, 6) of stands that are far off, in the value that shows it; else 0.

    Arguments as of `fit_drift`. The farthest stand is taken out again and again, and those up to
    the last that is beyond chance are far off: one hides another (Rosner's generalised test).
    """
    from scipy.special import stdtr

    rest, suspects, count = np.arange(len(time)), [], 0
    for _ in range(min(MAX_FAR, len(time) // 8)):
        fit = fit_drift(values[rest], sides[rest], time[rest])
        freedom = max(1, fit.freedom - 1)
        squares = fit.residuals**2 / fit.share[:, None]
        others = (fit.residuals**2).sum(axis=0) - squares
        ratios = squares / np.maximum(others / freedom, LEAST_VARIANCE)
        worst, component = np.unravel_index(ratios.argmax(), ratios.shape)
        suspects.append((rest[worst], component))
        if stdtr(freedom, -np.sqrt(ratios[worst, component])) * 2 * ratios.size < CHANCE:
            count = len(suspects)
        rest = np.delete(rest, worst)
    distances = np.zeros_like(values)
    for stand, component in suspects[:count]:
        alike = values[sides == sides[stand], component]
        distances[stand, component] = values[stand, component] - np.median(alike)
    return distances
