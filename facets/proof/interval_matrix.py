"""Interval matrices: bounds of the determinant, and tests of regularity."""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat

from ..core.units import Floats
from ..scalars.intervals import Interval, ends, hull, interval, magnitude

Matrix = list[list[Interval]]

#: A bound of the rounding errors in a sum of a few floats.
ROUNDED = 1e-12


def hull_of_matrices(matrices: list[Matrix]) -> Matrix:
    """The smallest interval matrix that contains all the given ones, which have the same shape."""
    rows, columns = len(matrices[0]), len(matrices[0][0])
    return [[hull(m[i][j] for m in matrices) for j in range(columns)] for i in range(rows)]


def middles(matrix: Matrix) -> Floats:
    return np.array([[float(x.mid()) for x in row] for row in matrix])


def determinant(matrix: Matrix) -> Interval:
    """The determinant of an interval matrix, preconditioned with its midpoint's inverse."""
    middle = middles(matrix)
    if not np.isfinite(middle).all() or np.linalg.matrix_rank(middle) < len(middle):
        return interval(-np.inf, np.inf)
    inverse = arb_mat(np.linalg.inv(middle).tolist())
    return (inverse * arb_mat(matrix)).det() / inverse.det()


def distance_from_zero(x: Interval) -> float:
    """The least absolute value in an interval, rounded down; 0 where it holds zero."""
    low, high = ends(x)
    if not np.isfinite(low) or not np.isfinite(high):
        return 0.0
    return max(low, -high, 0.0)


def determinant_bound(matrix: Matrix, slope: float, margin: float = 0.0) -> float:
    """A lower bound of |det| times a slope that is not negative; 0 if none is found.

    margin: the result of `regularity`, if it is known: no eigenvalue of C M is further than 1 -
    margin from 1, so that the determinant of C M is margin^6 or more.
    """
    bound = distance_from_zero(determinant(matrix))
    if margin > 0:
        inverse = arb_mat(np.linalg.pinv(middles(matrix)).tolist())
        bound = max(bound, distance_from_zero(arb(margin) ** len(matrix) / inverse.det()))
    return float(np.nextafter(bound * max(slope, 0.0), 0.0))


def regularity(matrix: Matrix) -> tuple[float, Floats, Floats]:
    """The margin by which |1 - C M| shrinks a positive vector, for every M in the intervals.

    If it is above 0, every matrix in the intervals is regular. Returns the margin, rounded down, C
    and the vector.
    """
    middle = middles(matrix)
    size = len(middle)
    if not np.isfinite(middle).all():
        return -np.inf, np.zeros_like(middle), np.ones(size)
    inverse = np.linalg.pinv(middle)
    left = arb_mat(inverse.tolist()) * arb_mat(matrix)
    apart: Floats = np.array(
        [[magnitude(left[i, j] - (i == j)) for j in range(size)] for i in range(size)]
    )
    vector: Floats = np.ones(size)
    for _ in range(200):
        vector = apart @ vector + 1e-9 * vector.max()
        vector /= vector.max()
    margin = float(1 - (apart @ vector / vector).max()) - ROUNDED
    return margin, np.asarray(inverse), vector
