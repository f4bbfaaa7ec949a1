"""Interval matrices: bounds of the determinant, and tests of regularity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from flint import arb, arb_mat
from numpy.typing import NDArray

from ..core.units import Floats
from ..scalars.intervals import Interval, ends, interval, magnitude

#: An array of intervals; NumPy calls the operators of its elements.
Intervals = NDArray[Any]

#: The smallest interval that contains two, and the largest absolute value, for each element.
UNION: Any = np.frompyfunc(arb.union, 2, 1)
MAGNITUDE: Any = np.frompyfunc(magnitude, 1, 1)
#: A bound of the rounding errors in a sum of a few floats.
ROUNDED = 1e-12


def hull_of_arrays(arrays: Sequence[Intervals]) -> Intervals:
    """The smallest array of intervals that contains all of some arrays of one shape."""
    hull: Intervals = UNION.reduce(arrays)
    return hull


def middles(matrix: Intervals) -> Floats:
    """The midpoints of a matrix of intervals, as floats of the same shape."""
    return np.array([[float(x.mid()) for x in row] for row in matrix])


def determinant(matrix: Intervals) -> Interval:
    """The determinant of an interval matrix, preconditioned with its midpoint's inverse; unbounded
    if the midpoint is singular."""
    middle = middles(matrix)
    if not np.isfinite(middle).all() or np.linalg.matrix_rank(middle) < len(middle):
        return interval(-np.inf, np.inf)
    inverse = arb_mat(np.linalg.inv(middle).tolist())
    return (inverse * arb_mat(matrix.tolist())).det() / inverse.det()


def distance_from_zero(x: Interval) -> float:
    """The least absolute value in an interval, rounded down; 0 if the interval contains zero or is
    not bounded."""
    low, high = ends(x)
    if not np.isfinite(low) or not np.isfinite(high):
        return 0.0
    return max(low, -high, 0.0)


def determinant_bound(matrix: Intervals, slope: float, margin: float = 0.0) -> float:
    """A lower bound of |det| times a slope that is not negative; 0 if none is found.

    margin: the result of `regularity`, if it is known: no eigenvalue of C M is further than 1 -
    margin from 1, so that the determinant of C M is margin^6 or more.
    """
    bound = distance_from_zero(determinant(matrix))
    if margin > 0:
        inverse = arb_mat(np.linalg.pinv(middles(matrix)).tolist())
        bound = max(bound, distance_from_zero(arb(margin) ** len(matrix) / inverse.det()))
    return float(np.nextafter(bound * max(slope, 0.0), 0.0))


def regularity(matrix: Intervals) -> tuple[float, Floats, Floats]:
    """The margin by which |1 - C M| shrinks a positive vector, for every M in the intervals.

    If it is above 0, every matrix in the intervals is regular. Returns the margin, rounded down, C
    (k, k) and the vector (k,). The margin is minus infinity if the midpoint of M is not finite.
    """
    middle = middles(matrix)
    size = len(middle)
    if not np.isfinite(middle).all():
        return -np.inf, np.zeros_like(middle), np.ones(size)
    inverse = np.linalg.pinv(middle)
    product = arb_mat(inverse.tolist()) * arb_mat(matrix.tolist())
    distances = MAGNITUDE(np.array(product.tolist()) - np.eye(size, dtype=int)).astype(float)
    vector: Floats = np.ones(size)
    for _ in range(200):
        vector = distances @ vector + 1e-9 * vector.max()
        vector /= vector.max()
    margin = float(1 - (distances @ vector / vector).max()) - ROUNDED
    return margin, np.asarray(inverse), vector
