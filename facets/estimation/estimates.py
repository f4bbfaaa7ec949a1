"""Estimate readings by compiled code: in blocks if these support the request, otherwise one by
one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..core.knowledge import Knowledge
from ..core.sensor import Sensor
from ..model import evaluators, rare
from ..model.arrays import packed_vectors
from ..model.kinds import block_kind, lit_kind
from . import as_text, blocks, problem
from .block_task import Form
from .plan import Plan, make_plan
from .solution import Status
from .uncertainty_parts import UncertaintyParts, uncertainty_parts


def add_calibration(sensor: Sensor, todo: Plan, found: problem.Results) -> UncertaintyParts | None:
    """Add the covariance of the calibrated parameters (`Sensor.calibration`) to the poses'
    covariances."""
    if sensor.calibration is None or not found.covariances.shape[1]:
        return None
    parts = uncertainty_parts(sensor, found.states[:, :8], found.used, todo.free, todo.weights)
    found.covariances[:] += parts.calibration
    return parts


def estimate(
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.ScreeningLimits,
    request: problem.FitProblem,
    found: problem.Results,
) -> None:
    """Fill `found`: by blocks if these support the request, and one by one for readings that blocks
    leave over.

    Under real light, stalled estimates are repeated with exact derivatives.
    """
    near = evaluators.approximate_linearisation(sensor)
    code = block_code(sensor, request)
    if code is None:
        one_by_one(near, sensor, readings, limits, request, found)
    else:
        left = blocks.estimate(code, packed_vectors(sensor), readings, limits, request, found)
        if len(left) and sensor.light.on:
            left = blocks.estimate_some(
                code, left, packed_vectors(sensor), readings, limits, request, found
            )
        if len(left):
            estimate_some(near, left, sensor, readings, limits, request, found)
    if sensor.light.on:
        estimate_stalled_again(sensor, readings, limits, request, found)


def block_code(
    sensor: Sensor, request: problem.FitProblem, exact: bool = False, width: int | None = None
) -> Callable[[int], None] | None:
    """What estimates blocks of readings, compiled now if need be; None where blocks do not know
    what is asked. exact: see `Form`.  width: see `blocks.kernel`."""
    kind = block_kind(sensor)
    if kind is None:
        return None
    form = Form(tuple(request.free.tolist()), kind, exact)
    return blocks.kernel(form, width) if blocks.is_supported(request) else None


def row_kernel() -> Callable[[int], None]:
    """Return the compiled estimate of one reading after the other; imports Numba."""
    from .kernels import kernel

    return kernel()


def one_by_one(
    model: str,
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.ScreeningLimits,
    request: problem.FitProblem,
    found: problem.Results,
) -> None:
    """model: of `evaluators`."""
    left = as_text.estimate(model, sensor, readings, limits, request, found)
    if len(left) == 0:
        return
    if len(left) < len(readings.values):
        estimate_some(model, left, sensor, readings, limits, request, found)
        return
    given = problem.CompiledModel(evaluators.address(model), packed_vectors(sensor))
    task = problem.RowTask(given, readings, limits, request, found, problem.workspace())
    row_kernel()(task.address)


def prepare(sensor: Sensor, knowledge: Knowledge) -> None:
    """Compile or load everything that a reading may need outside its block, for a loop that cannot
    wait."""
    row_kernel()
    rare.prepare()
    for model in (evaluators.approximate_linearisation(sensor), evaluators.linearisation(sensor)):
        evaluators.model(model)
    if sensor.light.on and not sensor.apertures.cut:
        free = make_plan(sensor, knowledge).free
        blocks.kernel(Form(tuple(free.tolist()), lit_kind(sensor), exact=True))


def estimate_some(
    model: str,
    which: NDArray[np.intp],
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.ScreeningLimits,
    request: problem.FitProblem,
    found: problem.Results,
) -> None:
    """Estimates some readings one by one, anew, and puts what is found in its places."""
    again = problem.empty_results(len(which), len(found.covariances) > 0)
    some, questions = problem.some_rows(which, readings, request)
    one_by_one(model, sensor, some, limits, questions._replace(previous=False), again)
    problem.put_rows(found, which, again)


def estimate_stalled_again(
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.ScreeningLimits,
    request: problem.FitProblem,
    found: problem.Results,
) -> None:
    """Under the light of a bench: what stalled, by the derivatives that leave nothing out."""
    stalled, request = (
        np.flatnonzero(found.status == Status.STALLED),
        request._replace(previous=False),
    )
    code = block_code(sensor, request, exact=True) if len(stalled) else None
    if code is not None:
        numbers = packed_vectors(sensor)
        stalled = blocks.estimate_some(code, stalled, numbers, readings, limits, request, found)
    if len(stalled):
        model = evaluators.linearisation(sensor)
        estimate_some(model, stalled, sensor, readings, limits, request, found)
