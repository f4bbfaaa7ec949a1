"""Detectors bent beyond third order: found as a smooth spline, written, and loaded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.cli.calibration_files import write_results
from facets.experiments import rigs

import facets
from facets import add_noise
from facets.calibration import Data, choice, states_of
from facets.calibration.spline import KNOTS, LEFT, SPLINE, bases, replace_spline, spline_slopes
from facets.calibration.verdict import verdict
from facets.detectors import correct, invert_correction

CONFIG = facets.load("paper")
NOMINAL = CONFIG.sensor
OFF = dict.fromkeys(CONFIG.calibrate.effects, "off")
BOX = np.array([0.2, 0.2, 3.0, 6e-3, 6e-3, 1.5e-2])


def settings(**effects):
    return replace(CONFIG.calibrate, effects=OFF | effects)


def test_a_spline_has_no_part_that_a_polynomial_has():
    at = np.linspace(-1, 1, KNOTS)
    y, z = (part.ravel() for part in np.meshgrid(at, at))
    found = bases(np.column_stack([y, z]))
    for a, b in ((0, 0), (1, 0), (0, 2), (3, 0), (1, 2)):
        np.testing.assert_allclose((y**a * z**b) @ found, 0, atol=1e-12)
    np.testing.assert_allclose(found.T @ found, KNOTS**2 * np.eye(LEFT), atol=1e-9)


def test_what_is_written_into_a_sensor_is_the_spline():
    rng = np.random.default_rng(1)
    coefficients = 1e-3 * rng.normal(size=len(SPLINE))
    raw = rng.uniform(-6, 6, (200, 9))
    added = correct(replace_spline(NOMINAL, coefficients), raw) - raw
    np.testing.assert_allclose(added, spline_slopes(NOMINAL, raw) @ coefficients, atol=1e-4)
    assert np.abs(added).max() > 3e-3


def wavy(place):
    """What a detector adds, mm: no polynomial, no spline."""
    return 0.02 * np.sin(0.8 * place) * np.cos(0.4 * place[:, ::-1] + 0.4)


def measured(rig, count, box, rng):
    pose = rng.uniform(-1, 1, (count, 6)) * box
    data = Data(np.empty((count, 9)), pose, rigs.REFERENCE, np.zeros((count, 2)))
    state = states_of(data, np.zeros((count, 9)), rig.values)
    raw = add_noise(rig.sensor, facets.readings(rig.sensor, state), rng)
    for k in range(3):
        raw[:, 3 * k : 3 * k + 2] += wavy(raw[:, 3 * k : 3 * k + 2])
    return data._replace(raw=invert_correction(rig.sensor, raw)), state


@pytest.fixture(scope="module")
def rig():
    return rigs.draw_rig(NOMINAL, np.random.default_rng(3))


def error(sensor, rig):
    fresh, state = measured(rig, 300, 0.7 * BOX, np.random.default_rng(8))
    found = facets.solve(sensor, correct(sensor, fresh.raw), beam="known")
    own = found.uncertainty[:, :6]
    return rigs.rms((found.state - state)[:, :6])[2:], rigs.rms(own)[2:]


@pytest.mark.slow
def test_waves_beyond_third_order_are_found_and_written(rig, tmp_path):
    data, _ = measured(rig, 160, BOX, np.random.default_rng(5))
    asked = settings(bend="auto", spline="auto")
    with_it = verdict(NOMINAL, data, choice(NOMINAL, asked), asked)
    assert {row.key for row in with_it.search.rows if row.accepted} >= {"spline"}
    fine, stated = error(with_it.sensor, rig)
    coarse, _ = error(with_it.search.plain.sensor, rig)
    assert (fine < 0.7 * coarse).all()
    assert (fine < 1.3 * stated).all()
    names = ("mine.yaml", "mine-found.csv", "mine-covariance.csv", "mine.png")
    write_results(CONFIG, with_it, [tmp_path / name for name in names], [], None)
    loaded = facets.load(tmp_path / "mine.yaml").sensor
    np.testing.assert_allclose(
        correct(loaded, data.raw), correct(with_it.found.sensor, data.raw), atol=1e-9
    )


def test_straight_detectors_keep_straight():
    rng = np.random.default_rng(6)
    rig = rigs.draw_rig(NOMINAL, rng)
    data, _ = rigs.sample_motion(rig, 120, rng)
    asked = settings(bend="on", spline="auto")
    found = verdict(NOMINAL, data, choice(NOMINAL, asked), asked)
    assert {row.key: row.accepted for row in found.search.rows} == {"bend": True, "spline": False}
