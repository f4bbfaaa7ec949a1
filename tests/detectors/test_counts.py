"""Counts to readings and back, and what is flagged."""

from __future__ import annotations

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


@pytest.mark.parametrize("kind", ["duo-lateral", "pincushion", "tetra-lateral"])
@pytest.mark.parametrize("xy_sum", [False, True])
def test_readings_come_back_within_a_step(kind, xy_sum):
    electronics = facets.Electronics(kind=kind, adc_bits=20)
    exact = facets.readings(PAPER, states(80, seed=2, angle=0.003))
    exact = exact[(np.abs(exact[:, [0, 1, 3, 4, 6, 7]]) < 6).all(axis=1)]
    assert len(exact) > 20
    counts = readings_to_counts(PAPER, electronics, exact)
    if xy_sum:
        counts = counts_to_xy_sum(electronics, counts)
    found, flags = counts_to_readings(PAPER, electronics, counts, xy_sum, NO_DARK)
    assert not flags.any()
    step = 1e3 / counts_per_ampere(electronics) / electronics.responsivity  # mW a count
    assert np.abs(found[:, 2::3] - exact[:, 2::3]).max() < 4 * step
    places = [0, 1, 3, 4, 6, 7]
    worst = 10 * 13 * step / exact[:, 2::3].min()
    assert np.abs(found[:, places] - exact[:, places]).max() < worst


def test_light_that_misses_a_detector_makes_no_counts():
    exact = np.array([[7.0, 0, 0.1, 0, -6.6, 0.1, np.nan, 0, 0.1], [1.0, 2, 0.1] * 3])
    counts = readings_to_counts(PAPER, facets.Electronics(), exact)
    assert not counts[0].any()
    assert (counts[1] > 0).all()


def test_dark_counts_are_taken_off():
    electronics = facets.Electronics(adc_bits=20)
    exact = facets.readings(PAPER, states(10, seed=3))
    counts = readings_to_counts(PAPER, electronics, exact)
    plain, _ = counts_to_readings(PAPER, electronics, counts, False, NO_DARK)
    shifted, _ = counts_to_readings(PAPER, electronics, counts + 500, False, np.full(12, 500.0))
    np.testing.assert_allclose(shifted, plain)


def test_a_full_converter_is_no_reading():
    electronics = facets.Electronics()
    counts = readings_to_counts(PAPER, electronics, facets.readings(PAPER, np.zeros((2, 8))))
    counts[0, 5] = 2**electronics.adc_bits - 1
    found, flags = counts_to_readings(PAPER, electronics, counts, False, NO_DARK)
    assert flags[0] & SATURATED
    assert np.isnan(found[0, 3:6]).all()
    assert np.isfinite(found[0, [0, 1, 2, 6, 7, 8]]).all()
    assert flags[1] == 0


def test_sums_that_differ_are_flagged():
    electronics = facets.Electronics()
    counts = readings_to_counts(PAPER, electronics, facets.readings(PAPER, np.zeros((2, 8))))
    counts[1, 0] = counts[1, 0] * 11 // 10
    _, flags = counts_to_readings(PAPER, electronics, counts, False, NO_DARK)
    assert flags.tolist() == [0, UNEQUAL]
