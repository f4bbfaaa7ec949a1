"""The likelihood by which causes are judged, against a dense covariance of all readings."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments.studies import rigs
from rig_samples import NOMINAL, sample_rig

from facets.calibration import Task, fit, scatter
from facets.detectors import standard_deviations


def test_the_likelihood_of_sizes_is_that_of_all_readings_together():
    data = sample_rig(40)[1]
    fitted = fit.fit(NOMINAL, data, rigs.choice())
    task = Task(NOMINAL, data, fitted.choice, None)
    like = scatter.Likelihood(task, fitted)
    known = scatter.prior_variances(task.data, fitted.choice)

    def dense(sizes, together):
        rows = like.common.reshape(-1, like.common.shape[2])
        cover = rows @ np.linalg.solve(task.prior, rows.T)
        for n, block in enumerate(like.variance(known, sizes, together)):
            cover[9 * n : 9 * n + 9, 9 * n : 9 * n + 9] += block
        start = (fitted.all_values - task.start)[fitted.choice.places]
        residuals = (
            like.residual.ravel() + rows @ start
        )  # from where the unknowns were thought to be
        return np.linalg.slogdet(cover)[1] + residuals @ np.linalg.solve(cover, residuals)

    rng = np.random.default_rng(1)
    first, second = zip(
        rng.uniform(0, 2, (2, len(scatter.NAMES))), rng.normal(size=(2, 6, 1)), strict=True
    )
    first, second = ((sizes, scatter.Together(way @ way.T)) for sizes, way in (first, second))
    change = like.restrict(known, *first).unlikely - like.restrict(known, *second).unlikely
    assert change == pytest.approx(dense(*first) - dense(*second), abs=1e-5)


def test_the_covariance_of_places_is_found_where_it_is_likeliest():
    """One detector scatters by itself, and all together; any other covariance is less likely."""
    way = np.array([1.0, -1.5, 1.2, 0.8, -1.0, 1.4])
    more = np.outer(way, way) + np.diag([0, 0, 4.0, 4.0, 0, 0])
    rng = np.random.default_rng(2)

    def shake(sensor, state, exact):
        sigma = standard_deviations(sensor, exact)[:, scatter.PLACE_READINGS]
        exact[:, scatter.PLACE_READINGS] += sigma * rng.multivariate_normal(
            np.zeros(6), more, len(exact)
        )
        return exact

    data = sample_rig(300, alter=shake)[1]
    fitted = fit.fit(NOMINAL, data, rigs.choice())
    like = scatter.Likelihood(Task(NOMINAL, data, fitted.choice, None), fitted)
    known = scatter.prior_variances(data, fitted.choice)
    start = np.zeros(len(scatter.NAMES))
    start[scatter.NAMES.index(scatter.POWERS)] = 0.1
    found = like.likeliest(known, (scatter.TOGETHER, scatter.POWERS), start)
    assert found.together.matrix == pytest.approx(more, abs=0.25 * more.max())
    for _ in range(10):
        step = 0.1 * rng.normal(size=(6, 6))
        other = found.together._replace(matrix=found.together.matrix + step + step.T)
        assert like.restrict(known, found.variances, other).unlikely > found.unlikely
