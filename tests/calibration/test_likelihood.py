"""The likelihood by which causes are judged, against dense covariances of all readings."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments import rigs
from rig_samples import NOMINAL, sample_rig

from facets.calibration import Task, fit, scatter, unmodelled


@pytest.fixture(scope="module")
def fitted():
    data = sample_rig(40)[1]
    return data, fit.fit(NOMINAL, data, rigs.choice())


def dense_covariance(like, prior, variances):
    """Of every reading, the common unknowns with their prior in it; and these readings' rows."""
    rows = like.common.reshape(-1, like.common.shape[2])
    cover = rows @ np.linalg.solve(prior, rows.T)
    for n, block in enumerate(variances):
        cover[9 * n : 9 * n + 9, 9 * n : 9 * n + 9] += block
    return cover, rows


def test_the_likelihood_of_sizes_is_that_of_all_readings_together(fitted):
    data, found = fitted
    task = Task(NOMINAL, data, found.choice, None)
    like = scatter.Likelihood(task, found)
    known = scatter.prior_variances(task.data, found.choice)

    def dense(sizes):
        cover, rows = dense_covariance(like, task.prior, like.variance(known, sizes))
        start = (found.every - task.start)[found.choice.places]
        residuals = like.left.ravel() + rows @ start  # from where the unknowns were thought to be
        return np.linalg.slogdet(cover)[1] + residuals @ np.linalg.solve(cover, residuals)

    first, second = np.random.default_rng(1).uniform(0, 2, (2, len(scatter.NAMES)))
    change = like.restrict(known, first).unlikely - like.restrict(known, second).unlikely
    assert change == pytest.approx(dense(first) - dense(second), abs=1e-5)


def test_the_fall_of_columns_is_that_of_the_whole_likelihood(fitted):
    remainder = unmodelled.Remainder(NOMINAL, *fitted, None)
    like = remainder.likelihood
    columns = np.random.default_rng(3).standard_normal((40, 9, 4)) * remainder.is_read[:, :, None]
    known = scatter.prior_variances(remainder.data, remainder.found.choice)
    variances = like.variance(known, np.zeros(len(scatter.NAMES)))
    cover, rows = dense_covariance(like, like.prior, variances)
    residuals, flat = like.left.ravel() + rows @ like.before, columns.reshape(-1, 4)
    side = flat.T @ np.linalg.solve(cover, residuals)
    fall = side @ np.linalg.solve(flat.T @ np.linalg.solve(cover, flat), side)
    assert remainder.test("", columns).fall == pytest.approx(fall, rel=1e-5)


def test_waves_and_steps_are_columns_like_others(fitted):
    remainder = unmodelled.Remainder(NOMINAL, *fitted, None)
    rng = np.random.default_rng(4)
    waves, columns = rng.standard_normal((40, 5, 2)), rng.standard_normal((40, 9, 2))
    best = remainder.test_waves("", waves, [0, 2], np.arange(5.0))
    both = np.zeros((40, 9, 4))
    for i, k in enumerate((0, 2)):
        wave = waves[:, int(best.at)] * remainder.light[:, k : k + 1]
        both[:, 3 * k + 2, 2 * i : 2 * i + 2] = wave
    assert remainder.test("", both).fall == pytest.approx(best.fall, rel=1e-6)
    step = remainder.test_steps("", columns)
    behind = columns * (np.arange(40) >= step.at)[:, None, None]
    assert remainder.test("", behind).fall == pytest.approx(step.fall, rel=1e-6)


def test_the_chance_of_a_fall_is_that_of_chi_square_also_where_it_is_tiny():
    from scipy.special import chdtrc

    assert unmodelled.log_chance(30.0, 3) == pytest.approx(np.log(chdtrc(3, 30.0)))
    assert unmodelled.log_chance(1300.0, 6) == pytest.approx(np.log(chdtrc(6, 1300.0)), rel=1e-3)
    assert unmodelled.log_chance(5000.0, 6) < unmodelled.log_chance(4000.0, 6) < -1900
    assert unmodelled.log_chance(0.0, 0) == 0.0  # columns that the unknowns explain
