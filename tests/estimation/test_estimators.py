"""All executions of the estimator give the same poses: see `tests/helpers/estimators.py`."""

from __future__ import annotations

import numpy as np
import pytest
from estimators import (
    COUNT,
    EXECUTIONS,
    SENSORS,
    SLOW_SENSORS,
    questions,
    solve_batch,
)
from hypothesis import HealthCheck, Phase, given, settings

from facets import Status
from facets.estimation import has_fold

#: Statuses before a step is made.
SCREENED = (Status.NON_FINITE, Status.NO_LIGHT, Status.OUT_OF_RANGE, Status.UNCHECKED)


def compare(execution, question):
    question = question.rows(slice(0, COUNT // execution.effort))
    answer, expected = execution.solve(question), solve_batch(question)
    converged = expected.status == Status.CONVERGED
    # where a sensor has a second solution, or a reading starts from the one before, rows are used
    sigmas, spread, misfits = execution.sigmas, execution.spread, execution.misfits
    if sigmas == 0 and (has_fold(question.sensor) or not question.is_of_each()):
        sigmas = spread = 1e-6
    if question.sensor.light.on and not question.is_of_each():  # where it ends depends on the start
        sigmas, spread, misfits = 0.05, 0.05, False
    compared = converged.copy()
    if not misfits:
        compared &= ~(expected.residual > expected.limit)
    if execution.screens:
        alike = misfits | compared | np.isin(expected.status, SCREENED)
        np.testing.assert_array_equal(answer.status[alike], expected.status[alike])
        np.testing.assert_array_equal(answer.used, expected.used)
        assert np.isnan(answer.state[answer.status != Status.CONVERGED]).all()
    else:
        fitting = compared.sum()
        compared &= answer.status == Status.CONVERGED
        assert compared.sum() >= 0.9 * fitting
    if sigmas == 0:
        for name, ours, theirs in zip(answer._fields, answer, expected, strict=True):
            if ours is not None:
                np.testing.assert_array_equal(ours, theirs, name)
        return
    size = np.sqrt(np.einsum("nii->ni", expected.covariance))
    off = np.abs(answer.state - expected.state)
    rounding = 1e-12 if sigmas < 1e-3 else 1e-8
    assert (off <= sigmas * size + rounding)[compared].all()
    assert np.abs(answer.residual - expected.residual)[compared].max(initial=0) <= sigmas
    np.testing.assert_allclose(answer.power[compared], expected.power[compared], rtol=sigmas)
    if answer.covariance is not None:
        off = np.abs(answer.covariance - expected.covariance)
        scale = size[:, :, None] * size[:, None, :]
        assert (off <= spread * scale + 1e-300)[compared].all()
    if answer.limit is not None:
        np.testing.assert_allclose(answer.limit, expected.limit, rtol=1e-12)


@pytest.mark.parametrize("name", EXECUTIONS)
@pytest.mark.parametrize(
    ("sensors", "count"), [(SENSORS, 4), pytest.param(SLOW_SENSORS, 8, marks=pytest.mark.slow)]
)
def test_an_execution_gives_the_poses_of_all_others(name, sensors, count):
    """Compare an execution with batches for some questions that it can answer."""
    execution = EXECUTIONS[name]
    if not execution.exists:
        pytest.skip("this machine has no program that it needs")
    examples = max(2, count // execution.effort)

    @settings(max_examples=examples, phases=[Phase.generate], suppress_health_check=HealthCheck)
    @given(questions(sensors).filter(execution.can_answer))
    def compare_all(question):
        compare(execution, question)

    compare_all()
