"""Samples that are solved together."""

from dataclasses import replace

import numpy as np
import pytest
from measured import measure

import facets
from facets import Samples

SENSOR, OPTIONS = facets.Sensor(), facets.load("paper").solve


def test_a_reading_that_needs_more_steps_from_rest_starts_from_its_neighbour():
    """Readings on a ramp away from rest, with so few steps that the farthest are not reached."""
    states = np.zeros((40, 8))
    states[:, 0] = np.linspace(0, 0.4, 40)
    readings = facets.readings(SENSOR, states)
    alone = facets.solve(SENSOR, readings, max_steps=4)
    together = measure(SENSOR, replace(OPTIONS, max_steps=4), Samples(readings))
    assert together.ok.sum() > alone.ok.sum()
    # as far as the estimate converges: 1e-6 of the noise, 2.6 nm a pm
    np.testing.assert_allclose(together.state[together.ok], states[together.ok], atol=1e-6)
    np.testing.assert_array_equal(together.state[alone.ok], alone.state[alone.ok])


@pytest.mark.parametrize("wrong", [np.nan, 1e30, 0.0])
def test_a_spoilt_reading_gets_its_status_and_spoils_no_other(wrong):
    """Each with what is known of the beam at its time: the mirror follows the beam."""
    states = np.zeros((30, 8))
    states[:, 0] = states[:, 6] = np.linspace(0, 3, 30)
    readings = facets.readings(SENSOR, states)
    readings[7] = wrong
    samples = Samples(readings, place=states[:, 6:])
    solution = measure(SENSOR, replace(OPTIONS, beam="known"), samples)
    assert not solution.ok[7]
    assert np.isnan(solution.state[7]).all()
    others = np.delete(np.arange(30), 7)
    np.testing.assert_allclose(solution.state[others], states[others], atol=1e-9)
