"""Readings of which each has a sensor of its own; `test_estimators.py` compares their poses."""

import numpy as np

import facets
from facets import Status
from facets.core import Question
from facets.estimation import solve_each
from facets.model import VariedSensors, parameters


def test_readings_without_a_pose_and_sensors_that_cannot_be_keep_their_places():
    sensor = facets.Sensor()
    values = np.tile(facets.readings(sensor, np.zeros(8)), (10, 1))
    values[2], values[3, 2], values[5, 0] = np.nan, 0.0, 6.6
    sensors = VariedSensors(sensor, np.tile(parameters(sensor), (10, 1)), None)
    sensors.parameters[7, 6] = -0.1
    found = solve_each(sensors, values, Question())
    lost = [2, 3, 5, 7]
    expected = [Status.NON_FINITE, Status.NO_LIGHT, Status.OUT_OF_RANGE, Status.NON_FINITE]
    assert found.status[lost].tolist() == expected
    assert np.isnan(found.states[lost]).all()
    assert np.abs(np.delete(found.states[:, :8], lost, axis=0)).max() < 1e-9
