"""The calibration certificate: what it states, what it does not, and of which files."""

import hashlib
import re
from html import unescape

import numpy as np
import pandas as pd
import pytest
from commands import command
from facets.experiments.studies import rigs
from rig_samples import sample_motion

import facets
from facets.calibration import REFERENCE
from facets.calibration.table import unit_of
from facets.calibration.uncertainty import Budget
from facets.core import READING_COLUMNS, STATE_UNITS as UNITS
from facets.pictures import calibration_certificate

STATEMENT = """extends: paper
calibrate:
  statement:
    number: 2026/17-A
    sensor: head <no. 3>
    serial_number: "0042"
    date: 2026-11-20
    traceability: certificate 123 of the national institute
    temperature_c: [20.1, 20.6]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Readings of a rig beside a reference: as they are, and with a detector that slips."""
    folder = tmp_path_factory.mktemp("calibration")
    rng = np.random.default_rng(2)
    data, _ = sample_motion(rigs.draw_rig(facets.Sensor(), rng), 60, rng)
    columns = dict(zip(READING_COLUMNS, data.raw.T, strict=True))
    columns |= dict(zip(REFERENCE, (data.pose / UNITS[:6]).T, strict=True))
    columns |= {"bx_mm": data.beam[:, 0], "by_mm": data.beam[:, 1]}
    pd.DataFrame(columns).to_csv(folder / "good.csv", index=False)
    columns["psi_b_mm"] = columns["psi_b_mm"] + 0.02 * (np.arange(60) > 30)
    pd.DataFrame(columns).to_csv(folder / "slips.csv", index=False)
    (folder / "my.yaml").write_text(STATEMENT)
    return folder


def text_of(page):
    """The words of a page."""
    return " ".join(unescape(re.sub(r"<style.*?</style>|<[^>]*>", " ", page, flags=re.S)).split())


@pytest.fixture(scope="module")
def calibrated(folder):
    """What a calibration prints, and the text of its certificate."""
    words = ("my.yaml", "good.csv", "-o", "c.yaml", "--report", "c.html")
    printed = command("calibrate", *words, cwd=folder).stdout
    return printed, text_of((folder / "c.html").read_text("utf-8"))


def test_a_certificate_states_what_was_entered_found_and_read(folder, calibrated):
    printed, text = calibrated
    assert "c.html" in printed
    assert "…" not in printed
    page = (folder / "c.html").read_text("utf-8")
    assert "Calibration certificate of head <no. 3>" in text
    assert "NOT VALID" not in page
    for entry in ("2026/17-A", "0042", "2026-11-20", "certificate 123 of the national institute"):
        assert entry in text
    assert "customer not stated" in text
    assert "temperature 20.1 to 20.6 °C" in text
    assert "no certificate of an accredited laboratory" in text
    for name in ("good.csv", "c.yaml", "c-covariance.csv"):
        checksum = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        assert f"{name} sha256 {checksum}" in text
    assert facets.load(folder / "my.yaml").sha256 in text
    assert "Residuals by pose and row" in page
    outside = r"""(src|href|url)\s*[=(]\s*["']?(?!#|data:|["'#])"""
    assert not re.search(outside, page)  # one file, without a network
    row = text.partition(" psd_a.height ")[2].split()  # value, change, U, unit, k
    value, expanded, factor = (float(row[n].replace("\N{MINUS SIGN}", "-")) for n in (0, 2, 4))
    sensor = facets.load(folder / "c.yaml").sensor
    known = sensor.calibration
    standard = np.sqrt(np.diag(known.covariance))[known.names.index("psd_a.height")]
    assert value == pytest.approx(sensor.psds[0].height, abs=0.5 * expanded)
    assert expanded == pytest.approx(factor * standard, rel=0.05)
    assert 1.96 <= factor < 2.1
    pose = text.partition(" at rest dof tx ")[2].split()
    standard = float(text.partition(" standard uncertainty u ")[2].split()[0])
    assert float(pose[0]) == pytest.approx(float(pose[3]) * standard, rel=0.05)


@pytest.mark.parametrize("kind", ["screen", "table", "certificate"])
def test_a_parameter_has_the_uncertainty_that_is_written_with_it(folder, calibrated, kind):
    """Bends of the detectors that no sample shows make a pitch less known than the fit says."""
    printed, text = calibrated
    sensor = facets.load(folder / "c.yaml").sensor
    known = sensor.calibration
    written = dict(zip(known.names, np.sqrt(np.diag(known.covariance)), strict=True))
    found = pd.read_csv(folder / "c-found.csv", comment="#", index_col="parameter")
    names = [name for name in found.index if name in written]
    assert len(names) > 30
    assert written["psd_a.pitch"] > 1e-3  # rad
    for name in names:
        expected = written[name] * unit_of(name, sensor)[1]
        if kind == "table":
            u = found.u[name]
        elif kind == "screen":
            u = float(re.search(rf" {re.escape(name)} .*? (\S+)  \S+$", printed, re.M)[1])
        else:
            row = text.partition(f" {name} ")[2].split()[:5]  # value, change, U, unit, k
            u = float(row[2]) / float(row[4])
        assert u == pytest.approx(expected, rel=0.06), name


def test_the_largest_uncertainty_of_poses_is_not_below_that_at_rest():
    """Where no sample is as uncertain as the pose at rest."""
    parts = {"noise": np.array([np.full(6, 4e-8), np.full(6, 1e-8)])}
    section = calibration_certificate.pose_section(Budget({}, ("noise",), 8.0), parts)
    assert all(rest == largest for _, rest, largest, *_ in section.rows)


@pytest.mark.slow
def test_a_calibration_that_failed_is_not_called_valid(folder):
    words = ("my.yaml", "slips.csv", "-o", "e.yaml", "--report", "e.html")
    command("calibrate", *words, "--accept-misfit", cwd=folder)
    text = text_of((folder / "e.html").read_text("utf-8"))
    assert text.index("NOT VALID. The checks of this calibration failed") < text.index("Parameters")
    assert "Calibration of head <no. 3>: not valid" in text
    assert "Calibration certificate of" not in text


def test_a_certificate_is_refused_before_anything_is_read(folder):
    for words in (
        ("good.csv", "--report", "c.txt"),
        ("--propose", "3", "--report", "c.html"),
    ):
        done = command("calibrate", "my.yaml", *words, cwd=folder)
        assert done.returncode == 2
    (folder / "bad.yaml").write_text(STATEMENT.replace("2026/17-A", "'a\"; color: red'"))
    done = command("config", "check", "bad.yaml", cwd=folder)
    assert "bad.yaml:4: calibrate.statement.number" in done.stderr
