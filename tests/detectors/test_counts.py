"""Counts to readings and back, and what is flagged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS, states

import facets
from facets.detectors import (
    SATURATED,
    UNEQUAL,
    counts_per_ampere,
    counts_to_readings,
    counts_to_xy_sum,
    readings_to_counts,
)

PAPER = SENSORS["paper"]
NO_DARK = np.zeros(12)
PLACES = [0, 1, 3, 4, 6, 7]


@pytest.mark.parametrize("kind", ["duo-lateral", "pincushion", "tetra-lateral"])
def test_readings_come_back_within_a_step(kind):
    """From detectors that are not square."""
    electronics = facets.Electronics(kind=kind, adc_bits=20)
    sensor = replace(PAPER, psds=tuple(replace(psd, size_z=9.0) for psd in PAPER.psds))
    exact = facets.readings(sensor, states(400, seed=2, angle=0.003))
    exact = exact[(np.abs(exact[:, PLACES]) < 4).all(axis=1)]
    assert len(exact) > 20
    counts = readings_to_counts(sensor, electronics, exact)
    step = 1e3 / counts_per_ampere(electronics) / electronics.responsivity  # mW a count
    worst = 10 * 13 * step / exact[:, 2::3].min()
    for xy_sum, sent, dark in (
        (False, counts + 500, NO_DARK + 500),
        (True, counts_to_xy_sum(electronics, counts), NO_DARK),
    ):
        back, flags = counts_to_readings(sensor, electronics, sent, xy_sum, dark)
        assert not flags.any()
        assert np.abs(back[:, 2::3] - exact[:, 2::3]).max() < 4 * step
        assert np.abs(back[:, PLACES] - exact[:, PLACES]).max() < worst


def test_light_that_misses_a_detector_makes_no_counts():
    exact = np.array([[7.0, 0, 0.1, 0, -6.6, 0.1, np.nan, 0, 0.1], [1.0, 2, 0.1] * 3])
    counts = readings_to_counts(PAPER, facets.Electronics(), exact)
    assert not counts[0].any()
    assert (counts[1] > 0).all()


def test_full_converters_and_sums_that_differ_are_flagged():
    electronics = facets.Electronics()
    counts = readings_to_counts(PAPER, electronics, facets.readings(PAPER, np.zeros((3, 8))))
    counts[0, 5] = 2**electronics.adc_bits - 1
    counts[1, 0] = counts[1, 0] * 11 // 10
    back, flags = counts_to_readings(PAPER, electronics, counts, False, NO_DARK)
    assert flags.tolist() == [SATURATED | UNEQUAL, UNEQUAL, 0]
    assert np.isnan(back[0]).tolist() == [False] * 3 + [True] * 3 + [False] * 3
