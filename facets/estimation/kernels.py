"""`gauss_newton.estimate_each` as Numba compiles it. Importing this imports Numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import carray  # type: ignore[attr-defined]  # noqa: TID253

from ..model.jit import bytes_at, call_address, doubles_at, integers_at, longs_at, twin
from ..model.jit import task as task_kernel
from ..model.threads import once
from . import gauss_newton, normal_equations
from . import problem as problems
from .gauss_newton import estimate_each
from .problem import (
    LAYERS,
    PLACES,
    CompiledModel,
    FitProblem,
    Readings,
    Results,
    ScreeningLimits,
    Workspace,
)

Array = Any


def solve_rows(task: Any) -> None:
    """Estimates the states of `Results` from `Readings`.

    task: a `problem.TaskTable`, by PLACES.
    """
    n, asked = task[PLACES.readings], task[PLACES.unknowns]
    rows, means = task[PLACES.rows_of_sigmas], task[PLACES.rows_of_means]
    starts, kept = task[PLACES.rows_of_starts], task[PLACES.rows_of_covariances]
    estimate_each(
        CompiledModel(task[PLACES.model], carray(doubles_at(task[PLACES.packed]), (1,))),
        Readings(
            carray(doubles_at(task[PLACES.values]), (n, 9)),
            carray(doubles_at(task[PLACES.sigmas]), (rows, 9)),
        ),
        ScreeningLimits(
            carray(doubles_at(task[PLACES.noise]), (3,)),
            carray(doubles_at(task[PLACES.light]), (2, 3)),
            carray(doubles_at(task[PLACES.half_sizes]), (3, 2)),
            task[PLACES.eight] != 0,
            carray(doubles_at(task[PLACES.rounding]), (2,)),
        ),
        FitProblem(
            carray(doubles_at(task[PLACES.means]), (means, 3)),
            carray(doubles_at(task[PLACES.weight]), (3,)),
            carray(longs_at(task[PLACES.free]), (asked,)),
            carray(doubles_at(task[PLACES.starts]), (starts, 9)),
            task[PLACES.previous] != 0,
            task[PLACES.max_steps],
            task[PLACES.damped] != 0,
            task[PLACES.accept_unchecked] != 0,
        ),
        Results(
            carray(doubles_at(task[PLACES.states]), (n, 9)),
            carray(bytes_at(task[PLACES.used]), (n, 3)),
            carray(bytes_at(task[PLACES.status]), (n,)),
            carray(integers_at(task[PLACES.steps]), (n,)),
            carray(doubles_at(task[PLACES.residuals]), (n,)),
            carray(doubles_at(task[PLACES.covariances]), (kept, 8, 8)),
        ),
        Workspace(
            carray(doubles_at(task[PLACES.layers]), (LAYERS, 10, 10)),
            carray(doubles_at(task[PLACES.outlines]), (1,)),
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
    return task_kernel(__file__, solve_rows, gauss_newton, normal_equations, problems)
