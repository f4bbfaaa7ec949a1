"""The budget of a calibration: each source's part beside fits to data that this source disturbs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import rigs

import facets
from facets.calibration import Choice, Data, budget, table
from facets.calibration.fit import fit
from facets.calibration.verdict import verdict
from facets.core import Calibration
from facets.detectors import standard_deviations
from facets.estimation import coverage_factor

NOMINAL = facets.Sensor()
NAMES, SIGMA = ("psd_a.height", "facet_b.inclination", "apex.x"), np.array([0.05, 5e-4, 0.02])


def small_case(power, joint=None):
    """Five samples with a poor reference, their fit of three unknowns, and its budget."""
    rng = np.random.default_rng(4)
    state = np.zeros((5, 8))
    state[:, :6] = rng.uniform(-1, 1, (5, 6)) * [0.1, 0.1, 1, 5e-3, 5e-3, 5e-3]
    reading = facets.readings(NOMINAL, state)
    reading += rng.normal(size=reading.shape) * standard_deviations(NOMINAL, reading)
    sigma = np.array([1e-3, 1e-3, 1e-3, 5e-6, 5e-6, 5e-6])
    data = Data(reading, state[:, :6], sigma, np.zeros((5, 2)))
    found = fit(NOMINAL, data, Choice(NAMES, SIGMA, power, joint=joint), None, enough=1e-12)
    return data, found, budget.calibration_budget(NOMINAL, data, found, found.sensor, None)


@pytest.mark.parametrize("power", [1e-4, np.inf])
def test_the_part_of_the_reference_is_how_far_the_result_follows_it(power):
    """Each pose of the reference is moved by its standard uncertainty and fitted again."""
    data, found, parts = small_case(power)
    known = found.sensor.calibration.names
    kept = [known.index(name) for name in NAMES[:2]]
    square = np.zeros(2)
    for n, axis in np.ndindex(data.pose.shape):
        pose = data.pose.copy()
        pose[n, axis] += 0.1 * data.sigma[axis]
        moved = fit(NOMINAL, data._replace(pose=pose), found.choice, None, found, enough=1e-12)
        square += ((moved.values - found.values)[:2] / 0.1) ** 2
    np.testing.assert_allclose(np.diag(parts.sensor[budget.REFERENCE])[kept], square, rtol=0.01)
    whole = sum(parts.sensor.values())
    np.testing.assert_allclose(whole, np.array(found.sensor.calibration.covariance), rtol=1e-9)
    assert (np.diag(parts.sensor[budget.READINGS]) > 0).all()
    assert ("beam.power" in known) == np.isinf(power)


def test_degrees_of_freedom_are_those_of_the_estimated_part():
    """Half of the variance from 8 degrees of freedom: 8 / (1/2)^2, by Welch and Satterthwaite."""
    parts = budget.Budget({}, ("noise",), 8.0)
    freedom = parts.effective_freedom({"noise": np.array([1.0, 1.0]), "rest": np.array([1.0, 0.0])})
    np.testing.assert_allclose(freedom, [32.0, 8.0])
    # the t distribution's 97.5 % points, of printed tables
    np.testing.assert_allclose(coverage_factor(budget.COVERAGE, freedom), [2.037, 2.306], atol=5e-4)
    assert coverage_factor(budget.COVERAGE) == pytest.approx(1.95996, abs=1e-5)


def test_values_of_an_earlier_calibration_have_its_degrees_of_freedom():
    _, _, parts = small_case(1e-4, Calibration(("psd_a.height",), ((1e-6,),), 5.0))
    assert (parts.estimated, parts.freedom) == ((budget.READINGS, budget.PRIOR), 5.0)


def test_a_misfit_is_a_source_of_its_own():
    rng = np.random.default_rng(2)
    config = facets.load("paper")
    rig = rigs.draw_rig(NOMINAL, rng)
    data, _ = rigs.sample_motion(rig, 60, rng)
    found = verdict(NOMINAL, data, table.choice(NOMINAL, config.calibrate), config.calibrate)
    known = found.sensor.calibration
    more = np.diag([1e-8])
    whole = np.block([[np.array(known.covariance), np.zeros((len(known.names), 1))],
                      [np.zeros((1, len(known.names))), more]])  # fmt: skip
    made = Calibration((*known.names, "misfit_b.psi"), tuple(map(tuple, whole.tolist())))
    made = replace(found.sensor, calibration=made)
    parts = budget.calibration_budget(found.search.sensor, found.fitted, found.found, made, 3.0)
    misfit = parts.sensor["misfit of the model, of unknown cause"]
    assert np.flatnonzero(np.diag(misfit)).tolist() == [len(known.names)]
    states, sure = np.zeros((1, 8)), facets.Knowledge(beam="known")
    poses = budget.pose_covariances(made, parts, states, sure)
    reading = facets.readings(made, states)
    stated = facets.solve(made, reading, beam="known").calibration_uncertainty[0, :6]
    variances = np.diagonal(sum(poses.values()), axis1=1, axis2=2)[0]
    np.testing.assert_allclose(np.sqrt(variances), stated, rtol=1e-9)
