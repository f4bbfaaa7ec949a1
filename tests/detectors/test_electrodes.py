"""The potential on a tetra-lateral detector, against the series that it is the sum of."""

import numpy as np
import pytest

from facets.detectors import fractions, side_potential


def series(towards: float, along: float, aspect: float) -> float:
    """Separation of variables, term by term, until the terms have no more effect."""
    n = np.arange(1, 40_001, 2)
    rate = n * np.pi / (2 * aspect)
    shape = np.exp(rate * (towards - 1)) * np.expm1(-2 * rate * (1 + towards))
    sign = np.where(n % 4 == 1, 1, -1)
    terms = sign / n * np.cos(n * np.pi / 2 * along) * shape / np.expm1(-4 * rate)
    return float(4 / np.pi * terms.sum())


@pytest.mark.parametrize("aspect", [0.3, 1.0, 2.7, 10.0])
@pytest.mark.parametrize("place", [(0, 0), (0.5, 0.3), (-0.9, 0.9), (0.97, -0.97), (0.2, -0.8)])
def test_the_closed_form_is_the_series(place, aspect):
    found = float(side_potential(np.array(place[0]), np.array(place[1]), aspect))
    assert found == pytest.approx(series(*place, aspect), rel=1e-11)


@pytest.mark.parametrize("aspect", [0.4, 1.0, 3.0])
def test_all_the_current_leaves_by_the_four_sides_also_at_the_rim(aspect):
    y, z = np.meshgrid(np.linspace(-0.999, 0.999, 21), np.linspace(-0.999, 0.999, 21))
    share = fractions("tetra-lateral", y, z, aspect)
    np.testing.assert_allclose(share.sum(axis=-1), 1.0, rtol=1e-12)
