"""Light that is lost on the facets, against one ray of a narrow beam."""

from dataclasses import replace
from math import factorial

import numpy as np
from sensors import box

import facets
from facets.core import BenchLight
from facets.core.sensor import STAIN_ORDERS

PAPER = facets.Sensor()
SIGMA = PAPER.beam.diameter_x / 4


def test_a_speck_takes_the_light_of_its_ray():
    """A speck at 0.2 sigma, expanded to fourth order, which misses 1e-5 of its light."""
    lost, place = 0.02, np.array([0.15, 0.1])  # in sigmas from the apex, on facet A
    speck = tuple(
        lost * float(np.prod((-place) ** (a, b))) / (factorial(a) * factorial(b)) ** 0.5
        for a, b in STAIN_ORDERS
    )
    clean = (0.0,) * 15
    some = box(20, 1, reach=0.2)
    stained = replace(PAPER, light=BenchLight(stains=(speck, clean, clean)))
    before, after = facets.readings(PAPER, some), facets.readings(stained, some)
    ray = some.copy()
    ray[:, 6:] = some[:, :2] + SIGMA * place
    thin = replace(PAPER, beam=replace(PAPER.beam, diameter_x=1e-3, diameter_y=1e-3))
    spot = facets.readings(thin, ray)
    distance = (some[:, :2] - some[:, 6:]) / SIGMA + place
    light = lost * PAPER.beam.power * np.exp(-(distance**2).sum(axis=1) / 2)
    np.testing.assert_allclose(after[:, 3:], before[:, 3:], atol=1e-11)
    np.testing.assert_allclose(before[:, 2] - after[:, 2], light, rtol=1e-3)
    rest = before[:, :2] * before[:, 2:3] - spot[:, :2] * light[:, None]
    np.testing.assert_allclose(after[:, :2] * after[:, 2:3], rest, atol=5e-7)
