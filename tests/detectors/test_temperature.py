"""What the temperature does to the readings and to the beam."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.core import Thermal
from facets.detectors import beam_shift, exact_readings, warmer_than_reference

THERMAL = Thermal(reference=21.0, beam=(2e-3, -1e-3), places=(0.0, -2e-3, 1e-3, 0, 0, 3e-3))
SENSOR = facets.Sensor(thermal=THERMAL)


def test_readings_at_a_temperature_become_those_at_the_reference():
    """Six places move by their coefficients; powers, and readings at the reference, stay."""
    exact = facets.readings(SENSOR, np.zeros((3, 8)))
    raw = exact.copy()
    warmer = warmer_than_reference(SENSOR, np.array([21.0, 23.0, np.nan]))
    assert warmer[:2].tolist() == [0.0, 2.0]
    raw[1, [1, 3, 7]] += [-4e-3, 2e-3, 6e-3]
    back = exact_readings(SENSOR, raw, warmer)
    np.testing.assert_allclose(back[:2], exact[:2], rtol=0, atol=1e-15)
    assert np.isnan(back[2]).tolist() == [True, True, False] * 3  # a temperature is missing
    assert np.isfinite(raw).all()  # what was given is not changed
    assert beam_shift(SENSOR, warmer[:2]).tolist() == [[0.0, 0.0], [4e-3, -2e-3]]


@pytest.mark.parametrize("sensor", [SENSOR, facets.Sensor()])
def test_a_sensor_without_a_thermometer_or_coefficients_has_no_difference(sensor):
    temperature = None if sensor is SENSOR else np.array([25.0])
    assert warmer_than_reference(sensor, temperature) is None


def test_gains_are_corrected_before_the_temperature():
    psd = SENSOR.psds[0]
    strong = replace(psd, correction=replace(psd.correction, power=0.01))
    sensor = replace(SENSOR, psds=(strong, *SENSOR.psds[1:]))
    raw = facets.readings(SENSOR, np.zeros((1, 8)))
    exact = exact_readings(sensor, raw, np.array([1.0]))
    assert exact[0, [2, 5]] / raw[0, [2, 5]] == pytest.approx([1.01, 1.0])
    assert exact[0, 1] - raw[0, 1] == pytest.approx(2e-3)
