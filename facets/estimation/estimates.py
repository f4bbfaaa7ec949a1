"""Estimate readings by compiled code, in blocks, and compile what a command is about to need."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.knowledge import Knowledge
from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import packed_vectors
from ..model.blocks import SINGLE
from ..model.kinds import LIT, kind_of
from . import blocks, problem
from .plan import Plan, make_plan
from .problem import Form
from .uncertainty import UncertaintyParts, uncertainty_parts


def add_calibration(
    sensor: Sensor, plan: Plan, results: problem.Results, warmer: Floats | None = None
) -> UncertaintyParts | None:
    """Add the covariance of the calibrated parameters (`Sensor.calibration`) to the poses'
    covariances.

    warmer: (n,) than the reference temperature of the calibration, K.
    """
    if sensor.calibration is None or not results.covariances.shape[1]:
        return None
    parts = uncertainty_parts(sensor, results.states[:, :8], results.used, plan, warmer)
    results.covariances[:] += parts.calibration
    return parts


def estimate(
    sensor: Sensor,
    readings: problem.Readings,
    request: problem.FitProblem,
    results: problem.Results,
) -> None:
    """Estimate the states of readings, and write them into `results`.

    Under real light, stalled estimates are repeated with exact derivatives.
    """
    run(sensor, False, readings, request, results)
    stalled = np.flatnonzero(results.status == problem.STALLED) if needs_exactness(sensor) else ()
    if len(stalled):
        again = problem.empty_results(len(stalled), len(results.covariances) > 0)
        some, questions = problem.some_rows(stalled, readings, request)
        run(sensor, True, some, questions._replace(previous=False), again)
        problem.put_rows(results, stalled, again)


def run(
    sensor: Sensor,
    exact: bool,
    readings: problem.Readings,
    request: problem.FitProblem,
    results: problem.Results,
) -> None:
    """Estimate readings once, with exact derivatives if `exact`, and write them into `results`."""
    code = block_code(sensor, request, exact, SINGLE if request.previous else None)
    way = blocks.estimate_in_turn if request.previous else blocks.estimate
    way(code, packed_vectors(sensor), readings, request, results)


def block_code(
    sensor: Sensor, request: problem.FitProblem, exact: bool = False, width: int | None = None
) -> Callable[[int], None]:
    """Return the code that estimates blocks of readings; compile it if it is not compiled yet.

    exact: see `Form`.  width: see `blocks.kernel`.
    """
    return blocks.kernel(Form(tuple(request.free.tolist()), kind_of(sensor), exact), width)


def prepare(sensor: Sensor, knowledge: Knowledge) -> None:
    """Compile or load everything that a reading may need, for a loop that cannot wait."""
    free = tuple(make_plan(sensor, knowledge).free.tolist())
    for exact in (False, True) if needs_exactness(sensor) else (False,):
        for width in (None, SINGLE):
            blocks.kernel(Form(free, kind_of(sensor), exact), width)


def needs_exactness(sensor: Sensor) -> bool:
    """Whether the usual derivatives leave something out, so that estimates may stall."""
    return kind_of(sensor) in LIT
