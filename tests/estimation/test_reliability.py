"""What one spoilt number can do unseen, against readings that are spoilt."""

import numpy as np
import pytest

import facets
from facets import Prior

SENSOR = facets.load("paper").sensor
STATE = np.array([0.05, -0.02, 1.0, 2e-3, -1e-3, 4e-3, 0, 0])


def shift(solution):
    """How far a pose is off, in standard uncertainties, correlations heeded."""
    off = solution.state - STATE
    scale = np.where(solution.uncertainty > 0, solution.uncertainty, np.inf)
    inner = np.linalg.pinv(solution.covariance / np.outer(scale, scale), rcond=1e-12)
    return float(np.sqrt(off / scale @ inner @ (off / scale)))


@pytest.mark.parametrize(
    "way",
    [
        {},
        {"beam": "known"},
        {"beam": "known", "power": "unknown"},
        {"beam": Prior((0, 0), 0.005), "power": Prior(0.3, 0.003)},
    ],
)
def test_an_error_that_leaves_the_limit_shifts_the_pose_by_what_is_told(way):
    """By first order: a number is spoilt by a tenth of its noise. Where the power is solved for
    too, a part of the shift is its own."""
    exact = facets.readings(SENSOR, STATE)
    sigma = facets.standard_deviations(SENSOR, exact)
    errors = facets.unseen_errors(SENSOR, STATE, **way)
    for k in range(9):
        reading = exact.copy()
        reading[k] += 0.1 * sigma[k]
        solution = facets.solve(SENSOR, reading, **way)
        if np.isinf(errors[k]):
            assert solution.residual < 1e-5
            continue
        unseen = shift(solution) / solution.residual * solution.limit
        assert unseen <= errors[k] * 1.01
        if way.get("power") is None:
            assert unseen == pytest.approx(errors[k], rel=0.01)


def test_nothing_checks_the_places_with_a_free_beam():
    free = facets.unseen_errors(SENSOR, np.tile(STATE, (2, 1))).reshape(2, 3, 3)
    assert np.isinf(free[..., :2]).all()
    assert (free[..., 2] < 10).all()
    assert np.isinf(facets.unseen_errors(SENSOR, STATE, power="unknown")).all()
    past_the_beam = np.array([0, 0, 0, 1.6, 0, 0, 0, 0])
    assert np.isnan(facets.unseen_errors(SENSOR, past_the_beam)).all()
