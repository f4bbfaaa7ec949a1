"""Estimate a few readings by interpreted Python, where that is faster than importing Numba.

A reading takes some hundredths of a second; the bits are those of `kernels`, which compiles the
same text.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..model import as_text
from ..model.arrays import geometry_of, packed_vectors
from . import gauss_newton, problem

#: For so many readings at a time.
MAX_READINGS = 30


def is_text_faster(sensor: Sensor, request: problem.FitProblem, count: int) -> bool:
    alone = not request.previous or count == 1
    loaded = f"{__package__}.kernels" in sys.modules
    can_run = alone and not loaded and not sensor.apertures.cut
    return can_run and count <= MAX_READINGS and as_text.has_time()


def estimate(
    model: str,
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.ScreeningLimits,
    request: problem.FitProblem,
    found: problem.Results,
) -> Any:
    """Fill `found` for independent readings; return the numbers of the readings that are left to
    `kernels`.

    model: of `evaluators`.
    """
    count = len(readings.values)
    if not is_text_faster(sensor, request, count):
        return np.arange(count)
    geometry, exact = geometry_of(sensor), not model.startswith("approximate_")

    def evaluate(x: Floats, out: Floats) -> None:
        as_text.fill_linearisation(geometry, exact, x, out)

    left = []
    for n in range(count):
        which, one = np.array([n]), problem.empty_results(1, len(found.covariances) > 0)
        given, questions = problem.some_rows(which, readings, request)
        try:
            with as_text.count_text_time():
                gauss_newton.estimate_each(
                    problem.CompiledModel(evaluate, packed_vectors(sensor)), given, limits,
                    questions, one, problem.workspace(),
                )  # fmt: skip
        except (ArithmeticError, ValueError):
            left.append(n)
            continue
        problem.put_rows(found, which, one)
    return np.array(left, int)
