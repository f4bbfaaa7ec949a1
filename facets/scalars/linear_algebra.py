"""Small linear algebra as straight code: matrices are lists of numbers of any kind.

Lower triangles are lists of rows, each as long as its number plus one. Lengths are those of the
lists, so that nothing is left of the loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .dispatch import maximum

#: Smallest ratio of a pivot to its diagonal element at which the pivot has digits that are not lost
#: to rounding. Below it, the condition number of J with scaled columns is above some 1e6.
MIN_PIVOT_RATIO = 1e-13
#: Lower bound of pivots, so that their inverses are finite.
MIN_PIVOT = 1e-300

Numbers = list[Any]
Triangle = Sequence[Sequence[Any]]


def product(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """The sum of products, by halves, which processors can compute at the same time."""
    if len(a) == 1:
        return a[0] * b[0]
    half = len(a) // 2
    return product(a[:half], b[:half]) + product(a[half:], b[half:])


def normal_equations(
    columns: Sequence[Sequence[Any]], residuals: Numbers
) -> tuple[list[Numbers], Numbers]:
    """J'J and J'r from the columns of J."""
    matrix = [[product(a, b) for b in columns[: i + 1]] for i, a in enumerate(columns)]
    return matrix, [product(column, residuals) for column in columns]


def factorise(matrix: Triangle, damping: Any) -> tuple[Triangle, Any]:
    """The factor L of L D L' = matrix, and whether all pivots are accurate.

    The matrix's diagonal is first increased by the fraction `damping`. L has a unit diagonal, in
    whose place the inverse of D is stored. There are no roots, because they would delay the next
    row.
    """
    factor: list[tuple[Any, ...]] = []
    fine: Any = None
    for row in matrix:
        pivot = diagonal = row[-1] * (1 + damping)
        row_factors: Numbers = []
        scaled: Numbers = []
        for earlier, rest in zip(factor, row[:-1], strict=True):
            for a, b in zip(scaled, earlier, strict=False):
                rest = rest - a * b
            scaled.append(rest)
            row_factors.append(rest * earlier[-1])
        for a, b in zip(scaled, row_factors, strict=True):
            pivot = pivot - a * b
        trusted = pivot > MIN_PIVOT_RATIO * diagonal
        fine = trusted if fine is None else fine & trusted
        factor.append((*row_factors, 1 / maximum(pivot, MIN_PIVOT)))
    return tuple(factor), fine


def solution(factor: Triangle, right: Sequence[Any]) -> tuple[Numbers, Any]:
    """The solution x of L D L' x = right, and the decrease of the sum of squares by x."""
    middle: Numbers = []
    result: Numbers = []
    gain: Any = 0.0
    for row, rest in zip(factor, right, strict=True):
        for value, each in zip(middle, row, strict=False):
            rest = rest - each * value
        middle.append(rest)
        result.append(rest * row[-1])
        gain = gain + rest * result[-1]
    for i in range(len(result) - 1, -1, -1):
        for k in range(i + 1, len(result)):
            result[i] = result[i] - factor[k][i] * result[k]
    return result, gain


def inverse(factor: Triangle) -> list[Numbers]:
    """The inverse (L D L')^-1, with both triangles."""
    size = len(factor)
    # L^-1 without its diagonal
    below: list[Numbers] = [[0.0 for _ in range(i)] for i in range(size)]
    for j in range(size):
        for i in range(j + 1, size):
            rest = factor[i][j]
            for k in range(j + 1, i):
                rest = rest + factor[i][k] * below[k][j]
            below[i][j] = -rest
    result: list[Numbers] = [[0.0 for _ in range(size)] for _ in range(size)]
    for i in range(size):
        after = zip(below[i + 1 :], factor[i + 1 :], strict=True)
        scaled = [row[i] * pivot_row[-1] for row, pivot_row in after]
        for j in range(i + 1):
            total = factor[i][-1] if j == i else factor[i][-1] * below[i][j]
            for k, each in enumerate(scaled, i + 1):
                total = total + each * below[k][j]
            result[i][j] = result[j][i] = total
    return result
