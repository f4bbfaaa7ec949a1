"""Poses that a second look takes back: spots that an edge cuts, and second solutions."""

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS

import facets
from facets import Status
from facets.estimation import has_fold
from facets.model import is_near_edge, spot_size

PAPER = facets.load("paper").sensor
CUT = replace(PAPER, apertures=facets.Apertures(detectors=True))
FOLDED = facets.load("singular").sensor


def errors(solution, truth):
    """Over the standard uncertainty, the largest of each pose; 0 where there is none."""
    off = np.abs(solution.state - truth) / np.maximum(solution.uncertainty, 1e-9)
    return np.where(solution.ok, np.nan_to_num(off).max(axis=1), 0.0)


def states_near_edges(count):
    rng = np.random.default_rng(5)
    drawn = rng.uniform(-1, 1, (count, 8)) * [0.25, 0.25, 7, 0.03, 0.03, 0.03, 0, 0]
    least = facets.margins(CUT, drawn)[..., :4].min(axis=(1, 2))
    return drawn[(least > -1.2) & (least < 0.3)]


@pytest.mark.parametrize("way", [{}, {"beam": "known", "power": "unknown"}])
def test_a_spot_that_an_edge_cuts_gives_no_pose_that_is_believed(way):
    truth = states_near_edges(30_000)
    readings = facets.add_noise(CUT, facets.readings(CUT, truth), np.random.default_rng(1))
    solution = facets.solve(CUT, readings, **way)
    assert solution.ok.sum() > 20
    assert errors(solution, truth).max() < 7
    for n in np.flatnonzero(solution.status == Status.OUT_OF_RANGE)[:20]:
        assert facets.solve(CUT, readings[n], **way).status == Status.OUT_OF_RANGE
    inside = np.array([0.05, -0.02, 3.0, 2e-3, -1e-3, 4e-3, 0, 0])
    solution = facets.solve(CUT, facets.readings(CUT, inside), **way)
    assert solution.ok
    assert np.abs(solution.state - inside).max() < 1e-9


def about_the_fold(count):
    rng = np.random.default_rng(5)
    drawn = rng.uniform(-1, 1, (count, 8)) * [0.2, 0.2, 6, 0.012, 0.012, 0.012, 0.05, 0.05]
    return drawn[facets.reaches(FOLDED, drawn).all(axis=1)]


def test_a_pose_that_has_a_double_is_ambiguous():
    truth = about_the_fold(12_000)
    readings = facets.add_noise(FOLDED, facets.readings(FOLDED, truth), np.random.default_rng(1))
    solution = facets.solve(FOLDED, readings)
    ambiguous = solution.status == Status.AMBIGUOUS
    assert ambiguous.sum() > 20
    assert np.isnan(solution.state[ambiguous]).all()
    assert np.isnan(solution.covariance[ambiguous]).all()
    assert errors(solution, truth).max() < 10
    truth[:, 6:] = 0  # a known beam tells the double apart
    truth = truth[facets.reaches(FOLDED, truth).all(axis=1)]
    known = facets.solve(FOLDED, facets.readings(FOLDED, truth), beam="known")
    assert known.ok.mean() > 0.99
    assert np.abs(known.state - truth)[known.ok].max() < 1e-6
    solver = facets.Solver(FOLDED, start="previous")
    for reading in readings[ambiguous][:5]:
        assert facets.solve(FOLDED, reading).status == Status.AMBIGUOUS
        assert solver.solve(reading).status != Status.CONVERGED


def test_with_diffraction_a_spot_is_near_an_edge_from_further_off():
    """Nearer than its 1/e^2 diameter; with diffraction nearer than one and a half diameters and
    0.1 mm, since light of the mirror's edges may fall half a diameter beside the spot."""
    spread = replace(PAPER, light=replace(PAPER.light, wavelength=633e-6))
    reading = np.zeros((4, 9))
    reading[:, 0] = PAPER.psds[0].size_y / 2 - spot_size(PAPER) * np.array([0.99, 1.01, 1.5, 1.5])
    reading[2:, 0] -= [0.09, 0.11]
    for sensor, count in ((PAPER, 1), (spread, 3)):
        assert is_near_edge(sensor, reading)[:, 0].tolist() == [n < count for n in range(4)]


#: Readings of poses 28.9 and 1.9 mm from the poses that the estimates end at. From the other
#: side of the fold no estimate ends anywhere, so that no second solution is found.
NO_SECOND_ESTIMATE = (
    (1.3253264640579023, 2.5891983446037607, 0.08097680579174249, 3.2660685821665174,
     3.952581721829265, 0.12948816859997223, 2.998205101082336, 0.668249475652364,
     0.08959920359837026),
    (0.13634583373394293, 4.0276808505678465, 0.06405566930077178, 1.8273564814938037,
     3.199248593416352, 0.11470623404724996, 1.1348504634773537, 1.265416785317718,
     0.12137350451589062),
)  # fmt: skip


@pytest.mark.parametrize("reading", NO_SECOND_ESTIMATE)
def test_a_pose_beside_a_fold_that_no_second_estimate_can_check_is_ambiguous(reading):
    assert facets.solve(FOLDED, reading).status == Status.AMBIGUOUS


def test_sensors_that_others_use_have_no_fold():
    others = [*SENSORS.values(), CUT, facets.load("bench-light").sensor]
    assert not any(map(has_fold, others))
    assert has_fold(FOLDED)


def test_a_detector_that_sees_hardly_more_than_other_light_has_no_light():
    """Far in the beam's tail several poses fit such a reading within its noise, up to 24 standard
    uncertainties from the truth."""
    quiet = replace(PAPER, noise=replace(PAPER.noise, power=1e-8))
    background = ((1e-3, 1, 2), (1e-3, -1, 0.5), (1e-3, 0, -2))
    lit = replace(quiet, light=replace(quiet.light, background=background))
    states = np.zeros((12, 8))
    states[:, 0] = np.linspace(0.1, 1.2, 12)
    solution = facets.solve(lit, facets.readings(lit, states), accept_unchecked=True)
    sees = facets.readings(quiet, states)[:, 2::3] > 5e-5
    np.testing.assert_array_equal(solution.used, sees)
    assert not sees[6].all()  # at 0.7 mm the weakest spot has 4 % of the other light
    assert solution.status[-1] == Status.NO_LIGHT
    assert facets.solve(quiet, facets.readings(quiet, states[6])).used.all()


@pytest.mark.slow
def test_a_small_beams_wrong_minimum_under_real_light_gives_way_to_the_right_one():
    sensor = facets.load("bench-light").sensor
    sensor = replace(sensor, beam=replace(sensor.beam, diameter_x=0.35, diameter_y=0.3675))
    truth = np.zeros((3, 8))
    truth[0, :6] = [0.11192, -0.07669, -1.39112, 9.0642e-3, -4.0356e-3, -4.188e-3]
    truth[1, :6] = [0.1172, -0.0717, -0.8569, 9.012e-3, -5.9741e-3, -5.5783e-3]
    readings, known = facets.readings(sensor, truth), {"beam": "known", "power": "unknown"}
    solution = facets.solve(sensor, readings, **known)
    assert solution.ok.all()
    assert np.abs(solution.state - truth).max() < 1e-9
    solver = facets.Solver(sensor, start="previous", **known)
    states = [solver.solve(reading).state for reading in readings]
    np.testing.assert_allclose(states, truth, atol=1e-9)
