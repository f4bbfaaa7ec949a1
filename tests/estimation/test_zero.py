"""Zeros of tables: which samples they are, also across the pieces of a table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import InputError, Measurement, Samples
from facets.core import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from facets.estimation import (
    PoseColumns,
    ZeroRequest,
    solve_table,
    zero_findings,
    zero_of_table,
)
from facets.files import read_head, write_table

CONFIG = replace(facets.load("paper"), object=facets.MeasuredObject((0, 0, 50.0)))
COUNT = 200


def noisy(states):
    readings = facets.readings(CONFIG.sensor, states)
    return facets.add_noise(CONFIG.sensor, readings, np.random.default_rng(2))


@pytest.fixture(scope="module")
def readings(tmp_path_factory):
    """A mirror at rest for 0.1 s, then moving; the eighth reading is spoilt, and the time begins
    again in the middle."""
    path = tmp_path_factory.mktemp("zero") / "readings.csv"
    states = np.zeros((COUNT, 8))
    states[100:, 4] = np.linspace(0, 1e-3, 100)
    rows = noisy(states)
    rows[7, 2] *= 3
    time = np.arange(COUNT) % 150 * 1e-3 + 5
    columns = dict(zip(READING_COLUMNS, rows.T, strict=True))
    write_table(path, {"time_s": time} | columns, {})
    return path


def solve(readings, name, request, rows, config=CONFIG):
    import pandas as pd

    path, about = readings.with_name(name), {"config_sha256": CONFIG.sha256}
    measurement = Measurement(config, PoseColumns(request))
    solve_table(measurement, readings, path, about, rows=rows)
    table = pd.read_csv(path, comment="#") if path.suffix == ".csv" else None
    return table, measurement.zero


@pytest.mark.parametrize("rows", [1000, 7])
def test_a_zero_is_the_mean_of_the_first_seconds(readings, rows):
    poses, zero = solve(readings, "poses.csv", ZeroRequest(seconds=0.1), rows)
    assert zero.samples == 99
    mean = poses[list(STATE_COLUMNS)][:100].drop(index=7).mean().to_numpy() * STATE_UNITS
    np.testing.assert_allclose(zero.state, mean, atol=1e-12)
    assert "first 0.1 s, 99 samples" in read_head(readings.with_name("poses.csv"))["zero"]
    moved = poses.displacement_tx_mm[199] - 50 * np.sin(1e-3)
    assert abs(moved) < 4 * poses.u_displacement_tx_mm[199]
    size = poses.u_displacement_tz_mm / poses.u_tz_mm
    assert size[7] > 1 > size[8]  # the spoilt row is no sample of the zero
    same, _ = solve(readings, "row.csv", ZeroRequest(row=150), rows)
    assert (same.filter(regex="^displacement_").iloc[149].abs() < 1e-12).all()
    assert (same.filter(regex="^u_displacement_").iloc[149] == 0).all()


@pytest.mark.parametrize("rows", [1000, 7])
def test_a_zero_is_no_longer_than_its_table(readings, tmp_path, rows):
    short = tmp_path / "short.csv"
    short.write_text("".join(readings.read_text().splitlines(True)[:103]))  # up to 5.1 s
    _, zero = solve(short, "poses.csv", ZeroRequest(seconds=0.1), rows)
    assert zero.samples > 95
    with pytest.raises(InputError, match=r"first 9999 s, but the table lasts 0\.\d+ s; give"):
        solve(short, "none.csv", ZeroRequest(seconds=9999), rows)
    assert not (tmp_path / "none.csv").exists()


def test_detectors_are_read_at_one_instant_also_across_the_pieces_of_a_table(readings):
    """Only the pieces differ; the readings of a moving mirror change by the delays."""
    late = replace(CONFIG.sensor, light=facets.BenchLight(delays=(0.0, 1e-3, 2e-3)))
    config = replace(CONFIG, sensor=late)
    whole, *others = (solve(readings, "late.csv", None, rows, config)[0] for rows in (1000, 7, 1))
    assert all(map(whole.equals, others))
    assert (whole.tx_mm != solve(readings, "late.csv", None, 1000)[0].tx_mm).all()


def test_a_saved_pose_is_a_zero(readings):
    solve(readings, "saved.csv", None, 1000)
    path = readings.with_name("saved.csv")
    zero = zero_of_table(path, CONFIG)
    assert (zero.samples, zero.same_calibration) == (COUNT - 1, True)
    assert "mirror moved" in zero_findings(zero)[0]
    known = facets.Calibration(("psd_a.height",), ((1e-6,),))
    other = replace(CONFIG, sha256="0", sensor=replace(CONFIG.sensor, calibration=known))
    zero = zero_of_table(path, other)
    assert not zero.same_calibration
    assert "independent" in zero_findings(zero)[1]
    head = ",".join(STATE_COLUMNS[:6])
    path.write_text(f"{head}\n0,0,0.1,0,0,0\n")
    zero = zero_of_table(path, CONFIG)
    assert (zero.state.tolist(), zero_findings(zero)) == ([0, 0, 0.1, 0, 0, 0, 0, 0], [])
    path.write_text(f"{head}\n90,0,0.1,0,0,0\n")
    with pytest.raises(facets.InputError, match=r"saved.csv: at the mean pose .* no light"):
        zero_of_table(path, CONFIG)


def test_a_zero_of_two_detectors_has_their_noise(readings):
    """Which is up to twice that of three; samples of different detectors are refused."""
    way = replace(CONFIG.solve, beam="known", accept_unchecked=True)
    path, rows = readings.with_name("two.csv"), noisy(np.zeros((COUNT, 8)))
    rows[:, 6:] = np.nan
    columns = dict(zip(READING_COLUMNS, rows.T, strict=True))
    write_table(path, {"time_s": np.arange(COUNT) * 1e-3} | columns, {})
    config = replace(CONFIG, solve=way)
    _, measured = solve(path, "pose.csv", ZeroRequest(seconds=0.2), 30, config)
    solve(path, "pose.parquet", None, 30, config)
    saved = [zero_of_table(path.with_name(f"pose.{kind}"), config) for kind in ("csv", "parquet")]
    found = facets.solve(CONFIG.sensor, rows, beam="known", accept_unchecked=True)
    zero = facets.zero_pose(CONFIG.sensor, found, beam="known")
    for each in (measured, zero, *saved):
        assert np.abs(each.scatter - 1).max() < 0.2
    mixed = np.tile([[True, True, False], [True, False, True]], (COUNT // 2, 1))
    with pytest.raises(InputError, match="different detectors; choose"):
        facets.zero_pose(CONFIG.sensor, replace(found, used=mixed), beam="known")


def test_few_samples_of_a_mirror_that_moves_are_told():
    """Samples at rest scatter by chance alone, the more the fewer they are."""
    for count in (2, 3, 10, 29):
        states = facets.solve(CONFIG.sensor, noisy(np.zeros((100, count, 8)))).state
        states[0, :, 3] += np.linspace(0, 1e-4, count)
        findings = [zero_findings(facets.zero_pose(CONFIG.sensor, some)) for some in states]
        assert "mirror moved" in findings[0][0]
        assert sum(map(bool, findings[1:])) <= 1


def test_zeros_that_the_table_does_not_have(readings):
    bare = readings.with_name("bare.csv")
    lines = readings.read_text().splitlines()
    bare.write_text("\n".join(line.partition(",")[2] for line in lines))
    for path, request, words in (
        (readings, ZeroRequest(row=201), "row 201, but the table has only 200 rows"),
        (readings, ZeroRequest(row=8), "no solved pose that fits"),
        (bare, ZeroRequest(seconds=1.0), "no column time_s; use --zero row:N"),
    ):
        with pytest.raises(facets.InputError, match=words):
            solve(path, "no.csv", request, 30)
    assert not readings.with_name("no.csv").exists()


def test_columns_hold_the_whole_covariance():
    solution = facets.solve(CONFIG.sensor, facets.readings(CONFIG.sensor, np.zeros((2, 8))))
    samples = Samples(facets.readings(CONFIG.sensor, np.zeros((2, 8))))
    columns = Measurement(CONFIG, PoseColumns(covariance=True)).poses(samples).object
    matrix = facets.transform(solution, CONFIG.object).covariance
    np.testing.assert_allclose(columns["cov_object_tx_pitch_mm_mrad"], 1e3 * matrix[:, 0, 4])
    np.testing.assert_allclose(columns["cov_pitch_yaw_mrad2"], 1e6 * solution.covariance[:, 4, 5])
    np.testing.assert_allclose(columns["cov_tx_tx_mm2"], solution.covariance[:, 0, 0])
    assert sum(name.startswith("cov_object_") for name in columns) == 21
