"""Determinants and singular values over many states; the search; states with equal readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS, states

import facets
from facets import InputError
from facets.characterization import (
    AXES,
    apex_offset,
    direction_in_words,
    find_ambiguous_pair,
    measures,
    parse_box,
    range_box,
    samples,
    scaled_jacobian,
    search,
    state_columns,
    survey,
    weakest_direction,
)

PAPER = SENSORS["paper"]


@pytest.mark.parametrize("name", list(SENSORS)[:4])
def test_measures_are_those_of_numpy(name):
    state = states(300, seed=5)
    found = measures(SENSORS[name], state)
    matrices = facets.jacobian(SENSORS[name], state)
    exact = np.linalg.det(np.delete(matrices, 8, axis=1))
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-9)
    values = np.linalg.svd(scaled_jacobian(SENSORS[name], state), compute_uv=False)
    np.testing.assert_allclose(found[:, 1], values[:, -1], rtol=1e-6)
    np.testing.assert_allclose(found[:, 2], values[:, 0] / values[:, -1], rtol=1e-6)


def rounding_of_determinants(matrices: np.ndarray) -> np.ndarray:
    """By how much two ways to the determinants of (n, 8, 8) may differ: (n,).

    Eliminations perturb a matrix by some 8 roundings of its numbers, and each row or column can
    turn its share of that into no more than itself times the product of the others' lengths
    (Hadamard): 64 x 2e-16, and eight times that for the growth of what is eliminated. Needed where
    a determinant is zero by symmetry, and all that is left is rounding.
    """
    rows = np.prod(np.linalg.norm(matrices, axis=2), axis=1)
    columns = np.prod(np.linalg.norm(matrices, axis=1), axis=1)
    return 512 * np.finfo(float).eps * np.minimum(rows, columns)


def test_any_reading_can_be_left_out():
    state = states(20, seed=6)
    matrices = facets.jacobian(PAPER, state)
    for row, name in enumerate(facets.READING):
        left = np.delete(matrices, row, axis=1)
        away = np.abs(measures(PAPER, state, name)[:, 0] - np.linalg.det(left))
        assert (away <= rounding_of_determinants(left)).all()
    with pytest.raises(InputError, match="power_d"):
        measures(PAPER, state, "power_d")


def test_electronics_weigh_the_rows():
    sensor = replace(PAPER, electronics=facets.Electronics())
    state = states(50, seed=7)
    values = np.linalg.svd(scaled_jacobian(sensor, state), compute_uv=False)
    np.testing.assert_allclose(measures(sensor, state)[:, 1], values[:, -1], rtol=1e-6)


@pytest.mark.slow
def test_the_paper_s_range_has_one_sign():
    config = facets.load("fig4")
    domain = range_box(config.sensor, config.range)
    found = survey(config.sensor, samples(domain, 20_000, "sobol", 1))
    assert found.states == 20_000
    assert found.one_sign
    assert found.signs[2] == 20_000
    assert found.counts.sum() == 20_000
    for column, worst in ((0, found.lowest), (1, found.weakest)):
        again = search(config.sensor, domain, column)
        assert again.values[column] <= 1.001 * worst.values[column]


def test_samples_are_in_the_box_and_in_chunks():
    domain = parse_box("tx_mm=1:2,yaw_mrad=5,offset_x_mm=0.1")
    drawn = list(samples(domain, 250_000, "uniform", 3))
    assert [len(part) for part in drawn] == [100_000, 100_000, 50_000]
    every = np.concatenate(drawn)
    assert every[:, 0].min() >= 1
    assert every[:, 0].max() <= 2
    assert (every[:, [1, 2, 3, 4]] == 0).all()
    assert apex_offset(every).max() <= 0.1 + 1e-12
    again = np.concatenate(list(samples(domain, 250_000, "uniform", 3)))
    np.testing.assert_array_equal(every, again)


def test_a_bad_box_is_refused():
    for text in ("txmm=1", "tx_mm=a", "tx_mm=1:2:3", "tx_mm=-1", "tx_mm"):
        with pytest.raises(InputError, match="--box"):
            parse_box(text)


def test_dark_states_are_counted_not_measured():
    found = survey(PAPER, samples(parse_box("roll_mrad=2000"), 1000, "sobol", 1))
    assert 0 < found.dark < 1000
    assert not found.one_sign


def test_states_are_counted_where_their_apex_is_off_the_beam():
    domain = parse_box("offset_x_mm=0.3,offset_y_mm=0.2")
    found = survey(PAPER, samples(domain, 3000, "sobol", 1))
    offsets = apex_offset(np.concatenate(list(samples(domain, 3000, "sobol", 1))))
    expected = np.histogram(np.minimum(offsets, found.edges[0][-1]), found.edges[0])[0]
    np.testing.assert_array_equal(found.counts.sum(axis=1), expected)
    np.testing.assert_array_equal(found.second.sum(axis=1), expected)


def test_directions_have_words():
    direction = np.zeros(8)
    direction[[0, 6]] = np.sqrt(0.5)
    assert direction_in_words(direction) == "mirror and beam together along x"
    direction[6] *= -1
    assert direction_in_words(direction) == "mirror and beam apart along x"
    for i, name in enumerate(AXES[:6]):
        assert name[-1] in direction_in_words(np.eye(8)[i])
    weakest = weakest_direction(PAPER, np.zeros(8))
    slope = np.linalg.norm(scaled_jacobian(PAPER, np.zeros((1, 8)))[0] @ weakest)
    assert slope == pytest.approx(measures(PAPER, np.zeros((1, 8)))[0, 1])


@pytest.mark.slow
def test_a_singular_design_has_twins():
    config = facets.load("singular")
    domain = parse_box(  # beyond the range, which ends where the determinant changes its sign
        "tx_mm=2,ty_mm=5,tz_mm=3,roll_mrad=6,pitch_mrad=3,yaw_mrad=20,offset_x_mm=0.2,"
        "offset_y_mm=0.2"
    )
    found = survey(config.sensor, samples(domain, 5000, "sobol", 1))
    assert not found.one_sign
    pair = find_ambiguous_pair(config.sensor, search(config.sensor, domain, 1).state)
    assert pair is not None
    readings = facets.readings(config.sensor, [pair.one, pair.other])
    np.testing.assert_allclose(readings[0], readings[1], atol=1e-10)
    assert np.abs(pair.one - pair.other)[:3].max() > 1
    assert pair.determinant[0] * pair.determinant[-1] < 0


def test_a_table_has_states_in_the_units_of_its_names():
    states = np.array([[0.1, -0.2, 3.0, 1e-3, 2e-3, -4e-3, 0.01, 0.02]])
    table = state_columns(states, np.array([[5.0, 6.0, 7.0]]))
    assert [column[0] for column in table.values()] == pytest.approx(
        [0.1, -0.2, 3.0, 1.0, 2.0, -4.0, 0.01, 0.02, np.hypot(0.09, 0.22), 5.0, 6.0, 7.0]
    )
