"""Solve readings for the mirror's pose: weighted least squares with all prior knowledge.

`Solver` solves one reading at a time; it checks its arguments once and reuses its memory.
`solve_each` solves readings each of which has its own sensor, such as draws of a calibration's
parameters: in blocks, or one by one if apertures cut the light.
"""

from __future__ import annotations

import threading
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import as_floats, check_arguments, index_of
from ..core.errors import InputError
from ..core.knowledge import BeamKnowledge, PowerKnowledge, Question
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..model.arrays import as_rows, as_vectors, packed_vectors
from ..model.blocks import SINGLE, lanes
from ..model.kinds import LIT, kind_of
from ..model.many import VariedSensors
from ..model.threads import Pool, part_of, share
from . import problem
from .blocks import KeptBlocks, estimate, find_code
from .doubts import UNLIKELY_STEPS, is_doubtful, replace_unlikely, withdraw_doubtful
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
from .problem import CHECKS, COVARIANCE, ITERATIONS, LIMIT, RESIDUAL, STATUS, USED
from .solution import LazySolution, Solution, results_of, solution
from .uncertainty import uncertainty_parts


@check_arguments
class Solver:
    """Solver of single readings of one sensor, for live loops.

    The results equal the results of `facets.solve` and take less time, because the arguments are
    checked when the solver is made, and memory is reused. Threads may share a solver: each call has
    its own memory. A forked process and a copy have their own solver.

    beam, power, method, max_steps, covariance, accept_unchecked: as for `facets.solve`; a `Prior`
    has one mean.
    start: "zero", or "previous": the solution of the last converged reading of the same thread, and
    zero if this does not lead to a pose.

    >>> import facets
    >>> sensor = facets.Sensor()
    >>> solver = facets.Solver(sensor, start="previous")
    >>> solver.solve(facets.readings(sensor, [0, 0, 0.1, 0, 0, 0, 0, 0])).state[2].round(6)
    np.float64(0.1)
    """

    def __init__(
        self,
        sensor: Sensor,
        *,
        beam: BeamKnowledge = "free",
        power: PowerKnowledge = "known",
        start: Literal["zero", "previous"] = "zero",
        method: Literal["least-squares", "paper"] = "least-squares",
        max_steps: int = 50,
        covariance: bool = True,
        accept_unchecked: bool = False,
    ) -> None:
        question = Question(beam, power, method, max_steps, covariance, accept_unchecked)
        self._begin(sensor, question, start)

    @classmethod
    def solver_of(
        cls, sensor: Sensor, question: Question, start: Literal["zero", "previous"] = "zero"
    ) -> Solver:
        """Make a solver from checked arguments."""
        solver = cls.__new__(cls)
        solver._begin(sensor, question, start)
        return solver

    def _begin(self, sensor: Sensor, question: Question, start: str) -> None:
        self._arguments = (sensor, question, start)
        self._plan = make_plan(sensor, question.knowledge, question.method)
        self._previous = _Previous() if start == "previous" else None
        self._pool = Pool(self._prepare)
        self._pool.put_back(self._prepare())  # raises errors now instead of at the first reading

    def __reduce__(self) -> Any:
        """Copies are new solvers, because the addresses of the memory differ."""
        return Solver.solver_of, self._arguments

    def _prepare(self) -> PreparedEstimate:
        sensor, question, _ = self._arguments
        return PreparedEstimate(sensor, self._plan, question)

    def solve(self, reading: ArrayLike) -> Solution:
        """Solve one reading (9,) for its pose: psi, zeta (mm), power (mW) of detectors A, B, C.

        Returns a `Solution` without leading shape; NaN and a status for a reading that cannot be
        solved. Raises `InputError` for another shape.
        """
        values = as_floats(reading, "reading", 9)
        if values.shape != (9,):
            raise InputError(f"a reading has shape {values.shape}; needed: (9,)")
        return self.solve_from(values, None)

    def solve_from(self, values: Floats, start: Floats | None) -> Solution:
        """Solve a checked reading (9,).

        start: (9,) or (1, 9) state and power; None for zero. A solver that starts from the previous
        solution ignores it.
        """
        prepared = self._pool.take()
        previous = self._previous
        if previous is None:
            solved = prepared.solve(values, start, False)
        else:
            solved = prepared.solve(values, previous.end, True)
            if prepared.end is not None:
                previous.end = prepared.end
        self._pool.put_back(prepared)
        return solved

    def solve_some(self, values: Floats, warmer: Floats | None = None) -> Solution | None:
        """Solve a few checked readings (n, 9) from zero.

        Returns None if one run of the blocks does not suffice, because the power is unknown, poses
        may have to be withdrawn, or an estimate under real light takes many steps or stalls.

        warmer: (n,) temperature above the calibration's reference, K.
        """
        prepared = self._pool.take()
        solved = prepared.solve_some(values, warmer)
        self._pool.put_back(prepared)
        return solved

    def start_state(self, start: str | ArrayLike, values: Floats) -> Floats | None:
        """Initial state and power of one reading (9,), from the argument `start` of `facets.solve`;
        None for zero."""
        if isinstance(start, str) and start in ("zero", "previous"):
            return None
        return start_states(self._arguments[0], start, self._plan, values[None], ())


class _Previous(threading.local):
    """The final state and power (9,) of this thread's last converged reading."""

    end: Floats | None = None


class PreparedEstimate:
    """Memory for estimating one reading, or a few, in one call at a time.

    end: (9,) final state and power, mm, rad and mW, if requested and the estimate has converged;
    else None.
    """

    end: Floats | None = None

    def __init__(self, sensor: Sensor, plan: Plan, question: Question) -> None:
        self._sensor, self._plan = sensor, plan
        self._zero = start_states(sensor, "zero", plan, np.zeros((1, 9)), ())
        self._unknown_power = bool(plan.weights[2] == 0 and plan.free[-1] == 8)
        self._starts, self._sigmas = self._zero.copy(), np.empty((0, 9))
        if sensor.electronics is not None:
            self._sigmas = np.empty((1, 9))
        self._readings = problem.Readings(np.empty((1, 9)), self._sigmas)
        self._problem = make_problem(plan, self._starts, question)
        self._chance = chance_of(sensor, plan)
        self._doubtful = is_doubtful(sensor, plan.free)
        self._seeks = sensor.light.on and self._problem.damped
        self._kind = kind_of(sensor)
        self._has_exact = self._kind in LIT
        self._code: Any = None  # loaded for the first reading
        self._block = KeptBlocks(
            packed_vectors(sensor), self._readings, self._problem, question.covariance
        )
        self._numbers = self._block.numbers[0]
        self._ends = self._numbers.data
        self._numbers[CHECKS:COVARIANCE] = self._chance.checks(np.ones(3, bool)), self._chance.limit
        self._some: KeptBlocks | None = None
        self._rows = self._readings

    def solve_some(self, values: Floats, warmer: Floats | None) -> Solution | None:
        """Solve a few readings (n, 9) from zero; see `Solver.solve_some`."""
        if self._doubtful or self._unknown_power:
            return None
        few_blocks = self._put_rows(values)
        few_blocks.estimate(self._wide_code)
        numbers = few_blocks.numbers[: len(values)].copy()
        wandered = self._seeks and (numbers[:, ITERATIONS] > UNLIKELY_STEPS).any()
        if wandered or (self._has_exact and (numbers[:, STATUS] == problem.STALLED).any()):
            return None
        return self._solution(self._put_limits(numbers), warmer)

    def _put_rows(self, values: Floats) -> KeptBlocks:
        """Copy readings (n, 9) into complete blocks, padded with the last one; all start at
        zero."""
        count = len(values)
        rows = -(-count // lanes()) * lanes()
        if self._some is None or len(self._some.numbers) != rows:
            self._some = self._make_some(rows)
        self._rows.values[:count], self._rows.values[count:] = values, values[-1]
        if self._sensor.electronics is not None:
            self._rows.sigmas[:] = standard_deviations(self._sensor, self._rows.values)
        self._starts[:] = self._zero
        return self._some

    def _make_some(self, rows: int) -> KeptBlocks:
        self._rows = problem.Readings(
            np.empty((rows, 9)), np.empty((rows if len(self._sigmas) else 0, 9))
        )
        self._wide_code = find_code(self._kind, self._problem)
        packed = packed_vectors(self._sensor)
        some = KeptBlocks(packed, self._rows, self._problem, len(self._numbers) > COVARIANCE)
        some.numbers[:, CHECKS:COVARIANCE] = self._numbers[CHECKS:COVARIANCE]
        return some

    def _put_limits(self, numbers: Floats) -> Floats:
        """Write the degrees of freedom and the limits, by the detectors used, into rows of
        numbers."""
        used = numbers[..., USED:RESIDUAL] > 0
        if not used.all():
            checks = self._chance.checks(used)
            numbers[..., CHECKS], numbers[..., LIMIT] = checks, self._chance.limits(checks)
        return numbers

    def _solution(self, numbers: Floats, warmer: Floats | None = None) -> Solution:
        parts = None
        if self._sensor.calibration is not None:
            parts = uncertainty_parts(self._sensor, self._plan, results_of(numbers), warmer)
        return LazySolution.from_fields({"numbers": numbers}, parts)

    def solve(self, values: Floats, start: Floats | None, warm: bool) -> Solution:
        """Solve a reading (9,) from `start`, or from zero if this is None.

        warm: whether to repeat from zero if the start leads to no pose, and to store the `end`.
        """
        self._readings.values[0] = values
        if self._sensor.electronics is not None:
            self._sigmas[:] = standard_deviations(self._sensor, self._readings.values)
        self._run(self._from_zero() if start is None else start)
        if warm and start is not None and self._ends[STATUS] != problem.CONVERGED:
            steps = float(self._ends[ITERATIONS])
            self._run(self._from_zero())
            self._ends[ITERATIONS] += steps
        numbers = self._own_numbers()
        if self._doubtful or (self._seeks and self._ends[ITERATIONS] > UNLIKELY_STEPS):
            return self._solution_in_doubt(results_of(numbers), warm)
        if warm:
            self._keep_end(numbers[: problem.UNKNOWNS], numbers[STATUS])
        return self._solution(numbers)

    def _own_numbers(self) -> Floats:
        """Copy the block's numbers, with the limit for the detectors used."""
        numbers: Floats = self._numbers.copy()
        used = self._ends[USED] and self._ends[USED + 1] and self._ends[USED + 2]
        return numbers if used else self._put_limits(numbers)

    def _solution_in_doubt(self, results: problem.Results, warm: bool) -> Solution:
        """The solution of a reading after `review_poses`."""
        review_poses(self._sensor, self._readings, self._plan, self._problem, results)
        if warm:
            self._keep_end(results.states[0], results.status[0])
        parts = uncertainty_parts(self._sensor, self._plan, results)
        return solution(results, (), self._chance, parts)

    def _keep_end(self, state: Floats, status: int) -> None:
        self.end = state.copy() if status == problem.CONVERGED else None

    def _from_zero(self) -> Floats:
        if self._unknown_power:
            return start_states(self._sensor, "zero", self._plan, self._readings.values, ())
        return self._zero

    def _run(self, start: Floats) -> None:
        """Estimate the reading from a start; repeat it with exact derivatives if it stalls under
        real light."""
        self._starts[:] = start
        if self._code is None:
            self._code = find_code(self._kind, self._problem, width=SINGLE)
        self._block.estimate(self._code)
        if self._has_exact and self._ends[STATUS] == problem.STALLED:
            exact: Any = find_code(self._kind, self._problem, True, SINGLE)
            self._block.estimate(exact)


#: Largest number of cached solvers.
MAX_SOLVERS = 8
_kept: dict[tuple[int, Question], Solver] = {}


def find_solver(sensor: Sensor, question: Question) -> Solver:
    """Return a cached solver that starts from zero.

    A cached solver holds its sensor, so that no other sensor can get the same identity.
    """
    key = (id(sensor), question)
    solver = _kept.get(key)
    if solver is None:
        if len(_kept) >= MAX_SOLVERS:
            _kept.clear()
        solver = _kept[key] = Solver.solver_of(sensor, question)
    return solver


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
    """Estimate the mirror's pose and the beam's position from the detectors' readings.

    Parameters
    ----------
    sensor
        The sensor.
    readings
        (..., 9), mm and mW, as `facets.readings` gives them, or a data frame with these columns. A
        detector with a NaN, without light or with a spot past its edge is excluded.
    beam
        Knowledge of the beam's position: "free", "known" to be (0, 0), or a `Prior` in mm.
    power
        Knowledge of the laser's power: "known" as the sensor's, "unknown", or a `Prior` in mW.
    start
        Start of the search: "zero" (with the apex at the beam's expected position), "previous"
        (the pose of the last converged sample before), or states (..., 8). A state at which the
        model has no reading, because of diffraction, is replaced by zero.
    method
        "least-squares", or "paper": Newton's method on eight readings, without the power of C
        (section 2.3 of the paper), with neither weights nor damping, a free beam and a known power.
        Its poses are unchecked.
    max_steps
        Largest number of steps; a reading that needs more has a status and no pose.
    covariance
        Whether to compute covariances.
    accept_unchecked
        Whether unchecked poses are returned, too; see the notes.
    threads
        Number of threads that share the readings; 0 for all cores. With start="previous" the part
        of each thread begins at zero.

    Returns
    -------
    Solution
        States, statuses and covariances. A reading that cannot be solved has a status and NaN. A
        pose with a residual that noise hardly explains is returned, but is not `ok`. `to_frame()`
        converts the solution to a data frame, with the index of the readings' data frame.

    Raises
    ------
    InputError
        If an argument has a wrong shape or value.

    Notes
    -----
    The method is weighted least squares on all nine readings, with weights from the sensor's noise,
    by Gauss-Newton steps with Levenberg-Marquardt damping.

    Two detectors with the beam and the power known, or with priors, have as many numbers as
    unknowns, and so do three detectors with the beam free and the power unknown. A corrupted number
    then causes an undetected error, and a second, distant pose may have the same readings. The same
    holds for priors of beam and power so wide that the redundancy of the readings is below 0.001.
    Such a reading has the status UNCHECKED and no pose, unless `accept_unchecked` is true.

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
    solved = solve_question(sensor, values, question, start, threads)
    if (index := index_of(readings)) is not None:
        object.__setattr__(solved, "index", index)  # The solution is new, hence not shared.
    return solved


def solve_question(
    sensor: Sensor,
    checked: Floats,
    question: Question,
    start: Literal["zero", "previous"] | ArrayLike = "zero",
    threads: int = 1,
    warmer: Floats | None = None,
) -> Solution:
    """Solve checked readings (..., 9), as `solve` does.

    warmer: (n,) temperature of readings (n, 9) above the calibration's reference, K.
    """
    if is_short(question) and threads >= 0 and are_few(checked, start):
        solver = find_solver(sensor, question)
        if checked.ndim == 1:
            return solver.solve_from(checked, solver.start_state(start, checked))
        if (few := solver.solve_some(checked, warmer)) is not None:
            return few
    values, shape = as_rows(checked, 9, "readings")
    plan = find_plan(sensor, question.knowledge, question.method, shape)
    starts = start_states(sensor, start, plan, values, shape)
    request = make_problem(plan, starts, question, is_previous(start))
    rows = problem.Readings(values, sigmas_of(sensor, values))
    results = solve_rows(sensor, rows, plan, request, question.covariance, threads)
    parts = uncertainty_parts(sensor, plan, results, warmer)
    return solution(results, shape, chance_of(sensor, plan), parts)


def is_short(question: Question) -> bool:
    """Whether the settings of a solve contain no array, so that its solver can be cached."""
    beam, power = question.beam, question.power
    return (isinstance(beam, str) or is_plain(beam, 2)) and (
        isinstance(power, str) or is_plain(power, 1)
    )


#: Largest number of readings in the memory of a cached solver.
FEW = 64


def are_few(readings: Floats, start: str | ArrayLike) -> bool:
    """Whether readings fit a cached solver's memory: a single one, or a few that start from
    zero."""
    from_zero = isinstance(start, str) and start == "zero"
    return readings.ndim == 1 or (readings.ndim == 2 and 0 < len(readings) <= FEW and from_zero)


def local_solution(sensor: Sensor, reading: Floats, start: Floats) -> tuple[Floats, float]:
    """Solve one reading (9,) from a state (8,) with a free beam, without a search for others.

    Returns the state (8,), mm and rad, and the residual in standard deviations; NaN without a pose.
    """
    question, values = Question(), reading[None].copy()
    plan = find_plan(sensor, question.knowledge, question.method, ())
    starts = start_states(sensor, start, plan, values, ())
    request = make_problem(plan, starts, question)
    results = problem.empty_results(1, False)
    readings = problem.Readings(values, sigmas_of(sensor, values))
    estimate(kind_of(sensor), packed_vectors(sensor), readings, request, results)
    return results.states[0, :8], float(results.residuals[0])


def solve_rows(
    sensor: Sensor,
    readings: problem.Readings,
    plan: Plan,
    request: problem.FitProblem,
    covariance: bool,
    threads: int = 1,
) -> problem.Results:
    """Solve checked readings as `solve` does, but with covariances without the calibration's part.

    request: input of the compiled code, made from the plan.
    """
    n, kind = len(readings.values), kind_of(sensor)
    all_results = problem.empty_results(n, covariance)
    find_code(kind, request)  # compiled once, before the threads use it

    def run(part: slice) -> None:
        some, questions = problem.some_rows(part, readings, request)
        results = problem.Results(*(part_of(array, part, n) for array in all_results))
        estimate(kind, packed_vectors(sensor), some, questions, results)

    share(run, n, threads)
    review_poses(sensor, readings, plan, request, all_results)
    return all_results


def review_poses(
    sensor: Sensor,
    readings: problem.Readings,
    plan: Plan,
    request: problem.FitProblem,
    results: problem.Results,
) -> None:
    """Solve unlikely poses again, and withdraw poses that cannot be trusted, in `results`; see
    `doubts`."""

    def repeat(rows: NDArray[np.intp], starts: Floats) -> problem.Results:
        some, questions = problem.some_rows(rows, readings, request)
        repeated = problem.empty_results(len(rows), results.covariances.shape[1] > 0)
        questions = questions._replace(starts=starts, previous=False)
        estimate(kind_of(sensor), packed_vectors(sensor), some, questions, repeated)
        return repeated

    chance = chance_of(sensor, plan)
    if sensor.light.on and request.damped:
        replace_unlikely(sensor, plan, chance, results, repeat)
    withdraw_doubtful(sensor, plan.free, chance, results, repeat)


def solve_each(
    sensors: VariedSensors,
    values: Floats,
    question: Question,
) -> problem.Results:
    """Solve readings (n, 9) as `facets.solve` does, each with its own sensor; no covariances.

    question: settings; the means of priors may be arrays (n, 2) and (n,), one for each reading. A
    reading whose sensor is not possible has the status NON_FINITE.
    """
    sensor, shape = sensors.sensor, (len(values),)
    plan = make_plan(sensor, question.knowledge, shape=shape)
    starts = start_states(sensor, "zero", plan, values, shape)
    request = make_problem(plan, starts, question)
    readings = problem.Readings(values, sigmas_of(sensor, values))

    def estimate_rows(
        which: Any, some: problem.Readings, questions: problem.FitProblem
    ) -> problem.Results:
        results = problem.empty_results(len(some.values), False)
        some_sensors, some_question = sensors.rows(which), question.rows(which)
        remaining = np.arange(len(some.values))
        if some_sensors.kind is not None and len(remaining):
            vectors = some_sensors.pack(some_sensors.kind)
            estimate(some_sensors.kind, vectors, some, questions, results)
            is_unlit = (results.status == problem.OUT_OF_RANGE) & (results.steps == 0)
            remaining = np.flatnonzero(is_unlit & results.used.all(axis=1))  # or impossible
        estimate_singly(
            some_sensors, remaining, some.values, some_question, questions.starts, results
        )
        return results

    results = estimate_rows(np.arange(len(values)), readings, request)
    if sensors.kind is not None:

        def repeat(which: Any, starts: Floats) -> problem.Results:
            some, questions = problem.some_rows(which, readings, request)
            return estimate_rows(which, some, questions._replace(starts=starts))

        withdraw_doubtful(sensor, plan.free, chance_of(sensor, plan), results, repeat)
    return results


def estimate_singly(
    sensors: VariedSensors,
    which: Any,
    values: Floats,
    question: Question,
    starts: Floats,
    results: problem.Results,
) -> None:
    """Solve some rows one by one, with a `Sensor` for each, and write them into `results`."""
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
