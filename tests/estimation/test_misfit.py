"""Residuals beyond chance: as many as chance has where all is right, and told where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import facets
from facets.detectors.noise import add_noise
from facets.estimation.chance import LEVEL, LIMITS
from facets.estimation.misfit import Misfit
from facets.estimation.table import Count, solve_readings

CONFIG = facets.load("paper")
OPTIONS = replace(CONFIG.solve, beam="known", power="unknown")


def read(count=2000, seed=1):
    rng = np.random.default_rng(seed)
    state = np.zeros((count, 8))
    state[:, :6] = rng.uniform(-1, 1, (count, 6)) * [0.1, 0.1, 1, 4e-3, 4e-3, 5e-3]
    return add_noise(CONFIG.sensor, facets.readings(CONFIG.sensor, state), rng)


@pytest.mark.parametrize(
    ("beam", "power", "count"),
    [("known", "known", 3), ("known", "unknown", 2), ("free", "known", 1), ("free", "unknown", 0)],
)
def test_redundancy_is_what_is_read_beside_what_is_sought(beam, power, count):
    raw = read(2)
    raw[1, 4] = np.nan
    found = facets.solve(CONFIG.sensor, raw, beam=beam, power=power)
    assert found.checks.tolist() == [count, max(count - 3, 0)]
    assert found.limit.tolist() == LIMITS[found.checks].tolist()
    assert found.checks[0] == facets.solve(CONFIG.sensor, raw[0], beam=beam, power=power).checks


def test_chance_flags_as_many_as_it_should():
    solution = solve_readings(CONFIG.sensor, OPTIONS, read(), None)
    share = (solution.residual > np.sqrt(chi2.isf(0.05, 2))).mean()
    assert 0.03 < share < 0.07


def flags(sensor, raw):
    found = Misfit()
    solution = solve_readings(sensor, OPTIONS, raw, None)
    found.add(solution)
    return solution.misfit, found


def test_nothing_is_said_where_all_is_right():
    assert flags(CONFIG.sensor, read())[1].sentence == ""


def test_a_spoilt_reading_is_flagged():
    raw = read()
    raw[::100, 3] += 0.1
    marks, found = flags(CONFIG.sensor, raw)
    assert marks[::100].all()
    assert "single readings are spoilt" in found.sentence


def test_another_geometry_is_told():
    psds = [replace(psd, height=0.8 * n) for n, psd in enumerate(CONFIG.sensor.psds)]
    wrong = replace(CONFIG.sensor, psds=(psds[0], psds[1], psds[2]))
    found = flags(wrong, read())[1]
    assert "not the geometry of the sensor" in found.sentence


def test_the_limits_that_are_kept_are_those_of_the_distribution():
    exact = np.sqrt(chi2.isf(LEVEL, np.arange(1, 10)))
    assert LIMITS[1:] == pytest.approx(exact, rel=1e-12)


def test_spots_near_an_edge_are_counted_where_the_model_has_none():
    """Light is lost there; of three poses one has a spot nearer to an edge than its own size."""
    states = np.zeros((3, 8))
    states[1:, 2] = 6.0, 5.5
    readings = facets.readings(CONFIG.sensor, states)
    for cut, edges in ((False, 1), (True, 0)):
        apertures = facets.Apertures(detectors=cut)
        sensor, count = replace(CONFIG.sensor, apertures=apertures), Count()
        solution = facets.solve(sensor, readings, beam="known", power="unknown")
        count.add(sensor, OPTIONS, readings, solution, np.array(["converged"] * 3))
        assert count.edges == edges
    assert count.unseen[1] > count.unseen[0] > 5
