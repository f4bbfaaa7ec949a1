"""Light in a wedge, against 30-digit references from the definition of the integrals.

The references (references/make_wedge.py) hold the points where a search found the float code worst.
"""

import json
import math
from pathlib import Path

import mpmath
import numpy as np
import pytest

from facets.optics import sides, tail_integrals, wedge

ROWS = json.loads((Path(__file__).parent / "references" / "wedge.json").read_text())
UP, RIGHT = (0.0, 1.0), (1.0, 0.0)


def point(row: dict) -> tuple:
    return tuple(tuple(float.fromhex(x) for x in row[key]) for key in ("q", "u1", "u2"))


def moments(q: tuple, u1: tuple, u2: tuple) -> np.ndarray:
    ((mass, centroid, shift, _),) = wedge.wedges(q, ((u1, u2, *sides(q, (u1, u2))),))
    return np.array([mass, *centroid, *shift])


def difference(ours: np.ndarray, exact: list[str]) -> np.ndarray:
    """Relative for the mass, absolute (in sigmas, and of order one) for the rest."""
    with mpmath.workdps(40):
        away = [mpmath.mpf(float(a)) - mpmath.mpf(b) for a, b in zip(ours, exact, strict=True)]
        return np.array(
            [float(abs(away[0] / mpmath.mpf(exact[0]))), *map(float, map(abs, away[1:]))]
        )


def test_moments_hold_13_digits_everywhere():
    """Offsets to 35 sigma, openings from 0.01 to 179.99 degrees, powers down to 1e-270."""
    for row in ROWS:
        assert difference(moments(*point(row)), row["exact"]).max() < 1e-13, row
    assert min(float(mpmath.mpf(row["exact"][0])) for row in ROWS) < 1e-200
    assert max(math.hypot(*point(row)[0]) for row in ROWS) == pytest.approx(35)


def test_beam_centre_on_an_edge_and_next_to_it():
    """No jump where the sign of h flips, down to subnormal offsets."""
    for tiny in (0.0, 5e-324, -5e-324, 1e-300, -1e-300, 1e-17, -1e-17):
        assert moments((-0.7, tiny), RIGHT, UP) == pytest.approx(
            moments((-0.7, 0.0), RIGHT, UP), abs=1e-15
        )
        assert np.isfinite(moments((tiny, tiny), RIGHT, UP)).all()


def test_no_light_at_all_is_no_centroid():
    mass, *centroid = moments((60.0, 60.0), RIGHT, UP)[:3]
    assert mass == 0
    assert np.isnan(centroid).all()


def radial_integrals(a: float) -> list[float]:
    """int s^n exp(-s^2/2 - a s) ds from 0 up, for n = 0 to 2, by quadrature in 30 digits."""
    with mpmath.workdps(30):
        ends = [mpmath.mpf(x) / max(1, a) for x in (0, 1, 4, 16, 80)]
        return [
            float(mpmath.quad(lambda s, n=n: s**n * mpmath.exp(-s * s / 2 - a * s), ends))
            for n in range(3)
        ]


@pytest.mark.parametrize("a", [0.0, 0.3, 1.0, 2.5, 7.0, 35.0, 400.0])
def test_the_polynomial_of_a_half_line_holds_all_digits(a):
    assert tail_integrals(a) == pytest.approx(radial_integrals(a), rel=2e-15)
