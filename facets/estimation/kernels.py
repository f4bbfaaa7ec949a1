"""`gauss_newton.estimate_each` as Numba compiles it. Importing this imports Numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import carray  # type: ignore[attr-defined]  # noqa: TID253

from ..model.jit import bytes_at, call_address, doubles_at, integers_at, longs_at, twin
from ..model.jit import task as task_kernel
from ..model.threads import once
from . import gauss_newton, least_squares, normal_equations
from . import problem as problems
from .gauss_newton import estimate_each
from .problem import (
    ACCEPT_UNCHECKED,
    COUNT,
    COUNT_OF_COVARIANCES,
    COUNT_OF_FREE,
    COUNT_OF_MEANS,
    COUNT_OF_SIGMAS,
    COUNT_OF_STARTS,
    COVARIANCES,
    DAMPED,
    EIGHT,
    FREE,
    HALF_SIZES,
    LAYERS,
    LAYERS_AT,
    MEANS,
    MODEL,
    MOST_STEPS,
    NOISE,
    OUTLINES_AT,
    PACKED,
    PREVIOUS,
    RESIDUALS,
    ROUNDINGS,
    ROWS,
    ROWS_AT,
    SIGMAS,
    STARTS,
    STATES,
    STATUS,
    STEPS,
    USED,
    VALUES,
    WEIGHT,
    Limits,
    Model,
    Problem,
    Readings,
    Results,
    Workspace,
)

Array = Any


def solve_rows(task: Any) -> None:
    """Estimates the states of `Results` from `Readings`.

    task: the addresses and counts of `problem.Task`.
    """
    n, rows, starts = task[COUNT], task[COUNT_OF_SIGMAS], task[COUNT_OF_STARTS]
    means, asked, kept = task[COUNT_OF_MEANS], task[COUNT_OF_FREE], task[COUNT_OF_COVARIANCES]
    estimate_each(
        Model(task[MODEL], carray(doubles_at(task[PACKED]), (1,))),
        Readings(
            carray(doubles_at(task[VALUES]), (n, 9)), carray(doubles_at(task[SIGMAS]), (rows, 9))
        ),
        Limits(
            carray(doubles_at(task[NOISE]), (3,)),
            carray(doubles_at(task[HALF_SIZES]), (3, 2)),
            task[EIGHT] != 0,
            carray(doubles_at(task[ROUNDINGS]), (2,)),
        ),
        Problem(
            carray(doubles_at(task[MEANS]), (means, 3)),
            carray(doubles_at(task[WEIGHT]), (3,)),
            carray(longs_at(task[FREE]), (asked,)),
            carray(doubles_at(task[STARTS]), (starts, 9)),
            task[PREVIOUS] != 0,
            task[MOST_STEPS],
            task[DAMPED] != 0,
            task[ACCEPT_UNCHECKED] != 0,
        ),
        Results(
            carray(doubles_at(task[STATES]), (n, 9)),
            carray(bytes_at(task[USED]), (n, 3)),
            carray(bytes_at(task[STATUS]), (n,)),
            carray(integers_at(task[STEPS]), (n,)),
            carray(doubles_at(task[RESIDUALS]), (n,)),
            carray(doubles_at(task[COVARIANCES]), (kept, 8, 8)),
        ),
        Workspace(
            carray(doubles_at(task[LAYERS_AT]), (LAYERS, 10, 10)),
            carray(doubles_at(task[ROWS_AT]), (ROWS, 10)),
            carray(doubles_at(task[OUTLINES_AT]), (1,)),
        ),
    )


@once
def kernel() -> Callable[[int], None]:
    """The compiled `solve_rows`, to be called with the address of a task's table."""
    twin(
        gauss_newton.evaluate_model,
        lambda model, x, found, outlines: (
            lambda model, x, found, outlines: call_address(
                model.address, model.packed, x, found, outlines
            )
        ),
    )
    modules = (gauss_newton, least_squares, normal_equations)
    return task_kernel(__file__, solve_rows, *modules, problems)
