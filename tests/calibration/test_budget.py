"""The budget of a calibration: each source's part beside fits to data that this source disturbs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig_samples import NOMINAL, judge, sample_rig, settings

import facets
from facets.calibration import PLACE, Choice, Data, fit, uncertainty
from facets.core import Calibration
from facets.detectors import standard_deviations

NAMES, SIGMA = ("psd_a.height", "facet_b.inclination", "apex.x"), np.array([0.05, 5e-4, 0.02])


def small_case(power, joint=None):
    """Five samples with a poor reference, their fit of three unknowns, and its uncertainty."""
    rng = np.random.default_rng(4)
    state = np.zeros((5, 8))
    state[:, :6] = rng.uniform(-1, 1, (5, 6)) * [0.1, 0.1, 1, 5e-3, 5e-3, 5e-3]
    reading = facets.readings(NOMINAL, state)
    reading += rng.normal(size=reading.shape) * standard_deviations(NOMINAL, reading)
    sigma = np.array([1e-3, 1e-3, 1e-3, 5e-6, 5e-6, 5e-6])
    data = Data(reading, state[:, :6], sigma, np.zeros((5, 2)))
    fitted = fit.fit(
        NOMINAL,
        data,
        Choice(NAMES, SIGMA, power, joint=joint),
        None,
        rule=fit.StoppingRule(fall=1e-12),
    )
    return data, fitted, uncertainty.calibration_budget(NOMINAL, data, fitted, fitted.sensor, None)


@pytest.mark.parametrize("power", [1e-4, np.inf])
def test_the_part_of_the_reference_is_how_far_the_result_follows_it(power):
    """Each pose of the reference is moved by its standard uncertainty and fitted again."""
    data, fitted, parts = small_case(power)
    known = fitted.sensor.calibration
    places = [known.names.index(name) for name in NAMES[:2]]
    square = np.zeros(2)
    for n, axis in np.ndindex(data.pose.shape):
        pose = data.pose.copy()
        pose[n, axis] += 0.1 * data.sigma[axis]
        moved = data._replace(pose=pose)
        again = fit.fit(
            NOMINAL, moved, fitted.choice, None, fitted, rule=fit.StoppingRule(fall=1e-12)
        )
        square += ((again.values - fitted.values)[:2] / 0.1) ** 2
    reference = np.diag(parts.sensor[uncertainty.REFERENCE])
    np.testing.assert_allclose(reference[places], square, rtol=0.01)
    whole = sum(parts.sensor.values())
    np.testing.assert_allclose(whole, np.array(known.covariance), rtol=1e-9)
    assert (np.diag(parts.sensor[uncertainty.READINGS]) > 0).all()
    assert ("beam.power" in known.names) == np.isinf(power)


def test_degrees_of_freedom_are_those_of_the_estimated_part():
    """Half of the variance from 8 degrees of freedom: 8 / (1/2)^2, by Welch and Satterthwaite."""
    parts = uncertainty.Budget({}, ("noise",), 8.0)
    freedom = parts.effective_freedom({"noise": np.ones(2), "rest": np.array([1.0, 0.0])})
    np.testing.assert_allclose(freedom, [32.0, 8.0])
    _, _, parts = small_case(1e-4, Calibration(("psd_a.height",), ((1e-6,),), 5.0))
    assert (parts.estimated, parts.freedom) == ((uncertainty.READINGS, uncertainty.PRIOR), 5.0)


def test_the_sources_are_all_of_what_is_written():
    """An Abbe offset of the reference widens the uncertainty, by a part that no source of the fit
    has; a rig without a fault has no such part."""
    abbe = {"mirror": lambda pose, rng: np.outer(2.0 * pose[:, 5], np.eye(6)[1])}
    for fault in (abbe, {}):
        judged = judge(sample_rig(240, **fault)[1])
        parts = uncertainty.calibration_budget(
            judged.search.sensor, judged.fitted, judged.fit, judged.sensor, 3.0
        )
        written = np.array(judged.sensor.calibration.covariance)
        np.testing.assert_allclose(np.diag(sum(parts.sensor.values())), np.diag(written), rtol=1e-9)
        assert (uncertainty.CAUSES in parts.sensor) == bool(fault)


def test_other_light_is_less_known_where_the_lasers_power_falls():
    """By a third, which it may follow or not."""

    def fade(sensor, state, exact):
        exact[:, 2::3] += 1e-3  # at the middle of each detector
        for m in (0, 1):
            exact[:, m::3] *= 1 - 1e-3 / exact[:, 2::3]
        exact[:, 2::3] *= np.linspace(1.2, 0.8, len(exact))[:, None]
        return exact

    judged = judge(sample_rig(200, alter=fade)[1], settings(background="on"))
    known, value = judged.sensor.calibration, judged.fit.all_values[PLACE["background_a.power"]]
    n = known.names.index("background_a.power")
    assert known.covariance[n][n] ** 0.5 > 0.19 * value > 1e-4


def test_a_misfit_is_a_source_of_its_own():
    judged = judge(sample_rig(60)[1])
    known = judged.sensor.calibration
    covariance = np.pad(np.array(known.covariance), (0, 1))
    covariance[-1, -1] = 1e-8
    made = Calibration((*known.names, "misfit_b.psi"), tuple(map(tuple, covariance.tolist())))
    made = replace(judged.sensor, calibration=made)
    parts = uncertainty.calibration_budget(NOMINAL, judged.fitted, judged.fit, made, 3.0)
    misfit = parts.sensor["misfit of the model, of unknown cause"]
    assert np.flatnonzero(np.diag(misfit)).tolist() == [len(known.names)]
    states = np.zeros((1, 8))
    poses = uncertainty.pose_covariances(made, parts, states, facets.Knowledge(beam="known"))
    solved = facets.solve(made, facets.readings(made, states), beam="known")
    variances = np.diagonal(sum(poses.values()), axis1=1, axis2=2)
    np.testing.assert_allclose(np.sqrt(variances), solved.calibration_uncertainty[:, :6], rtol=1e-9)
