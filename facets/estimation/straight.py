"""Small linear algebra as straight code: matrices are lists of numbers that write instructions.

Lower triangles are lists of rows, each as long as its number plus one. Lengths are those of the
lists, so that nothing is left of the loops.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .normal_equations import MIN_PIVOT_SHARE

Numbers = list[Any]
Triangle = list[Numbers]


def product(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """The sum of products, by halves, which do not wait for each other."""
    if len(a) == 1:
        return a[0] * b[0]
    half = len(a) // 2
    return product(a[:half], b[:half]) + product(a[half:], b[half:])


def normal_equations(columns: list[Numbers], residuals: Numbers) -> tuple[Triangle, Numbers]:
    """J'J and J'r from the columns of J."""
    matrix = [[product(a, b) for b in columns[: i + 1]] for i, a in enumerate(columns)]
    return matrix, [product(column, residuals) for column in columns]


def cholesky(code: Any, matrix: Triangle) -> tuple[Triangle, Any]:
    """L with L L' = matrix, its diagonal as its inverse; and whether each pivot can be trusted."""
    factor: Triangle = []
    fine = None
    for i, row in enumerate(matrix):
        own: Numbers = []
        for j in range(i):
            rest = row[j]
            for k in range(j):
                rest = rest - own[k] * factor[j][k]
            own.append(rest * factor[j][j])
        pivot = row[i]
        for each in own:
            pivot = pivot - each * each
        trusted = pivot > row[i] * MIN_PIVOT_SHARE
        fine = trusted if fine is None else fine & trusted
        own.append(1 / code.function("sqrt", pivot))
        factor.append(own)
    return factor, fine


def solution(factor: Triangle, right: Numbers) -> tuple[Numbers, Any]:
    """The solution of L L' x = right, and by how much x lessens the sum of squares."""
    middle: Numbers = []
    gain: Any = 0.0
    for row, rest in zip(factor, right, strict=True):
        for each, known in zip(row, middle, strict=False):
            rest = rest - each * known
        middle.append(rest * row[-1])
        gain = gain + middle[-1] * middle[-1]
    found: Numbers = [None] * len(right)
    for i in range(len(right) - 1, -1, -1):
        rest = middle[i]
        for k in range(i + 1, len(right)):
            rest = rest - factor[k][i] * found[k]
        found[i] = rest * factor[i][i]
    return found, gain


def inverse(factor: Triangle) -> list[Numbers]:
    """(L L')^-1, whole."""
    size = len(factor)
    below: Triangle = [[None] * (i + 1) for i in range(size)]
    for j in range(size):
        below[j][j] = factor[j][j]
        for i in range(j + 1, size):
            rest = factor[i][j] * below[j][j]
            for k in range(j + 1, i):
                rest = rest + factor[i][k] * below[k][j]
            below[i][j] = -(rest * factor[i][i])
    whole: list[Numbers] = [[None] * size for _ in range(size)]
    for i in range(size):
        for j in range(i + 1):
            total = below[i][i] * below[i][j]
            for k in range(i + 1, size):
                total = total + below[k][i] * below[k][j]
            whole[i][j] = whole[j][i] = total
    return whole
