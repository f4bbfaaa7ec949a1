"""Allan deviations at chosen averaging times."""

import numpy as np
import pytest
from colours import flicker

from facets.noise_analysis.allan import allan

NOISE = np.random.default_rng(2).standard_normal(4000)
#: White, flicker and a random walk, by the power of frequency in their densities.
KINDS = {0: NOISE, -1: flicker(np.random.default_rng(3), 1.0, 4000, 1000.0), -2: np.cumsum(NOISE)}


@pytest.mark.parametrize("power", KINDS)
def test_deviations_and_their_intervals_are_those_of_another_program(power):
    allantools = pytest.importorskip("allantools")
    found = allan(KINDS[power], 1000.0)
    for n in range(2, 12):
        times, length = found.tau[n : n + 1], round(1000 * found.tau[n])
        deviation = allantools.oadev(KINDS[power], 1000.0, "freq", times)[1][0]
        assert found.deviation[n] == pytest.approx(deviation, rel=1e-9)
        freedom = allantools.edf_simple(4001, length, power)
        ends = allantools.confidence_interval(deviation, freedom, 0.95)
        assert (found.low[n], found.high[n]) == pytest.approx(ends, rel=1e-6)


def test_an_averaging_time_between_computed_ones_has_a_deviation():
    found = allan(NOISE, 100.0)
    for tau in (0.1, 0.7, 3.0):
        assert found.interpolate(tau) == pytest.approx(1 / np.sqrt(100 * tau), rel=0.2)


def test_an_averaging_time_outside_the_computed_ones_has_none():
    """Shorter than a sample; longer than the samples between two gaps."""
    assert np.isnan(allan(NOISE, 5.0).interpolate(0.1))
    gaps = NOISE.copy()
    gaps[::100] = np.nan
    found = allan(gaps, 100.0)
    assert found.tau[-1] < 0.5
    assert np.isfinite(found.interpolate(0.1))
    assert np.isnan(found.interpolate(1.0))


@pytest.mark.parametrize("clock", [1 - 1e-4, 1.0, 1 + 1e-4])
def test_a_clock_that_is_a_little_off_loses_no_averaging_time(clock):
    found = allan(NOISE, 10.0 * clock)
    assert found.interpolate(0.1) == pytest.approx(found.deviation[0], rel=1e-3)
    assert found.interpolate(100.0) == pytest.approx(found.deviation[-1], rel=1e-3)
