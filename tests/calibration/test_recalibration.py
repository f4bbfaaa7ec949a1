"""A calibration of some parameters that keeps what an older one knows of all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import rigs
from rig_samples import CONFIG, NOMINAL

import facets
from facets.calibration import (
    GAINS,
    Data,
    choice,
    choose_groups,
    eliminate_own_unknowns,
    fit,
    linear,
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


def draw_rig(seed: int) -> tuple[rigs.Rig, Data, Data]:
    """A rig that ALL describes, and two motions."""
    rng = np.random.default_rng(seed)
    values = values_of(NOMINAL)
    values[ALL.places] += 0.3 * ALL.sigma * rng.standard_normal(len(ALL.names))
    rig = rigs.Rig(rigs.assign_values(NOMINAL, values), values)
    return rig, rigs.sample_motion(rig, 80, rng)[0], rigs.sample_motion(rig, 40, rng)[0]


def normal_equations(data):
    zero = np.zeros((len(data.raw), 9))
    slopes = linear(NOMINAL, data, zero, values_of(NOMINAL), ALL)
    return eliminate_own_unknowns(slopes, np.ones((len(zero), 9)), zero, own_sigma(data, ALL))


def calibrated(covariance, names=ALL.names):
    known = facets.Calibration(names, tuple(map(tuple, covariance.tolist())))
    return replace(NOMINAL, calibration=known)


def test_two_linear_calibrations_are_one_of_both_data():
    _, *both = draw_rig(1)
    first, second = map(normal_equations, both)
    prior = prior_information(ALL)
    covariance = np.linalg.inv(prior + first.matrix)
    values = covariance @ first.side
    changed = choose_groups(calibrated(covariance), ASKED, ["gains"])
    assert changed.names == ALL.names
    known = prior_information(changed)
    later = np.linalg.inv(known + second.matrix)
    updated = later @ (known @ values + second.side)

    # at once: all parameters as they were, and by how much the gains changed
    places = [ALL.names.index(name) for name in GAINS]
    size = len(ALL.names)
    now = np.hstack([np.eye(size), np.eye(size)[:, places]])
    matrix = now.T @ second.matrix @ now
    matrix[:size, :size] += prior + first.matrix
    matrix[range(size, size + 3), range(size, size + 3)] += 1 / ALL.sigma[places] ** 2
    side = now.T @ second.side
    side[:size] += first.side
    whole = np.linalg.inv(matrix)
    scale = np.sqrt(np.diag(later))
    assert updated / scale == pytest.approx(now @ whole @ side / scale, abs=1e-4)  # rounding
    correlation = later / np.outer(scale, scale)
    assert correlation == pytest.approx(now @ whole @ now.T / np.outer(scale, scale), abs=1e-7)


def test_a_changed_gain_is_found_and_the_rest_stays_known():
    rig, first, _ = draw_rig(3)
    before = fit.fit(NOMINAL, first, ALL)
    psd = rig.sensor.psds[1]
    brighter = replace(psd, correction=replace(psd.correction, power=psd.correction.power + 0.01))
    changed = replace(rig.sensor, psds=(rig.sensor.psds[0], brighter, rig.sensor.psds[2]))
    few = rigs.sample_motion(rigs.Rig(changed, rig.values), 12, np.random.default_rng(4))[0]
    groups = ["gains", "beam"]
    after = fit.fit(before.sensor, few, choose_groups(before.sensor, ASKED, groups))
    alone = fit.fit(before.sensor, few, ALL)
    place = ALL.names.index("correction_b.power")
    growth = after.values[place] - before.values[place]
    assert abs(growth - 0.01) < 4 * np.hypot(after.uncertainty[place], before.uncertainty[place])
    heights = [n for n, name in enumerate(ALL.names) if name.endswith("height")]
    assert (after.uncertainty[heights] <= before.uncertainty[heights]).all()
    assert (after.uncertainty[heights] < 0.7 * alone.uncertainty[heights]).all()
    off = (after.values - rig.values[ALL.places])[heights] / after.uncertainty[heights]
    assert np.abs(off).max() < 4
    known = after.sensor.calibration
    assert set(known.names) == set(ALL.names)
    assert known.degrees_of_freedom == after.freedom < before.freedom
    old = replace(before.sensor.calibration, degrees_of_freedom=None)
    older = replace(before.sensor, calibration=old)
    again = fit.fit(older, few, choose_groups(older, ASKED, groups))
    assert again.sensor.calibration.degrees_of_freedom is None


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
