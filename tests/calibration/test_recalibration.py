"""A calibration of some parameters that keeps what an older one knows of all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies import rigs
from rig_samples import CONFIG, NOMINAL, sample_motion

import facets
from facets.calibration import (
    GAINS,
    choice,
    choose_groups,
    eliminate_own_unknowns,
    fit,
    linearise_model,
    own_sigma,
    prior_information,
    values_of,
)
from facets.core import InputError

#: What may be off, without the mirror's seat, which a later calibration has anew.
ASKED = replace(
    CONFIG.calibrate,
    power_per_sample=False,
    before={"psd_place_mm": 0.2, "facet_mrad": 1.5, "beam_tilt_mrad": 1.5, "power_percent": 2.0},
)
ALL = choice(NOMINAL, ASKED)


@pytest.fixture(scope="module")
def rig():
    """A rig that ALL describes."""
    values = values_of(NOMINAL)
    values[ALL.places] += 0.3 * ALL.sigma * np.random.default_rng(3).standard_normal(len(ALL.names))
    return rigs.Rig(rigs.assign_values(NOMINAL, values), values)


def calibrated(covariance, names=ALL.names):
    known = facets.Calibration(names, tuple(map(tuple, covariance.tolist())))
    return replace(NOMINAL, calibration=known)


def test_two_linear_calibrations_are_one_of_both_data(rig):
    def normal_equations(count):
        data, _ = sample_motion(rig, count, np.random.default_rng(count))
        zero = np.zeros((count, 9))
        slopes = linearise_model(NOMINAL, data, zero, values_of(NOMINAL), ALL)
        return eliminate_own_unknowns(slopes, np.ones((count, 9)), zero, own_sigma(data, ALL))

    first, second = normal_equations(80), normal_equations(40)
    prior = prior_information(ALL)
    covariance = np.linalg.inv(prior + first.matrix)
    changed = choose_groups(calibrated(covariance), ASKED, ["gains"])
    assert changed.names == ALL.names
    known = prior_information(changed)
    later = np.linalg.inv(known + second.matrix)
    updated = later @ (known @ covariance @ first.side + second.side)

    # at once: all parameters as they were, and by how much the gains changed
    places = [ALL.names.index(name) for name in GAINS]
    size = len(ALL.names)
    now = np.hstack([np.eye(size), np.eye(size)[:, places]])
    matrix = now.T @ second.matrix @ now
    matrix[:size, :size] += prior + first.matrix
    matrix[range(size, size + 3), range(size, size + 3)] += 1 / ALL.sigma[places] ** 2
    side = now.T @ second.side
    side[:size] += first.side
    whole = now @ np.linalg.inv(matrix)
    scale = np.sqrt(np.diag(later))
    assert updated / scale == pytest.approx(whole @ side / scale, abs=1e-4)  # rounding
    units = np.outer(scale, scale)
    assert later / units == pytest.approx(whole @ now.T / units, abs=1e-7)


def test_a_changed_gain_is_found_and_the_rest_stays_known(rig):
    before = fit.fit(NOMINAL, sample_motion(rig, 80, np.random.default_rng(3))[0], ALL)
    psds = list(rig.sensor.psds)
    correction = psds[1].correction
    psds[1] = replace(psds[1], correction=replace(correction, power=correction.power + 0.01))
    changed = rigs.Rig(replace(rig.sensor, psds=tuple(psds)), rig.values)
    few, _ = sample_motion(changed, 12, np.random.default_rng(4))
    after = fit.fit(before.sensor, few, choose_groups(before.sensor, ASKED, ["gains", "beam"]))
    place = ALL.names.index("correction_b.power")
    growth = after.values[place] - before.values[place]
    assert abs(growth - 0.01) < 4 * np.hypot(after.uncertainty[place], before.uncertainty[place])
    heights = [n for n, name in enumerate(ALL.names) if name.endswith("height")]
    assert (after.uncertainty[heights] <= before.uncertainty[heights]).all()
    off = (after.values - rig.values[ALL.places])[heights] / after.uncertainty[heights]
    assert np.abs(off).max() < 4
    known = after.sensor.calibration
    assert set(known.names) == set(ALL.names)
    assert known.degrees_of_freedom == after.freedom < before.freedom


def test_what_cannot_be_recalibrated_is_said():
    known = calibrated(np.diag(ALL.sigma**2))
    thermal = replace(known, thermal=replace(known.thermal, beam=(1e-3, 0.0)))
    for sensor, before, reason in (
        (NOMINAL, ASKED.before, "calibrated configuration"),
        (known, {"facet_mrad": 1.0}, "--only gains: every key"),
        (thermal, ASKED.before, "sensor.temperature"),
    ):
        with pytest.raises(InputError, match=reason):
            choose_groups(sensor, replace(ASKED, before=before), ["gains"])


def test_a_power_of_each_sample_takes_the_place_of_the_old_one():
    names = (*ALL.names, "beam.power", "misfit_a.psi")
    known = calibrated(np.diag([*ALL.sigma**2, 1e-6, 1e-8]), names)
    chosen = choose_groups(known, replace(ASKED, power_per_sample=True), ["beam"])
    assert chosen.names == ALL.names
    assert np.isinf(chosen.power)
    tilt = chosen.sigma[chosen.names.index("beam.tilt_x")]
    assert tilt == pytest.approx(np.sqrt(2) * 1.5e-3)
