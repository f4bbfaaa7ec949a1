"""The likelihood by which causes are judged, against a dense covariance of all readings."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments.studies import rigs
from rig_samples import NOMINAL, sample_rig

from facets.calibration import Task, fit, scatter


def test_the_likelihood_of_sizes_is_that_of_all_readings_together():
    data = sample_rig(40)[1]
    fitted = fit.fit(NOMINAL, data, rigs.choice())
    task = Task(NOMINAL, data, fitted.choice, None)
    like = scatter.Likelihood(task, fitted)
    known = scatter.prior_variances(task.data, fitted.choice)

    def dense(sizes):
        rows = like.common.reshape(-1, like.common.shape[2])
        cover = rows @ np.linalg.solve(task.prior, rows.T)
        for n, block in enumerate(like.variance(known, sizes)):
            cover[9 * n : 9 * n + 9, 9 * n : 9 * n + 9] += block
        start = (fitted.all_values - task.start)[fitted.choice.places]
        residuals = (
            like.residual.ravel() + rows @ start
        )  # from where the unknowns were thought to be
        return np.linalg.slogdet(cover)[1] + residuals @ np.linalg.solve(cover, residuals)

    first, second = np.random.default_rng(1).uniform(0, 2, (2, len(scatter.NAMES)))
    change = like.restrict(known, first).unlikely - like.restrict(known, second).unlikely
    assert change == pytest.approx(dense(first) - dense(second), abs=1e-5)
