"""Normal equations of up to nine unknowns and nine readings: text for `kernels`.

Matrices are layers (10, 10) of one array, the workspace's, of which the lower triangle of the first
`count` rows is used. A layer of normal equations holds J'J and, in its last row, J'r. The lengths
of the inner sums over readings are known to the compiler.
"""

from __future__ import annotations

from math import sqrt

from .problem import Array

#: A pivot that is less than this share of its diagonal element has no digits that rounding leaves:
#: the condition number of J, columns scaled, is then above some 1e6.
MIN_PIVOT_SHARE = 1e-13
#: The row of a layer that holds J'r, the residuals r in a layer of columns, and a solution.
LAST = 9


def multiply(layers: Array, columns: int, normal: int, count: int) -> None:
    """Layer `normal` from layer `columns`, which has the columns of J as rows and r as the last."""
    for i in range(count):
        a0, a1, a2 = layers[columns, i, 0], layers[columns, i, 1], layers[columns, i, 2]
        a3, a4, a5 = layers[columns, i, 3], layers[columns, i, 4], layers[columns, i, 5]
        a6, a7, a8 = layers[columns, i, 6], layers[columns, i, 7], layers[columns, i, 8]
        for k in range(i + 2):
            j = k if k <= i else LAST
            total = (
                (a0 * layers[columns, j, 0] + a1 * layers[columns, j, 1])
                + (a2 * layers[columns, j, 2] + a3 * layers[columns, j, 3])
                + (a4 * layers[columns, j, 4] + a5 * layers[columns, j, 5])
                + (a6 * layers[columns, j, 6] + a7 * layers[columns, j, 7])
                + a8 * layers[columns, j, 8]
            )
            if k <= i:
                layers[normal, i, j] = total
            else:
                layers[normal, LAST, i] = total


def factorise(layers: Array, normal: int, factor: int, count: int, damping: float) -> bool:
    """Cholesky: L L' = J'J with its diagonal raised by `damping` of itself.

    The diagonal of L is kept as its inverse. False where a pivot is too small to be trusted.
    """
    for j in range(count):
        whole = layers[normal, j, j] * (1 + damping)
        pivot = whole
        for k in range(j):
            pivot -= layers[factor, j, k] * layers[factor, j, k]
        if not pivot > MIN_PIVOT_SHARE * whole:
            return False
        inverse = 1 / sqrt(pivot)
        layers[factor, j, j] = inverse
        for i in range(j + 1, count):
            rest = layers[normal, i, j]
            for k in range(j):
                rest -= layers[factor, i, k] * layers[factor, j, k]
            layers[factor, i, j] = rest * inverse
    return True


def solve_cholesky(layers: Array, normal: int, factor: int, count: int) -> float:
    """Solves L L' step = J'r; the step is put in the factor's last row.

    Returns by how much the step lessens the sum of squares.
    """
    gain = 0.0
    for i in range(count):
        rest = layers[normal, LAST, i]
        for k in range(i):
            rest -= layers[factor, i, k] * layers[factor, LAST, k]
        rest *= layers[factor, i, i]
        layers[factor, LAST, i] = rest
        gain += rest * rest
    for i in range(count - 1, -1, -1):
        rest = layers[factor, LAST, i]
        for k in range(i + 1, count):
            rest -= layers[factor, k, i] * layers[factor, LAST, k]
        layers[factor, LAST, i] = rest * layers[factor, i, i]
    return gain


def covariance_of(layers: Array, factor: int, inverse: int, covariance: int, count: int) -> None:
    """(L L')^-1 into layer `covariance`; `inverse` is memory."""
    for j in range(count):
        layers[inverse, j, j] = layers[factor, j, j]
        for i in range(j + 1, count):
            rest = 0.0
            for k in range(j, i):
                rest += layers[factor, i, k] * layers[inverse, k, j]
            layers[inverse, i, j] = -rest * layers[factor, i, i]
    for i in range(count):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, count):
                total += layers[inverse, k, i] * layers[inverse, k, j]
            layers[covariance, i, j] = total
            layers[covariance, j, i] = total
