"""Determinants and singular values over many states; the search; states with equal readings."""

import numpy as np
import pytest
from sensors import SENSORS, states

import facets
from facets.characterization import (
    Sobol,
    apex_offset,
    direction_in_words,
    find_ambiguous_pair,
    measures,
    parse_box,
    samples,
    scaled_jacobian,
    search_weakest,
    survey,
    weakest_direction,
)

PAPER = SENSORS["paper"]


@pytest.mark.parametrize("sensor", [SENSORS["skewed3"], facets.load("bench").sensor])
def test_measures_are_those_of_numpy(sensor):
    """Electronics weigh the rows."""
    state = states(100, seed=5)
    values = measures(sensor, state)
    rest = facets.jacobian(sensor, state)[:, :8]
    np.testing.assert_allclose(values[:, 0], np.linalg.det(rest), rtol=1e-9)
    sizes = np.linalg.svd(scaled_jacobian(sensor, state), compute_uv=False)
    np.testing.assert_allclose(values[:, 1], sizes[:, -1], rtol=1e-6)
    np.testing.assert_allclose(values[:, 2], sizes[:, 0] / sizes[:, -1], rtol=1e-6)


def test_samples_are_in_the_box_and_in_chunks():
    domain = parse_box("tx_mm=1:2,yaw_mrad=5,offset_x_mm=0.1")
    drawn = list(samples(domain, 250_000, "uniform", 3))
    assert [len(part) for part in drawn] == [100_000, 100_000, 50_000]
    every = np.concatenate(drawn)
    assert 1 <= every[:, 0].min() < every[:, 0].max() <= 2
    assert (every[:, [1, 2, 3, 4]] == 0).all()
    assert apex_offset(every).max() <= 0.1 + 1e-12


@pytest.mark.parametrize("dimension", [1, 8, 34])
def test_points_of_a_sobol_sequence_are_those_of_scipy(dimension):
    from scipy.stats import qmc

    own, rng = Sobol(dimension, np.random.default_rng(3)), np.random.default_rng(3)
    points = np.concatenate([own.draw(5), own.draw(1), own.draw(250)])
    np.testing.assert_array_equal(points, qmc.Sobol(dimension, rng=rng).random(256))


def test_dark_states_are_counted_and_saturated_ones_measured_too():
    result = survey(PAPER, samples(parse_box("roll_mrad=2000"), 1000, "sobol", 1))
    assert 0 < result.unlit < 1000
    assert not result.one_sign
    state = np.zeros((5, 8))
    state[3:, :3] = 0.3, 0.3, 5.0  # mm: most of the light near the edge of one detector
    result = survey(facets.load("bench").sensor, iter([state]))
    assert (result.states, result.unlit, result.saturated) == (5, 0, 2)


def test_states_are_counted_where_their_apex_is_off_the_beam():
    (drawn,) = samples(parse_box("offset_x_mm=0.3,offset_y_mm=0.2"), 3000, "sobol", 1)
    result = survey(PAPER, [drawn])
    edges = result.edges[0]
    expected = np.histogram(np.minimum(apex_offset(drawn), edges[-1]), edges)[0].tolist()
    for counts in (result.counts, result.second):
        assert counts.sum(axis=1).tolist() == expected


def test_the_weakest_direction_has_the_least_slope_and_words():
    rest = np.zeros((1, 8))
    slope = np.linalg.norm(scaled_jacobian(PAPER, rest)[0] @ weakest_direction(PAPER, rest[0]))
    assert slope == pytest.approx(measures(PAPER, rest)[0, 1])
    for sign, way in ((1, "together"), (-1, "apart")):
        direction = np.array([1, 0, 0, 0, 0, 0, sign, 0]) / np.sqrt(2)
        assert direction_in_words(direction) == f"mirror and beam {way} along x"


@pytest.mark.slow
def test_a_singular_design_has_twins():
    sensor = facets.load("singular").sensor
    domain = parse_box(  # beyond the range, which ends where the determinant changes its sign
        "tx_mm=2,ty_mm=5,tz_mm=3,roll_mrad=6,pitch_mrad=3,yaw_mrad=20,offset_x_mm=0.2,"
        "offset_y_mm=0.2"
    )
    pair = find_ambiguous_pair(sensor, search_weakest(sensor, domain).state)
    readings = facets.readings(sensor, [pair.first, pair.second])
    np.testing.assert_allclose(readings[0], readings[1], atol=1e-10)
    assert np.abs(pair.first - pair.second)[:3].max() > 1
    assert pair.determinant[0] * pair.determinant[-1] < 0
