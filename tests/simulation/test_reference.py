"""A reference beside the sensor."""

import numpy as np
import pytest

from facets.simulation import reference_columns, reference_poses

SIGMA = (1e-4, 1e-4, np.inf, 1e-6, 1e-6, 1e-6)


def test_an_error_stays_while_the_mirror_stands_still():
    poses = np.repeat([[0.0] * 6, [0.1] * 6, [0.0] * 6], 4, axis=0)
    error = np.delete(reference_poses(poses, SIGMA, np.random.default_rng(1)) - poses, 2, axis=1)
    stands = error.reshape(3, 4, 5)
    assert np.ptp(stands, axis=1).max() < 1e-15
    assert (np.diff(stands[:, 0], axis=0) != 0).all()


def test_errors_are_as_large_as_said_and_an_axis_may_be_missing():
    poses = np.random.default_rng(1).uniform(-1, 1, (4000, 6))
    said = reference_poses(poses, SIGMA, np.random.default_rng(2))
    assert (said - poses).std(axis=0)[[0, 5]] == pytest.approx([1e-4, 1e-6], rel=0.05)
    assert len(reference_columns(said)) == 5
