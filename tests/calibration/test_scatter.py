"""What scatters from sample to sample, whose it is, and what follows the motion instead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import disturbed_rigs, rigs

import facets
from facets import add_noise
from facets.calibration import (
    PLACE,
    Data,
    Task,
    add_power_polynomials,
    choice,
    explain_scatter,
    first_state,
    fold_mount,
    scatter,
    states_of,
)
from facets.calibration.fit import fit
from facets.calibration.laser import fit_steady_laser
from facets.calibration.misfit import add_unseen_errors
from facets.calibration.outliers import exclude_outliers
from facets.calibration.scatter import fit_with_scatter
from facets.calibration.unmodelled import Remainder, shape_of_powers
from facets.calibration.verdict import verdict
from facets.detectors import correct, invert_correction, standard_deviations

CONFIG = facets.load("paper")
NOMINAL = CONFIG.sensor
SETTINGS = CONFIG.calibrate
PLAIN = replace(SETTINGS, effects=dict.fromkeys(SETTINGS.effects, "off"))
COUNT = 120


def samples(mirror=0.0, beam=0.0, noise=1.0, profile=0.0, seed=3):
    """Of a rig with ideal light: a mirror that vibrates, a beam that trembles (mm), noise larger
    than stated, a power of A that follows the fourth power of x."""
    rng = np.random.default_rng(seed)
    rig = rigs.draw_rig(NOMINAL, rng)
    pose = rng.uniform(-1, 1, (COUNT, 6)) * [0.25, 0.25, *rigs.BOX[2:]]
    there = pose.copy()
    there[:, :3] += mirror * rng.standard_normal((COUNT, 3))
    data = Data(np.zeros((COUNT, 9)), there, rigs.REFERENCE, beam * rng.standard_normal((COUNT, 2)))
    exact = facets.readings(rig.sensor, states_of(data, np.zeros((COUNT, 9)), rig.values))
    exact[:, 2] *= 1 + profile * (pose[:, 0] / 0.25) ** 4
    raw = invert_correction(rig.sensor, exact + noise * (add_noise(rig.sensor, exact, rng) - exact))
    said = pose + rigs.REFERENCE * rng.standard_normal(pose.shape)
    return add_power_polynomials(data._replace(raw=raw, pose=said, beam=np.zeros((COUNT, 2))))


def plain_fit(data):
    free = fit(NOMINAL, data, choice(NOMINAL, PLAIN))
    return fit_steady_laser(NOMINAL, data, free, 3.0)


def test_the_likelihood_is_that_of_all_readings_together():
    """Against the dense covariance of every reading, the common unknowns with their prior in it."""
    data = samples().part(slice(0, 6))
    found = fit(NOMINAL, data, rigs.choice())
    task = Task(NOMINAL, data, found.choice, None)
    like = scatter.Likelihood(task, found)
    known = scatter.prior_variances(task.data, found.choice)
    rng = np.random.default_rng(1)

    def dense(sizes):
        rows = like.common.reshape(54, -1)
        cover = rows @ np.linalg.solve(task.prior, rows.T)
        for n in range(6):
            part = slice(9 * n, 9 * n + 9)
            cover[part, part] += like.variance(known, sizes)[n]
        start = (found.every - task.start)[found.choice.places]
        left = like.left.ravel() + rows @ start  # from where the unknowns were thought to be
        return np.linalg.slogdet(cover)[1] + left @ np.linalg.solve(cover, left)

    first, second = rng.uniform(0, 2, (2, len(scatter.NAMES)))
    change = like.restrict(known, first).unlikely - like.restrict(known, second).unlikely
    assert change == pytest.approx(dense(first) - dense(second), abs=1e-5)


@pytest.mark.parametrize(
    ("wrong", "cause", "name", "size"),
    [
        ({"mirror": 1e-3}, "reference", "tx", 1e-3),
        ({"beam": 5e-4}, "beam", "beam", 5e-4),
        ({"noise": 2.0}, "detectors", scatter.POWERS, 3**0.5),
    ],
    ids=["vibration", "beam", "noise"],
)
@pytest.mark.slow
def test_what_scatters_is_found_with_its_size(wrong, cause, name, size):
    data = samples(**wrong)
    plain = plain_fit(data)
    done = explain_scatter(first_state(NOMINAL, data, SETTINGS, plain, []))
    assert done.scatter.causes == (cause,)
    assert done.scatter.size_of(name) == pytest.approx(size, rel=0.3)
    assert abs(done.found.reduced_chi_square - 1) < 0.2
    row = done.rows["beam_moves"]
    assert row.accepted == (cause == "beam")
    assert row.unknowns == (2 * COUNT if row.accepted else 0)  # in x and y, each sample its own
    assert row.fall == (plain.loss - done.found.loss if row.accepted else 0)


def test_nothing_is_explained_where_nothing_scatters():
    data = samples()
    plain = plain_fit(data)
    same, found, one = fit_with_scatter(NOMINAL, data, plain, 3.0, beam=True)
    assert one == scatter.NOTHING or not one.causes
    assert same is data
    assert found is plain


@pytest.mark.slow
def test_a_power_that_follows_the_place_is_no_scatter():
    for wrong, there in (({"mirror": 3e-4}, False), ({"profile": 0.01}, True)):
        data = samples(**wrong)
        data, found, _ = fit_with_scatter(NOMINAL, data, plain_fit(data), 3.0, beam=True)
        shape = shape_of_powers(Remainder(NOMINAL, data, found, 3.0))
        assert (shape.log_chance < np.log(1e-6)) == there


# ---- light that is not Gaussian, which no residual shows


def test_a_beam_that_may_not_be_gaussian_makes_x_and_y_less_certain():
    """All poses together, by as much as the light's middle may be off; nothing else."""
    data = samples().part(slice(0, 20))
    found = plain_fit(samples())
    centre = 2e-4
    wider = add_unseen_errors(found.sensor, found, {}, centre, {})
    before, after = (
        facets.solve(sensor, data.raw, beam="known", power="unknown").uncertainty ** 2
        for sensor in (found.sensor, wider)
    )
    assert np.sqrt((after - before)[:, :2]) == pytest.approx(centre, rel=1e-2)
    assert np.sqrt(after[:, 2:6] / before[:, 2:6]).max() < 1.01


# ---- samples that no noise makes


@pytest.mark.parametrize("kind", ["rows", "single", "bursts", "detector"])
def test_samples_that_jump_are_taken_out_and_decide_nothing(kind):
    """The same fit, and the same steadiness of the laser, as without them."""
    data = samples()
    sigma = facets.standard_deviations(NOMINAL, data.raw)
    raw = disturbed_rigs.jumps(0.03, 300, kind)(data.raw, sigma, np.random.default_rng(2))
    hit = np.flatnonzero((raw != data.raw).any(axis=1))
    jumped = data._replace(raw=raw)
    kept, found, gone = exclude_outliers(
        NOMINAL, jumped, fit(NOMINAL, jumped, choice(NOMINAL, PLAIN)), 3.0
    )
    assert gone == (hit + 1).tolist()
    assert len(kept.raw) == COUNT - len(hit)
    clean = data.part(np.delete(np.arange(COUNT), hit))
    expected = fit(NOMINAL, clean, choice(NOMINAL, PLAIN))
    off = (found.values - expected.values) / expected.uncertainty
    assert np.abs(off).max() < 0.1
    steady, other = (
        fit_steady_laser(NOMINAL, kept, found, 3.0),
        fit_steady_laser(NOMINAL, clean, expected, 3.0),
    )
    assert steady.choice.power == other.choice.power


def test_many_outliers_are_none():
    data = samples()
    raw = data.raw.copy()
    raw[::5, 0] += 1.0
    jumped = data._replace(raw=raw)
    found = fit(NOMINAL, jumped, choice(NOMINAL, PLAIN))
    assert exclude_outliers(NOMINAL, jumped, found, 3.0)[2] == []


# ---- what follows the motion


@pytest.mark.slow
def test_backlash_is_found_and_told():
    rng = np.random.default_rng(4)
    data = samples(seed=4)
    rig = rigs.draw_rig(NOMINAL, np.random.default_rng(4))
    play = np.array([1e-3, 0, 0, 0, 0, 0])
    there = disturbed_rigs.backlash(play)(data.pose, rng)
    data = rigs.read(rig, data._replace(pose=there), rng)._replace(pose=data.pose)
    asked = replace(PLAIN, effects=PLAIN.effects | {"backlash": "auto"})
    found = verdict(NOMINAL, data, choice(NOMINAL, asked), asked)
    said = " ".join(one.words for one in found.findings)
    assert found.is_trusted
    assert found.found.every[PLACE["backlash.tx"]] == pytest.approx(1e-3, abs=1e-4)
    assert "The reference has backlash (tx 2 um from side to side)" in said


def test_a_lag_by_a_share_of_the_last_step_is_no_backlash_and_no_scale():
    """In poses of a random order half of a lag looks like a scale of the reference."""
    rng = np.random.default_rng(4)
    data = samples(seed=4)
    rig = rigs.draw_rig(NOMINAL, np.random.default_rng(4))
    there = data.pose - 0.004 * np.diff(data.pose, axis=0, prepend=data.pose[:1])
    data = rigs.read(rig, data._replace(pose=there), rng)._replace(pose=data.pose)
    asked = replace(PLAIN, effects=PLAIN.effects | {"backlash": "auto", "lag": "auto"})
    found = verdict(NOMINAL, data, choice(NOMINAL, asked), asked)
    assert found.is_trusted
    assert {row.key for row in found.search.rows if row.accepted} == {"lag"}
    assert found.found.every[PLACE["lag.tx"]] == pytest.approx(0.004, abs=4e-4)
    assert "The mirror lags" in " ".join(one.words for one in found.findings)
    pose = rng.uniform(-1, 1, (200, 6)) * rigs.BOX
    fresh = rigs.read(rig, Data(np.zeros((200, 9)), pose, rigs.REFERENCE, np.zeros((200, 2))), rng)
    truth = states_of(fresh, np.zeros((200, 9)), fold_mount(rig.values))
    off = rigs.errors(found.sensor, fresh, truth)
    scale = [np.polyfit(truth[:, n], off[:, n], 1)[0] for n in (0, 1, 3, 4, 5)]
    assert np.abs(scale).max() < 5e-4  # 2e-3 without the lag


def share_noise(sensor, exact, rng):
    """Readings whose places along zeta have 60 % of their noise's variance in common."""
    sigma = standard_deviations(sensor, exact)
    noise, common = rng.standard_normal(exact.shape), rng.standard_normal((len(exact), 1))
    noise[:, 1::3] = np.sqrt(0.4) * noise[:, 1::3] + np.sqrt(0.6) * common
    return invert_correction(sensor, exact + sigma * noise)


def test_noise_that_detectors_share_is_part_of_the_uncertainty():
    rng = np.random.default_rng(3)
    rig = rigs.draw_rig(NOMINAL, rng)
    pose, nothing = rng.uniform(-1, 1, (400, 6)) * rigs.BOX, np.zeros((400, 9))
    data = Data(nothing, pose, rigs.REFERENCE, np.zeros((400, 2)))
    exact = facets.readings(rig.sensor, states_of(data, nothing, rig.values))
    data = data._replace(raw=share_noise(rig.sensor, exact, rng))
    found = verdict(NOMINAL, data.part(slice(0, 200)), choice(NOMINAL, PLAIN), PLAIN)
    assert "detectors' zeta scatter together" in " ".join(one.words for one in found.findings)
    solved = facets.solve(found.sensor, correct(found.sensor, data.raw), beam="known")
    truth = states_of(data, nothing, fold_mount(rig.values))
    off = ((solved.state - truth)[:, 2] / solved.uncertainty[:, 2])[200:]
    assert 0.75 < np.sqrt(np.nanmean(off**2)) < 1.15  # 1.34 without
