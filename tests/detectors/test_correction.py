"""Corrections of a detector, against the polynomial written out."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.detectors import NAMES, coefficients, correct, correction_slopes, invert_correction

RAW = np.array([[1.5, -2.0, 0.1, -4.0, 3.0, 0.08, 0.2, 0.1, 0.12]])


@pytest.fixture
def sensor() -> facets.Sensor:
    """A different correction of each detector."""
    rng = np.random.default_rng(3)
    psds = []
    for k, psd in enumerate(facets.Sensor().psds, 1):
        y, z = rng.normal(0, 0.01, (2, 9)).tolist()
        correction = facets.Correction(power=0.01 * k, dark=1e-3 * k, y=tuple(y), z=tuple(z))
        psds.append(replace(psd, correction=correction))
    return replace(facets.Sensor(), psds=tuple(psds))


def test_a_correction_is_a_polynomial_of_the_place_in_half_sizes(sensor):
    fixed = correct(sensor, RAW)
    for k, psd in enumerate(sensor.psds):
        psi, zeta, power = RAW[0, 3 * k : 3 * k + 3]
        y, z, correction = 2 * psi / psd.size_y, 2 * zeta / psd.size_z, psd.correction
        terms = np.array([y, z, y * y, y * z, z * z, y**3, y * y * z, y * z * z, z**3])
        expected = [
            psi + terms @ correction.y,
            zeta + terms @ correction.z,
            power * (1 + correction.power) + correction.dark,
        ]
        assert fixed[0, 3 * k : 3 * k + 3] == pytest.approx(expected, rel=1e-13)
    assert invert_correction(sensor, fixed) == pytest.approx(RAW, abs=1e-12)


def test_coefficients_stand_in_the_order_of_their_names(sensor):
    assert len(NAMES) == 60
    named = dict(zip(NAMES, coefficients(sensor), strict=True))
    second = sensor.psds[1].correction
    assert named["correction_b.power"] == second.power
    assert named["correction_b.dark"] == second.dark
    assert named["correction_b.z01"] == second.z[1]
    linear = RAW + correction_slopes(sensor, RAW) @ coefficients(sensor)
    assert linear == pytest.approx(correct(sensor, RAW))


def test_a_grid_is_interpolated_and_goes_on_as_at_its_edge():
    """A grid of two planes, which linear interpolation gives as they are."""
    y, z = (-4.0, 1.0, 5.0), (-3.0, 2.0)
    slopes = np.array([[0.01, 0.02], [0.03, -0.01]])
    add_y, add_z = np.tensordot(slopes, np.meshgrid(y, z, indexing="ij"), axes=1).tolist()
    correction = facets.Correction(grid=facets.Grid(y, z, add_y, add_z))
    first, *others = facets.Sensor().psds
    sensor = facets.Sensor(psds=(replace(first, correction=correction), *others))
    raw = np.zeros((3, 9))
    raw[:, :2] = [[-6.0, -5.0], [2.0, 1.0], [7.0, 3.0]]
    nearest = [[-4.0, -3.0], [2.0, 1.0], [5.0, 2.0]]
    added = (correct(sensor, raw) - raw)[:, :2]
    assert added == pytest.approx(nearest @ slopes.T, abs=1e-14)
