"""What scatters from sample to sample, what jumps, and what follows the motion instead."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies import rigs
from facets.experiments.studies.faults import jumps
from rig_samples import (
    NOMINAL,
    accepted_effects,
    error_slope,
    judge,
    sample_in_time,
    sample_rig,
    settings,
    words_of,
)

import facets
from facets.calibration import PLACE
from facets.detectors import add_noise, correct, standard_deviations

COUNT = 120


def shake_mirror(pose, rng):
    return 2e-4 * rng.standard_normal(pose.shape) * [1, 1, 1, 0, 0, 0]


def shake_beam(count, rng):
    return 5e-4 * rng.standard_normal((count, 2))


@pytest.mark.parametrize(
    ("count", "wrong", "cause", "name", "size"),
    [
        (COUNT, {"mirror": shake_mirror}, "reference_scatter", "tx", 2e-4),
        (COUNT, {"noise": 1.3}, "detector_scatter", "powers", (1.3**2 - 1) ** 0.5),
        pytest.param(2 * COUNT, {"beam": shake_beam}, "beam_scatter", "beam",
                     5e-4, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_what_scatters_is_found_with_its_size(count, wrong, cause, name, size):
    judged = judge(sample_rig(count, 3, **wrong)[1], settings(beam_moves="auto"))
    assert judged.is_trusted
    assert "The samples scatter by more than the stated noise" in words_of(judged)
    scatter = judged.search.scatter
    assert scatter.causes == (cause,)
    assert scatter.size_of(name) == pytest.approx(size, rel=0.3)
    assert abs(judged.fit.reduced_chi_square - 1) < 0.2
    (row,) = judged.search.rows
    assert row.accepted == (cause == "beam_scatter")


def test_times_that_jitter_are_told_from_a_mirror_that_vibrates():
    late = 2e-5 * np.random.default_rng(8).standard_normal(2 * COUNT)
    judged = judge(sample_in_time(late=late, count=2 * COUNT))
    assert judged.search.scatter.causes == ("clock_scatter",)
    jitter = re.search(r"times of the reference jitter by (\S+) ms", words_of(judged))
    assert float(jitter[1]) == pytest.approx(0.02, rel=0.2)


def test_a_reference_that_scatters_by_its_last_digit_forbids_the_use():
    data = sample_rig(COUNT, 3)[1]
    coarse = data.pose.copy()
    coarse[:, 1] = np.round(coarse[:, 1] / 4e-3) * 4e-3
    judged = judge(data._replace(pose=coarse))
    assert not judged.is_trusted
    assert "rounding of its values (ty in steps of 4 um)" in words_of(judged)


# ---- samples that no noise makes


def test_samples_that_jump_are_excluded_and_decide_nothing():
    """The same fit, and the same steadiness of the laser, as without them."""
    data = sample_rig(COUNT, 3)[1]
    sigma = standard_deviations(NOMINAL, data.raw)
    raw = jumps(0.03, 300, "bursts")(data.raw, sigma, np.random.default_rng(2))
    hit = (raw != data.raw).any(axis=1)
    asked = replace(settings(), held_back=0.0)
    judged, clean = judge(data._replace(raw=raw), asked), judge(data.part(~hit), asked)
    rows = ", ".join(str(row + 1) for row in np.flatnonzero(hit))
    assert judged.is_trusted
    assert f"that noise does not explain and were excluded (rows {rows})" in words_of(judged)
    assert len(judged.fitted.raw) == len(clean.fitted.raw)
    off = (judged.fit.values - clean.fit.values) / clean.fit.uncertainty
    assert np.abs(off).max() < 0.1
    assert judged.fit.choice.power == clean.fit.choice.power


@pytest.mark.parametrize(
    ("field", "column", "words"),
    [("pose", 1, "the reference's ty errs"), ("raw", 4, "zeta_b_mm errs")],
)
def test_what_errs_in_most_of_the_excluded_samples_is_said(field, column, words):
    data = sample_rig(COUNT, 3)[1]
    values = getattr(data, field).copy()
    values[5:50:9, column] += [0.08, -0.1, 0.12, 0.06, -0.07]
    judged = judge(data._replace(**{field: values}), replace(settings(), held_back=0.0))
    assert f"5 of {COUNT} samples contain an outlier" in words_of(judged)
    assert f"In most of them {words}" in words_of(judged)


def test_many_outliers_are_none():
    data = sample_rig(COUNT, 3)[1]
    data.raw[::5, 0] += 1.0
    judged = judge(data)
    assert not judged.is_trusted
    assert not judged.search.outliers
    assert "of them in psi of detector A: its noise is larger than the configuration says" in (
        words_of(judged)
    )


# ---- what follows the motion


def test_backlash_is_found_and_told():
    def play(pose, rng):
        return -np.sign(np.diff(pose, axis=0, prepend=pose[:1] - 1)) * [1e-3, 0, 0, 0, 0, 0]

    data = sample_rig(COUNT, 4, mirror=play)[1]
    judged = judge(data, settings(backlash="auto"))
    assert judged.is_trusted
    assert judged.fit.all_values[PLACE["backlash.tx"]] == pytest.approx(1e-3, abs=1e-4)
    assert "The reference has backlash (tx 2 um from side to side)" in words_of(judged)


def test_a_lag_by_a_share_of_the_last_step_is_no_backlash_and_no_scale():
    """In poses of a random order half of a lag looks like a scale of the reference."""

    def lag(pose, rng):
        return -0.004 * np.diff(pose, axis=0, prepend=pose[:1])

    rig, data, _ = sample_rig(COUNT, 4, mirror=lag)
    judged = judge(data, settings(backlash="auto", lag="auto"))
    assert judged.is_trusted
    assert accepted_effects(judged) == {"lag"}
    assert judged.fit.all_values[PLACE["lag.tx"]] == pytest.approx(0.004, abs=4e-4)
    assert "The mirror lags" in words_of(judged)
    for axis in (0, 1, 3, 4, 5):
        assert abs(error_slope(rig, judged, axis, axis)) < 5e-4  # 2e-3 without the lag


def share_noise(sensor, state, exact):
    """Along zeta the detectors have 60 % of their noise's variance in common."""
    noise, rng = np.random.default_rng(4).standard_normal(exact.shape), np.random.default_rng(5)
    noise[:, 1::3] *= np.sqrt(0.4)
    noise[:, 1::3] += np.sqrt(0.6) * rng.standard_normal((len(exact), 1))
    return exact + standard_deviations(sensor, exact) * noise


def add_shared_noise(sensor, state, exact):
    """A supply adds 4 um to all zetas, however much light there is."""
    exact[:, 1::3] += 0.004 * np.random.default_rng(5).standard_normal((len(exact), 1)) * [1, -1, 1]
    return add_noise(sensor, exact, np.random.default_rng(4))


@pytest.mark.parametrize("alter", [share_noise, add_shared_noise])
def test_noise_that_detectors_share_is_part_of_the_uncertainty(alter):
    _, data, state = sample_rig(400, 3, box=rigs.BOX, alter=alter, noise=0.0)
    judged = judge(data.part(slice(0, 200)))
    assert "together, as by a supply or a reference voltage that they share" in words_of(judged)
    assert "reference errs" not in words_of(judged)
    fresh = data.part(slice(200, 400))
    solved = facets.solve(judged.sensor, correct(judged.sensor, fresh.raw), beam="known")
    off = (solved.state - state[200:])[:, 2] / solved.uncertainty[:, 2]
    assert 0.75 < rigs.rms(off) < 1.15  # 1.34 without
