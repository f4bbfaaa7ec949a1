"""Stated densities and Allan deviations, beside those of simulated and solved records."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.characterization import density_at_rest, estimators
from facets.detectors import draw_flicker

RATE, COUNT = 100.0, 60_000


def test_drawn_flicker_has_its_density():
    """Walks: tests/detectors/test_drift.py."""
    from scipy import signal

    drawn = draw_flicker(np.array([4.0, 9.0]), COUNT, 1 / RATE, np.random.default_rng(4))
    assert (drawn[0] == 0).all()
    frequency, density = signal.welch(drawn.T, RATE, nperseg=8192, detrend="linear")
    band = (frequency > 0.5) & (frequency < 20)
    ratio = density[:, band] * frequency[band] / [[4.0], [9.0]]
    assert ratio.mean(axis=1) == pytest.approx([1, 1], rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["beam free", "beam known"])
def test_solved_records_have_the_stated_allan_deviations(name):
    """White noise and slow noise of each kind, in 12 records of ten minutes."""
    allantools = pytest.importorskip("allantools")
    config = facets.load("bench-drift")
    (how,) = (one for one in estimators(1e-3) if one.name == name)
    stated = density_at_rest(config.sensor, how, RATE / 2)
    config = replace(config, solve=replace(config.solve, beam=how.knowledge.beam))
    times, squares = [0.1, 1.0, 30.0], []
    for seed in range(12):
        (segment,) = facets.simulate(config, motions=["rest"], seed=seed)
        squares.append([
            allantools.oadev(column, rate=RATE, data_type="freq", taus=times)[1] ** 2
            for column in segment.solution.state[:, :6].T
        ])  # fmt: skip
    found = np.sqrt(np.mean(squares, axis=0))
    for n, tau in enumerate(times):
        assert found[:, n] == pytest.approx(stated.allan_deviation(tau), rel=0.2)


def test_without_drift_there_is_the_white_floor_alone():
    sensor = facets.load("bench").sensor
    how = estimators(1e-3)[1]
    white = density_at_rest(sensor, how, 5000.0)
    expected = facets.uncertainties(sensor, np.zeros(8), how) / np.sqrt(5000)
    for frequency in (0.01, 100.0):
        assert white.amplitude(frequency) == pytest.approx(expected)
    assert white.allan_deviation(100.0) == pytest.approx(expected / np.sqrt(200))
