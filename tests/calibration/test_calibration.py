"""Calibrations: hidden rigs found, honest uncertainties, what a motion tells, and the command."""

from __future__ import annotations

import numpy as np
import pytest
from commands import command
from facets.experiments.studies import rigs
from rig_samples import NOMINAL, pose_errors, sample_motion, sample_rig, write_samples

import facets
from facets import ConfigError
from facets.calibration import (
    choose_poses,
    fit,
    information,
    mean_reduction,
    nearest_order,
    pose_information,
    travel,
    weak_directions,
)
from facets.core import STATE_COLUMNS, STATE_UNITS, Table
from facets.detectors import KNOWN, correct
from facets.files import run_record, tables
from facets.live import Recording, recorded_config
from facets.simulation import states

# ---- what comes of it


def test_rigs_are_found_with_honest_uncertainties():
    """Three of the rigs of `experiments/studies/rigs.py`, which have 78 parameters: 95 %
    inside is 74 +- 2."""
    off = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        rig = rigs.draw_rig(NOMINAL, rng)
        fitted = fit.fit(NOMINAL, sample_motion(rig, 300, rng)[0], rigs.choice())
        fresh, state = sample_motion(rig, 2000, rng)
        before, after, perfect = (
            rigs.rms(pose_errors(sensor, fresh, state))
            for sensor in (NOMINAL, fitted.sensor, rig.sensor)
        )
        assert fitted.ended
        assert (after < 1.3 * perfect).all()
        assert (before[2:] > 10 * after[2:]).all()
        off.append((fitted.values - rig.values[fitted.choice.places]) / fitted.uncertainty)
    assert 0.9 < (np.abs(np.concatenate(off)) < 1.96).mean() < 0.995


def test_stated_uncertainties_of_poses_have_the_calibration_in_them():
    """A rig calibrated by few samples: the errors left are larger than the noise alone says."""
    squares = []
    for seed in range(6):
        rng = np.random.default_rng(seed + 50)
        rig = rigs.draw_rig(NOMINAL, rng)
        calibrated = fit.fit(NOMINAL, sample_motion(rig, 12, rng)[0], rigs.choice()).sensor
        fresh, state = sample_motion(rig, 300, rng)
        solution = facets.solve(calibrated, correct(calibrated, fresh.raw), beam="known")
        off = (solution.state - state)[:, :6]
        noise = np.sqrt(solution.uncertainty**2 - solution.calibration_uncertainty**2)[:, :6]
        squares.append([(off / u) ** 2 for u in (solution.uncertainty[:, :6], noise)])
    honest, short = np.sqrt(np.nanmean(squares, axis=(0, 2, 3)))
    assert 0.75 < honest < 1.3
    assert short > 1.3 * honest
    # the budget of a resolution has the same part
    rest = np.zeros((1, 8))
    solved = facets.solve(calibrated, facets.readings(calibrated, rest), beam="known")
    stated = facets.uncertainties(calibrated, rest, facets.Knowledge("known"))
    np.testing.assert_allclose(stated, solved.uncertainty[:, :6], rtol=1e-6)


def test_outliers_count_less_and_a_missing_detector_is_no_obstacle():
    rng = np.random.default_rng(2)
    rig = rigs.draw_rig(NOMINAL, rng)
    data, _ = sample_motion(rig, 200, rng)
    hit = rng.random(200) < 0.05
    data.raw[hit, 0] += 0.3
    data.raw[::4, 3:6] = np.nan
    robust, plain = (fit.fit(NOMINAL, data, rigs.choice(), limit) for limit in (3.0, None))
    fresh, state = sample_motion(rig, 500, rng)
    perfect, good, bad = (
        rigs.rms(pose_errors(sensor, fresh, state))
        for sensor in (rig.sensor, robust.sensor, plain.sensor)
    )
    assert (good < 1.3 * perfect).all()
    assert (bad > 1.5 * perfect).any()
    assert robust.weights[hit, 0].max() < 0.5


# ---- what a motion tells


@pytest.mark.parametrize(
    ("unmeasured", "expected"),
    [
        ([], set()),
        ([3, 4, 5], {"turning all facets about z, as yaw does",
                     "tilting all facets about x, as roll does"}),
        ([2], {"raising all PSDs"}),
    ],
)  # fmt: skip
def test_what_cannot_be_told_is_named(unmeasured, expected):
    _, data, _ = sample_rig(150, box=rigs.BOX)
    chosen, sigma = rigs.choice(), rigs.REFERENCE.copy()
    sigma[unmeasured] = np.inf
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
    assert min(map(reduction, np.split(poses[:50], 5))) > 1.05 * remaining[-1]


# ---- the command


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A folder with a calibrated rig, what the command printed, and samples of another motion."""
    folder = tmp_path_factory.mktemp("rig")
    rig, data, _ = sample_rig(100, 1, box=rigs.BOX)
    write_samples(folder / "data.csv", data)
    trial, truth = sample_motion(rig, 300, np.random.default_rng(2))
    write_samples(folder / "trial.csv", trial)
    result = command("calibrate", "paper", "data.csv", "-o", "mine.yaml", cwd=folder)
    assert result.returncode == 0, result.stderr
    return folder, result.stdout, truth


def test_the_command_writes_the_rig_that_the_solver_takes(run):
    """Raw readings of another motion are solved with honest uncertainties."""
    folder, said, truth = run
    assert "The motion determines these combinations of parameters less well" in said
    assert "Effects of real light, and whether the data require them" in said
    assert set(facets.load(folder / "mine.yaml").sensor.calibration.names) <= set(KNOWN)
    assert (folder / "mine.png").exists()
    words = ("solve", "mine.yaml", "trial.csv", "-o", "poses.csv", "--beam", "known")
    assert command(*words, cwd=folder).returncode == 0
    for n in (2, 3, 5):
        names = [part + STATE_COLUMNS[n] for part in ("", "u_", "u_noise_", "u_calibration_")]
        (chunk,) = tables.read_chunks(folder / "poses.csv", tuple(names), (), 1000)
        value, u, noise, calibration = (chunk.columns[name] for name in names)
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
        with pytest.raises(ConfigError, match="no such file"):
            facets.load(folder / "mine.yaml")
        hidden.write_text(moved_away.read_text().replace("beam.tilt_x", "beam.tilt_y", 1))
        with pytest.raises(ConfigError, match=r"mine\.yaml:\d+: .*has changed"):
            facets.load(folder / "mine.yaml")
    finally:
        moved_away.replace(hidden)


def test_the_command_proposes_poses(run_in_process, tmp_path):
    status, out, _ = run_in_process("calibrate", "paper", "--propose", "5", "-o", "poses.csv")
    assert status == 0
    assert "approaches each axis's poses from below in" in " ".join(out.split())
    _, visit = states(Table(tmp_path / "poses.csv", 2, 10.0), np.random.default_rng(1))
    assert len(visit) == 10  # a motion as it stands


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("empty.csv", "give their own table with --reference"),
        ("empty.csv -o mine.yaml", "--force"),
        ("empty.csv --effect bend=perhaps", "NAME=auto, of curvature"),
        ("empty.csv --effect nothing=on", "NAME=auto, of curvature"),
    ],
)
def test_what_is_wrong_is_told(run_in_process, tmp_path, words, reason):
    (tmp_path / "empty.csv").write_text("a\n1\n")
    (tmp_path / "mine.yaml").write_text("extends: paper\n")
    status, _, err = run_in_process("calibrate", "paper", *words.split())
    assert status == 2
    assert reason in " ".join(err.split())


def test_a_calibration_that_is_not_trusted_is_not_written(run_in_process, tmp_path):
    _, data, _ = sample_rig(100, 1)
    data.raw[:, 4] = data.raw[0, 4]
    write_samples(tmp_path / "stuck.csv", data)
    status, out, err = run_in_process("calibrate", "paper", "stuck.csv", "-o", "mine.yaml")
    assert status == 1
    assert "zeta of detector B is stuck" in " ".join(out.split())
    assert "nothing was written" in err
    assert [path.name for path in tmp_path.iterdir()] == ["stuck.csv"]


@pytest.mark.parametrize("count", [0, 1, 6, 40])
def test_poses_are_visited_by_the_nearest_first(count):
    points = np.random.default_rng(count).uniform(-1, 1, (count, 6)).round(0 if count == 40 else 9)
    order = nearest_order(points, np.zeros(6))
    assert sorted(order.tolist()) == list(range(count))
    way = np.vstack([np.zeros((1, 6)), points[order]])
    for n in range(count):
        assert np.abs(way[n + 1 :] - way[n]).max(axis=1).argmin() == 0
    assert travel(way) <= travel(np.vstack([way[:1], points])) + 1e-12
