"""What changed since a calibration, from readings at one stop that rays have made."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from facets.experiments import bench_rays, new_zero
from rig_samples import IDEAL_RAYS, NOMINAL

import facets
from facets.calibration import (
    CHANGES,
    LEAST_CHANCE,
    ChangePriors,
    StopReadings,
    renew_zero,
    stop_readings,
)
from facets.core import READING_COLUMNS, Floats, InputError, Solve
from facets.detectors import invert_correction, standard_deviations
from facets.files import tables
from facets.optics import PARAMETERS

NAMES = (*(name for name in PARAMETERS if name.startswith("psd")), *CHANGES[2:6])
#: Well calibrated: 1 um, 1 urad, 1e-6 of the powers; heights and radii are correlated.
KNOWN = facets.Calibration(NAMES, tuple(map(tuple, (1e-12 * (np.eye(len(NAMES)) + 0.1)).tolist())))
SENSOR = replace(NOMINAL, calibration=KNOWN)
POSE = np.array([0.01, -0.02, 0.3, 1e-3, -2e-3, 1e-3])
NOTHING = np.zeros(10)
CHANGE = np.array([1e-3, -5e-4, 0.01, 1e-3, 0, 0, 2.3e-3, 2.3e-3, 2.3e-3, 0])
EXACT = new_zero.EXACT_STOP


def read(change: Floats, pose: Floats = POSE, rows: int = 20_000) -> StopReadings:
    """The means of the changed sensor by rays, without noise; their variances are those of noise.

    change: power and widths as shares.
    """
    heights, gains = change[6:9], change[3:6]
    psds = [
        replace(psd, height=h, correction=replace(psd.correction, power=g))
        for psd, h, g in zip(NOMINAL.psds, heights, gains, strict=True)
    ]
    power = NOMINAL.beam.power * (1 + change[2])
    sensor = replace(
        NOMINAL, beam=replace(NOMINAL.beam, power=power), psds=(psds[0], psds[1], psds[2])
    )
    pose, light = np.atleast_2d(pose), new_zero.change_light(IDEAL_RAYS, change)
    exact = bench_rays.spots(
        sensor, light, np.column_stack([pose, np.tile(change[:2], (len(pose), 1))])
    )
    sigma = standard_deviations(sensor, exact) / np.sqrt(rows)
    return StopReadings(invert_correction(sensor, exact), sigma**2)


THEN = read(NOTHING)


def test_changes_are_found_again_from_rays():
    zero = renew_zero(SENSOR, THEN, read(CHANGE), EXACT)
    off = zero.change - CHANGE * zero.prior / EXACT.sigmas(1.0)
    assert zero.is_explained
    assert zero.chi_square < 3  # of the priors, which the posts stretch
    assert (np.abs(off) < 0.7 * zero.uncertainty).all()  # the priors draw gains towards zero
    um, percent = 1e3 * zero.uncertainty, 100 * zero.uncertainty
    assert um[:2] == pytest.approx([0.036, 0.036], abs=0.004)
    assert um[6:9] == pytest.approx([0.03] * 3, abs=0.005)
    assert percent[3:6] == pytest.approx([0.117] * 3, abs=0.003)
    assert zero.sensor.beam.power == pytest.approx(1.01 * NOMINAL.beam.power, rel=1e-3)
    assert [psd.height for psd in zero.sensor.psds] == pytest.approx([2.3e-3] * 3, abs=1e-4)


def test_the_estimate_is_that_of_weighted_rows():
    """Derivatives by differences of rays, priors as rows of their own, and least squares."""
    step = np.array([*[1e-3] * 6, *[1e-2] * 3, 1e-3])
    columns = [
        (read(unit * step).mean - read(-unit * step).mean)[0] / (2 * unit @ step)
        for unit in np.eye(10)
    ]
    now = read(CHANGE)
    sigma = np.sqrt(THEN.variance + now.variance)[0]
    prior = EXACT.sigmas(1.0)
    rows = np.concatenate([np.array(columns).T / sigma[:, None], np.diag(1 / prior)])
    side = np.concatenate([((now.mean - THEN.mean)[0]) / sigma, NOTHING])
    change = np.linalg.lstsq(rows, side, rcond=None)[0]
    u = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    zero = renew_zero(SENSOR, THEN, now, EXACT)
    share = zero.prior / prior
    # 1 um of the beam and 1 % of power bend the readings by some hundredths of this
    assert (np.abs(zero.change / share - change) < 0.1 * u).all()
    assert zero.uncertainty / share == pytest.approx(u, rel=0.02)


def test_a_mirror_that_moved_is_refused():
    for axis, size in ((0, 2e-3), (1, 2e-3), (3, 1e-5), (4, 1e-5), (5, 1e-5)):
        zero = renew_zero(SENSOR, THEN, read(NOTHING, POSE + size * np.eye(6)[axis]))
        assert not zero.is_explained
        if axis != 4:  # which of roll and pitch it was, this pose does not always tell
            assert zero.likeliest_motion[0] == axis
            moved, u = zero.motion[:, axis]
            assert abs(moved - size) < 3 * u
    # one that explains the readings better than chance does is refused, too
    zero = renew_zero(SENSOR, THEN, read(NOTHING, np.add(POSE, [4.4e-4, 0, 0, 0, 1.76e-6, 0])))
    assert 1e-3 < zero.likeliest_motion[1] < LEAST_CHANCE
    assert not zero.is_explained


def test_along_z_a_motion_of_the_mirror_looks_like_posts():
    higher = read(NOTHING, np.add(POSE, [0, 0, 1e-3, 0, 0, 0]))
    zero = renew_zero(SENSOR, THEN, higher, ChangePriors(width=1e-7))
    assert zero.is_explained
    assert zero.change[6:9] == pytest.approx([-1e-3] * 3, rel=0.05)


def test_a_wider_beam_is_not_read_as_higher_posts():
    """At one stop both look alike: the posts' uncertainty covers it; more tell them apart."""
    wider = NOTHING + np.array([*[0] * 9, 0.005])
    zero = renew_zero(SENSOR, THEN, read(wider))
    assert zero.is_explained
    assert (np.abs(zero.change[6:9]) < 1.96 * zero.uncertainty[6:9]).all()
    poses = POSE + np.array([[0.1, 0, 0, 0, 0, 0], [-0.1, 0.1, 0, 0, 0, 0], [0, -0.1, 0, 0, 0, 0]])
    zero = renew_zero(SENSOR, read(NOTHING, poses), read(wider, poses))
    assert zero.change[9] == pytest.approx(0.005, abs=2 * zero.uncertainty[9])
    assert zero.uncertainty[9] < 0.001


def test_an_error_of_the_stop_widens_what_it_spoils():
    exact, half = (
        renew_zero(SENSOR, THEN, read(CHANGE), priors).uncertainty
        for priors in (EXACT, ChangePriors(stop=5e-4, stop_angle=1e-9))
    )
    assert (half[6:9] > 10 * exact[6:9]).all()  # the posts stand for the mirror's height
    assert half[2] == pytest.approx(exact[2], rel=0.01)  # the laser does not


def test_several_stops_tell_more():
    poses = POSE + np.array([[0, 0, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0], [0, 0.1, 1, 0, 0, 0]])
    single = renew_zero(SENSOR, THEN, read(CHANGE)).uncertainty
    three = renew_zero(SENSOR, read(NOTHING, poses), read(CHANGE, poses))
    assert three.freedom == 27
    assert three.is_explained
    assert (three.uncertainty < single).all()
    with pytest.raises(InputError, match="1 stops then and 3 now"):
        renew_zero(SENSOR, THEN, read(CHANGE, poses))


def test_errors_of_the_calibration_go_into_changes_as_stated():
    """The beam moved by 20 um; the estimate follows a detector that is thought to be turned."""
    names, sizes = ("psd_a.roll", "psd_c.radius"), np.array([0.02, 0.3])
    known = facets.Calibration(names, tuple(map(tuple, np.diag(sizes**2).tolist())))
    now = read(np.array([0.02, -0.01, *[0] * 8]))
    for name, size in zip(names, sizes.tolist(), strict=True):
        k, field = "abc".index(name[4]), name[6:]
        zeros = []
        for step in (-0.1 * size, 0.1 * size):
            psds = list(NOMINAL.psds)
            psds[k] = replace(psds[k], **{field: getattr(psds[k], field) + step})
            thought = replace(NOMINAL, psds=tuple(psds), calibration=known)
            zeros.append(renew_zero(thought, THEN, now, EXACT))
        slope = (zeros[1].change - zeros[0].change)[:2] / 0.2
        calibration = zeros[0].sensor.calibration
        places = [calibration.names.index(other) for other in (*CHANGES[:2], name)]
        covariance = np.array(calibration.covariance)[np.ix_(places, places)]
        scale = np.sqrt(np.diag(covariance))
        assert scale[2] == pytest.approx(size)
        # a sensor thought to have more has the error less, and so have the changes
        correlation = covariance[:2, 2] / scale[:2] / scale[2]
        assert slope / scale[:2] == pytest.approx(correlation, abs=0.02)
        assert field != "roll" or np.abs(correlation).max() > 0.1


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


def test_the_beam_stands_beside_where_it_is_said_to_be():
    options = Solve(beam="known", beam_offset=(1e-3, -2e-3))
    assert options.knowledge(NOMINAL).beam == facets.Prior((1e-3, -2e-3), 0.0)
    places = options.knowledge(NOMINAL, np.array([[1.0, 2.0], [3.0, 4.0]])).beam.mean
    assert places == pytest.approx(np.array([[1.001, 1.998], [3.001, 3.998]]))


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
    write_stop(tmp_path / "then.csv", THEN)
    return run_in_process


def write_stop(path, stop, rows=500, **about):
    rng = np.random.default_rng(len(path.stem))
    sigma = np.sqrt(stop.variance * 20_000)
    noise = rng.standard_normal((rows, 9))
    raw = stop.mean + sigma * (noise - noise.mean(axis=0))
    tables.write_table(path, dict(zip(READING_COLUMNS, raw.T, strict=True)), about)


def test_the_command_writes_a_configuration_that_extends_the_calibrated_one(run, tmp_path):
    write_stop(tmp_path / "now.csv", read(CHANGE))
    (tmp_path / "new").mkdir()
    status, out, _ = run("rezero", "calibrated.yaml", "then.csv", "now.csv", "-o", "new/today.yaml")
    assert status == 0
    assert "gain of detector A" in out
    written = (tmp_path / "new" / "today.yaml").read_text()
    assert "extends: ../calibrated.yaml" in written
    assert len(written.splitlines()) < 40
    today = facets.load("new/today.yaml")
    assert today.solve.beam_offset == pytest.approx(CHANGE[:2], abs=4e-4)
    assert set(today.sensor.calibration.names) == {*NAMES, *CHANGES}
    for name, limit in (("calibrated.yaml", 6e-4), ("new/today.yaml", 2.5e-4)):
        assert run("solve", name, "now.csv", "-o", "p.csv", "--force")[0] == 0
        chunk = next(tables.read_chunks(tmp_path / "p.csv", ("tx_mm", "tz_mm"), (), 1000))
        off = np.hypot(chunk.columns["tx_mm"].mean() - POSE[0], 0)
        assert (off < limit) == (name != "calibrated.yaml")
    assert run("rezero", "calibrated.yaml", "then.csv", "now.csv", "-o", "new/today.yaml")[0] == 2


def test_a_zero_is_not_renewed_twice_nor_from_recordings_in_the_wrong_order(run, tmp_path):
    for name, change, date in (("old.csv", NOTHING, "10"), ("new.csv", CHANGE, "11")):
        write_stop(tmp_path / name, read(change), made=f"2026-01-{date}T00:00:00+00:00")
    assert run("rezero", "calibrated.yaml", "old.csv", "new.csv", "-o", "today.yaml")[0] == 0
    for file in ("today.yaml", "today-covariance.csv"):
        text = (tmp_path / file).read_text()
        assert "# zero_then: old.csv, recorded at 2026-01-10 00:00:00+00:00" in text
        assert "# zero_now: new.csv, recorded at 2026-01-11 00:00:00+00:00" in text
        assert "# config: calibrated" in text
    (tmp_path / "top.yaml").write_text("extends: today.yaml")
    for words, reason in (
        (("top.yaml", "old.csv", "new.csv"), "its zero was renewed already, from new.csv"),
        (("calibrated.yaml", "new.csv", "old.csv"), "new.csv: was recorded at 2026-01-11"),
    ):
        status, _, err = run("rezero", *words, "-o", "twice.yaml")
        assert status == 2
        assert reason in err
    assert not (tmp_path / "twice.yaml").exists()


def test_the_command_refuses_a_mirror_that_moved(run, tmp_path):
    pose = POSE + np.array([0, 0, 0, 0, 0, 2e-5])
    write_stop(tmp_path / "now.csv", read(NOTHING, pose))
    status, out, err = run("rezero", "calibrated.yaml", "then.csv", "now.csv")
    assert status == 1
    assert "in yaw between the stops" in out
    assert "the mirror moved" in err.replace("\n  ", " ")
    assert not (tmp_path / "calibrated-rezeroed.yaml").exists()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("paper", "then.csv", "then.csv"), "no calibration"),
        (("calibrated.yaml", "then.csv", "none.csv"), "none.csv"),
        (("calibrated.yaml", "then.csv", "then.csv", "-o", "x.csv"), "ends in .yaml"),
        (("calibrated.yaml", "then.csv", "then.csv", "--dwells"), "ref_tx_mm"),
        (("calibrated.yaml", "then.csv", "then.csv", "--stop-um", "0"), "--stop-um"),
    ],
)
def test_what_cannot_be_used_is_said(run, words, reason):
    status, _, err = run("rezero", *words)
    assert status == 2
    assert reason in err


@pytest.mark.parametrize(
    "words",
    [
        ("rezero", "calibrated.yaml", "then.csv", "then.csv", "-o", "calibrated.yaml"),
        ("rezero", "top.yaml", "then.csv", "then.csv", "-o", "calibrated.yaml"),
        ("rezero", "link.yaml", "then.csv", "then.csv", "-o", "calibrated.yaml"),
        ("rezero", "calibrated.yaml", "then.csv", "then.csv", "-o", "link.yaml"),
        ("rezero", "top.yaml", "then.csv", "then.csv", "-o", "old.yaml"),  # its covariance
        ("optimize", "top.yaml", "-o", "calibrated.yaml"),
        ("explore", "top.yaml", "--pick", "1", "-o", "calibrated.yaml"),
        ("calibrate", "top.yaml", "then.csv", "-o", "calibrated.yaml"),
        ("calibrate", "top.yaml", "--propose", "3", "-o", "then.csv"),  # the motion's table
        ("solve", "paper", "then.csv", "-o", "then.csv"),
        ("solve", "paper", "then.csv", "-o", "old-covariance.csv", "--zero", "old-covariance.csv"),
        ("simulate", "top.yaml", "-d", ".", "--zero", "poses.csv"),
    ],
    ids=" ".join,
)
def test_a_result_never_replaces_what_it_extends_or_is_made_from(run, tmp_path, words):
    (tmp_path / "known.csv").rename(tmp_path / "old-covariance.csv")
    (tmp_path / "poses.csv").write_text("tx_mm\n0\n")
    (tmp_path / "link.yaml").symlink_to("calibrated.yaml")
    text = (tmp_path / "calibrated.yaml").read_text().replace("known.csv", "old-covariance.csv")
    (tmp_path / "calibrated.yaml").write_text(text)
    (tmp_path / "top.yaml").write_text(
        "extends: [paper, calibrated.yaml]\nmotions: {own: {kind: table, file: then.csv}}\n"
    )
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    status, _, err = run(*words, "--force")
    assert status == 2
    assert "extends this file or is made from it" in err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
