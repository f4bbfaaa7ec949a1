"""Calibrations: hidden rigs found, honest uncertainties, what a motion tells, and the command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from commands import command
from facets.experiments import rigs
from rig_samples import CONFIG, NOMINAL, sample_rig

import facets
from facets import ConfigError, Knowledge, uncertainties
from facets.calibration import (
    PLACE,
    REFERENCE,
    Data,
    choose_poses,
    fit,
    information,
    mean_reduction,
    pose_information,
    table,
    weak_directions,
)
from facets.core import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS, Table
from facets.detectors import KNOWN, correct
from facets.files import run_record, tables
from facets.live import Recording, recorded_config
from facets.simulation import states

# ---- what comes of it


def test_rigs_are_found_with_honest_uncertainties():
    """Three of the twenty rigs of `experiments/rigs.py`, which have 78 parameters: 95 % inside is
    74 +- 2."""
    off = []
    for seed in range(3):
        rig, fitted, (before, after, perfect) = rigs.try_rig(seed, 300, NOMINAL)
        assert fitted.ended
        assert (after < 1.3 * perfect).all()
        assert (before[2:] > 10 * after[2:]).all()
        off.append((fitted.values - rig.values[fitted.choice.places]) / fitted.uncertainty)
    assert 0.9 < (np.abs(np.concatenate(off)) < 1.96).mean() < 0.995


def test_stated_uncertainties_of_poses_have_the_calibration_in_them():
    """A rig calibrated by few samples: the errors left are larger than the noise alone says."""
    ratios, bare = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed + 50)
        rig = rigs.draw_rig(NOMINAL, rng)
        calibrated = fit.fit(NOMINAL, rigs.sample_motion(rig, 12, rng)[0], rigs.choice()).sensor
        fresh, state = rigs.sample_motion(rig, 300, rng)
        for sensor, errors in (
            (calibrated, ratios),
            (replace(calibrated, calibration=None), bare),
        ):
            solution = facets.solve(sensor, correct(sensor, fresh.raw), beam="known")
            errors.append((solution.state - state)[:, :6] / solution.uncertainty[:, :6])
    honest, short = (np.sqrt(np.nanmean(np.concatenate(errors) ** 2)) for errors in (ratios, bare))
    assert 0.75 < honest < 1.3
    assert short > 1.3 * honest
    # the budget of a resolution has the same part
    rest = np.zeros((1, 8))
    solved = facets.solve(calibrated, facets.readings(calibrated, rest), beam="known")
    stated = uncertainties(calibrated, rest, Knowledge("known"))
    np.testing.assert_allclose(stated, solved.uncertainty[:, :6], rtol=1e-6)


def test_outliers_count_less_and_a_missing_detector_is_no_obstacle():
    rng = np.random.default_rng(2)
    rig = rigs.draw_rig(NOMINAL, rng)
    data, _ = rigs.sample_motion(rig, 200, rng)
    hit = rng.random(200) < 0.05
    data.raw[hit, 0] += 0.3
    data.raw[::4, 3:6] = np.nan
    robust, plain = (fit.fit(NOMINAL, data, rigs.choice(), limit) for limit in (3.0, None))
    fresh, state = rigs.sample_motion(rig, 500, rng)
    perfect, good, bad = (
        rigs.rms(rigs.errors(sensor, fresh, state))
        for sensor in (rig.sensor, robust.sensor, plain.sensor)
    )
    assert (good < 1.3 * perfect).all()
    assert (bad > 1.5 * perfect).any()
    assert robust.weights[hit, 0].max() < 0.5


def test_seatings_by_thirds_part_mirror_from_detectors():
    """Each facet before each detector: what all facets share with all detectors is told apart."""
    rng = np.random.default_rng(4)
    rig = rigs.draw_rig(NOMINAL, rng)
    for seat in (2, 3):
        rig.values[PLACE[f"seat_{seat}.apex.z"]] = 0.05 * seat
        rig.values[PLACE[f"seat_{seat}.mount.yaw"]] = 2e-3 * seat
    pose = rng.uniform(-1, 1, (240, 6)) * rigs.BOX * [1, 1, 1, 0.8, 0.8, 0.8]
    seat = np.repeat(np.arange(3), 80)
    data = Data(np.zeros((240, 9)), pose, rigs.REFERENCE, np.zeros((240, 2)), seat=seat,
                thirds=seat)  # fmt: skip
    data, asked = rigs.read(rig, data, rng), CONFIG.calibrate
    single = table.choice(NOMINAL, asked)
    wide = table.add_seats(single, data, asked)
    two = table.add_seats(single, data.part(seat < 2), asked)
    for chosen, further in ((wide, {"seat_2", "seat_3"}), (two, {"seat_2"})):
        assert {name.split(".")[0] for name in chosen.names if "seat_" in name} == further
    whole = fit.fit(NOMINAL, data, wide)
    once = fit.fit(NOMINAL, data.part(seat == 0), single)
    assert whole.ended
    assert abs(whole.reduced_chi_square - 1) < 5 * np.sqrt(2 / whole.freedom)
    parted, common = (
        each.uncertainty[each.choice.names.index("psd_a.azimuth")] for each in (whole, once)
    )
    assert parted < 0.8 * common


# ---- what a motion tells


def test_what_cannot_be_told_is_named():
    _, data, _ = sample_rig(150, box=rigs.BOX)
    chosen = rigs.choice()
    for unmeasured, expected in (
        ((), set()),
        ((3, 4, 5), {"turning all facets about z, as yaw does",
                     "tilting all facets about x, as roll does"}),
        ((2,), {"raising all PSDs"}),
    ):  # fmt: skip
        sigma = rigs.REFERENCE.copy()
        sigma[list(unmeasured)] = np.inf
        matrix = information(NOMINAL, data._replace(sigma=sigma), chosen)
        weak = weak_directions(matrix, chosen, NOMINAL)
        untold = {direction.words for direction in weak if direction.information < 1e-3}
        assert expected <= untold
        assert bool(expected) == bool(untold)


def test_proposed_poses_tell_more_than_random_ones():
    poses = np.random.default_rng(5).uniform(-1, 1, (400, 6)) * rigs.BOX
    chosen = rigs.choice()

    def reduction(some):
        rows = pose_information(NOMINAL, chosen, rigs.REFERENCE, some)
        rows = rows.reshape(-1, len(chosen.names))
        return mean_reduction(np.eye(rows.shape[1]) + rows.T @ rows)

    best, remaining = choose_poses(NOMINAL, chosen, rigs.REFERENCE, poses, 10)
    assert (np.diff(remaining) < 0).all()
    assert remaining[-1] == pytest.approx(reduction(poses[best]), rel=1e-6)
    for n in range(5):
        assert reduction(poses[10 * n : 10 * n + 10]) > 1.05 * remaining[-1]


# ---- the command


def write_samples(path, data):
    columns = dict(zip(READING_COLUMNS, data.raw.T, strict=True))
    columns |= dict(zip(REFERENCE, (data.pose / STATE_UNITS[:6]).T, strict=True))
    tables.write_table(path, columns, {})


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A folder with a calibrated rig, what the command printed, and samples of another motion."""
    folder = tmp_path_factory.mktemp("rig")
    rig, data, _ = sample_rig(100, 1, box=rigs.BOX)
    write_samples(folder / "data.csv", data)
    trial, truth = rigs.sample_motion(rig, 300, np.random.default_rng(2))
    write_samples(folder / "trial.csv", trial)
    result = command("calibrate", "paper", "data.csv", "-o", "mine.yaml", cwd=folder)
    assert result.returncode == 0, result.stderr
    return folder, result.stdout, truth


def test_the_command_writes_the_rig_that_the_solver_takes(run):
    """Raw readings of another motion are solved with honest uncertainties."""
    folder, said, truth = run
    assert "The motion determines these combinations of parameters less well" in said
    assert "Effects of real light, and whether the data need them" in said
    assert set(facets.load(folder / "mine.yaml").sensor.calibration.names) <= set(KNOWN)
    assert (folder / "mine.png").stat().st_size > 10_000
    arguments = ("mine.yaml", "trial.csv", "-o", "poses.csv", "--beam", "known")
    solved = command("solve", *arguments, cwd=folder)
    assert solved.returncode == 0, solved.stderr
    names = [f"{part}{name}" for name in STATE_COLUMNS[:6]
             for part in ("", "u_", "u_noise_", "u_calibration_")]  # fmt: skip
    poses = next(tables.read_chunks(folder / "poses.csv", tuple(names), (), 1000)).columns
    for n in (2, 3, 5):
        value, u, noise, calibration = (poses[name] for name in names[4 * n : 4 * n + 4])
        off = (value - truth[:, n] / STATE_UNITS[n]) / u
        assert 0.8 < np.sqrt(np.nanmean(off**2)) < 1.3
        np.testing.assert_allclose(np.hypot(noise, calibration), u, rtol=0.005)


def test_a_recording_keeps_what_was_measured_of_the_rig(run, tmp_path):
    folder, *_ = run
    (folder / "again.yaml").write_text("extends: mine.yaml\n")
    config = facets.load(folder / "again.yaml")
    Recording(tmp_path / "r", run_record(config, None, 0.0, {}), config.resolved).close()
    hidden = folder / "mine-covariance.csv"
    moved_away = hidden.rename(folder / "away.csv")
    try:
        assert recorded_config(tmp_path / "r").sensor == config.sensor
    finally:
        moved_away.rename(hidden)


def test_a_covariance_that_was_changed_is_refused(run):
    folder, *_ = run
    path = folder / "mine-covariance.csv"
    text = path.read_text()
    try:
        path.write_text(text.replace("beam.tilt_x", "beam.tilt_y", 1))
        with pytest.raises(ConfigError, match=r"mine\.yaml:\d+: .*has changed"):
            facets.load(folder / "mine.yaml")
        path.unlink()
        with pytest.raises(ConfigError, match="no such file"):
            facets.load(folder / "mine.yaml")
    finally:
        path.write_text(text)


def test_the_command_proposes_poses(run_in_process, tmp_path):
    status, out, _ = run_in_process("calibrate", "paper", "--propose", "5", "-o", "poses.csv")
    assert status == 0
    assert "approaches each axis's poses from below in" in " ".join(out.split())
    _, visit = states(Table(tmp_path / "poses.csv", 2, 10.0), np.random.default_rng(1))
    assert len(visit) == 10  # a motion as it stands


def test_what_is_wrong_is_told(run):
    folder, *_ = run
    (folder / "empty.csv").write_text("a\n1\n")
    for words, reasons in (
        ("-o new.yaml", ["DATA is missing"]),
        ("--propose 0", ["Invalid value for '--propose'"]),
        ("nowhere.csv", ["no such file"]),
        ("empty.csv", ["missing columns: psi_a_mm", "give their own table with --reference"]),
        ("data.csv -o mine.yaml", ["--force"]),
        ("data.csv -o e.yaml --effect bend", ["the names are curvature"]),
        ("data.csv -o e.yaml --effect bend=perhaps", ["the names are curvature"]),
        ("data.csv -o e.yaml --effect nothing=on", ["the names are curvature"]),
    ):
        result = command("calibrate", "paper", *words.split(), cwd=folder)
        assert result.returncode == 2
        assert all(reason in result.stderr for reason in reasons), result.stderr


def test_a_calibration_that_is_not_trusted_is_not_written(run_in_process, tmp_path):
    _, data, _ = sample_rig(100, 1)
    data.raw[:, 4] = data.raw[0, 4]
    write_samples(tmp_path / "stuck.csv", data)
    status, out, err = run_in_process("calibrate", "paper", "stuck.csv", "-o", "mine.yaml")
    assert status == 1
    assert "zeta of detector B is stuck" in " ".join(out.split())
    assert "nothing was written" in err
    assert [path.name for path in tmp_path.iterdir()] == ["stuck.csv"]
