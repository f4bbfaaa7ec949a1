"""Detectors bent beyond third order: found as a smooth spline, written, and loaded."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from facets.experiments.studies import rigs
from rig_samples import NOMINAL, accepted_effects, judge, sample_rig, settings, write_samples

import facets
from facets import ConfigError
from facets.calibration import (
    ALL,
    PLACE,
    Choice,
    Data,
    assign_values,
    linearise_model,
    values_of,
)
from facets.detectors import correct, invert_correction

BOX = np.array([0.2, 0.2, 3.0, 6e-3, 6e-3, 1.5e-2])
SPLINE = [name for name in ALL if name.startswith("spline")]


def test_what_is_written_into_a_sensor_is_what_the_fit_has():
    rng, values = np.random.default_rng(1), values_of(NOMINAL)
    raw, still = rng.uniform(-6, 6, (200, 9)), np.zeros((200, 9))
    data = Data(raw, still[:, :6], np.ones(6), still[:, :2], noise=np.ones_like(raw))
    chosen = Choice(tuple(SPLINE), np.ones(len(SPLINE)))
    slopes = -linearise_model(NOMINAL, data, still, values, chosen).common
    values[[PLACE[name] for name in SPLINE]] = coefficients = 1e-3 * rng.normal(size=len(SPLINE))
    added = correct(assign_values(NOMINAL, values), raw) - raw
    np.testing.assert_allclose(added, slopes @ coefficients, atol=1e-4)
    assert np.abs(added).max() > 3e-3


def test_a_spline_does_nothing_that_polynomials_up_to_third_order_do():
    values, half = values_of(NOMINAL), NOMINAL.psds[0].size_y / 2
    values[[PLACE[name] for name in SPLINE]] = np.random.default_rng(1).normal(size=len(SPLINE))
    y, z = np.array(list(product(np.linspace(-1, 1, 5), repeat=2))).T
    raw = np.tile(np.column_stack([half * y, half * z, np.ones(25)]), 3)
    added = correct(assign_values(NOMINAL, values), raw) - raw
    powers = [y**a * z**b for a, b in product(range(4), repeat=2) if a + b <= 3]
    assert np.abs(added).max() > 1
    np.testing.assert_allclose(np.array(powers) @ added, 0, atol=1e-10)


def add_waves(sensor, state, exact):
    """Add what is no polynomial and no spline."""
    for k in range(3):
        place = exact[:, 3 * k : 3 * k + 2]
        place += 0.02 * np.sin(0.8 * place) * np.cos(0.4 * place[:, ::-1] + 0.4)
    return exact


@pytest.mark.slow
def test_waves_beyond_third_order_are_found_and_written(tmp_path, run_in_process):
    _, data, _ = sample_rig(160, 3, box=BOX, alter=add_waves)
    write_samples(tmp_path / "data.csv", data)
    off = [f"--effect={key}=off" for key in settings().effects if key not in ("bend", "spline")]
    status, out, err = run_in_process("calibrate", "paper", "data.csv", "-o", "mine.yaml", *off)
    assert status == 0, out + err
    assert (tmp_path / "mine-detector-a.csv").exists()
    _, fresh, state = sample_rig(300, 3, box=0.7 * BOX, alter=add_waves)
    sensor = facets.load("mine.yaml").sensor
    solved = facets.solve(sensor, correct(sensor, fresh.raw), beam="known")
    error, stated = (rigs.rms(each[:, 2:6]) for each in (solved.state - state, solved.uncertainty))
    assert (error < 1.3 * stated).all()


def test_straight_detectors_keep_straight():
    _, data, _ = sample_rig(120, 6)
    judged = judge(data, settings(bend="on", spline="auto"))
    assert accepted_effects(judged) == {"bend"}


def test_a_measured_table_is_read_in_any_order_and_undone(tmp_path):
    """What is added between its places: tests of the detectors."""
    y, z = (-6.0, 0.0, 6.0), (-5.0, 5.0)
    rows = [f"{a},{b},{10 * a - 3 * b},{2 * b}" for a, b in product(y, z)]
    lines = ["psi_mm,zeta_mm,add_psi_um,add_zeta_um", *rows[::-1]]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    config = tmp_path / "my.yaml"
    config.write_text("extends: paper\nsensor: {psd: {b: {correction: {table: a.csv}}}}\n")
    sensor = facets.load(config).sensor
    grid = sensor.psds[1].correction.grid
    assert (grid.y, grid.z) == (y, z)
    np.testing.assert_allclose(grid.add_y, 0.01 * np.array(y)[:, None] - 0.003 * np.array(z))
    np.testing.assert_allclose(grid.add_z, [[-0.01, 0.01]] * 3)
    raw = np.array([[1.5, -2.0, 0.1, -4.0, 3.0, 0.08, 0.2, 0.1, 0.12]])
    np.testing.assert_allclose(invert_correction(sensor, correct(sensor, raw)), raw, atol=1e-12)
    (tmp_path / "a.csv").write_text("\n".join(lines[:-1]))
    with pytest.raises(ConfigError, match=r"my\.yaml:2: .* a grid: 5 rows, 3 values of psi_mm, 2"):
        facets.load(config)
