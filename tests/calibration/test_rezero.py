"""What changed since a calibration, from readings at one stop that rays have made."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from facets.experiments.studies import new_zero, rigs
from rig_samples import IDEAL_RAYS, NOMINAL

import facets
from facets.calibration import (
    CHANGES,
    LEAST_CHANCE,
    ChangePriors,
    StopReadings,
    renew_zero,
    stop_readings,
    values_of,
)
from facets.core import READING_COLUMNS, STATE_COLUMNS, InputError
from facets.detectors import invert_correction, standard_deviations
from facets.files import tables
from facets.optics import PARAMETERS

NAMES = (*(name for name in PARAMETERS if name.startswith("psd")), *CHANGES[2:6])
#: Well calibrated: 1 um, 1 urad, 1e-6 of the powers; heights and radii are correlated.
KNOWN = facets.Calibration(NAMES, tuple(map(tuple, (1e-12 * (np.eye(len(NAMES)) + 0.1)).tolist())))
SENSOR = replace(NOMINAL, calibration=KNOWN)
REAL = rigs.BenchRig(rigs.Rig(NOMINAL, values_of(NOMINAL)), IDEAL_RAYS)
POSE = np.array([0.01, -0.02, 0.3, 1e-3, -2e-3, 1e-3])
POSES = POSE + np.array([[0, 0, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0], [0, 0.1, 1, 0, 0, 0]])
NOTHING = np.zeros(10)
CHANGE = np.array([1e-3, -5e-4, 0.01, 1e-3, 0, 0, 2.3e-3, 2.3e-3, 2.3e-3, 0])
EXACT = new_zero.EXACT_STOP
#: Rows that are averaged at a stop.
ROWS = 20_000


def read(change, pose=POSE):
    """The means of the changed sensor by rays, without noise; their variances are those of noise.

    change: power and widths as shares.
    """
    real = new_zero.change_rig(REAL, change)
    exact = new_zero.read_exactly(real, np.atleast_2d(pose), change[:2])
    variance = standard_deviations(real.rig.sensor, exact) ** 2 / ROWS
    return StopReadings(invert_correction(real.rig.sensor, exact), variance)


THEN = read(NOTHING)


def test_changes_are_found_again_from_rays():
    """Beside derivatives by differences of rays, priors as rows of their own, and least squares."""
    now, prior = read(CHANGE), EXACT.sigmas(1.0)
    zero = renew_zero(SENSOR, THEN, now, EXACT)
    share = zero.prior / prior
    assert zero.is_explained
    assert zero.chi_square < 3  # of the priors, which the posts stretch
    # the priors draw gains towards zero
    assert (np.abs(zero.change - CHANGE * share) < 0.7 * zero.uncertainty).all()
    assert zero.sensor.beam.power == pytest.approx(1.01 * NOMINAL.beam.power, rel=1e-3)
    assert [psd.height for psd in zero.sensor.psds] == pytest.approx([2.3e-3] * 3, abs=1e-4)

    step = np.array([*[1e-3] * 6, *[1e-2] * 3, 1e-3])
    columns = [
        (read(unit * step).mean - read(-unit * step).mean)[0] / (2 * unit @ step)
        for unit in np.eye(10)
    ]
    sigma = np.sqrt(THEN.variance + now.variance)[0]
    rows = np.concatenate([np.array(columns).T / sigma[:, None], np.diag(1 / prior)])
    side = np.concatenate([(now.mean - THEN.mean)[0] / sigma, NOTHING])
    change = np.linalg.lstsq(rows, side, rcond=None)[0]
    u = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    # 1 um of the beam and 1 % of power bend the readings by some hundredths of this
    assert (np.abs(zero.change / share - change) < 0.1 * u).all()
    assert zero.uncertainty / share == pytest.approx(u, rel=0.02)


def test_a_mirror_that_moved_is_refused():
    for axis, size in ((0, 2e-3), (1, 2e-3), (3, 1e-5), (4, 1e-5), (5, 1e-5)):
        zero = renew_zero(SENSOR, THEN, read(NOTHING, POSE + size * np.eye(6)[axis]))
        assert not zero.is_explained
        if axis != 4:  # which of roll and pitch it was, this pose does not always tell
            alternative, words = zero.causes[0]
            assert alternative.key == "seat.jumped"
            assert STATE_COLUMNS[axis].startswith(words.split()[-1])
            moved = float(words.split()[1])
            assert moved == pytest.approx(size * (1e3 if axis < 3 else 1e6), rel=0.2)
    # one that explains the readings better than chance does is refused, too
    zero = renew_zero(SENSOR, THEN, read(NOTHING, np.add(POSE, [4.4e-4, 0, 0, 0, 1.76e-6, 0])))
    assert zero.chance > LEAST_CHANCE
    assert not zero.is_explained


def test_a_wider_beam_is_not_read_as_higher_posts():
    """At one stop both look alike: the posts' uncertainty covers it; more tell them apart."""
    wider = NOTHING + np.array([*[0] * 9, 0.005])
    single = renew_zero(SENSOR, THEN, read(wider))
    assert single.is_explained
    assert (np.abs(single.change[6:9]) < 1.96 * single.uncertainty[6:9]).all()
    three = renew_zero(SENSOR, read(NOTHING, POSES), read(wider, POSES))
    assert three.freedom == 27
    assert three.is_explained
    assert (three.uncertainty < single.uncertainty).all()
    assert three.change[9] == pytest.approx(0.005, abs=2 * three.uncertainty[9])
    assert three.uncertainty[9] < 0.001
    with pytest.raises(InputError, match="1 stops then and 3 now"):
        renew_zero(SENSOR, THEN, read(wider, POSES))


def test_an_error_of_the_stop_widens_what_it_spoils():
    exact, half = (
        renew_zero(SENSOR, THEN, read(CHANGE), priors).uncertainty
        for priors in (EXACT, ChangePriors(stop=5e-4, stop_angle=1e-9))
    )
    assert (half[6:9] > 10 * exact[6:9]).all()  # the posts stand for the mirror's height
    assert half[2] == pytest.approx(exact[2], rel=0.01)  # the laser does not


def test_errors_of_the_calibration_go_into_changes_as_stated():
    """The beam moved by 20 um; the estimate follows a detector that is thought to be turned."""
    size, now = 0.02, read(np.array([0.02, -0.01, *[0] * 8]))
    known = facets.Calibration(("psd_a.roll",), ((size**2,),))
    zeros = []
    for step in (-0.1 * size, 0.1 * size):
        turned = replace(NOMINAL.psds[0], roll=NOMINAL.psds[0].roll + step)
        thought = replace(NOMINAL, psds=(turned, *NOMINAL.psds[1:]), calibration=known)
        zeros.append(renew_zero(thought, THEN, now, EXACT))
    slope = (zeros[1].change - zeros[0].change)[:2] / 0.2
    calibration = zeros[0].sensor.calibration
    places = [calibration.names.index(name) for name in (*CHANGES[:2], "psd_a.roll")]
    covariance = np.array(calibration.covariance)[np.ix_(places, places)]
    scale = np.sqrt(np.diag(covariance))
    assert scale[2] == pytest.approx(size)
    # a sensor thought to have more has the error less, and so have the changes
    correlation = covariance[:2, 2] / scale[:2] / scale[2]
    assert slope / scale[:2] == pytest.approx(correlation, abs=0.02)
    assert np.abs(correlation).max() > 0.1


def test_readings_that_wander_are_no_stop():
    rng = np.random.default_rng(2)
    exact = facets.readings(NOMINAL, np.zeros((1, 8)))
    sigma = standard_deviations(NOMINAL, exact)
    raw = exact + sigma * rng.standard_normal((3200, 9))
    stop = stop_readings(NOMINAL, raw)
    assert np.sqrt(stop.variance) == pytest.approx(sigma / np.sqrt(3200), rel=0.8)
    assert np.abs(stop.mean - exact).max() < 4 * np.sqrt(stop.variance).max()
    raw[:, 4] += np.linspace(0, 10 * sigma[0, 4], 3200)
    with pytest.raises(InputError, match="zeta_b_mm wanders"):
        stop_readings(NOMINAL, raw)
    with pytest.raises(InputError, match="31 rows"):
        stop_readings(NOMINAL, raw[:31])


# ---- the command


@pytest.fixture
def run(tmp_path, run_in_process):
    """Runs a command in this process, in a folder with a calibrated configuration."""
    tables.write_table(tmp_path / "known.csv", dict(zip(NAMES, KNOWN.covariance, strict=True)), {})
    total = sha256((tmp_path / "known.csv").read_bytes()).hexdigest()
    (tmp_path / "calibrated.yaml").write_text(
        "extends: paper\nsolve: {beam: known, power: unknown}\n"
        f"sensor: {{calibration: {{file: known.csv, sha256: {total}}}}}\n"
    )
    write_stop(tmp_path / "then.csv", THEN, "10")
    return run_in_process


def write_stop(path, stop, day="11"):
    rng = np.random.default_rng(len(path.stem))
    noise = rng.standard_normal((500, 9))
    raw = stop.mean + np.sqrt(stop.variance * ROWS) * (noise - noise.mean(axis=0))
    columns = dict(zip(READING_COLUMNS, raw.T, strict=True))
    tables.write_table(path, columns, {"made": f"2026-01-{day}T00:00:00+00:00"})


def test_the_command_writes_a_configuration_that_extends_the_calibrated_one(run, tmp_path):
    write_stop(tmp_path / "now.csv", read(CHANGE))
    (tmp_path / "new").mkdir()
    words = ["rezero", "calibrated.yaml", "then.csv", "now.csv", "-o", "new/today.yaml"]
    status, out, _ = run(*words)
    assert status == 0
    assert "gain of detector A" in out
    written = (tmp_path / "new" / "today.yaml").read_text()
    assert "extends: ../calibrated.yaml" in written
    for text in (written, (tmp_path / "new" / "today-covariance.csv").read_text()):
        assert "# zero_then: then.csv, recorded at 2026-01-10 00:00:00+00:00" in text
        assert "# zero_now: now.csv, recorded at 2026-01-11 00:00:00+00:00" in text
    today = facets.load("new/today.yaml")
    assert today.solve.beam_offset == pytest.approx(CHANGE[:2], abs=4e-4)
    assert set(today.sensor.calibration.names) == {*NAMES, *CHANGES}
    for name, limit in (("calibrated.yaml", 6e-4), ("new/today.yaml", 2.5e-4)):
        assert run("solve", name, "now.csv", "-o", "p.csv", "--force")[0] == 0
        chunk = next(tables.read_chunks(tmp_path / "p.csv", ("tx_mm",), (), 1000))
        off = abs(chunk.columns["tx_mm"].mean() - POSE[0])
        assert (off < limit) == (name != "calibrated.yaml")
    assert run(*words)[0] == 2
    # not twice, and not in the wrong order
    for words, reason in (
        ("new/today.yaml then.csv now.csv", "its zero was renewed already, from now.csv"),
        ("calibrated.yaml now.csv then.csv", "now.csv: was recorded at 2026-01-11"),
    ):
        status, _, err = run("rezero", *words.split(), "-o", "twice.yaml")
        assert status == 2
        assert reason in err
    assert not (tmp_path / "twice.yaml").exists()


def test_the_command_refuses_a_mirror_that_moved(run, tmp_path):
    write_stop(tmp_path / "now.csv", read(NOTHING, POSE + 2e-5 * np.eye(6)[5]))
    status, _, err = run("rezero", "calibrated.yaml", "then.csv", "now.csv")
    assert status == 1
    assert "by 20 urad in yaw" in err
    assert not (tmp_path / "calibrated-rezeroed.yaml").exists()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("paper then.csv then.csv", "no calibration"),
        ("calibrated.yaml then.csv then.csv -o x.csv", "ends in .yaml"),
        ("calibrated.yaml then.csv then.csv --dwells", "ref_tx_mm"),
    ],
)
def test_what_cannot_be_used_is_said(run, words, reason):
    status, _, err = run("rezero", *words.split())
    assert status == 2
    assert reason in err


@pytest.mark.parametrize(
    "words",
    [
        "rezero calibrated.yaml then.csv then.csv -o calibrated.yaml",
        "rezero top.yaml then.csv then.csv -o calibrated.yaml",
        "rezero link.yaml then.csv then.csv -o calibrated.yaml",
        "rezero calibrated.yaml then.csv then.csv -o link.yaml",
        "rezero top.yaml then.csv then.csv -o old.yaml",  # its covariance
        "optimize top.yaml -o calibrated.yaml",
        "explore top.yaml --pick 1 -o calibrated.yaml",
        "calibrate top.yaml then.csv -o calibrated.yaml",
        "calibrate top.yaml --propose 3 -o then.csv",  # the motion's table
        "solve paper then.csv -o old-covariance.csv --zero old-covariance.csv",
        "simulate top.yaml -d . --zero poses.csv",
    ],
)
def test_a_result_never_replaces_what_it_extends_or_is_made_from(run, tmp_path, words):
    """Nor the table that is solved: `test_simulate.py` of the commands."""
    (tmp_path / "known.csv").rename(tmp_path / "old-covariance.csv")
    (tmp_path / "poses.csv").write_text("tx_mm\n0\n")
    (tmp_path / "link.yaml").symlink_to("calibrated.yaml")
    text = (tmp_path / "calibrated.yaml").read_text().replace("known.csv", "old-covariance.csv")
    (tmp_path / "calibrated.yaml").write_text(text)
    (tmp_path / "top.yaml").write_text(
        "extends: [paper, calibrated.yaml]\nmotions: {own: {kind: table, file: then.csv}}\n"
        "optimize: {variables: {radius_mm: [150, 260]}}\n"
    )
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    status, _, err = run(*words.split(), "--force")
    assert status == 2
    assert "extends this file or is made from it" in err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
