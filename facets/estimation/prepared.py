"""A solver for one reading at a time: the arguments are checked once, and memory is reused."""

from __future__ import annotations

import threading
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import as_floats, check_arguments
from ..core.errors import InputError
from ..core.knowledge import BeamKnowledge, PowerKnowledge, Question
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..model.arrays import packed_vectors
from ..model.blocks import SINGLE, lanes
from ..model.threads import Pool
from . import problem
from .blocks import KeptBlocks
from .doubts import WANDERED, is_doubtful, replace_unlikely, withdraw_doubtful
from .estimates import add_calibration, block_code, estimate, needs_exactness
from .plan import Plan, chance_of, make_plan, make_problem, start_states
from .problem import CHECKS, COVARIANCE, ITERATIONS, LIMIT, RESIDUAL, STATUS, USED
from .solution import LazySolution, Solution, results_of, solution
from .uncertainty import UncertaintyParts


@check_arguments
class Solver:
    """Solves single readings of one sensor, as a live loop does.

    The results equal those of `facets.solve` and take less time, because the arguments are checked
    when the solver is made, and memory is reused. Threads may share a solver: each call has its own
    memory. A forked process and a copy have their own solver.

    beam, power, method, max_steps, covariance, accept_unchecked: as for `facets.solve`; a `Prior`
    has one mean.
    start: "zero", or "previous", which starts where the last converged reading of the same thread
    ended, and at zero where that does not lead to a pose.

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
        """Make a solver from a question that is checked."""
        solver = cls.__new__(cls)
        solver._begin(sensor, question, start)
        return solver

    def _begin(self, sensor: Sensor, question: Question, start: str) -> None:
        self._arguments = (sensor, question, start)
        self._plan = make_plan(sensor, question.knowledge, question.method)
        self._previous = _Previous() if start == "previous" else None
        self._pool = Pool(self._prepare)
        self._pool.put_back(self._prepare())  # refuses now what it would refuse later

    def __reduce__(self) -> Any:
        """A copy is another solver, which begins anew: its memory has other addresses."""
        return Solver.solver_of, self._arguments

    def _prepare(self) -> PreparedEstimate:
        sensor, question, _ = self._arguments
        return PreparedEstimate(sensor, self._plan, question)

    def solve(self, reading: ArrayLike) -> Solution:
        """Solve one reading (9,) for its pose: psi, zeta (mm), power (mW) of detectors A, B, C.

        Returns a `Solution` without leading shape. A reading that cannot be solved gets a status
        and NaN. Raises `InputError` for another shape.
        """
        values = as_floats(reading, "reading", 9)
        if values.shape != (9,):
            raise InputError(f"a reading has shape {values.shape}; needed: (9,)")
        return self.solve_from(values, None)

    def solve_from(self, values: Floats, start: Floats | None) -> Solution:
        """Solve a reading (9,) that is checked.

        start: (9,) or (1, 9); not used where the solver starts from the previous end.
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
        """Solve a few readings (n, 9) that are checked, from zero.

        Returns None where one pass of blocks is not enough: the power is unknown, poses may have to
        be withdrawn, or an estimate under real light wanders or stalls.

        warmer: (n,) how much warmer than the calibration's reference each is, K.
        """
        prepared = self._pool.take()
        solved = prepared.solve_some(values, warmer)
        self._pool.put_back(prepared)
        return solved

    def start_state(self, start: str | ArrayLike, values: Floats) -> Floats | None:
        """The start of `facets.solve` for one reading (9,); None for zero."""
        if isinstance(start, str) and start in ("zero", "previous"):
            return None
        return start_states(self._arguments[0], start, self._plan, values[None], ())


class _Previous(threading.local):
    """The end (9,) of this thread's last converged reading, with the power."""

    end: Floats | None = None


class PreparedEstimate:
    """The memory of one reading's estimate, for one call at a time.

    end: (9,) where the estimate ended, an array of its own; None unless it was asked for and has
    converged.
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
        self._has_exact = needs_exactness(sensor)
        self._code: Any = None  # made when it is asked for
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
        count = len(values)
        rows = -(-count // lanes()) * lanes()
        if self._some is None or len(self._some.numbers) != rows:
            self._some = self._make_some(rows)
        self._rows.values[:count], self._rows.values[count:] = values, values[-1]
        if self._sensor.electronics is not None:
            self._rows.sigmas[:] = standard_deviations(self._sensor, self._rows.values)
        self._starts[:] = self._zero
        self._some.estimate(self._wide_code)
        numbers = self._some.numbers[:count].copy()
        wandered = self._seeks and (numbers[:, ITERATIONS] > WANDERED).any()
        if wandered or (self._has_exact and (numbers[:, STATUS] == problem.STALLED).any()):
            return None
        return LazySolution.from_numbers(self._put_limits(numbers), self._parts(numbers, warmer))

    def _make_some(self, rows: int) -> KeptBlocks:
        self._rows = problem.Readings(
            np.empty((rows, 9)), np.empty((rows if len(self._sigmas) else 0, 9))
        )
        self._wide_code = block_code(self._sensor, self._problem)
        packed = packed_vectors(self._sensor)
        kept = KeptBlocks(packed, self._rows, self._problem, len(self._numbers) > COVARIANCE)
        kept.numbers[:, CHECKS:COVARIANCE] = self._numbers[CHECKS:COVARIANCE]
        return kept

    def _put_limits(self, numbers: Floats) -> Floats:
        """Give numbers the limits of the detectors that were used."""
        used = numbers[..., USED:RESIDUAL] > 0
        if not used.all():
            checks = self._chance.checks(used)
            numbers[..., CHECKS], numbers[..., LIMIT] = checks, self._chance.limits(checks)
        return numbers

    def _parts(self, numbers: Floats, warmer: Floats | None = None) -> UncertaintyParts | None:
        if self._sensor.calibration is None:
            return None
        return add_calibration(self._sensor, self._plan, results_of(numbers), warmer)

    def solve(self, values: Floats, start: Floats | None, warm: bool) -> Solution:
        """Solve a reading (9,) from `start`, or from zero without one.

        warm: whether to try zero where the start leads to no pose, and to keep the `end`.
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
        if self._doubtful or (self._seeks and self._ends[ITERATIONS] > WANDERED):
            return self._solution_in_doubt(results_of(numbers), warm)
        if warm:
            self._keep_end(numbers[: problem.UNKNOWNS], numbers[STATUS])
        return LazySolution.from_numbers(numbers, self._parts(numbers))

    def _own_numbers(self) -> Floats:
        """The block's numbers in an array of their own, with the limit of the detectors used."""
        numbers: Floats = self._numbers.copy()
        used = self._ends[USED] and self._ends[USED + 1] and self._ends[USED + 2]
        return numbers if used else self._put_limits(numbers)

    def _solution_in_doubt(self, results: problem.Results, warm: bool) -> Solution:
        """The solution of a reading whose pose may not be the right one."""
        again, chance = self._estimate_again, self._chance
        if self._seeks:
            replace_unlikely(self._sensor, self._plan, chance, results, again)
        if self._doubtful:
            withdraw_doubtful(self._sensor, self._plan.free, chance, results, again)
        if warm:
            self._keep_end(results.states[0], results.status[0])
        return solution(results, (), chance, add_calibration(self._sensor, self._plan, results))

    def _keep_end(self, state: Floats, status: int) -> None:
        self.end = state.copy() if status == problem.CONVERGED else None

    def _from_zero(self) -> Floats:
        if self._unknown_power:
            return start_states(self._sensor, "zero", self._plan, self._readings.values, ())
        return self._zero

    def _run(self, start: Floats) -> None:
        """Estimate the reading from a start, and again with exact derivatives where it has stalled
        under real light."""
        self._starts[:] = start
        if self._code is None:
            self._code = block_code(self._sensor, self._problem, width=SINGLE)
        self._block.estimate(self._code)
        if self._has_exact and self._ends[STATUS] == problem.STALLED:
            exact: Any = block_code(self._sensor, self._problem, True, SINGLE)
            self._block.estimate(exact)

    def _estimate_again(self, rows: Any, starts: Floats) -> problem.Results:
        """Estimate the reading from another start, into new results."""
        results = problem.empty_results(1, len(self._numbers) > COVARIANCE)
        request = self._problem._replace(starts=starts)
        estimate(self._sensor, self._readings, request, results)
        return results


#: Solvers are kept for so many questions.
MAX_SOLVERS = 8
_kept: dict[tuple[int, Question], Solver] = {}


def find_solver(sensor: Sensor, question: Question) -> Solver:
    """Return a cached solver for a sensor that starts from zero.

    The cache keeps the sensor, so that no other sensor can have its identity.
    """
    key = (id(sensor), question)
    solver = _kept.get(key)
    if solver is None:
        if len(_kept) >= MAX_SOLVERS:
            _kept.clear()
        solver = _kept[key] = Solver.solver_of(sensor, question)
    return solver
