"""Detectors that are read one after the other."""

from dataclasses import replace

import numpy as np

import facets
from facets import BenchLight, simulate
from facets.core import Sweep
from facets.detectors import align, delay_states, slopes

LATE = replace(facets.Sensor(), light=BenchLight(delays=(0.0, 5e-6, 1e-5)))


def test_slopes_are_means_of_both_sides_and_unknown_over_gaps():
    time = np.array([0, 1, 3, 100, 101, 101, 102, 103.0])
    rows = np.array([0, 1, 9, 7, 8, 50, 51, np.nan])[:, None]
    assert slopes(time, rows)[:, 0].tolist() == [1, 2.5, 4, 1, 1, 1, 1, 0]
    assert slopes(time[:1], rows[:1]).tolist() == [[0]]


def test_readings_are_brought_to_one_instant():
    """To the second order of the delay, since the slopes are those of late readings."""
    time = np.arange(50) / 3000
    states = np.outer(np.sin(20 * time), [0.05, 0.02, 0.5, 5e-3, 3e-3, 5e-3, 0, 0])
    exact = facets.readings(LATE, states)
    late = exact.copy()
    for k, delay in enumerate(LATE.light.delays):
        part = slice(3 * k, 3 * k + 3)
        late[:, part] = facets.readings(LATE, delay_states(time, states, delay))[:, part]
    assert np.abs(late - exact).max() > 1e-5
    acceleration = 20**2 * np.abs(exact - exact[0]).max()
    rest = np.abs(align(LATE, time, late) - exact).max()
    assert rest < max(LATE.light.delays) ** 2 * acceleration
    assert align(facets.Sensor(), time, late) is late


def test_simulations_have_it_and_the_solver_takes_it_off():
    """What is left is of the second order of the samples' steps."""
    config = facets.load("bench-light")
    (segment,) = simulate(config, ["multi-axis"], noise=False)
    assert segment.solution.ok.all()
    at_once = replace(config.sensor, light=replace(config.sensor.light, delays=(0.0,) * 3))
    raw = facets.solve(at_once, segment.readings, beam="known").state - segment.truth
    rest = np.abs(segment.error[1:-1, 3:6]).max()
    assert rest < 0.05 * np.abs(raw[1:-1, 3:6]).max()


def test_each_detector_is_read_late_by_its_own_delay():
    """The bench's converters read along a motion along z, at 1 mm/s."""
    delays = (0.0, 2e-3, 5e-3)
    sweep = Sweep((0.0,) * 8, (0.0, 0.0, 0.1, *(0.0,) * 5), 101, 1000.0)
    sensor = replace(facets.Sensor(), light=BenchLight(delays=delays))
    config = replace(facets.load("paper"), motions={"sweep": sweep}, sensor=sensor)
    (segment,) = simulate(config, noise=False)
    for k, delay in enumerate(delays):
        late = segment.truth.copy()
        late[:, 2] += delay
        part = np.s_[10:-10, 3 * k : 3 * k + 3]
        expected = facets.readings(facets.Sensor(), late)[part]
        np.testing.assert_allclose(segment.readings[part], expected, atol=1e-9)
