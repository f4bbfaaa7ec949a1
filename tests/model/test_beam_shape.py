"""The beam's cross-section as a covariance."""

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies.sensors import skew_sensor

import facets
from facets.model import beam_shape


@pytest.mark.parametrize("diameter_y", [0.85, 0.7])
def test_derivatives_by_the_shape_of_round_and_oval_beams_are_differences(diameter_y):
    sensor = skew_sensor(3)
    beam = replace(sensor.beam, diameter_x=0.85, diameter_y=diameter_y, rotation=0.3)
    sensor = replace(sensor, beam=beam)
    states = np.array([[0.02, -0.03, 0.5, 1e-3, -2e-3, 0, 0, 0]])
    shape, step = np.array(beam_shape.shape_of(0.85, diameter_y, 0.3)), 1e-7

    def moved(change):
        x, y, turn = beam_shape.axes_of(shape + change, 0.3)
        changed = replace(beam, diameter_x=x, diameter_y=y, rotation=turn)
        return facets.readings(replace(sensor, beam=changed), states)[0]

    differences = [(moved(way) - moved(-way)) / (2 * step) for way in step * np.eye(3)]
    whole = facets.parameter_jacobian(sensor, states)
    derivatives = beam_shape.shape_derivatives(sensor, states, whole)[0]
    assert derivatives == pytest.approx(np.transpose(differences), rel=1e-4, abs=1e-6)
