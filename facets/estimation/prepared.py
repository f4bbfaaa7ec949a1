"""A solver for one reading at a time: what is asked is checked once, and its memory is kept."""

from __future__ import annotations

import threading
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..model.arrays import packed
from . import problem
from .solution import FirstRow, Solution, SolutionOfOne, results_of
from .solver import (
    Prior,
    add_calibration,
    by_blocks,
    empty_results,
    plan,
    starting,
    workspace,
)


class Solver:
    """Solves single readings of one sensor, as a live loop does.

    Gives what `facets.solve` gives for the same reading, in less time, because the arguments are
    checked when the solver is made. Not to be shared by threads: its memory is used again.

    beam, power, method, max_steps, covariance: as for `facets.solve`; a `Prior` has one mean.
    start: "zero", or "previous", which starts where the last converged reading ended, and at zero
    where that does not lead to a pose.

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
        beam: Literal["free", "known"] | Prior = "free",
        power: Literal["known", "unknown"] | Prior = "known",
        start: Literal["zero", "previous"] = "zero",
        method: Literal["least-squares", "paper"] = "least-squares",
        max_steps: int = 50,
        covariance: bool = True,
    ) -> None:
        if max_steps < 1:
            raise InputError(f"max_steps is {max_steps}; allowed: 1 or more")
        if start not in ("zero", "previous"):
            raise InputError(f'start is {start!r}; allowed: "zero" or "previous"')
        self._asked = (sensor, beam, power, start, method, max_steps, covariance)
        self._sensor, self._warm = sensor, start == "previous"
        self._plan = plan(sensor, beam, power, method, ())
        self._values, self._found = np.empty((1, 9)), empty_results(1, covariance)
        self._zero = starting("zero", self._plan, np.zeros((1, 9)), ())
        self._unknown_power = bool(self._plan.weights[2] == 0 and self._plan.free[-1] == 8)
        self._starts, self._sigmas = self._zero.copy(), np.empty((0, 9))
        if sensor.electronics is not None:
            self._sigmas = np.empty((1, 9))
        self._problem = problem.Problem(
            means=self._plan.means,
            weight=self._plan.weights,
            free=self._plan.free,
            starts=self._starts,
            previous=False,
            max_steps=max_steps,
            damped=method != "paper",
        )
        self._task: problem.Task | None = None
        self._exact: problem.Task | None = None
        self._block: Any = None
        if by_blocks(sensor, self._problem):
            from .blocks import One

            given = problem.Readings(self._values, self._sigmas)
            self._block = One(packed(sensor), given, self._plan.limits, self._problem, covariance)
        self._first = FirstRow(self._found)
        self._last: Floats | None = None

    def __reduce__(self) -> Any:
        """A copy is a solver of its own, which begins anew: its memory has other addresses."""
        return _solver, self._asked

    def solve(self, reading: ArrayLike) -> Solution:
        """The pose of one reading (9,): psi, zeta (mm), power (mW) of detectors A, B, C.

        Returns a `Solution` without leading shape. A reading that can not be solved gets a status
        and NaN. Raises `InputError` for another shape.
        """
        values = np.asarray(reading, dtype=np.float64)
        if values.shape != (9,):
            raise InputError(f"a reading has shape {values.shape}; needed: (9,)")
        return self.solve_from(values, self._last)

    def solve_from(self, values: Floats, start: Floats | None) -> Solution:
        """The same of a reading (9,) that is checked, from `start` (9,) or (1, 9) if one is given.

        With start="previous" from zero where that leads to no pose.
        """
        self._values[0] = values
        if self._sensor.electronics is not None:
            self._sigmas[:] = standard_deviations(self._sensor, self._values)
        in_block = start is not None and self._run(start)
        if start is None or (self._warm and not in_block and not self._has_converged()):
            in_block = self._run(self._from_zero())
        return self._of_block() if in_block else self._of_one()

    def _has_converged(self) -> bool:
        return bool(self._found.status[0] == problem.CONVERGED)

    def _of_block(self) -> Solution:
        """What the block has found, in an array of its own."""
        if self._warm:
            self._last = self._block.state.copy()
        numbers = self._block.numbers.copy()
        if self._sensor.calibration is not None:
            add_calibration(self._sensor, self._plan, results_of(numbers))
        return SolutionOfOne.of(numbers)

    def _of_one(self) -> Solution:
        """What was found without a block, in arrays of its own."""
        if self._sensor.light.on and self._found.status[0] == problem.STALLED:
            self._run_exactly()
        if self._warm and self._has_converged():
            self._last = self._found.states[0].copy()
        add_calibration(self._sensor, self._plan, self._found)
        return self._first.solution()

    def starting(self, start: str | ArrayLike, values: Floats) -> Floats | None:
        """Where `facets.solve` starts for one reading (1, 9); None for zero."""
        if isinstance(start, str) and start in ("zero", "previous"):
            return None
        return starting(start, self._plan, values, ())

    def _from_zero(self) -> Floats:
        if self._unknown_power:
            return starting("zero", self._plan, self._values, ())
        return self._zero

    def _task_of(self, model: int) -> problem.Task:
        return problem.Task(
            problem.Model(model, packed(self._sensor)),
            problem.Readings(self._values, self._sigmas),
            self._plan.limits,
            self._problem,
            self._found,
            workspace(),
        )

    def _one_by_one(self) -> None:
        """The estimate of one reading alone, compiled when it is first needed."""
        from ..model import evaluators
        from .kernels import kernel

        if self._task is None:
            self._task = self._task_of(evaluators.nearly_linearised(self._sensor))
            self._kernel = kernel()
        self._kernel(self._task.address)

    def _run(self, start: Floats) -> bool:
        """Estimates the reading from a start; whether the block has found its pose."""
        self._starts[:] = start
        if self._block is not None and self._block.estimate():
            return True
        self._one_by_one()
        return False

    def _run_exactly(self) -> None:
        """From the last start, with derivatives that leave nothing out, for where steps without
        them stall."""
        from ..model import evaluators

        if self._exact is None:
            self._exact = self._task_of(evaluators.linearised(self._sensor))
        self._kernel(self._exact.address)


def _solver(
    sensor: Sensor, beam: Any, power: Any, start: Any, method: Any, max_steps: int, covariance: bool
) -> Solver:
    return Solver(
        sensor, beam=beam, power=power, start=start, method=method, max_steps=max_steps,
        covariance=covariance,
    )  # fmt: skip


#: Solvers are kept for so many questions a thread.
MOST_KEPT = 8
_kept = threading.local()


def kept_solver(
    sensor: Sensor, beam: str, power: str, method: str, max_steps: int, covariance: bool
) -> Solver:
    """A solver from zero for a sensor, made once a thread while no more than a few are asked for.

    It keeps its sensor, so that another can not have its identity.
    """
    if not hasattr(_kept, "solvers"):
        _kept.solvers = {}
    solvers: dict[tuple[Any, ...], Solver] = _kept.solvers
    key = (id(sensor), beam, power, method, max_steps, covariance)
    found = solvers.get(key)
    if found is None:
        if len(solvers) >= MOST_KEPT:
            solvers.clear()
        found = _solver(sensor, beam, power, "zero", method, max_steps, covariance)
        solvers[key] = found
    return found
