"""Electrodes' currents: the potential on a tetra-lateral detector."""

import numpy as np
import pytest

from facets.detectors import fractions


def series(towards: float, along: float, aspect: float) -> float:
    """Separation of variables, term by term, until the terms have no more effect."""
    n = np.arange(1, 40_001, 2)
    rate = n * np.pi / (2 * aspect)
    shape = np.exp(rate * (towards - 1)) * np.expm1(-2 * rate * (1 + towards))
    sign = np.where(n % 4 == 1, 1, -1)
    terms = sign / n * np.cos(n * np.pi / 2 * along) * shape / np.expm1(-4 * rate)
    return float(4 / np.pi * terms.sum())


@pytest.mark.parametrize("aspect", [0.3, 1.0, 2.7, 10.0])
def test_a_tetra_laterals_currents_are_those_of_a_conducting_sheet(aspect):
    """The current into each side is the potential at the light with that side at 1."""
    for y, z in ((0, 0), (0.5, 0.3), (-0.9, 0.9), (0.97, -0.97), (0.2, -0.8)):
        shares = fractions("tetra-lateral", np.array(y), np.array(z), aspect)
        sides = [(-y, z, aspect), (y, z, aspect), (-z, y, 1 / aspect), (z, y, 1 / aspect)]
        assert shares == pytest.approx([series(*side) for side in sides], rel=1e-11, abs=1e-13)
    at_rim = fractions("tetra-lateral", np.array(0.999), np.array(-0.999), aspect)
    assert at_rim.sum() == pytest.approx(1.0, rel=1e-12)
