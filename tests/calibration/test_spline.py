"""Detectors bent beyond third order: found as a smooth spline, written, and loaded."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments import rigs
from rig_samples import NOMINAL, accepted_effects, judge, sample_rig, settings

import facets
from facets import ConfigError
from facets.calibration import REFERENCE, spline
from facets.core import READING_COLUMNS, STATE_UNITS
from facets.detectors import correct, invert_correction
from facets.files import tables

BOX = np.array([0.2, 0.2, 3.0, 6e-3, 6e-3, 1.5e-2])


def test_a_spline_has_no_part_that_a_polynomial_has():
    at = np.linspace(-1, 1, spline.KNOTS)
    y, z = (part.ravel() for part in np.meshgrid(at, at))
    bases = spline.bases(np.column_stack([y, z]))
    for a, b in ((0, 0), (1, 0), (0, 2), (3, 0), (1, 2)):
        np.testing.assert_allclose((y**a * z**b) @ bases, 0, atol=1e-12)
    size = spline.KNOTS**2
    np.testing.assert_allclose(bases.T @ bases, size * np.eye(spline.LEFT), atol=1e-9)


def test_what_is_written_into_a_sensor_is_the_spline():
    rng = np.random.default_rng(1)
    coefficients = 1e-3 * rng.normal(size=len(spline.SPLINE))
    raw = rng.uniform(-6, 6, (200, 9))
    added = correct(spline.replace_spline(NOMINAL, coefficients), raw) - raw
    np.testing.assert_allclose(added, spline.spline_slopes(NOMINAL, raw) @ coefficients, atol=1e-4)
    assert np.abs(added).max() > 3e-3


def add_waves(sensor, state, exact):
    """Add what is no polynomial and no spline."""
    for k in range(3):
        place = exact[:, 3 * k : 3 * k + 2]
        place += 0.02 * np.sin(0.8 * place) * np.cos(0.4 * place[:, ::-1] + 0.4)
    return exact


@pytest.mark.slow
def test_waves_beyond_third_order_are_found_and_written(tmp_path, run_in_process):
    _, data, _ = sample_rig(160, 3, box=BOX, alter=add_waves)
    columns = dict(zip(READING_COLUMNS, data.raw.T, strict=True))
    columns |= dict(zip(REFERENCE, (data.pose / STATE_UNITS[:6]).T, strict=True))
    tables.write_table(tmp_path / "data.csv", columns, {})
    off = [f"--effect={key}=off" for key in settings().effects if key not in ("bend", "spline")]
    status, out, err = run_in_process("calibrate", "paper", "data.csv", "-o", "mine.yaml", *off)
    assert status == 0, out + err
    fresh = sample_rig(300, 3, box=0.7 * BOX, alter=add_waves)
    assert (tmp_path / "mine-detector-a.csv").exists()
    fine, stated = error(facets.load("mine.yaml").sensor, *fresh)
    coarse, _ = error(judge(data).sensor, *fresh)
    assert (fine < 0.7 * coarse).all()
    assert (fine < 1.3 * stated).all()


def error(sensor, rig, data, state):
    solved = facets.solve(sensor, correct(sensor, data.raw), beam="known")
    folded = rigs.states_of(data, np.zeros((len(state), 9)), rigs.fold_mount(rig.values))
    return rigs.rms((solved.state - folded)[:, 2:6]), rigs.rms(solved.uncertainty[:, 2:6])


def test_straight_detectors_keep_straight():
    _, data, _ = sample_rig(120, 6)
    judged = judge(data, settings(bend="on", spline="auto"))
    assert accepted_effects(judged) == {"bend"}


def test_a_measured_table_corrects_as_what_it_was_measured_of(tmp_path):
    """A grid of a plane is that plane, in a file of any order; past its edge it stays as it is."""
    rng = np.random.default_rng(1)
    grid = np.array([(y, z) for y in range(-6, 7, 2) for z in (-6, 0, 6)], dtype=float)
    rows = np.column_stack([grid, 10 * grid[:, 0] - 3 * grid[:, 1], 2 * grid[:, 1]])
    lines = ["psi_mm,zeta_mm,add_psi_um,add_zeta_um"]
    lines += [",".join(map(str, row)) for row in rng.permutation(rows)]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    config = tmp_path / "my.yaml"
    config.write_text("extends: paper\nsensor: {psd: {b: {correction: {table: a.csv}}}}\n")
    sensor = facets.load(config).sensor
    raw = np.repeat([[1.5, -2.0, 0.1, -4.0, 3.0, 0.08, 0.2, 0.1, 0.12]], 2, axis=0)
    raw[1, 3] = -6.4
    fixed = correct(sensor, raw)
    psi, zeta = np.maximum(raw[:, 3], -6), raw[:, 4]
    np.testing.assert_allclose((fixed - raw)[:, 3], 0.01 * psi - 0.003 * zeta, atol=1e-12)
    np.testing.assert_allclose((fixed - raw)[:, 4], 0.002 * zeta, atol=1e-12)
    np.testing.assert_array_equal(np.delete(fixed - raw, [3, 4], axis=1), 0)
    np.testing.assert_allclose(invert_correction(sensor, fixed), raw, atol=1e-12)
    (tmp_path / "a.csv").write_text("\n".join(lines[:-1]))
    with pytest.raises(ConfigError, match="not a grid: 20 rows, 7 values of psi_mm, 3 of zeta_mm"):
        facets.load(config)
    (tmp_path / "a.csv").unlink()
    with pytest.raises(ConfigError, match=r"my\.yaml:2: .*no such file"):
        facets.load(config)
