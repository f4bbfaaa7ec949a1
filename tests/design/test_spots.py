"""The constraints of spots in the search for a front: together, the ranges' own clearances."""

from __future__ import annotations

import numpy as np
import pytest
from sensors import SENSORS, states

import facets
from facets.design import columns_of_states
from facets.design.spots import corner_clearances
from facets.model import geometry_of
from facets.optics import dark_scene


@pytest.mark.parametrize("name", ["paper", "skewed0", "skewed1"])
def test_the_light_on_a_facet_reaches_as_far_as_the_ranges_have_it(name):
    sensor = SENSORS[name]
    sizes = [(psd.size_y, psd.size_z) for psd in sensor.psds]
    for offset, angle in ((0.05, 0.3), (0.2, 0.02)):
        places = states(40, seed=3, offset=offset, angle=angle)
        fixed = geometry_of(sensor)
        parts = corner_clearances(fixed, dark_scene(fixed, columns_of_states(places)), sizes)
        found = np.array([np.min(np.broadcast_arrays(*part), axis=0) for part in parts.values()])
        expected = facets.margins(sensor, places)[:, :, :4].reshape(-1, 12)
        known = np.isfinite(expected).all(axis=1)
        assert known.any()
        np.testing.assert_allclose(found.T[known], expected[known], atol=1e-9)
