"""Blocks of poses: equal to one pose at a time, whatever stands beside it."""

from dataclasses import replace

import numpy as np
import pytest
from sensors import ALL, ASYMMETRY, PROFILE, SENSORS, states

import facets
from facets.core import BenchLight
from facets.model import as_text, blocks, derivatives, evaluators, packed_vectors

NAMED = pytest.mark.parametrize("name", ["paper", "skewed0", "skewed2", "skewed4"])
FUNCTIONS = [facets.readings, facets.jacobian, facets.footprints]
EACH = pytest.mark.parametrize("function", FUNCTIONS)


def one_by_one(sensor: facets.Sensor, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings and Jacobians by the code for one pose, which shares the text but no function."""
    values, found = np.empty((len(some), 9)), np.empty((len(some), 10, 10))
    evaluators.fill(evaluators.readings(sensor), packed_vectors(sensor), some, values)
    with_power = np.insert(some, 8, sensor.beam.power, axis=1)
    evaluators.fill(evaluators.linearisation(sensor), packed_vectors(sensor), with_power, found)
    slopes = found[:, 1:, :8].copy()
    slopes[np.isnan(found[:, 0, :9])] = np.nan
    return values, slopes


@NAMED
def test_blocks_agree_with_one_pose_at_a_time(name):
    """Both carry roundings of 300 mm, 6e-14 mm each."""
    sensor, some = SENSORS[name], states(400, seed=3)
    values, slopes = one_by_one(sensor, some)
    found = np.empty_like(values)
    left = blocks.run("readings", packed_vectors(sensor), some, found)
    assert len(left) < len(some) / 4
    assert np.abs(facets.readings(sensor, some) - values).max() < 1e-12
    scale = np.abs(slopes).max(axis=(0, 1))
    assert (np.abs(facets.jacobian(sensor, some) - slopes).max(axis=(0, 1)) < 1e-13 * scale).all()


@pytest.mark.parametrize("opening", [np.inf, 0.3])
@pytest.mark.parametrize("name", ["paper", "skewed0", "skewed4"])
def test_footprints_of_blocks_are_those_of_one_pose_at_a_time(name, opening):
    """Also where facets meet no light inside the beam's circle, or inside its aperture."""
    sensor = replace(SENSORS[name], apertures=facets.Apertures(beam=opening))
    some, one = states(2000, seed=6, offset=0.8), np.empty((2000, 3, 5))
    some[5, 0], some[6, 0], some[7, 2], some[8, 7] = np.nan, np.inf, -np.inf, np.inf
    evaluators.fill(evaluators.footprints(sensor), packed_vectors(sensor), some, one)
    found = facets.footprints(sensor, some)
    assert 0.1 < np.isnan(one[:, :, 0]).mean() < 0.9
    np.testing.assert_array_equal(np.isnan(found), np.isnan(one))
    assert np.nanmax(np.abs(found - one)) < 2e-12


LIT = {
    "ideal": SENSORS["skewed2"],
    "polarised": replace(SENSORS["paper"], light=ALL),
    "not Gaussian": replace(
        SENSORS["skewed2"], light=BenchLight(profile=PROFILE, asymmetry=ASYMMETRY)
    ),
}


@pytest.mark.parametrize("sensor", LIT.values(), ids=LIT)
@pytest.mark.parametrize("name", list(as_text.FORMULAS))
def test_what_few_poses_give_as_text_has_the_bits_of_compiled_code(sensor, name, monkeypatch):
    """Else results would depend on how many poses left their blocks before."""
    some = states(60, seed=7, offset=1.5)
    some[:30, 3:6] += np.linspace(0.6, 1.1, 30)[:, None]
    some[50], some[51, 0] = np.nan, np.inf
    text = {
        "readings": facets.readings,
        "derivatives": facets.jacobian,
        "approximate_derivatives": derivatives,
        "footprints": facets.footprints,
    }[name]
    monkeypatch.setattr(as_text, "MAX_TEXT_S", 0.0)
    expected = text(sensor, some)
    monkeypatch.setattr(as_text, "MAX_TEXT_S", np.inf)  # however slow the machine
    monkeypatch.setattr(evaluators, "is_ready", lambda _: False)
    ran = []
    monkeypatch.setattr(as_text, "fill_each", counted(as_text.fill_each, ran))
    np.testing.assert_array_equal(text(sensor, some), expected)
    known = name != "footprints" or not sensor.light.on  # footprints of curved light have no block
    assert sum(ran) > 5 if known else not ran
    assert np.isnan(expected).any()


def counted(fill_each, ran):
    """Notes of how many rows the text has found what was asked."""

    def call(formula, states, found, which):
        left = fill_each(formula, states, found, which)
        ran.append(len(which) - len(left))
        return left

    return call


@pytest.mark.parametrize("sensor", LIT.values(), ids=LIT)
def test_slopes_by_parameters_have_the_same_bits_as_text(sensor, monkeypatch):
    some = states(20, seed=7, offset=1.5)
    monkeypatch.setattr(as_text, "MAX_TEXT_S", 0.0)
    expected = facets.parameter_jacobian(sensor, some)
    monkeypatch.setattr(as_text, "MAX_TEXT_S", np.inf)
    monkeypatch.setattr(evaluators, "is_ready", lambda _: False)
    ran = []
    monkeypatch.setattr(as_text, "fill_each", counted(as_text.fill_each, ran))
    np.testing.assert_array_equal(facets.parameter_jacobian(sensor, some), expected)
    assert sum(ran) > 10


@EACH
def test_a_pose_gives_the_same_bits_wherever_it_stands(function):
    """In any lane, beside any other, in batches of any length; among them what leaves its block."""
    sensor, some = SENSORS["skewed2"], states(40, seed=4)
    some[7], some[12, 0], some[20, 0] = np.nan, 1.0, 1e6
    some[28, 4] = some[33, 3] = 1.2
    whole = function(sensor, some)
    order = np.random.default_rng(1).permutation(40)
    np.testing.assert_array_equal(function(sensor, some[order]), whole[order])
    for length in range(1, 18):
        np.testing.assert_array_equal(function(sensor, some[:length]), whole[:length])
        np.testing.assert_array_equal(function(sensor, some[-length:]), whole[-length:])
    for state, row in zip(some, whole, strict=True):
        np.testing.assert_array_equal(function(sensor, state), row)


@EACH
def test_threads_do_not_change_bits(function):
    some = states(2100, seed=5)
    one, two = (function(SENSORS["paper"], some, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_what_does_not_fit_a_block_is_left():
    """Faint facets, an apex far off, a mirror far turned, and what is no number."""
    sensor, some = facets.Sensor(), np.zeros((9, 8))
    some[1, 0], some[2, 0], some[3, 0] = 0.5, 2.0, np.inf
    some[5, 4], some[6, 2], some[7, 5] = 1.1, np.nan, -1.0
    left = blocks.run("readings", packed_vectors(sensor), some, np.empty((9, 9)))
    assert list(left) == [1, 2, 3, 5, 6, 7]
    values = one_by_one(sensor, some)[0]
    np.testing.assert_allclose(facets.readings(sensor, some), values, rtol=1e-13, atol=1e-13)


def test_a_facet_that_meets_no_beam_reads_nan_beside_others():
    some = np.zeros((8, 8))
    some[3, 4], some[5, 4] = 0.79, -0.79
    values, slopes = one_by_one(facets.Sensor(), some)
    assert np.isnan(values[[3, 5], 0]).all()
    for function, expected in ((facets.readings, values), (facets.jacobian, slopes)):
        found = function(facets.Sensor(), some)
        np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))


def test_no_poses_give_nothing():
    assert facets.readings(facets.Sensor(), np.empty((0, 8))).shape == (0, 9)
    assert facets.jacobian(facets.Sensor(), np.empty((0, 8))).shape == (0, 9, 8)
