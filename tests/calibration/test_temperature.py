"""A rig that follows the temperature, read by rays: coefficients, and poses solved with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies import bench_rays, rigs
from measured import measure
from rig_samples import CONFIG, IDEAL_RAYS, NOMINAL, accepted_effects, judge, settings, words_of

import facets
from facets import Samples
from facets.calibration import REFERENCE, average_stop, choice, fit, gather_samples, renew_zero
from facets.config import sensor_keys
from facets.core import READING_COLUMNS, STATE_UNITS, InputError, Solve
from facets.detectors import TEMPERATURE, add_noise, standard_deviations
from facets.estimation import shift_per_kelvin
from facets.files import tables

#: Of the posts and of the beam's position, mm/K.
POST, BEAM = 2.3e-3, np.array([4e-4, -3e-4])
KNOWN = Solve(beam="known", power="unknown")
BEFORE = {"psd_place_mm": 0.2, "power_percent": 2.0}
DRIFTS = ("time_drift", "temperature_drift", "temperature_lag")
ASKED = replace(settings(**dict.fromkeys(DRIFTS, "auto")), power_per_sample=False, before=BEFORE)


def read(pose, temperature):
    """Readings by rays at temperatures, degrees Celsius, of a rig that is nominal at 20."""
    exact = np.empty((len(pose), 9))
    for value in np.unique(temperature):
        rows, warmer = temperature == value, value - 20
        psds = [replace(psd, height=psd.height + POST * warmer) for psd in NOMINAL.psds]
        state = np.column_stack([pose[rows], np.tile(BEAM * warmer, (rows.sum(), 1))])
        exact[rows] = bench_rays.spots(replace(NOMINAL, psds=tuple(psds)), IDEAL_RAYS, state)
    return exact


def sample(seed, head, **more):
    """Samples of a head at temperatures, with further columns."""
    rng = np.random.default_rng(seed)
    pose = rng.uniform(-1, 1, (len(head), 6)) * rigs.BOX
    columns = dict(zip(READING_COLUMNS, add_noise(NOMINAL, read(pose, head), rng).T, strict=True))
    said = pose + rigs.REFERENCE * rng.standard_normal(pose.shape)
    columns |= dict(zip(REFERENCE, (said / STATE_UNITS[:6]).T, strict=True))
    return gather_samples("t.csv", columns | more, CONFIG.calibrate)


def errors_of_coefficients(sensor):
    """By how much a calibrated sensor's coefficients are off, and their standard uncertainties."""
    known, thermal = sensor.calibration, sensor.thermal
    u = np.sqrt(np.diag(known.covariance))[[known.names.index(name) for name in TEMPERATURE]]
    truth = np.array([*BEAM, *[0.0, -POST] * 3])
    return np.array([*thermal.beam, *thermal.places]) - truth, u


@pytest.fixture(scope="module")
def calibrated():
    """The sensor after a calibration over 3 K."""
    temperature = 20 + np.round(1.5 * np.sin(np.linspace(0, 11, 300)), 1)
    data = sample(1, temperature, temperature_c=temperature)
    chosen = choice(NOMINAL, ASKED).add_unknowns(dict.fromkeys(TEMPERATURE, 0.01))
    return fit.fit(NOMINAL, data, chosen).sensor


def test_the_coefficients_are_those_of_the_rig(calibrated):
    assert calibrated.thermal.reference == pytest.approx(20.0, abs=0.2)
    off, u = errors_of_coefficients(calibrated)
    assert (np.abs(off) < 4 * u).all()
    assert (u < 3e-4).all()


@pytest.mark.slow
def test_a_temperature_that_leads_the_head():
    """The head follows a ramp with a time constant of a quarter of the run.

    Drifts may absorb the remainder of the nearest time constant, but none is significant.
    """
    time = np.linspace(0, 4, 200)
    air = 18.5 + np.minimum(time, 2)  # its mean is 20, where the rig is nominal
    head = np.full(200, air[0])
    for n in range(1, 200):
        head[n] = head[n - 1] + (air[n] - head[n - 1]) * (1 - np.exp(-time[1]))
    judged = judge(sample(3, head.round(2), temperature_c=air, time_s=time), ASKED)
    assert judged.is_trusted
    assert accepted_effects(judged) - set(DRIFTS[:2]) == {"temperature_lag"}
    assert "follow temperature_c late" in words_of(judged)
    assert "drifted over the run" not in words_of(judged)
    off, u = errors_of_coefficients(judged.sensor)
    assert (np.abs(off) < 3 * u).all()
    assert u[:2].max() < 1e-4


@pytest.mark.slow
def test_poses_at_another_temperature(calibrated):
    """What has no temperature has no pose: tests of estimation."""
    rng = np.random.default_rng(2)
    pose = rng.uniform(-1, 1, (400, 6)) * rigs.BOX
    temperature = np.full(400, 22.5)
    raw = add_noise(NOMINAL, read(pose, temperature), rng)
    corrected, ignored = (
        measure(calibrated, KNOWN, Samples(raw, temperature=each)) for each in (temperature, None)
    )
    held, held_without = (
        (np.abs((each.state[:, :6] - pose) / each.uncertainty[:, :6]) < 1.96).mean(axis=0)
        for each in (corrected, ignored)
    )
    assert (held > 0.8).all()  # the calibration's own part is the same in all poses
    assert held.mean() > 0.9
    assert (held_without[:2] < 0.05).all()  # 1 um of the beam
    assert held_without[2] < 0.6  # 6 um of the posts
    assert (corrected.uncertainty >= ignored.uncertainty * (1 - 1e-9)).all()
    shift = shift_per_kelvin(calibrated, KNOWN)
    off = (ignored.state - corrected.state).mean(axis=0)
    assert off[2] == pytest.approx(2.5 * shift[2], rel=0.2)
    assert shift[2] == pytest.approx(-POST, rel=0.1)


def stop_at(sensor, celsius, column):
    """A stop at a temperature, of which a recording tells by a column; 2 s of readings."""
    exact = read(np.zeros((1, 6)), np.array([celsius]))
    sigma = standard_deviations(NOMINAL, exact) / np.sqrt(20_000 / 500)
    rows = exact + sigma * np.random.default_rng(int(celsius)).standard_normal((500, 9))
    return average_stop(sensor, dict(zip(READING_COLUMNS, rows.T, strict=True)) | column, "rec")


def test_a_new_zero_at_another_temperature_is_none(calibrated):
    """The stops differ by 2 K, which the coefficients explain, and the beam by 1 um besides."""
    stops = [
        stop_at(calibrated, celsius, {"temperature_c": np.full(500, celsius)})
        for celsius in (20.0, 22.0)
    ]
    assert stops[1].warmer == pytest.approx([22.0 - calibrated.thermal.reference])
    same = renew_zero(calibrated, *stops)
    assert same.is_explained
    assert (np.abs(same.change) < 3 * same.uncertainty).all()
    ignored = renew_zero(calibrated, *(replace(stop, warmer=None) for stop in stops))
    assert np.abs(ignored.change[6:]).min() > 3e-3  # the posts
    assert np.abs(same.beam).max() < 3e-4 < np.abs(ignored.beam).max()
    with pytest.raises(InputError, match="rec: there is no temperature_c"):
        stop_at(calibrated, 22.0, {})
    with pytest.raises(InputError, match="rec: temperature_c has no value"):
        stop_at(calibrated, 22.0, {"temperature_c": np.full(500, np.nan)})


def test_the_command_says_what_a_missing_column_costs(calibrated, tmp_path, run_in_process):
    """Poses with the column: tests of estimation."""
    keys = sensor_keys.write_sensor(CONFIG.resolved["sensor"], calibrated)["temperature"]
    text = f"extends: paper\nsolve: {{beam: known}}\nsensor: {{temperature: {keys}}}\n"
    (tmp_path / "warm.yaml").write_text(text)
    thermal = facets.load("warm.yaml").sensor.thermal
    assert thermal.places == pytest.approx(calibrated.thermal.places, rel=1e-14)
    readings = read(np.zeros((20, 6)), np.full(20, 22.0))
    columns = dict(zip(READING_COLUMNS, readings.T, strict=True))
    tables.write_table(tmp_path / "rows.csv", columns, {})
    _, out, _ = run_in_process("solve", "warm.yaml", "rows.csv", "-o", "poses.csv")
    assert "no column temperature_c" in " ".join(out.split())
