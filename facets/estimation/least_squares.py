"""Small dense least squares on preallocated arrays: text for `kernels`, plain Python for checks."""

from __future__ import annotations

from math import sqrt
from typing import Any

Array = Any


def triangularise(matrix: Array, rows: int, columns: int) -> bool:
    """Householder QR in place of matrix[:rows, :columns], the right-hand side in the next column.

    Leaves R above the diagonal, and Q' rhs in the last column. False where a column is, to
    rounding, a combination of those before it: R then has no use.
    """
    for j in range(columns):
        whole = 0.0
        for i in range(rows):
            whole += matrix[i, j] * matrix[i, j]
        square = 0.0
        for i in range(j, rows):
            square += matrix[i, j] * matrix[i, j]
        if not square > 1e-28 * whole:
            return False
        norm = -sqrt(square) if matrix[j, j] > 0 else sqrt(square)
        head = matrix[j, j] - norm
        scale = 1 / (norm * head)
        # the reflection 1 - v v' / (-norm head) with v = (head, matrix[j+1:, j])
        for k in range(j + 1, columns + 1):
            along = head * matrix[j, k]
            for i in range(j + 1, rows):
                along += matrix[i, j] * matrix[i, k]
            along *= scale
            matrix[j, k] += along * head
            for i in range(j + 1, rows):
                matrix[i, k] += along * matrix[i, j]
        matrix[j, j] = norm
    return True


def back_substitute(matrix: Array, columns: int, solution: Array) -> None:
    """Solves R solution = the right-hand side, both as `triangularise` leaves them."""
    for i in range(columns - 1, -1, -1):
        rest = matrix[i, columns]
        for j in range(i + 1, columns):
            rest -= matrix[i, j] * solution[j]
        solution[i] = rest / matrix[i, i]
