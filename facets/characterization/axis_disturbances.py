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

from ..core.units import Booleans, Floats, Integers
from .error_motions import ErrorMotions, Visits

#: Probability of a stand far off, and of a drift, in a test that has none.
CHANCE = 2e-4
#: Highest order of a drift's polynomial, and the statistical freedom that each order needs.
MAX_ORDER, FREEDOM_PER_ORDER = 6, 6
#: Most stands that are looked at as far off; also at most an eighth of all.
MAX_FAR = 20
#: Draws from which the sensor's own scatter is taken.
NOISE_DRAWS = 100


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
    place = (..., visits.target, visits.direction, visits.run)
    values, sides = motions.values[place].T, 2 * visits.target + visits.direction
    errors = subtract_means(np.moveaxis(motions.draws[:, :NOISE_DRAWS][place], -1, 0), sides)
    noise = np.mean(errors**2, axis=(0, 2)) * len(sides) / max(1, freedom_of(sides))
    distances = find_far_stands(values, sides, visits.time, noise)
    trend, scatter = np.zeros_like(values), np.zeros((6, motions.draws.shape[1], len(sides)))
    rest = ~distances.any(axis=1)
    trend[rest], scatter[..., rest] = fit_drift(
        values[rest], sides[rest], visits.time[rest], noise, motions.draws.shape[1]
    )
    return Disturbances(distances, trend, scatter)


def freedom_of(sides: Integers) -> int:
    """Degrees of freedom of stands (k,) beside a mean for each side of each position."""
    return len(sides) - len(np.unique(sides))


def subtract_means(values: Floats, sides: Integers) -> Floats:
    """Values (k, ...) less the mean of those with the same number in `sides` (k,)."""
    member = np.unique(sides)[:, None] == sides
    means = np.tensordot(member / member.sum(axis=1, keepdims=True), values, axes=1)
    found: Floats = values - means[member.argmax(axis=0)]
    return found


def time_functions(time: Floats, sides: Integers) -> tuple[Floats, Floats]:
    """Polynomials in time (k, orders), and the same less their means over each side, where they
    are orthonormal; the first n are those up to order n."""
    orders = min(MAX_ORDER, freedom_of(sides) // FREEDOM_PER_ORDER)
    scaled = 2 * (time - time.min()) / max(np.ptp(time), 1e-300) - 1
    functions = np.polynomial.legendre.legvander(scaled, orders)[:, 1:]
    across, triangle = np.linalg.qr(subtract_means(functions, sides))
    return functions @ np.linalg.pinv(triangle), across


def find_far_stands(values: Floats, sides: Integers, time: Floats, noise: Floats) -> Floats:
    """Distances (k, 6) of stands that are far off, in the value that shows it; else 0.

    values: (k, 6).  noise: (6,) variance by the sensor, below which no scatter counts. The farthest
    stand is taken out again and again, and those up to the last that is beyond chance are far off:
    one hides another (Rosner's generalised test).
    """
    from scipy.special import stdtr

    rest, suspects, count = np.arange(len(time)), [], 0
    for _ in range(min(MAX_FAR, len(time) // 8)):
        _, across = time_functions(time[rest], sides[rest])
        freedom = freedom_of(sides[rest]) - across.shape[1] - 1
        if freedom < FREEDOM_PER_ORDER:
            break
        residuals = subtract_means(values[rest], sides[rest])
        residuals -= across @ (across.T @ residuals)
        stands = (sides[rest, None] == sides[rest]).sum(axis=1)
        share = 1 - 1 / stands - (across**2).sum(axis=1)  # of a stand's distance in its residual
        share[stands < 3] = np.inf  # of two, nobody knows which is off
        squares = residuals**2 / share[:, None]
        others = (residuals**2).sum(axis=0) - squares
        ratios = squares / np.maximum(others / freedom, noise)
        worst, component = np.unravel_index(ratios.argmax(), ratios.shape)
        suspects.append((rest[worst], component))
        if 2 * stdtr(freedom, -np.sqrt(ratios[worst, component])) * ratios.size < CHANCE:
            count = len(suspects)
        rest = np.delete(rest, worst)
    distances = np.zeros_like(values)
    for stand, component in suspects[:count]:
        others = values[sides == sides[stand], component]
        distances[stand, component] = values[stand, component] - np.median(others)
    return distances


def fit_drift(
    values: Floats, sides: Integers, time: Floats, noise: Floats, draws: int
) -> tuple[Floats, Floats]:
    """The drift (k, 6) of values (k, 6), 0 where it is not beyond chance, and draws (6, draws, k)
    of its errors; noise as of `find_far_stands`."""
    from scipy.special import fdtrc

    functions, across = time_functions(time, sides)
    trend, errors = np.zeros_like(values), np.zeros((values.shape[1], draws, len(time)))
    order = np.arange(1, functions.shape[1] + 1)
    freedom, rng = freedom_of(sides) - order, np.random.default_rng(1)
    for n, column in enumerate(subtract_means(values, sides).T if len(order) else ()):
        sizes = across.T @ column
        explained = np.cumsum(sizes**2)
        variance = np.maximum((column @ column - explained) / freedom, noise[n])
        # Schwarz's criterion takes the order, and the test pays for the choice.
        best = int(np.argmin(len(time) * np.log(variance * freedom) + np.log(len(time)) * order))
        ratio = explained[best] / order[best] / variance[best]
        if fdtrc(order[best], freedom[best], ratio) * values.shape[1] * len(order) < CHANCE:
            chosen = functions[:, : order[best]]
            trend[:, n] = chosen @ sizes[: order[best]]
            wide = rng.standard_normal((draws, order[best])) * np.sqrt(variance[best])
            errors[n] = wide @ chosen.T
    return trend, errors
