"""A solver for one reading at a time: what is asked is checked once, and its memory is kept."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..model.arrays import packed
from . import problem
from .solver import (
    Prior,
    Solution,
    Status,
    add_calibration,
    empty_results,
    plan,
    solution,
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
        from ..model import evaluators
        from .kernels import invert

        self._sensor, self._warm, self._invert = sensor, start == "previous", invert
        self._plan = plan(sensor, beam, power, method, ())
        self._values, self._found = np.empty((1, 9)), empty_results(1, covariance)
        self._zero = starting("zero", self._plan, np.zeros((1, 9)), ())
        self._unknown_power = bool(self._plan.weights[2] == 0 and self._plan.free[-1] == 8)
        self._starts = self._zero.copy()
        self._problem = problem.Problem(
            means=self._plan.means,
            weight=self._plan.weights,
            free=self._plan.free,
            starts=self._starts,
            previous=False,
            max_steps=max_steps,
            damped=method != "paper",
        )
        self._model = problem.Model(evaluators.nearly_linearised(sensor), packed(sensor))
        self._memory, self._no_sigmas = workspace(), np.empty((0, 9))
        self._last: Floats | None = None

    def solve(self, reading: ArrayLike) -> Solution:
        """The pose of one reading (9,): psi, zeta (mm), power (mW) of detectors A, B, C.

        Returns a `Solution` without leading shape. A reading that can not be solved gets a status
        and NaN. Raises `InputError` for another shape.
        """
        values = np.asarray(reading, dtype=np.float64)
        if values.shape != (9,):
            raise InputError(f"a reading has shape {values.shape}; needed: (9,)")
        self._values[0] = values
        if self._last is not None:
            self._run(self._last)
        if self._last is None or self._found.status[0] != Status.CONVERGED:
            self._run(self._from_zero())
        if self._sensor.light.on and self._found.status[0] == Status.STALLED:
            self._run(self._from_zero(), self._exact_model())
        if self._warm and self._found.status[0] == Status.CONVERGED:
            self._last = self._found.states.copy()
        if len(self._found.covariances) > 0:
            add_calibration(self._sensor, self._plan, self._found)
        return solution(problem.Results(*(array.copy() for array in self._found)), ())

    def _from_zero(self) -> Floats:
        if self._unknown_power:
            return starting("zero", self._plan, self._values, ())
        return self._zero

    def _exact_model(self) -> problem.Model:
        """With derivatives that leave nothing out, for where steps without them stall."""
        from ..model import evaluators

        return problem.Model(evaluators.linearised(self._sensor), packed(self._sensor))

    def _run(self, start: Floats, model: problem.Model | None = None) -> None:
        self._starts[:] = start
        self._found.covariances[:] = 0.0
        sigmas = self._no_sigmas
        if self._sensor.electronics is not None:
            sigmas = standard_deviations(self._sensor, self._values)
        readings = problem.Readings(self._values, sigmas)
        self._invert(
            model or self._model,
            readings,
            self._plan.limits,
            self._problem,
            self._found,
            self._memory,
        )
