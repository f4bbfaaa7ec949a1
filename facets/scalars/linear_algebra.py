"""Small linear algebra as straight code: matrices are lists of numbers of any kind.

Lower triangles are lists of rows, each as long as its number plus one. Lengths are those of the
lists, so that nothing is left of the loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .dispatch import maximum

#: A pivot that is less than this share of its diagonal element has no digits that rounding leaves:
#: the condition number of J, columns scaled, is then above some 1e6.
MIN_PIVOT_SHARE = 1e-13
#: A lesser pivot is none.
LEAST_PIVOT = 1e-300

Numbers = list[Any]
Triangle = Sequence[Sequence[Any]]


def product(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """The sum of products, by halves, which do not wait for each other."""
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
    """L with L D L' = matrix, its diagonal raised by `damping` of itself, whose diagonal is 1 and
    holds the inverse of D; and whether each pivot can be trusted.

    Without roots, for which the next row would wait.
    """
    factor: list[tuple[Any, ...]] = []
    fine: Any = None
    for row in matrix:
        pivot = whole = row[-1] * (1 + damping)
        own: Numbers = []
        scaled: Numbers = []
        for known, rest in zip(factor, row[:-1], strict=True):
            for one, other in zip(scaled, known, strict=False):
                rest = rest - one * other
            scaled.append(rest)
            own.append(rest * known[-1])
        for one, other in zip(scaled, own, strict=True):
            pivot = pivot - one * other
        trusted = pivot > MIN_PIVOT_SHARE * whole
        fine = trusted if fine is None else fine & trusted
        factor.append((*own, 1 / maximum(pivot, LEAST_PIVOT)))
    return tuple(factor), fine


def solution(factor: Triangle, right: Sequence[Any]) -> tuple[Numbers, Any]:
    """The solution of L D L' x = right, and by how much x lessens the sum of squares."""
    middle: Numbers = []
    found: Numbers = []
    gain: Any = 0.0
    for row, rest in zip(factor, right, strict=True):
        for known, each in zip(middle, row, strict=False):
            rest = rest - each * known
        middle.append(rest)
        found.append(rest * row[-1])
        gain = gain + rest * found[-1]
    for i in range(len(found) - 1, -1, -1):
        for k in range(i + 1, len(found)):
            found[i] = found[i] - factor[k][i] * found[k]
    return found, gain


def inverse(factor: Triangle) -> list[Numbers]:
    """(L D L')^-1, whole."""
    size = len(factor)
    below: list[Numbers] = [[0.0 for _ in range(i)] for i in range(size)]  # L^-1, diagonal left out
    for j in range(size):
        for i in range(j + 1, size):
            rest = factor[i][j]
            for k in range(j + 1, i):
                rest = rest + factor[i][k] * below[k][j]
            below[i][j] = -rest
    whole: list[Numbers] = [[0.0 for _ in range(size)] for _ in range(size)]
    for i in range(size):
        after = zip(below[i + 1 :], factor[i + 1 :], strict=True)
        scaled = [row[i] * known[-1] for row, known in after]
        for j in range(i + 1):
            total = factor[i][-1] if j == i else factor[i][-1] * below[i][j]
            for k, each in enumerate(scaled, i + 1):
                total = total + each * below[k][j]
            whole[i][j] = whole[j][i] = total
    return whole
