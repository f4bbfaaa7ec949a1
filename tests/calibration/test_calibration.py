"""Calibrations: derivatives and algebra against plain ones, hidden rigs found, honest words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from commands import command
from facets.experiments import rigs
from scipy.spatial.transform import Rotation
from sensors import SENSORS

import facets
from facets import ConfigError, InputError, Knowledge, uncertainties
from facets.calibration import (
    ALL,
    OWN_COUNT,
    OWN_UNITS,
    PLACE,
    Choice,
    Data,
    block,
    choose_poses,
    eliminate_own_unknowns,
    information,
    linear,
    mean_reduction,
    pose_information,
    predict_readings,
    states_of,
    table,
    values_of,
    weak_directions,
)
from facets.calibration import unknowns as study
from facets.calibration.fit import fit
from facets.core import Table
from facets.detectors import KNOWN, coefficients, correct, correction_slopes, invert_correction
from facets.files import run_record
from facets.live import Recording, recorded_config
from facets.model import parameters, sensor_with
from facets.simulation import states

NOMINAL = facets.Sensor()
EVERY = Choice(ALL, np.ones(len(ALL)))


def some_rig(seed=3, count=60):
    rng = np.random.default_rng(seed)
    rig = rigs.draw_rig(NOMINAL, rng)
    data, state = rigs.sample_motion(rig, count, rng)
    return rig, data, state


# ---- corrections


def test_corrections_go_both_ways():
    rig, data, _ = some_rig()
    bent = tuple(0.01 * n for n in range(1, 10))
    psds = [replace(p, correction=replace(p.correction, y=bent)) for p in rig.sensor.psds]
    sensor = replace(rig.sensor, psds=(psds[0], psds[1], psds[2]))
    back = invert_correction(sensor, correct(sensor, data.raw))
    np.testing.assert_allclose(back, data.raw, atol=1e-12)
    assert not np.allclose(correct(sensor, data.raw), data.raw, atol=1e-3)
    whole = data.raw + correction_slopes(sensor, data.raw) @ coefficients(sensor)
    np.testing.assert_allclose(correct(sensor, data.raw), whole)


def test_a_scale_and_a_gain_mean_what_they_say():
    psd = replace(NOMINAL.psds[0], correction=facets.Correction(
        power=0.02, dark=1e-3, y=(0.065, *[0.0] * 8)))  # fmt: skip
    sensor = replace(NOMINAL, psds=(psd, *NOMINAL.psds[1:]))
    raw = facets.readings(NOMINAL, np.array([[0.02, 0.01, 0.1, 1e-3, 2e-3, 5e-3, 0, 0]]))
    fixed = correct(sensor, raw)
    np.testing.assert_allclose(fixed[0, :2] / raw[0, :2], [1.01, 1.0], rtol=1e-12)
    assert fixed[0, 2] == pytest.approx(1.02 * raw[0, 2] + 1e-3, rel=1e-12)
    np.testing.assert_array_equal(fixed[:, 3:], raw[:, 3:])


def test_a_measured_table_corrects_as_what_it_was_measured_of(tmp_path):
    """A grid of a plane is that plane, in a file of any order; past its edge it stays as it is."""
    rng = np.random.default_rng(1)
    grid = np.array([(y, z) for y in range(-6, 7, 2) for z in (-6, 0, 6)], dtype=float)
    rows = np.column_stack([grid, 10 * grid[:, 0] - 3 * grid[:, 1], 2 * grid[:, 1]])
    mixed = [",".join(map(str, row)) for row in rng.permutation(rows)]
    lines = ["psi_mm,zeta_mm,add_psi_um,add_zeta_um", *mixed]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    text = "extends: paper\nsensor: {psd: {b: {correction: {table: a.csv}}}}\n"
    (tmp_path / "my.yaml").write_text(text)
    config = facets.load(tmp_path / "my.yaml")
    raw = facets.readings(NOMINAL, np.array([[0.02, 0.01, 0.4, 1e-3, 2e-3, 5e-3, 0, 0]]))
    psi, zeta = raw[0, 3:5]
    fixed = correct(config.sensor, raw)
    np.testing.assert_allclose(fixed[0, 3] - psi, 0.01 * psi - 0.003 * zeta, atol=1e-12)
    np.testing.assert_allclose(fixed[0, 4] - zeta, 0.002 * zeta, atol=1e-12)
    np.testing.assert_array_equal(fixed[:, [0, 1, 2, 5, 6, 7, 8]], raw[:, [0, 1, 2, 5, 6, 7, 8]])
    np.testing.assert_allclose(invert_correction(config.sensor, fixed), raw, atol=1e-12)
    (tmp_path / "a.csv").write_text("\n".join(lines[:-1]))
    with pytest.raises(ConfigError, match="not a grid: 20 rows, 7 values of psi_mm, 3 of zeta_mm"):
        facets.load(tmp_path / "my.yaml")
    (tmp_path / "my.yaml").write_text(text.replace("b: {", "").replace("}}}}", "}}}"))
    (tmp_path / "a.csv").unlink()
    with pytest.raises(ConfigError, match=r"my\.yaml:2: .*no such file"):
        facets.load(tmp_path / "my.yaml")


@pytest.mark.parametrize("name", ["paper", "skewed0"])
def test_a_sensor_is_its_parameters(name):
    sensor = SENSORS[name]
    assert sensor_with(sensor, parameters(sensor)) == sensor


# ---- the pieces of the fit


def test_the_mirror_is_carried_as_a_rigid_body():
    """By SciPy's rotations: t = t_s + (R_s - 1) lever + apex, R = R_s R_m, R = Rz Ry Rx."""
    rng = np.random.default_rng(1)
    pose = rng.uniform(-0.3, 0.3, (20, 6))
    lever, apex, mount = rng.uniform(-5, 5, (3, 3)) * [[1], [1], [0.05]]
    values = values_of(NOMINAL)
    values[block(study.OF_SEAT)] = np.concatenate([lever, apex, mount])
    data = Data(np.zeros((20, 9)), pose, np.ones(6), np.zeros((20, 2)))
    state = states_of(data, np.zeros((20, OWN_COUNT)), values)
    turn = Rotation.from_euler("ZYX", pose[:, [5, 4, 3]])
    place = pose[:, :3] + turn.apply(lever) - lever + apex
    np.testing.assert_allclose(state[:, :3], place, atol=1e-13)
    put = turn * Rotation.from_euler("ZYX", mount[[2, 1, 0]])
    np.testing.assert_allclose(state[:, [5, 4, 3]], put.as_euler("ZYX"), atol=1e-13)


def test_a_mirror_turned_on_its_reference_is_a_mirror_with_other_facets():
    """Degrees, to rounding: the readings are the same once the facets have taken the turn."""
    rig, data, _ = some_rig(count=20)
    values = rig.values.copy()
    values[study.mount_of(0)] = [0.01, -0.02, 0.05]
    turned = states_of(data, np.zeros((20, OWN_COUNT)), values)
    other = study.assign_values(NOMINAL, study.fold_mount(values))
    straight = states_of(data, np.zeros((20, OWN_COUNT)), study.fold_mount(values))
    np.testing.assert_allclose(
        facets.readings(other, straight), facets.readings(rig.sensor, turned), atol=1e-10
    )
    assert abs(turned[:, 5] - straight[:, 5]).min() > 0.04


def real_light():
    """A sensor with an ellipse, and with every effect of the model on."""
    light = replace(
        NOMINAL.light, curvature_xx=3e-4, curvature_xy=1e-4, curvature_yy=-2e-4, wavelength=6.3e-4,
        rolloff=(1e-5, 2e-5, 3e-5, -1e-5, 1e-5, 2e-5), strips=(0.01, 0.004, 0.008), tip=1e-4,
        background=((5e-4, 1.0, -2.0), (3e-4, 0.5, 1.0), (1e-4, -1.0, 0.3)), index=(1.4, 7.6),
        polarization=0.4, rolloff_width=0.05,
    )  # fmt: skip
    beam = replace(NOMINAL.beam, diameter_x=0.9, diameter_y=0.8, rotation=0.3)
    return replace(NOMINAL, beam=beam, light=light)


@pytest.mark.parametrize("sensor", [NOMINAL, real_light()], ids=["ideal", "bench"])
def test_derivatives_are_those_of_differences(sensor):
    """Every unknown there is and the nine of each sample, by central differences."""
    rng = np.random.default_rng(3)
    values = values_of(sensor)
    values[block(study.OF_SEAT)] += rng.normal(size=9) * [5, 5, 5, 0.02, 0.02, 0, 1e-3, 1e-3, 1e-3]
    opening = rng.normal(size=(4, OWN_COUNT)) * [*[1e-3] * 3, *[1e-4] * 3, 0.02, 1e-3, 1e-3]
    data = Data(
        np.zeros((4, 9)), rng.uniform(-1, 1, (4, 6)) * rigs.BOX, rigs.REFERENCE, np.zeros((4, 2)),
        velocity=rng.normal(size=(4, 6)) * 0.1, clock=rng.uniform(-1, 1, (4, 4)),
        slow=rng.uniform(-1, 1, (4, 5)), step=rng.normal(size=(4, 6)) * 0.1,
    )  # fmt: skip
    values[block(study.POWER_DRIFT)] = rng.uniform(-0.02, 0.02, 5)
    made = study.assign_values(sensor, values)
    raw = predict_readings(made, data, opening, values, states_of(data, opening, values))
    data = data._replace(raw=raw, noise=np.ones((4, 9)))
    found = linear(made, data, opening, values, EVERY)

    def seen(values, opening):
        other = study.assign_values(sensor, values)
        state = states_of(data, opening, values)
        return predict_readings(other, data, opening, values, state) - correct(other, raw)

    for n, name in enumerate(ALL):
        if name.startswith("seat_") or (sensor is NOMINAL and name in study.EFFECTS):
            continue
        if name in study.SPLINE:  # written as straight lines between fine places: test_spline
            continue
        step = np.zeros(len(ALL))
        step[n] = 1e-6 if "wavelength" not in name else 1e-8
        slope = (seen(values + step, opening) - seen(values - step, opening)) / (2 * step[n])
        scale = np.abs(slope).max() + 1
        np.testing.assert_allclose(found.common[:, :, n], slope, atol=5e-5 * scale, err_msg=name)
    for n in range(OWN_COUNT):
        step = np.zeros((4, OWN_COUNT))
        step[:, n] = 1e-3 * OWN_UNITS[n]
        slope = (seen(values, opening + step) - seen(values, opening - step)) / 2e-3
        scale = np.abs(slope).max()
        np.testing.assert_allclose(found.own[:, :, n], slope, atol=1e-4 * scale, err_msg=str(n))


def test_elimination_gives_what_the_whole_system_gives():
    """Against the dense normal equations of all unknowns together."""
    _, data, _ = some_rig(count=7)
    data = data._replace(sigma=np.array([1e-4, 1e-4, np.inf, 5e-7, np.inf, 5e-7]))
    choice = rigs.choice()
    values = values_of(NOMINAL)
    opening = np.zeros((7, OWN_COUNT))
    found = linear(NOMINAL, data, opening, values, choice)
    normal = eliminate_own_unknowns(found, np.ones((7, 9)), opening, data.sigma)
    size = len(choice.names)
    prior = 1 / choice.sigma**2
    step = np.linalg.solve(normal.matrix + np.diag(prior), normal.side)
    rows = np.zeros((7 * 9, size + 42))
    rows[:, :size] = found.common.reshape(-1, size)
    for n in range(7):
        rows[9 * n : 9 * n + 9, size + 6 * n : size + 6 * n + 6] = found.own[n][:, :6]
    known = np.where(np.isfinite(data.sigma), OWN_UNITS[:6] / data.sigma, 1e-9)
    extra = np.diag(np.concatenate([1 / choice.sigma, np.tile(known, 7)]))
    side = np.concatenate([found.residual.ravel(), np.zeros(size + 42)])
    whole, *_ = np.linalg.lstsq(np.concatenate([rows, extra]), side, rcond=None)
    np.testing.assert_allclose(step / choice.sigma, whole[:size] / choice.sigma, atol=1e-6)
    own = normal.back[:, :, -1] - normal.back[:, :, :-1] @ step
    poses = own[:, :6].ravel()
    np.testing.assert_allclose(poses, whole[size:], atol=1e-4 * np.abs(whole[size:]).max())
    assert np.abs(own[:, 6:]).max() < 1e-9


# ---- what comes of it


@pytest.fixture(scope="module")
def calibrated():
    """Four rigs of `experiments/rigs.py`, which has twenty."""
    return [rigs.try_rig(seed, 300, NOMINAL) for seed in range(4)]


@pytest.mark.slow
def test_poses_are_as_fine_as_by_a_rig_that_is_known(calibrated):
    for _, found, rows in calibrated:
        assert found.ended
        before, after, perfect = rows
        assert (after < 1.3 * perfect).all()
        assert (before[2:] > 10 * after[2:]).all()


def test_stated_uncertainties_of_the_parameters_are_honest(calibrated):
    """160 of them: 95 % inside is 152 +- 3, not all independent."""
    off = [(found.values - rig.values[found.choice.places]) / found.uncertainty
           for rig, found, _ in calibrated]  # fmt: skip
    inside = np.abs(np.concatenate(off)) < 1.96
    assert 0.9 < inside.mean() < 0.995


def test_stated_uncertainties_of_poses_have_the_calibration_in_them():
    """A rig calibrated by few samples: the errors left are larger than the noise alone says."""
    ratios, bare = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed + 50)
        rig = rigs.draw_rig(NOMINAL, rng)
        data, _ = rigs.sample_motion(rig, 12, rng)
        found = fit(NOMINAL, data, rigs.choice())
        fresh, state = rigs.sample_motion(rig, 300, rng)
        for sensor, kept in (
            (found.sensor, ratios),
            (replace(found.sensor, calibration=None), bare),
        ):
            solution = facets.solve(sensor, correct(sensor, fresh.raw), beam="known")
            kept.append((solution.state - state)[:, :6] / solution.uncertainty[:, :6])
    honest, short = (np.sqrt(np.nanmean(np.concatenate(kept) ** 2)) for kept in (ratios, bare))
    assert 0.75 < honest < 1.3
    assert short > 1.3 * honest


def test_the_budget_of_a_resolution_has_the_same_part():
    _, data, _ = some_rig(count=20)
    found = fit(NOMINAL, data, rigs.choice())
    state = np.zeros((1, 8))
    with_it = uncertainties(found.sensor, state, Knowledge("known"))[0]
    without = uncertainties(replace(found.sensor, calibration=None), state, Knowledge("known"))[0]
    reading = facets.readings(found.sensor, state)
    solved = facets.solve(found.sensor, reading, beam="known").uncertainty[0, :6]
    np.testing.assert_allclose(with_it, solved, rtol=1e-6)
    assert (with_it > without).all()


def test_outliers_count_less():
    rig, data, _ = some_rig(seed=8, count=300)
    rng = np.random.default_rng(2)
    hit = rng.random(300) < 0.05
    data.raw[hit, 0] += 0.3
    robust, plain = (fit(NOMINAL, data, rigs.choice(), limit) for limit in (3.0, None))
    fresh, state = rigs.sample_motion(rig, 1000, rng)
    perfect, good, bad = (
        rigs.rms(rigs.errors(sensor, fresh, state))
        for sensor in (rig.sensor, robust.sensor, plain.sensor)
    )
    assert (good < 1.3 * perfect).all()
    assert (bad > 1.5 * perfect).any()
    assert robust.weights[hit, 0].max() < 0.5


def test_a_missing_detector_is_no_obstacle():
    rig, data, _ = some_rig(count=200)
    data.raw[::4, 3:6] = np.nan
    found = fit(NOMINAL, data, rigs.choice())
    fresh, state = rigs.sample_motion(rig, 500, np.random.default_rng(4))
    ratio = rigs.rms(rigs.errors(found.sensor, fresh, state)) / rigs.rms(
        rigs.errors(rig.sensor, fresh, state)
    )
    assert (ratio < 1.3).all()


def test_dark_offsets_and_the_laser_s_power_are_found():
    """Detectors that read 0.3 uW too much or too little, and a laser 2 % weaker than thought."""
    rng = np.random.default_rng(9)
    values = values_of(NOMINAL)
    known = {"beam.power": 0.01, **{f"correction_{k}.dark": 5e-4 for k in "abc"}}
    values[ALL.index("beam.power")] *= 0.98
    for k, dark in zip("abc", (3e-4, -3e-4, 1e-4), strict=True):
        values[ALL.index(f"correction_{k}.dark")] = dark
    rig = rigs.Rig(study.assign_values(NOMINAL, values), values)
    data, _ = rigs.sample_motion(rig, 400, rng)
    found = fit(NOMINAL, data, Choice(tuple(known), np.array(list(known.values()))))
    off = (found.values - values[found.choice.places]) / found.uncertainty
    assert np.abs(off).max() < 4
    assert (found.uncertainty < 0.1 * found.choice.sigma).all()


def test_bent_detectors_are_straightened():
    """Second and third order of 30 um at the edge, found from the same data."""
    rng = np.random.default_rng(6)
    bend = {f"correction_{k}.{a}{p}": 0.03 for k in "abc" for a in "yz"
            for p in ("20", "11", "02", "30", "21", "12", "03")}  # fmt: skip
    values = values_of(NOMINAL)
    for name in bend:
        values[ALL.index(name)] = rng.uniform(-0.03, 0.03)
    rig = rigs.Rig(study.assign_values(NOMINAL, values), values)
    data, _ = rigs.sample_motion(rig, 600, rng)
    names = {**rigs.hidden(), **bend}
    found = fit(NOMINAL, data, Choice(tuple(names), np.array(list(names.values()))))
    fresh, state = rigs.sample_motion(rig, 1000, rng)
    before, after, perfect = (
        rigs.rms(rigs.errors(sensor, fresh, state))
        for sensor in (NOMINAL, found.sensor, rig.sensor)
    )
    assert (after < 1.3 * perfect).all()
    assert (before[3:] > 1.5 * after[3:]).all()


# ---- what a motion tells


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        ((3, 4, 5), "turning all facets about z, as yaw does"),
        ((3, 4, 5), "tilting all facets about x, as roll does"),
        ((2,), "raising all PSDs"),
    ],
)
def test_what_cannot_be_told_is_named(lost, words):
    _, data, _ = some_rig(count=150)
    sigma = rigs.REFERENCE.copy()
    sigma[list(lost)] = np.inf
    choice = rigs.choice()
    found = weak_directions(
        information(NOMINAL, data._replace(sigma=sigma), choice), choice, NOMINAL
    )
    untold = {direction.words for direction in found if direction.information < 1e-3}
    assert words in untold
    whole = weak_directions(information(NOMINAL, data, choice), choice, NOMINAL)
    assert words not in {direction.words for direction in whole if direction.information < 1e-3}


def test_proposed_poses_tell_more_than_random_ones():
    rng = np.random.default_rng(5)
    poses = rng.uniform(-1, 1, (400, 6)) * rigs.BOX
    choice = rigs.choice()
    chosen, left = choose_poses(NOMINAL, choice, rigs.REFERENCE, poses, 10)
    assert (np.diff(left) < 0).all()
    for part in (poses[10 * n : 10 * n + 10] for n in range(5)):
        rows = pose_information(NOMINAL, choice, rigs.REFERENCE, part).reshape(
            -1, len(choice.names)
        )
        assert mean_reduction(np.eye(rows.shape[1]) + rows.T @ rows) > 1.05 * left[-1]
    rows = pose_information(NOMINAL, choice, rigs.REFERENCE, poses[chosen]).reshape(
        -1, len(choice.names)
    )
    assert left[-1] == pytest.approx(
        mean_reduction(np.eye(rows.shape[1]) + rows.T @ rows), rel=1e-6
    )


def test_too_little_is_an_error():
    _, data, _ = some_rig(count=1)
    with pytest.raises(InputError, match="two samples"):
        fit(NOMINAL, data, rigs.choice())


# ---- the command


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    made = command(
        "simulate",
        "rig",
        "--motion",
        "calibration",
        "--with-reference",
        "--folder",
        "rig",
        cwd=folder,
    )
    assert made.returncode == 0, made.stderr
    result = command("calibrate", "paper", "rig/readings.csv", "-o", "mine.yaml", cwd=folder)
    assert result.returncode == 0, result.stderr
    return folder, result.stdout


@pytest.mark.slow
def test_the_command_finds_the_rig(run):
    folder, told = run
    assert "The motion determines these combinations of parameters less well" in told
    assert "Effects of real light, and whether the data need them" in told
    mine, rig = facets.load(folder / "mine.yaml").sensor, facets.load("rig").sensor
    assert mine.beam.tilt_x == pytest.approx(rig.beam.tilt_x, abs=3e-5)
    mean = sum(psd.correction.power for psd in rig.psds) / 3  # the common gain is a convention
    for found, true in zip(mine.psds, rig.psds, strict=True):
        assert found.radius == pytest.approx(true.radius, abs=0.12)
        assert found.correction.power == pytest.approx(true.correction.power - mean, abs=8e-4)
    assert mine.calibration is not None
    assert set(mine.calibration.names) <= set(KNOWN)
    assert (folder / "mine.png").stat().st_size > 10_000


@pytest.mark.slow
def test_every_command_takes_the_calibrated_rig(run):
    """Raw readings of another motion: as fine as by the rig itself, with honest uncertainties."""
    folder, _ = run
    command("simulate", "rig", "--motion", "trial", "--folder", "trial", cwd=folder)
    arguments = ("mine.yaml", "trial/readings.csv", "-o", "trial.csv", "--beam", "known")
    solved = command("solve", *arguments, cwd=folder)
    assert solved.returncode == 0, solved.stderr
    import pandas as pd

    found = pd.read_csv(folder / "trial.csv", comment="#")
    truth = pd.read_csv(folder / "trial" / "poses.csv", comment="#")
    for name in ("tz_mm", "roll_mrad", "yaw_mrad"):
        off = (found[name] - truth[f"true_{name}"]) / found[f"u_{name}"]
        assert 0.8 < np.sqrt((off**2).mean()) < 1.3
        parts = found[f"u_noise_{name}"] ** 2 + found[f"u_calibration_{name}"] ** 2
        np.testing.assert_allclose(parts, found[f"u_{name}"] ** 2, rtol=0.01)
    again = command("simulate", "mine.yaml", "--motion", "x-steps", "--folder", "again", cwd=folder)
    assert again.returncode == 0, again.stderr
    fine = command("resolution", "mine.yaml", "--folder", "fine", cwd=folder)
    assert fine.returncode == 0, fine.stderr


@pytest.mark.slow
def test_a_recording_keeps_what_was_measured_of_the_rig(run, tmp_path):
    folder, _ = run
    text = "extends: mine.yaml\n"
    (folder / "again.yaml").write_text(text)
    config = facets.load(folder / "again.yaml")
    kept = Recording(tmp_path / "r", run_record(config, None, 0.0, {}), config.resolved)
    kept.close()
    hidden = folder / "mine-covariance.csv"
    moved_away = hidden.rename(folder / "away.csv")
    try:
        assert recorded_config(tmp_path / "r").sensor == config.sensor
    finally:
        moved_away.rename(hidden)


@pytest.mark.slow
def test_the_command_proposes_poses(run):
    folder, _ = run
    result = command("calibrate", "paper", "--propose", "5", "-o", "poses.csv", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "approaches each axis's poses from below in" in " ".join(result.stdout.split())
    assert (folder / "poses.csv").read_text().count("\n") == 11
    _, visit = states(Table(folder / "poses.csv", 2, 10.0), np.random.default_rng(1))
    assert len(visit) == 10  # a motion as it stands


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("paper",), "DATA is missing"),
        (("paper", "--propose", "0"), "Invalid value for '--propose'"),
        (("paper", "nowhere.csv"), "no such file"),
        (("paper", "trial.csv", "-o", "new.yaml"), "missing columns: psi_a_mm"),
        (("paper", "trial.csv", "-o", "new.yaml"), "give their own table with --reference"),
        (("paper", "rig/readings.csv", "-o", "mine.yaml"), "--force"),
        (("paper", "rig/readings.csv", "-o", "mine.txt"), "ends in .yaml"),
    ],
)
@pytest.mark.slow
def test_what_is_wrong_is_told(run, arguments, words):
    folder, _ = run
    (folder / "trial.csv").write_text("a\n1\n")
    result = command("calibrate", *arguments, cwd=folder)
    assert result.returncode == 2
    assert words in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.slow
def test_a_swapped_sign_is_told_and_nothing_is_written(run):
    """It used to be absorbed as a scale of -2, in a file that could not be loaded."""
    folder, _ = run
    lines = (folder / "rig" / "readings.csv").read_text().splitlines()
    head = next(n for n, line in enumerate(lines) if not line.startswith("#"))
    place = lines[head].split(",").index("psi_b_mm")
    for n in range(head + 1, len(lines)):
        cells = lines[n].split(",")
        cells[place] = str(-float(cells[place]))
        lines[n] = ",".join(cells)
    (folder / "swapped.csv").write_text("\n".join(lines) + "\n")
    result = command("calibrate", "paper", "swapped.csv", "-o", "swapped.yaml", cwd=folder)
    assert result.returncode == 1, result.stderr
    assert "sign of psi of detector B is swapped" in " ".join(result.stdout.split())
    assert "nothing was written" in result.stderr
    assert not list(folder.glob("swapped*.yaml"))
    assert not list(folder.glob("swapped-*.csv"))


@pytest.mark.parametrize("text", ["bend", "bend=perhaps", "nothing=on"])
@pytest.mark.slow
def test_an_effect_that_is_none_is_refused(run, text):
    folder, _ = run
    arguments = ("paper", "rig/readings.csv", "-o", "e.yaml", "--effect", text)
    result = command("calibrate", *arguments, cwd=folder)
    assert result.returncode == 2
    assert "the names are curvature" in result.stderr


@pytest.mark.slow
def test_a_covariance_that_was_changed_is_refused(run):
    folder, _ = run
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


# ---- the mirror put on anew


def test_seatings_by_thirds_part_mirror_from_detectors():
    """Each facet before each detector: what all facets share with all detectors is told apart."""
    rng = np.random.default_rng(4)
    rig = rigs.draw_rig(NOMINAL, rng)
    values = rig.values.copy()
    for seat in (2, 3):
        values[PLACE[f"seat_{seat}.apex.z"]] = 0.05 * seat
        values[PLACE[f"seat_{seat}.mount.yaw"]] = 2e-3 * seat
    pose = rng.uniform(-1, 1, (240, 6)) * rigs.BOX * [1, 1, 1, 0.8, 0.8, 0.8]
    seat = np.repeat(np.arange(3), 80)
    data = Data(np.zeros((240, 9)), pose, rigs.REFERENCE, np.zeros((240, 2)), seat=seat,
                thirds=seat)  # fmt: skip
    data = rigs.read(rig._replace(values=values), data, rng)
    asked = facets.load("paper").calibrate
    wide = table.add_seats(table.choice(NOMINAL, asked), data, asked)
    two = table.add_seats(table.choice(NOMINAL, asked), data.part(seat < 2), asked)
    for chosen, further in ((wide, {"seat_2", "seat_3"}), (two, {"seat_2"})):
        assert {name.split(".")[0] for name in chosen.names if "seat_" in name} == further
    found = fit(NOMINAL, data, wide)
    once = fit(NOMINAL, data.part(seat == 0), table.choice(NOMINAL, asked))
    assert found.ended
    assert abs(found.reduced_chi_square - 1) < 5 * np.sqrt(2 / found.freedom)
    place = found.choice.names.index("psd_a.azimuth")
    other = once.choice.names.index("psd_a.azimuth")
    assert found.uncertainty[place] < 0.8 * once.uncertainty[other]
