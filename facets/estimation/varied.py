"""Solve readings of which each has a sensor of its own: the draws of a calibration's parameters.

Blocks do nearly all of them. Light that is cut is solved one by one, with a `Sensor` for each.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.knowledge import Question
from ..core.units import Floats
from ..model.varied import VariedSensors
from . import blocks, problem
from .block_task import Form
from .doubts import is_doubtful, withdraw_doubtful
from .plan import chance_of, make_plan, make_problem, sigmas_of, start_states
from .solver import solve_question


def solve_each(
    sensors: VariedSensors,
    values: Floats,
    question: Question,
) -> problem.Results:
    """Solve readings (n, 9) as `facets.solve` does, each with its own sensor; no covariances.

    question: priors with means (n, 2), (n) are those of each reading. A reading whose sensor cannot
    be has the status NON_FINITE.
    """
    sensor, shape = sensors.sensor, (len(values),)
    plan = make_plan(sensor, question.knowledge, shape=shape)
    starts = start_states(sensor, "zero", plan, values, shape)
    request = make_problem(plan, starts, question)
    readings = problem.Readings(values, sigmas_of(sensor, values))

    def estimate(
        which: Any, some: problem.Readings, questions: problem.FitProblem
    ) -> problem.Results:
        found = problem.empty_results(len(some.values), False)
        own, some_question = sensors.rows(which), question.rows(which)
        left = np.arange(len(some.values))
        if own.kind is not None and len(left):
            left = estimate_in_blocks(own, own.kind, some, questions, found)
        estimate_singly(own, left, some.values, some_question, questions.starts, found)
        return found

    found = estimate(np.arange(len(values)), readings, request)
    if is_doubtful(sensor, plan.free) and sensors.kind is not None:

        def again(which: Any, begin: Floats) -> problem.Results:
            some, questions = problem.some_rows(which, readings, request)
            return estimate(which, some, questions._replace(starts=begin))

        withdraw_doubtful(sensor, plan.free, chance_of(sensor, plan), found, again)
    return found


def estimate_in_blocks(
    sensors: VariedSensors,
    kind: str,
    readings: problem.Readings,
    request: problem.FitProblem,
    found: problem.Results,
) -> Any:
    """Fill `found`, as `estimates.estimate` does.

    Returns the numbers of the rows without light where they begin: their sensors may be none that
    can be.
    """

    def run(which: Any, exact: bool) -> None:
        code = blocks.kernel(Form(tuple(request.free.tolist()), kind, exact, varied=True))
        some, questions = problem.some_rows(which, readings, request)
        part = problem.empty_results(len(which), False)
        blocks.estimate(code, sensors.rows(which).pack(kind), some, questions, part)
        problem.put_rows(found, which, part)

    run(np.arange(len(readings.values)), False)
    unlit = (found.status == problem.OUT_OF_RANGE) & (found.steps == 0) & found.used.all(axis=1)
    stalled = np.flatnonzero(found.status == problem.STALLED)
    if len(stalled) and kind != "plain":
        run(stalled, True)
    return np.flatnonzero(unlit)


def estimate_singly(
    sensors: VariedSensors,
    which: Any,
    values: Floats,
    question: Question,
    starts: Floats,
    found: problem.Results,
) -> None:
    """Fill rows of `found`, with a `Sensor` for each."""
    for row in which.tolist():
        start = starts[row if len(starts) > 1 else 0]
        try:
            asked = question.rows(row)._replace(covariance=False)
            one = solve_question(sensors.one(row), values[row], asked, start[:8])
        except InputError:
            found.status[row], found.used[row] = problem.NON_FINITE, False
            found.states[row] = found.residuals[row] = np.nan
            continue
        found.states[row, :8], found.states[row, 8] = one.state, one.power
        found.status[row], found.used[row] = one.status, one.used
        found.steps[row], found.residuals[row] = one.iterations, one.residual
