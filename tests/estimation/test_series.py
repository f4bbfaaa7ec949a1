"""Samples of a motion that are solved together."""

import numpy as np
import pytest

import facets
from facets import Knowledge, Prior
from facets.estimation import beam_at, nearest, solve_series

SENSOR = facets.Sensor()


def test_a_reading_that_needs_more_steps_from_rest_starts_from_its_neighbour():
    """Readings on a ramp away from rest, with so few steps that the farthest are not reached."""
    states = np.zeros((40, 8))
    states[:, 0] = np.linspace(0, 0.4, 40)
    readings = facets.readings(SENSOR, states)
    alone = facets.solve(SENSOR, readings, max_steps=4)
    found = solve_series(SENSOR, readings, Knowledge(), max_steps=4)
    assert alone.ok.sum() < 40
    assert found.ok.sum() > alone.ok.sum()
    # as far as the estimate converges: 1e-6 of the noise, 2.6 nm a pm
    np.testing.assert_allclose(found.state[found.ok, 0], states[found.ok, 0], atol=1e-6)
    np.testing.assert_array_equal(found.state[alone.ok], alone.state[alone.ok])


@pytest.mark.parametrize("wrong", [np.nan, 1e30, 0.0])
def test_a_spoilt_reading_gets_its_status_and_spoils_no_other(wrong):
    """Each with what is known of the beam at its time: the mirror follows the beam."""
    states = np.zeros((30, 8))
    states[:, 0] = states[:, 6] = np.linspace(0, 3, 30)
    readings = facets.readings(SENSOR, states)
    readings[7] = wrong
    known = Prior(states[:, 6:], 0.0)
    found = solve_series(SENSOR, readings, Knowledge(beam=known))
    assert not found.ok[7]
    assert np.isnan(found.state[7]).all()
    np.testing.assert_allclose(*(np.delete(x, 7, 0) for x in (found.state, states)), atol=1e-9)
    np.testing.assert_array_equal(beam_at(known, np.array([3, 5])).mean, states[[3, 5], 6:])
    assert beam_at("free", np.array([3])) == "free"


def test_the_nearest_number():
    among = np.array([2, 3, 9])
    np.testing.assert_array_equal(nearest(np.array([0, 2, 5, 7, 20]), among), [2, 2, 3, 9, 9])
    np.testing.assert_array_equal(nearest(np.array([0, 5]), np.array([4])), [4, 4])
