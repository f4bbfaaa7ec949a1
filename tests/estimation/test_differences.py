"""How uncertain means and steps are: by rigs that are drawn from the calibration's covariance."""

from dataclasses import replace

import numpy as np
import pytest
from pages import DOCS, blocks
from sensors import correlate

import facets
from facets.calibration import ALL, assign_values, values_of
from facets.detectors import MISFIT, MODEL_ERROR

#: A calibration that knows less than a good one, so that its part counts beside the noise.
SIGMAS = {
    "psd_a.radius": 2e-3, "psd_b.height": 1e-3, "psd_c.azimuth": 1e-5, "psd_a.roll": 2e-4,
    "facet_b.inclination": 4e-6, "facet_c.azimuth": 6e-6, "beam.tilt_x": 5e-6,
    "beam.tilt_y": 5e-6,
}  # fmt: skip
START = np.array([0.02, -0.03, 0.1, 1e-3, 2e-3, -1e-3, 0, 0])
END = np.array([-0.04, 0.02, -0.4, -2e-3, 1e-3, 3e-3, 0, 0])
KNOWN = {"beam": "known", "power": "unknown"}


def calibrated() -> facets.Sensor:
    return replace(facets.load("paper").sensor, calibration=correlate(SIGMAS))


def share_inside(error: np.ndarray, sigma: np.ndarray) -> float:
    return float((np.abs(error) < 1.96 * sigma).mean())


def documented() -> tuple[facets.Sensor, np.ndarray, np.ndarray]:
    """The sensor and the step of the worked example in the documentation."""
    names: dict = {}
    exec(blocks(DOCS / "uncertainty.md", "python")[0], names)
    return names["sensor"], names["start"], names["end"]


@pytest.mark.slow
def test_intervals_of_means_and_steps_hold_over_rigs_and_noise():
    """Each rig is another draw of the calibration: 95 % of the intervals of samples, of means and
    of steps hold, and steps would not hold without what the two poses have in common."""
    (sensor, start, end), samples, rigs = documented(), 50, 400
    rng = np.random.default_rng(2)
    names, covariance = sensor.calibration.names, np.array(sensor.calibration.covariance)
    places, values = [ALL.index(name) for name in names], values_of(sensor)
    found = np.empty((rigs, 2, samples, 6))
    for n in range(rigs):
        true = values.copy()
        true[places] += rng.multivariate_normal(np.zeros(len(names)), covariance)
        rig = assign_values(sensor, true)
        for k, state in enumerate((start, end)):
            reading = facets.readings(rig, np.tile(state, (samples, 1)))
            noisy = facets.add_noise(rig, reading, rng)
            solution = facets.solve(sensor, noisy, **KNOWN)
            found[n, k] = (solution.state - state)[:, :6]
    single = found[:, 0, 0]
    both = np.stack([start, end])
    solution = facets.solve(sensor, facets.readings(sensor, both), **KNOWN)
    mean_sigma = facets.mean_uncertainty(sensor, both, samples, **KNOWN)[:, :6]
    step = found[:, 1].mean(axis=1) - found[:, 0].mean(axis=1)
    step_sigma = facets.difference_uncertainty(sensor, start, end, samples, **KNOWN)[:6]
    shares = {
        "sample": share_inside(single, solution.uncertainty[0, :6]),
        "mean": share_inside(found.mean(axis=2), mean_sigma),
        "step": share_inside(step, step_sigma),
    }
    assert all(0.93 < share < 0.97 for share in shares.values()), shares
    by_table = np.hypot(
        solution.noise_uncertainty / np.sqrt(samples), solution.calibration_uncertainty
    )
    np.testing.assert_allclose(mean_sigma, by_table[:, :6], rtol=1e-9)
    assert share_inside(step, np.hypot(*mean_sigma)) > 0.975  # as if nothing cancelled


def test_parts_of_an_uncertainty_are_the_whole():
    sensor = calibrated()
    reading = facets.readings(sensor, np.stack([START, END, START]))
    reading[2] = np.nan
    solution = facets.solve(sensor, reading, **KNOWN)
    square = solution.noise_uncertainty**2 + solution.calibration_uncertainty**2
    np.testing.assert_allclose(square, solution.uncertainty**2, rtol=1e-6)
    bare = facets.solve(replace(sensor, calibration=None), reading, **KNOWN)
    np.testing.assert_allclose(solution.noise_uncertainty, bare.uncertainty, rtol=1e-6)
    single = facets.solve(sensor, reading[0], **KNOWN)
    for name in ("noise_uncertainty", "calibration_covariance"):
        np.testing.assert_allclose(getattr(single, name), getattr(solution, name)[0], rtol=1e-6)
    assert np.isnan(solution.calibration_uncertainty[2]).all()
    with pytest.raises(facets.InputError, match="no calibration covariance"):
        bare.noise_uncertainty  # noqa: B018


def test_a_prior_stays_in_means():
    sensor, prior = facets.load("paper").sensor, facets.Prior((0.0, 0.0), 1e-4)
    size = facets.mean_uncertainty(sensor, START, 10**6, beam=prior)
    np.testing.assert_allclose(size[:2], 1e-4, rtol=0.02)
    assert size[2] < 1e-5
    step = facets.difference_uncertainty(sensor, START, END, 10**6, beam=prior)
    np.testing.assert_allclose(step[:2], np.sqrt(2) * 1e-4, rtol=0.02)


def test_a_step_to_the_same_pose_has_no_part_of_the_parameters_but_twice_that_of_the_model():
    sensor = calibrated()
    noise = facets.solve(sensor, facets.readings(sensor, START), **KNOWN).noise_uncertainty
    none = facets.difference_uncertainty(sensor, START, START, **KNOWN)
    np.testing.assert_allclose(none, np.sqrt(2) * noise, rtol=1e-6)
    missed = replace(sensor, calibration=facets.Calibration((MISFIT[1],), ((1e-6,),)))
    part = facets.solve(missed, facets.readings(missed, START), **KNOWN).calibration_uncertainty
    step = facets.difference_uncertainty(missed, START, START, 10**12, **KNOWN)
    np.testing.assert_allclose(step, np.sqrt(2) * part, rtol=1e-4)


def test_the_model_errs_by_the_same_at_poses_that_are_near_each_other():
    """A misfit of an unknown cause counts twice in any step; the model's own error, in a long one
    only, and in none to the same pose."""
    sizes = {}
    for name in (MISFIT[1], MODEL_ERROR[1]):
        sensor = replace(calibrated(), calibration=facets.Calibration((name,), ((1e-6,),)))
        ways = [START + part * (END - START) for part in (0, 0.01, 0.1, 1)]
        steps = facets.difference_uncertainty(sensor, START, np.stack(ways), 10**12, **KNOWN)
        sizes[name] = steps[:, 2] / facets.mean_uncertainty(sensor, START, 10**12, **KNOWN)[2]
    np.testing.assert_allclose(sizes[MISFIT[1]], np.sqrt(2), rtol=0.06)
    same, short, middle, long = sizes[MODEL_ERROR[1]]
    assert same < 1e-3 < short < 0.1 < middle < 1 < long < 1.5


def test_many_states_and_bad_arguments():
    sensor = calibrated()
    many = np.tile(START, (2, 3, 1))
    many[1, 2] = np.nan
    found = facets.difference_uncertainty(sensor, many, END, **KNOWN)
    assert found.shape == (2, 3, 8)
    assert np.isnan(found[1, 2]).all()
    assert np.isfinite(found[0]).all()
    with pytest.raises(facets.InputError, match="samples is 0"):
        facets.mean_uncertainty(sensor, START, 0)
    with pytest.raises(facets.InputError, match="do not fit"):
        facets.difference_uncertainty(sensor, np.zeros((2, 8)), np.zeros((3, 8)))
