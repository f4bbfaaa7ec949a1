"""Samples of a motion that are solved together."""

import numpy as np
import pytest

import facets
from facets import Knowledge
from facets.estimation import beam_at, nearest, solve_series

SENSOR = facets.Sensor()


def circle(radius: float, count: int) -> np.ndarray:
    """States (n, 8) of an apex that goes round the beam, mm and rad."""
    angle = np.linspace(0, 2 * np.pi, count)
    states = np.zeros((count, 8))
    states[:, 0], states[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    states[:, 5] = 1e-3 * np.sin(3 * angle)
    return states


def test_the_poses_are_those_of_each_reading_by_itself():
    readings = facets.readings(SENSOR, circle(0.2, 50))
    found = solve_series(SENSOR, readings, Knowledge())
    alone = facets.solve(SENSOR, readings)
    assert found.ok.all()
    np.testing.assert_array_equal(found.state, alone.state)


def test_a_reading_that_needs_more_steps_from_rest_starts_from_its_neighbour():
    """Readings on a ramp away from rest, with so few steps that the farthest are not reached."""
    states = np.zeros((40, 8))
    states[:, 0] = np.linspace(0, 0.4, 40)
    readings = facets.readings(SENSOR, states)
    few = {"max_steps": 4}
    alone = facets.solve(SENSOR, readings, **few)
    found = solve_series(SENSOR, readings, Knowledge(), **few)
    assert alone.ok.sum() < 40
    assert found.ok.sum() > alone.ok.sum()
    good = found.ok
    # as far as the estimate converges: 1e-6 of the noise, 2.6 nm a pm
    np.testing.assert_allclose(found.state[good, 0], states[good, 0], atol=1e-6)


@pytest.mark.parametrize("wrong", [np.nan, 1e30, 0.0])
def test_a_spoilt_reading_gets_its_status_and_spoils_no_other(wrong):
    readings = facets.readings(SENSOR, circle(0.1, 20))
    readings[7] = wrong
    found = solve_series(SENSOR, readings, Knowledge())
    assert not found.ok[7]
    assert np.isnan(found.state[7]).all()
    assert np.delete(found.ok, 7).all()


def test_what_is_known_of_the_beam_goes_with_its_reading():
    states = np.zeros((30, 8))
    states[:, 0] = states[:, 6] = np.linspace(0, 3, 30)  # the mirror follows the beam
    readings = facets.readings(SENSOR, states)
    known = facets.Prior(states[:, 6:], 0.0)
    found = solve_series(SENSOR, readings, Knowledge(beam=known))
    np.testing.assert_allclose(found.state, states, atol=1e-9)
    np.testing.assert_array_equal(beam_at(known, np.array([3, 5])).mean, states[[3, 5], 6:])
    assert beam_at("free", np.array([3])) == "free"


def test_the_nearest_number():
    among = np.array([2, 3, 9])
    np.testing.assert_array_equal(nearest(np.array([0, 2, 5, 7, 20]), among), [2, 2, 3, 9, 9])
    np.testing.assert_array_equal(nearest(np.array([0, 5]), np.array([4])), [4, 4])
