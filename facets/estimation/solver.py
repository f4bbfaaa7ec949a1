"""Solve readings for the mirror's pose: weighted least squares with all prior knowledge.

`solve_each` solves readings of which each has a sensor of its own: the draws of a calibration's
parameters. Blocks do nearly all of them; light that is cut is solved one by one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import check_arguments, index_of
from ..core.errors import InputError
from ..core.knowledge import BeamKnowledge, PowerKnowledge, Question
from ..core.sensor import Sensor
from ..core.units import Floats
from ..model.arrays import as_rows, as_vectors
from ..model.threads import part_of, share
from ..model.varied import VariedSensors
from . import blocks, problem
from .doubts import is_doubtful, replace_unlikely, withdraw_doubtful
from .estimates import add_calibration, block_code, estimate
from .plan import (
    Plan,
    chance_of,
    find_plan,
    is_plain,
    is_previous,
    make_plan,
    make_problem,
    sigmas_of,
    start_states,
)
from .prepared import find_solver
from .problem import Form
from .solution import Solution, solution


@check_arguments
def solve(
    sensor: Sensor,
    readings: ArrayLike,
    *,
    beam: BeamKnowledge = "free",
    power: PowerKnowledge = "known",
    start: Literal["zero", "previous"] | ArrayLike = "zero",
    method: Literal["least-squares", "paper"] = "least-squares",
    max_steps: int = 50,
    covariance: bool = True,
    accept_unchecked: bool = False,
    threads: int = 1,
) -> Solution:
    """Estimate the mirror's pose and the beam's place from the detectors' readings.

    Parameters
    ----------
    sensor
        The sensor.
    readings
        (..., 9), mm and mW, as `facets.readings` gives them, or a data frame with these columns. A
        detector with a NaN, without light or with a spot past its edge is left out.
    beam
        What is known of the beam's place: "free", "known" to be (0, 0), or a `Prior` in mm.
    power
        What is known of the laser's power: "known" as the sensor's, "unknown", or a `Prior` in mW.
    start
        Where the search begins: "zero" (with the apex where the beam is thought to be), "previous"
        (the last converged sample before), or states (..., 8); one at which diffraction leaves
        no reading counts as zero.
    method
        "paper" is Newton's method on eight readings, without the power of C (section 2.3 of the
        paper): no weights, no damping, the beam free and its power known. Nothing checks its
        poses.
    max_steps
        Largest number of steps; a reading that takes more has a status and no pose.
    covariance
        Whether covariances are computed.
    accept_unchecked
        Whether poses that nothing checks are given, too; see the notes.
    threads
        Number of threads that share the readings; 0 for all cores. With start="previous" each
        begins at zero.

    Returns
    -------
    Solution
        States, statuses and covariances. A reading that cannot be solved has a status and NaN. A
        pose whose residual noise would hardly leave is given, and is not `ok`. `to_frame()` makes
        it a data frame, with the index of the readings' data frame.

    Raises
    ------
    InputError
        If an argument has a wrong shape or value.

    Notes
    -----
    Weighted least squares on all nine readings, with weights from the sensor's noise, by
    Gauss-Newton steps that are damped where they do not help.

    Two detectors with the beam and the power known, or with priors, have as many numbers as
    unknowns, and so have three detectors with the beam free and the power unknown. Then a wrong
    number also gives a pose, and no residual shows the error; a second, distant pose may have the
    same readings. Priors of beam and power that are so wide that the readings have a redundancy
    below 0.001 leave as little to check. Unless `accept_unchecked` is true, such a reading has the
    status UNCHECKED and no pose.

    Examples
    --------
    >>> import numpy as np, facets
    >>> sensor = facets.Sensor()
    >>> reading = facets.readings(sensor, [0.01, 0, 0.5, 0, 0, 0.001, 0, 0])
    >>> solution = facets.solve(sensor, reading, beam="known")
    >>> bool(solution.ok), f"yaw {1e3 * solution.state[5]:.3f} mrad"
    (True, 'yaw 1.000 mrad')
    >>> facets.Status(int(facets.solve(sensor, np.zeros(9)).status)).label
    'no light'
    """
    values = as_vectors(readings, 9, "readings")
    question = Question(beam, power, method, max_steps, covariance, accept_unchecked)
    found, index = solve_question(sensor, values, question, start, threads), index_of(readings)
    return found if index is None else replace(found, index=index)


def solve_question(
    sensor: Sensor,
    checked: Floats,
    question: Question,
    start: Literal["zero", "previous"] | ArrayLike = "zero",
    threads: int = 1,
    warmer: Floats | None = None,
) -> Solution:
    """`solve` of readings (..., 9) that are checked.

    warmer: (n,) of readings (n, 9), than the reference temperature of the calibration, K.
    """
    if is_short(question) and threads >= 0 and are_few(checked, start):
        solver = find_solver(sensor, question)
        if checked.ndim == 1:
            return solver.solve_from(checked, solver.start_state(start, checked))
        if (kept := solver.solve_some(checked, warmer)) is not None:
            return kept
    values, shape = as_rows(checked, 9, "readings")
    plan = find_plan(sensor, question.knowledge, question.method, shape)
    starts = start_states(sensor, start, plan, values, shape)
    request = make_problem(plan, starts, question, is_previous(start))
    rows = problem.Readings(values, sigmas_of(sensor, values))
    results = solve_rows(sensor, rows, plan, request, question.covariance, threads)
    parts = add_calibration(sensor, plan, results, warmer)
    return solution(results, shape, chance_of(sensor, plan), parts)


def is_short(question: Question) -> bool:
    """Whether a question has no array, so that a solver is kept for it."""
    beam, power = question.beam, question.power
    return (isinstance(beam, str) or is_plain(beam, 2)) and (
        isinstance(power, str) or is_plain(power, 1)
    )


#: The memory of so many readings is kept.
FEW = 64


def are_few(readings: Floats, start: str | ArrayLike) -> bool:
    """Whether a kept solver has memory for readings: for one, and for a few from zero."""
    from_zero = isinstance(start, str) and start == "zero"
    return readings.ndim == 1 or (readings.ndim == 2 and 0 < len(readings) <= FEW and from_zero)


def local_solution(sensor: Sensor, reading: Floats, start: Floats) -> tuple[Floats, float]:
    """The state (8,) to which a reading (9,) leads from a start (8,), the beam free, and the
    residual there; NaN where it leads to none. Another state may give the same reading."""
    question, values = Question(), reading[None].copy()
    plan = find_plan(sensor, question.knowledge, question.method, ())
    starts = start_states(sensor, start, plan, values, ())
    request = make_problem(plan, starts, question)
    results = problem.empty_results(1, False)
    estimate(sensor, problem.Readings(values, sigmas_of(sensor, values)), request, results)
    return results.states[0, :8], float(results.residuals[0])


def solve_rows(
    sensor: Sensor,
    readings: problem.Readings,
    plan: Plan,
    request: problem.FitProblem,
    covariance: bool,
    threads: int = 1,
) -> problem.Results:
    """`solve` of readings that are checked, without what the calibration adds to covariances."""
    n = len(readings.values)
    all_results = problem.empty_results(n, covariance)
    block_code(sensor, request)  # compiled once, before threads ask for it

    def run(part: slice) -> None:
        some, questions = problem.some_rows(part, readings, request)
        results = problem.Results(*(part_of(array, part, n) for array in all_results))
        estimate(sensor, some, questions, results)

    share(run, n, threads)

    def again(rows: NDArray[np.intp], starts: Floats) -> problem.Results:
        some, questions = problem.some_rows(rows, readings, request)
        results = problem.empty_results(len(rows), covariance)
        questions = questions._replace(starts=starts, previous=False)
        estimate(sensor, some, questions, results)
        return results

    chance = chance_of(sensor, plan)
    if sensor.light.on and request.damped:
        replace_unlikely(sensor, plan, chance, all_results, again)
    if is_doubtful(sensor, plan.free):
        withdraw_doubtful(sensor, plan.free, chance, all_results, again)
    return all_results


def solve_each(
    sensors: VariedSensors,
    values: Floats,
    question: Question,
) -> problem.Results:
    """Solve readings (n, 9) as `facets.solve` does, each with its own sensor; no covariances.

    question: priors with means (n, 2), (n) are those of each reading. A reading whose sensor is
    impossible has the status NON_FINITE.
    """
    sensor, shape = sensors.sensor, (len(values),)
    plan = make_plan(sensor, question.knowledge, shape=shape)
    starts = start_states(sensor, "zero", plan, values, shape)
    request = make_problem(plan, starts, question)
    readings = problem.Readings(values, sigmas_of(sensor, values))

    def estimate(
        which: Any, some: problem.Readings, questions: problem.FitProblem
    ) -> problem.Results:
        results = problem.empty_results(len(some.values), False)
        some_sensors, some_question = sensors.rows(which), question.rows(which)
        remaining = np.arange(len(some.values))
        if some_sensors.kind is not None and len(remaining):
            kind = some_sensors.kind
            remaining = estimate_in_blocks(some_sensors, kind, some, questions, results)
        estimate_singly(
            some_sensors, remaining, some.values, some_question, questions.starts, results
        )
        return results

    results = estimate(np.arange(len(values)), readings, request)
    if is_doubtful(sensor, plan.free) and sensors.kind is not None:

        def again(which: Any, begin: Floats) -> problem.Results:
            some, questions = problem.some_rows(which, readings, request)
            return estimate(which, some, questions._replace(starts=begin))

        withdraw_doubtful(sensor, plan.free, chance_of(sensor, plan), results, again)
    return results


def estimate_in_blocks(
    sensors: VariedSensors,
    kind: str,
    readings: problem.Readings,
    request: problem.FitProblem,
    results: problem.Results,
) -> Any:
    """Estimate readings in blocks, and write them into `results`.

    Returns the numbers of the rows without light at their start: their sensors may be
    impossible.
    """

    def run(which: Any, exact: bool) -> None:
        code = blocks.kernel(Form(tuple(request.free.tolist()), kind, exact, varied=True))
        some, questions = problem.some_rows(which, readings, request)
        part = problem.empty_results(len(which), False)
        blocks.estimate(code, sensors.rows(which).pack(kind), some, questions, part)
        problem.put_rows(results, which, part)

    run(np.arange(len(readings.values)), False)
    unlit = (
        (results.status == problem.OUT_OF_RANGE) & (results.steps == 0) & results.used.all(axis=1)
    )
    stalled = np.flatnonzero(results.status == problem.STALLED)
    if len(stalled) and kind != "plain":
        run(stalled, True)
    return np.flatnonzero(unlit)


def estimate_singly(
    sensors: VariedSensors,
    which: Any,
    values: Floats,
    question: Question,
    starts: Floats,
    results: problem.Results,
) -> None:
    """Estimate some rows one by one, with a `Sensor` for each, and write them into `results`."""
    for row in which.tolist():
        start = starts[row if len(starts) > 1 else 0]
        try:
            row_question = question.rows(row)._replace(covariance=False)
            pose = solve_question(sensors.one(row), values[row], row_question, start[:8])
        except InputError:
            results.status[row], results.used[row] = problem.NON_FINITE, False
            results.states[row] = results.residuals[row] = np.nan
            continue
        results.states[row, :8], results.states[row, 8] = pose.state, pose.power
        results.status[row], results.used[row] = pose.status, pose.used
        results.steps[row], results.residuals[row] = pose.iterations, pose.residual
