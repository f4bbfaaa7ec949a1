"""The likelihood by which causes are judged, against dense covariances of all readings."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments import rigs
from rig_samples import NOMINAL, sample_rig

from facets.calibration import fit, scatter, unmodelled


@pytest.fixture(scope="module")
def remainder():
    data = sample_rig(40)[1]
    return unmodelled.Remainder(NOMINAL, data, fit.fit(NOMINAL, data, rigs.choice()), None)


def dense_covariance(like, variances):
    """Of every reading, the common unknowns with their prior in it; and the residuals from where
    these were thought to be."""
    rows = like.common.reshape(-1, like.common.shape[2])
    cover = rows @ np.linalg.solve(like.prior, rows.T)
    for n, block in enumerate(variances):
        cover[9 * n : 9 * n + 9, 9 * n : 9 * n + 9] += block
    return cover, like.left.ravel() + rows @ like.before


def test_the_likelihood_of_sizes_is_that_of_all_readings_together(remainder):
    like = remainder.likelihood
    known = scatter.prior_variances(remainder.data, remainder.found.choice)

    def dense(sizes):
        cover, residuals = dense_covariance(like, like.variance(known, sizes))
        return np.linalg.slogdet(cover)[1] + residuals @ np.linalg.solve(cover, residuals)

    first, second = np.random.default_rng(1).uniform(0, 2, (2, len(scatter.NAMES)))
    change = like.restrict(known, first).unlikely - like.restrict(known, second).unlikely
    assert change == pytest.approx(dense(first) - dense(second), abs=1e-5)


def test_the_fall_of_columns_waves_and_steps_is_that_of_the_whole_likelihood(remainder):
    known = scatter.prior_variances(remainder.data, remainder.found.choice)
    variances = remainder.likelihood.variance(known, np.zeros(len(scatter.NAMES)))
    cover, residuals = dense_covariance(remainder.likelihood, variances)

    def fall(columns):
        flat = (columns * remainder.is_read[:, :, None]).reshape(len(residuals), -1)
        side = flat.T @ np.linalg.solve(cover, residuals)
        return pytest.approx(side @ np.linalg.solve(flat.T @ np.linalg.solve(cover, flat), side),
                             rel=1e-5)  # fmt: skip

    rng = np.random.default_rng(3)
    columns, waves = rng.standard_normal((40, 9, 4)), rng.standard_normal((40, 5, 2))
    assert remainder.test("", columns).fall == fall(columns)
    step = remainder.test_steps("", columns)
    assert step.fall == fall(columns * (np.arange(40) >= step.at)[:, None, None])
    best = remainder.test_waves("", waves, [0, 2], np.arange(5.0))
    both = np.zeros((40, 9, 4))
    for i, k in enumerate((0, 2)):
        both[:, 3 * k + 2, 2 * i : 2 * i + 2] = (
            waves[:, int(best.at)] * remainder.light[:, k : k + 1]
        )
    assert best.fall == fall(both)
