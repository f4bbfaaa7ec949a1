"""A recording with known noise, through the command: found, told, and put to use."""

from __future__ import annotations

import csv
from functools import partial

import numpy as np
import pytest
from commands import command

import facets
from facets.characterization import configured_deviation
from facets.core import THEMES, chosen_style
from facets.detectors import readings_to_counts
from facets.live import Samples, pack

RATE, COUNT = 1000, 1 << 14
CENTROID, POWER, MAINS = 5e-3, 1e-4, 2e-3  # mm, mW, mm


def stream(rng):
    """The bytes of a mirror at rest whose readings have white noise, and one of them mains."""
    config = facets.load("bench")
    exact = facets.readings(config.sensor, np.zeros(8))
    sigma = np.tile([CENTROID, CENTROID, POWER], 3) * np.repeat([1, 1, 1], 3)
    readings = exact + sigma * rng.standard_normal((COUNT, 9))
    time = np.arange(COUNT) / RATE
    readings[:, 4] += MAINS * np.sin(2 * np.pi * 50 * time)
    readings[:, 0] += 1e-3 * time
    counts = readings_to_counts(config.sensor, config.electronics, readings)
    number = np.arange(COUNT, dtype=np.uint32)
    kind = np.ones(COUNT, np.uint8)
    whole = Samples(kind, 0 * kind, number, (1_000_000 // RATE) * number, counts)
    return pack(whole.where((number < 5000) | (number >= 5003)))


@pytest.fixture
def run(tmp_path):
    """Runs a command in a folder of its own."""
    return partial(command, cwd=tmp_path)


@pytest.fixture
def record(run, tmp_path):
    """Records the bytes of a board."""

    def record(data, folder):
        (tmp_path / "board.bin").write_bytes(data)
        run("acquire", "bench", "--port", "file:board.bin", "-d", folder, "--plain")

    return record


@pytest.mark.slow
def test_known_noise_is_found_and_the_configuration_takes_it(run, record, tmp_path):
    record(stream(np.random.default_rng(8)), "rec")
    result = run("noise", "rec", "--folder", "noise", "--write", "noise.yaml")
    assert result.returncode == 0, result.stderr
    assert f"{COUNT - 3} samples, 16.38 s at 1000 Hz, 3 missing" in result.stdout
    lines = (tmp_path / "noise" / "noise.csv").read_text().splitlines()
    rows = {row["channel"]: row for row in csv.DictReader(x for x in lines if x[0] != "#")}
    assert len(rows) == 15
    for name in ("psi_b_mm", "zeta_c_mm"):
        assert float(rows[name]["sigma_white"]) == pytest.approx(1e3 * CENTROID, rel=0.05)
    assert "mains 50 Hz" in rows["zeta_b_mm"]["lines"]
    assert float(rows["psi_a_mm"]["drift_low"]) < 1.0 < float(rows["psi_a_mm"]["drift_high"])
    assert float(rows["psi_b_mm"]["drift_low"]) < 0.0 < float(rows["psi_b_mm"]["drift_high"])
    page = (tmp_path / "noise" / "noise.html").read_text()
    assert page.count("<svg") == 3
    assert "mains, 50 Hz" in page
    hues = THEMES[chosen_style()]
    for hue in (*hues.detectors.values(), hues.axes["tx"], hues.axes["yaw"]):
        assert hue.lower() in page, hue
    for words in ("detector A", "shift in x", "frequency, Hz", "averaging time, s"):
        assert f">{words}</text>" in page
    sensor = facets.load(tmp_path / "noise.yaml").sensor
    assert sensor.electronics is None
    found = facets.standard_deviations(sensor, facets.readings(sensor, np.zeros(8)))
    assert found[0] == pytest.approx(CENTROID, rel=0.1)
    assert found[2] == pytest.approx(POWER, rel=0.1)
    again = run("noise", "rec", "--folder", "noise")
    assert again.returncode == 2
    assert "use --force to replace it" in again.stderr


@pytest.mark.slow
def test_a_recording_that_does_not_show_the_noise_is_refused_and_leaves_nothing(
    run, record, tmp_path
):
    """One that is too short, and one of a moving mirror."""
    record(stream(np.random.default_rng(8))[: 64 * 20], "short")
    result = run("noise", "short")
    assert result.returncode == 2
    assert "too few for their noise" in result.stderr
    config = facets.load("bench")
    count = 4_000
    state = np.zeros((count, 8))
    state[:, 5] = 1e-3 * np.sin(np.arange(count) / 300)
    counts = readings_to_counts(
        config.sensor, config.electronics, facets.readings(config.sensor, state),
        np.random.default_rng(1),
    )  # fmt: skip
    number = np.arange(count, dtype=np.uint32)
    kind = np.ones(count, np.uint8)
    record(pack(Samples(kind, 0 * kind, number, 100 * number, counts)), "rec")
    result = run("noise", "rec", "--folder", "new/noise", "--write", "new/n.yaml")
    assert result.returncode == 1
    assert "All detectors change as when the mirror moves, mostly in yaw" in result.stdout
    assert "Not written: new/noise/, new/n.yaml." in result.stdout
    assert "position_um" not in result.stdout
    assert not (tmp_path / "new").exists()
    result = run("noise", "rec", "--folder", "noise")
    assert result.returncode == 1
    assert "the noise of the bench cannot be estimated from this recording" in result.stdout
    page = (tmp_path / "noise" / "noise.html").read_text()
    assert "he noise of the bench cannot be estimated from this recording" in page
    assert "For the configuration" not in page
    result = run("noise", "rec", "--write", "foo.txt")
    assert result.returncode == 2
    assert "foo.txt: a configuration's name ends in .yaml or .yml" in result.stderr


def test_a_calibration_does_not_scatter_at_rest():
    """What is measured at rest stands beside the noise alone, where a table tells it apart."""
    columns = {"u_tz_mm": np.full(5, 2e-3), "u_noise_tz_mm": np.full(5, 1e-3)}
    config, rows = facets.load("paper"), slice(1, 4)
    assert configured_deviation("tz_mm", columns, rows, config) == pytest.approx(1e-3)
    del columns["u_noise_tz_mm"]
    assert configured_deviation("tz_mm", columns, rows, config) == pytest.approx(2e-3)
