"""Whatever the readings, the solver ends, and a converged pose explains them."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from sensors import SENSORS, states

import facets
from facets import Prior, Status

ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)
PLACES = st.floats(-7, 7)
POWERS = st.floats(-0.1, 1)
READINGS = st.tuples(*[st.one_of(PLACES, ANY), PLACES, st.one_of(POWERS, ANY)] * 3)
WAYS = st.sampled_from(
    [
        {},
        {"beam": "known"},
        {"beam": Prior((0, 0), 1e-3)},
        {"power": "unknown", "accept_unchecked": True},
        {"beam": "known", "accept_unchecked": True},
        {"method": "paper"},
    ]
)
PLAIN = facets.Sensor()


@settings(max_examples=150)
@given(READINGS, WAYS)
def test_readings_with_anything_in_them(reading, way):
    solution = facets.solve(PLAIN, np.array(reading), **way)
    assert int(solution.status) in set(Status)
    assert solution.iterations <= 100
    for numbers in (solution.state, solution.covariance):
        assert np.isfinite(numbers).all() == solution.converged
    assert np.isnan(solution.state).all() != solution.converged
    assert solution.converged or not solution.ok


@pytest.mark.parametrize("name", SENSORS)
def test_far_off_the_beam_the_truth_is_found_or_none(name):
    """To 2.8 sigma of the smallest beam, from zero: no converged pose that is not the true one."""
    sensor, truth = SENSORS[name], states(20_000, seed=5, offset=0.35)
    truth = truth[facets.reaches(sensor, truth).all(axis=1)]
    solution = facets.solve(sensor, facets.readings(sensor, truth), covariance=False, threads=0)
    assert solution.ok.mean() > 0.999
    assert np.abs(solution.state - truth)[solution.ok].max() < 1e-9


@pytest.mark.parametrize("angle", [0.05, 0.2])
def test_starts_far_off_end_at_the_truth_or_say_why(angle):
    truth = states(2000, seed=6, offset=0.1, angle=0.005)
    truth = truth[facets.reaches(PLAIN, truth).all(axis=1)]
    off = np.random.default_rng(1).uniform(-1, 1, truth.shape)
    start = truth + off * [0.2, 0.2, 5, *[angle] * 3, 0.2, 0.2]
    solution = facets.solve(PLAIN, facets.readings(PLAIN, truth), start=start)
    assert np.abs(solution.state - truth)[solution.ok].max() < 1e-9
    assert solution.ok.mean() > 0.9
