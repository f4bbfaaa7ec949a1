"""A rig that follows the temperature, read by rays: coefficients, and poses solved with them."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from facets.cli import main
from facets.experiments import bench_rays, rigs

import facets
from facets.calibration import (
    StopReadings,
    average_stop,
    choice,
    choose_groups,
    gather_samples,
    renew_zero,
)
from facets.calibration.fit import fit
from facets.calibration.verdict import verdict
from facets.config import sensor_keys
from facets.core import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS, InputError, Solve
from facets.detectors import TEMPERATURE, add_noise, standard_deviations
from facets.estimation import shift_per_kelvin, solve_readings
from facets.files import tables

SETTINGS = facets.load("paper")
NOMINAL = SETTINGS.sensor
IDEAL = bench_rays.RayBench(
    np.eye(2) * (NOMINAL.beam.diameter_x / 4) ** 2, np.zeros((2, 2)), 0.0, None, 0.0, np.zeros(3),
    np.zeros((3, 2)), 0.03, np.zeros((3, 3)),
)  # fmt: skip
#: Of the posts and of the beam's position, mm/K.
POST, BEAM = 2.3e-3, np.array([4e-4, -3e-4])
KNOWN = Solve(beam="known", power="unknown")


def read(pose, temperature):
    """Readings by rays at temperatures, degrees Celsius, of a rig that is nominal at 20."""
    exact = np.empty((len(pose), 9))
    for value in np.unique(temperature):
        rows, warmer = temperature == value, value - 20
        psds = [replace(psd, height=psd.height + POST * warmer) for psd in NOMINAL.psds]
        state = np.column_stack([pose[rows], np.tile(BEAM * warmer, (rows.sum(), 1))])
        exact[rows] = bench_rays.spots(replace(NOMINAL, psds=tuple(psds)), IDEAL, state)
    return exact


def sample(seed, head, more):
    """Samples of a head at temperatures, with further columns."""
    rng = np.random.default_rng(seed)
    pose = rng.uniform(-1, 1, (len(head), 6)) * rigs.BOX
    columns = dict(zip(READING_COLUMNS, add_noise(NOMINAL, read(pose, head), rng).T, strict=True))
    said = pose + rigs.REFERENCE * rng.standard_normal(pose.shape)
    for n, name in enumerate(STATE_COLUMNS[:6]):
        columns[f"ref_{name}"] = said[:, n] / STATE_UNITS[n]
    return gather_samples("t.csv", columns | more, SETTINGS.calibrate)


@pytest.fixture(scope="module")
def calibrated():
    return calibrate(1)


def calibrate(seed):
    """The sensor after a calibration over 3 K, with other noise for each seed."""
    temperature = 20 + np.round(1.5 * np.sin(np.linspace(0, 11, 300)), 1)
    data = sample(seed, temperature, {"temperature_c": temperature})
    before = {"psd_place_mm": 0.2, "power_percent": 2.0}
    asked = replace(SETTINGS.calibrate, power_per_sample=False, before=before)
    wanted = choice(NOMINAL, asked).add_unknowns(dict.fromkeys(TEMPERATURE, 0.01))
    return fit(NOMINAL, data, wanted).sensor


def test_the_coefficients_are_those_of_the_rig(calibrated):
    thermal, known = calibrated.thermal, calibrated.calibration
    assert thermal.reference == pytest.approx(20.0, abs=0.2)
    u = np.sqrt(np.diag(known.covariance))[[known.names.index(name) for name in TEMPERATURE]]
    truth = [*BEAM, *([0.0, -POST] * 3)]
    assert np.abs((np.array([*thermal.beam, *thermal.places]) - truth) / u).max() < 4
    assert (u < 3e-4).all()


def test_a_temperature_that_leads_the_head():
    """The head follows a ramp with a time constant of a quarter of the run."""
    time = np.linspace(0, 4, 200)
    air = 18.5 + np.minimum(time, 2)  # its mean is 20, where the rig is nominal
    head = np.full(200, air[0])
    for n in range(1, 200):
        head[n] = head[n - 1] + (air[n] - head[n - 1]) * (1 - np.exp(-time[1]))
    data = sample(3, head.round(2), {"temperature_c": air, "time_s": time})
    effects = dict.fromkeys(SETTINGS.calibrate.effects, "off")
    effects |= dict.fromkeys(("time_drift", "temperature_drift", "temperature_lag"), "auto")
    before = {"psd_place_mm": 0.2, "power_percent": 2.0}
    asked = replace(SETTINGS.calibrate, power_per_sample=False, before=before, effects=effects)
    found = verdict(NOMINAL, data, choice(NOMINAL, asked), asked)
    assert found.is_trusted
    assert {row.key for row in found.search.rows if row.accepted} == {"temperature_lag"}
    assert "follow temperature_c late" in " ".join(one.words for one in found.findings)
    known = found.sensor.calibration
    u = np.sqrt(np.diag(known.covariance))[[known.names.index(name) for name in TEMPERATURE]]
    off = np.array([*found.sensor.thermal.beam, *found.sensor.thermal.places])
    off -= [*BEAM, *([0.0, -POST] * 3)]
    assert (np.abs(off) < 3 * u).all()
    assert u[:2].max() < 1e-4


def test_poses_at_another_temperature(calibrated):
    rng = np.random.default_rng(2)
    pose = rng.uniform(-1, 1, (400, 6)) * rigs.BOX
    temperature = np.full(400, 22.5)
    raw = add_noise(NOMINAL, read(pose, temperature), rng)
    with_it, without = (
        solve_readings(calibrated, KNOWN, raw, None, one) for one in (temperature, None)
    )
    held = [
        (np.abs((found.state[:, :6] - pose) / found.uncertainty[:, :6]) < 1.96).mean(axis=0)
        for found in (with_it, without)
    ]
    assert (held[0] > 0.8).all()  # the calibration's own part is the same in all poses
    assert held[0].mean() > 0.9
    assert (held[1][:2] < 0.05).all()  # 1 um of the beam
    assert held[1][2] < 0.6  # 6 um of the posts
    assert (with_it.uncertainty >= without.uncertainty * (1 - 1e-9)).all()
    shift = shift_per_kelvin(calibrated, KNOWN)
    off = (without.state - with_it.state)[:, :6].mean(axis=0)
    assert off[2] == pytest.approx(2.5 * shift[2], rel=0.2)
    assert shift[2] == pytest.approx(-POST, rel=0.1)


def test_rows_without_a_temperature_have_no_pose(calibrated):
    raw, temperature = read(np.zeros((2, 6)), np.full(2, 20.0)), np.array([20.0, np.nan])
    for options in (KNOWN, Solve(beam="free")):
        found = solve_readings(calibrated, options, raw, None, temperature)
        assert found.converged.tolist() == [True, False]


def test_a_new_zero_at_another_temperature_is_none(calibrated):
    """The stops differ by 2 K, which the coefficients explain, and the beam by 1 um besides."""
    pose = np.zeros((1, 6))
    stops = []
    for celsius in (20.0, 22.0):
        exact = read(pose, np.array([celsius]))
        sigma = standard_deviations(NOMINAL, exact) / 141
        warmer = np.array([celsius - calibrated.thermal.reference])
        stops.append(StopReadings(exact, sigma**2, warmer))
    same = renew_zero(calibrated, *stops)
    assert same.is_explained
    assert (np.abs(same.change) < 3 * same.uncertainty).all()
    ignored = renew_zero(calibrated, *(replace(one, warmer=None) for one in stops))
    assert np.abs(ignored.change[6:]).min() > 3e-3  # the posts
    assert np.abs(same.beam).max() < 3e-4 < np.abs(ignored.beam).max()


def test_a_stop_of_a_recording_needs_its_temperature(calibrated):
    rows = np.tile(read(np.zeros((1, 6)), np.array([22.0])), (500, 1))
    rows += 1e-5 * np.random.default_rng(1).standard_normal(rows.shape)
    columns = dict(zip(READING_COLUMNS, rows.T, strict=True))
    with pytest.raises(InputError, match="rec: there is no temperature_c"):
        average_stop(calibrated, columns, "rec")
    unknown = {"temperature_c": np.full(500, np.nan)}
    with pytest.raises(InputError, match="rec: temperature_c has no value"):
        average_stop(calibrated, columns | unknown, "rec")
    stop = average_stop(calibrated, columns | {"temperature_c": np.full(500, 22.0)}, "rec")
    assert stop.warmer == pytest.approx([22.0 - calibrated.thermal.reference])


def test_a_partial_calibration_refuses_coefficients(calibrated):
    with pytest.raises(InputError, match=r"sensor\.temperature"):
        choose_groups(calibrated, SETTINGS.calibrate, ["gains"])


def test_the_command_says_what_a_missing_column_costs(calibrated, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    keys = sensor_keys.write_sensor(SETTINGS.resolved["sensor"], calibrated)["temperature"]
    text = f"extends: paper\nsolve: {{beam: known}}\nsensor: {{temperature: {keys}}}\n"
    (tmp_path / "warm.yaml").write_text(text)
    thermal = facets.load("warm.yaml").sensor.thermal
    assert thermal.places == pytest.approx(calibrated.thermal.places, rel=1e-14)
    pose, temperature = np.zeros((20, 6)), np.full(20, 22.0)
    columns = dict(zip(READING_COLUMNS, read(pose, temperature).T, strict=True))
    tables.write_table(tmp_path / "without.csv", columns, {})
    tables.write_table(tmp_path / "with.csv", columns | {"temperature_c": temperature}, {})
    for name in ("with", "without"):
        words = ("solve", "warm.yaml", f"{name}.csv", "-o", f"{name}-poses.csv")
        monkeypatch.setattr(sys, "argv", ["facets", *words])
        with pytest.raises(SystemExit):
            main()
        out = " ".join(capsys.readouterr().out.split())
        assert ("no column temperature_c" in out) == (name == "without")
        chunk = next(tables.read_chunks(tmp_path / f"{name}-poses.csv", ("tz_mm",), (), 100))
        assert (abs(chunk.columns["tz_mm"].mean()) > 3e-3) == (name == "without")
    assert "um and" in out
