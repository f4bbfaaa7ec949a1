"""A solver for one reading at a time: the arguments are checked once, and memory is reused."""

from __future__ import annotations

import threading
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import as_floats, check_arguments
from ..core.errors import InputError
from ..core.knowledge import BeamKnowledge, Knowledge, PowerKnowledge
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..model import evaluators
from ..model.arrays import packed_vectors
from ..model.blocks import SINGLE
from ..model.threads import Pool
from . import as_text, problem
from .blocks import SingleBlock
from .doubts import WANDERED, are_unlikely, is_doubtful, replace_unlikely, withdraw_doubtful
from .estimates import add_calibration, block_code, estimate, row_kernel
from .plan import Plan, chance_of, make_plan, make_problem, start_states
from .solution import ITERATIONS, LIMIT, FirstRow, Solution, SolutionOfOne, results_of


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
        if max_steps < 1:
            raise InputError(f"max_steps is {max_steps}; allowed: 1 or more")
        self._asked = (sensor, beam, power, start, method, max_steps, covariance, accept_unchecked)
        self._plan = make_plan(sensor, Knowledge(beam=beam, power=power), method)
        self._previous = _Previous() if start == "previous" else None
        self._pool = Pool(self._prepare)
        self._pool.put_back(self._prepare())  # refuses now what it would refuse later

    def __reduce__(self) -> Any:
        """A copy is a solver of its own, which begins anew: its memory has other addresses."""
        return _solver, self._asked

    def _prepare(self) -> PreparedEstimate:
        sensor, _, _, _, method, max_steps, covariance, accept_unchecked = self._asked
        return PreparedEstimate(sensor, self._plan, method, max_steps, covariance, accept_unchecked)

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
        """The same of a reading (9,) that is checked, from `start` (9,) or (1, 9) if one is given,
        unless the solver itself knows where to start."""
        prepared = self._pool.take()
        previous = self._previous
        if previous is None:
            found = prepared.solve(values, start, False)
        else:
            found = prepared.solve(values, previous.end, True)
            if prepared.end is not None:
                previous.end = prepared.end
        self._pool.put_back(prepared)
        return found

    def start_state(self, start: str | ArrayLike, values: Floats) -> Floats | None:
        """The start of `facets.solve` for one reading (9,); None for zero."""
        if isinstance(start, str) and start in ("zero", "previous"):
            return None
        return start_states(self._asked[0], start, self._plan, values[None], ())


class _Previous(threading.local):
    """Where the last converged reading of this thread ended: (9,), with the power."""

    end: Floats | None = None


class PreparedEstimate:
    """The memory of one reading's estimate, for one call at a time.

    end: (9,) where the estimate ended, an array of its own; None unless it was asked for and has
    converged.
    """

    end: Floats | None = None

    def __init__(
        self,
        sensor: Sensor,
        todo: Plan,
        method: str,
        max_steps: int,
        covariance: bool,
        accept_unchecked: bool,
    ) -> None:
        self._sensor, self._plan = sensor, todo
        self._values, self._found = np.empty((1, 9)), problem.empty_results(1, covariance)
        self._zero = start_states(sensor, "zero", self._plan, np.zeros((1, 9)), ())
        self._unknown_power = bool(self._plan.weights[2] == 0 and self._plan.free[-1] == 8)
        self._starts, self._sigmas = self._zero.copy(), np.empty((0, 9))
        if sensor.electronics is not None:
            self._sigmas = np.empty((1, 9))
        self._problem = make_problem(
            self._plan, self._starts, "zero", method, max_steps, accept_unchecked
        )
        chance = self._chance = chance_of(sensor, self._plan)
        self._tasks: dict[str, problem.RowTask] = {}
        self._block: Any = None
        self._doubtful = is_doubtful(sensor, self._plan.free)
        self._seeks = sensor.light.on and self._problem.damped
        self._code = None if self._doubtful else self._block_code()
        if self._code is not None:
            given = problem.Readings(self._values, self._sigmas)
            self._block = SingleBlock(
                packed_vectors(sensor), given, self._plan.limits, self._problem, chance, covariance
            )
        self._first = FirstRow(self._found, chance)

    def solve(self, values: Floats, start: Floats | None, warm: bool) -> Solution:
        """The pose of a reading (9,), from `start` or else from zero.

        warm: whether to try zero where the start leads to no pose, and to keep the `end`.
        """
        self._values[0] = values
        if self._sensor.electronics is not None:
            self._sigmas[:] = standard_deviations(self._sensor, self._values)
        in_block = start is not None and self._run(start)
        if start is None or (warm and not in_block and not self._has_converged()):
            in_block = self._run(self._from_zero())
        if not in_block and self._sensor.light.on and self._found.status[0] == problem.STALLED:
            in_block = self._run_exactly()
        if in_block and self._is_sought_anew():
            in_block = False
        if in_block:
            if warm:
                self.end = self._block.state.copy()
            return self._block_solution()
        return self._row_solution(warm)

    def _has_converged(self) -> bool:
        return bool(self._found.status[0] == problem.CONVERGED)

    def _block_solution(self) -> Solution:
        """What the block has found, in an array of its own."""
        numbers, parts = self._block.numbers.copy(), None
        if self._sensor.calibration is not None:
            parts = add_calibration(self._sensor, self._plan, results_of(numbers))
        return SolutionOfOne.from_numbers(numbers, parts)

    def _is_sought_anew(self) -> bool:
        """Whether the block's pose may be unlikely under real light; it then becomes that of a
        row."""
        numbers = self._block.numbers
        if not self._seeks or numbers[ITERATIONS] <= WANDERED:
            return False
        own = results_of(numbers)
        problem.put_rows(self._found, np.zeros(1, np.intp), own)
        return bool(are_unlikely(own, numbers[LIMIT]).any())

    def _row_solution(self, warm: bool) -> Solution:
        """What was found without a block, in arrays of its own."""
        if self._seeks:
            replace_unlikely(
                self._sensor, self._plan, self._chance, self._found, self._estimate_again
            )
        if self._doubtful:
            withdraw_doubtful(
                self._sensor, self._plan.free, self._chance, self._found, self._estimate_again
            )
        if warm:
            self.end = self._found.states[0].copy() if self._has_converged() else None
        return self._first.solution(add_calibration(self._sensor, self._plan, self._found))

    def _from_zero(self) -> Floats:
        if self._unknown_power:
            return start_states(self._sensor, "zero", self._plan, self._values, ())
        return self._zero

    def _estimate(self, model: str) -> None:
        """By the text, or else by compiled code, whose task is kept."""
        given = problem.Readings(self._values, self._sigmas)
        limits, asked, found = self._plan.limits, self._problem, self._found
        if model not in self._tasks:
            if not len(as_text.estimate(model, self._sensor, given, limits, asked, found)):
                return
            own = problem.CompiledModel(evaluators.address(model), packed_vectors(self._sensor))
            task = problem.RowTask(own, given, limits, asked, found, problem.workspace())
            self._tasks[model], self._kernel = task, row_kernel()
        self._kernel(self._tasks[model].address)

    def _one_by_one(self) -> None:
        """The estimate of one reading alone, compiled when it is first needed."""
        self._estimate(evaluators.approximate_linearisation(self._sensor))

    def _block_code(self, exact: bool = False) -> Any:
        return block_code(self._sensor, self._problem, exact, SINGLE)

    def _run(self, start: Floats) -> bool:
        """Estimates the reading from a start; whether the block has found its pose."""
        self._starts[:] = start
        ended = None if self._code is None else self._block.estimate(self._code)
        if ended is None:
            self._one_by_one()
        else:
            self._found.status[0] = ended
        return ended == problem.CONVERGED

    def _estimate_again(self, rows: Any, starts: Floats) -> problem.Results:
        """The reading from another start, in results of its own."""
        found = problem.empty_results(len(rows), len(self._found.covariances) > 0)
        given = problem.Readings(self._values, self._sigmas)
        asked = self._problem._replace(starts=starts)
        estimate(self._sensor, given, self._plan.limits, asked, found)
        return found

    def _run_exactly(self) -> bool:
        """From the last start, with derivatives that leave nothing out, for where steps without
        them stall; whether the block has found the pose."""
        code = None if self._block is None else self._block_code(exact=True)
        if code is not None and self._block.estimate(code) == problem.CONVERGED:
            return True
        self._estimate(evaluators.linearisation(self._sensor))
        return False


def _solver(
    sensor: Sensor,
    beam: Any,
    power: Any,
    start: Any,
    method: Any,
    max_steps: int,
    covariance: bool,
    accept_unchecked: bool,
) -> Solver:
    return Solver(
        sensor, beam=beam, power=power, start=start, method=method, max_steps=max_steps,
        covariance=covariance, accept_unchecked=accept_unchecked,
    )  # fmt: skip


#: Solvers are kept for so many questions.
MAX_SOLVERS = 8
_kept: dict[tuple[Any, ...], Solver] = {}


def find_solver(
    sensor: Sensor,
    beam: str,
    power: str,
    method: str,
    max_steps: int,
    covariance: bool,
    accept_unchecked: bool,
) -> Solver:
    """Return a cached solver for a sensor that starts from zero.

    The cache keeps the sensor, so that no other sensor can have its identity.
    """
    rest = (method, max_steps, covariance, accept_unchecked)
    key = (id(sensor), beam, power, *rest)
    found = _kept.get(key)
    if found is None:
        if len(_kept) >= MAX_SOLVERS:
            _kept.clear()
        found = _solver(sensor, beam, power, "zero", *rest)
        _kept[key] = found
    return found
