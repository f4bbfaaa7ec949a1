"""A cover before a detector: what a calibration excluded there is out of range in its result."""

import numpy as np
import pytest
from rig_samples import CONFIG, judge, sample_rig, write_samples
from scipy.special import ndtr

import facets
from facets.detectors import exact_readings

#: Where the cover before detector B begins, mm.
EDGE_MM = 3.0


def cover(sensor, state, exact):
    """Readings whose light on detector B is cut by a straight edge across psi."""
    width = sensor.beam.diameter_x / 4
    apart = (EDGE_MM - exact[:, 3]) / width
    share = np.maximum(ndtr(apart), 1e-9)
    out = exact.copy()
    out[:, 5] *= share
    out[:, 3] -= width * np.exp(-(apart**2) / 2) / np.sqrt(2 * np.pi) / share
    return out


def test_spots_behind_a_cover_are_out_of_range_in_the_result(run_in_process, tmp_path):
    _, data, _ = sample_rig(150, 7, alter=cover)
    write_samples(tmp_path / "covered.csv", data)
    status, printed, _ = run_in_process("calibrate", "paper", "covered.csv", "-o", "mine.yaml")
    assert status == 0
    words = " ".join(printed.split())
    assert "all where psi of detector B is over 2.6 mm" in words
    assert "out of range (sensor.psd.b.usable_mm)" in words
    config = facets.load(tmp_path / "mine.yaml")
    assert 1.8 < config.sensor.psds[1].usable[1] < 2.6
    _, other, state = sample_rig(480, 7, alter=cover)
    raw = exact_readings(config.sensor, other.raw, None)
    solution = facets.solve(config.sensor, raw, beam="known")
    off = np.abs(solution.state - state)[:, 2:6] / solution.uncertainty[:, 2:6]
    is_covered = other.raw[:, 3] > 2.6
    assert is_covered.sum() > 10
    assert not solution.converged[is_covered].any()
    assert (solution.converged & ~solution.ok).sum() <= 5
    assert np.nanmax(off[solution.ok]) < 5
    assert solution.ok.sum() > 400


def test_readings_near_an_edge_that_were_excluded_are_out_of_range_in_the_result():
    _, data, _ = sample_rig(60)
    data.raw[:2, 0] = CONFIG.sensor.psds[0].size_y / 2 - 0.1
    judged = judge(data)
    assert any("(sensor.psd.a.usable_mm)" in part.words for part in judged.findings)
    assert judged.sensor.psds[0].usable == pytest.approx((-5.65, 5.65, -5.65, 5.65))
