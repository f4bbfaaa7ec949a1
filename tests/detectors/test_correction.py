"""Corrections of a detector, against the polynomial written out."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.detectors import NAMES, coefficients, correct, correction_slopes

RAW = np.array([[1.5, -2.0, 0.1, -4.0, 3.0, 0.08, 0.2, 0.1, 0.12]])


def rig() -> facets.Sensor:
    """A different correction of each detector."""
    rng = np.random.default_rng(3)
    paper = facets.Sensor()
    psds = [
        replace(
            psd,
            correction=facets.Correction(
                power=0.01 * k,
                dark=1e-3 * k,
                y=tuple(rng.normal(0, 0.01, 9)),
                z=tuple(rng.normal(0, 0.01, 9)),
            ),
        )
        for k, psd in enumerate(paper.psds, 1)
    ]
    return replace(paper, psds=tuple(psds))


def test_a_correction_is_a_polynomial_of_the_place_in_half_sizes():
    one = rig()
    found = correct(one, RAW)[0]
    for k, psd in enumerate(one.psds):
        y, z = RAW[0, 3 * k] / (psd.size_y / 2), RAW[0, 3 * k + 1] / (psd.size_z / 2)
        terms = np.array([y, z, y * y, y * z, z * z, y**3, y * y * z, y * z * z, z**3])
        power = RAW[0, 3 * k + 2]
        expected = [
            RAW[0, 3 * k] + terms @ psd.correction.y,
            RAW[0, 3 * k + 1] + terms @ psd.correction.z,
            power * (1 + psd.correction.power) + psd.correction.dark,
        ]
        assert found[3 * k : 3 * k + 3] == pytest.approx(expected, rel=1e-13)


def test_coefficients_stand_in_the_order_of_their_names():
    one = rig()
    assert len(NAMES) == 60 == coefficients(one).size
    named = dict(zip(NAMES, coefficients(one), strict=True))
    assert [named[name] for name in NAMES[20:22]] == [
        one.psds[1].correction.power, one.psds[1].correction.dark
    ]  # fmt: skip
    assert (RAW + correction_slopes(one, RAW) @ coefficients(one)) == pytest.approx(
        correct(one, RAW)
    )
