"""Intervals hold what they claim to; what is singular is never certified; the checker checks."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.check_certificate import check
from flint import arb
from sensors import SENSORS

import facets
from facets.characterization.state_box import Domain, domain_of, range_domain
from facets.proof.certificate import write_certificate
from facets.proof.light_sharing import shares_held, together
from facets.proof.uniqueness import (
    certify,
    exact,
    fans_of,
    intervals,
    jacobian,
    share_over,
    slope_of_powers,
)
from facets.scalars.intervals import between, ends, monotone, positive, square

SMALL = domain_of("tx_mm=2,ty_mm=2,tz_mm=2,roll_mrad=4,pitch_mrad=4,yaw_mrad=6")
SHARE = 0.2


def held(sensor, domain, share):
    ball = exact(sensor)
    return ball, together([shares_held(fan, share) for fan in fans_of(ball, domain)])


def states_in(domain, sensor, share, count, seed=1):
    """States of the box at which every facet has its share."""
    rng = np.random.default_rng(seed)
    pose = domain.low[:6] + rng.random((count, 6)) * (domain.high[:6] - domain.low[:6])
    offset = rng.uniform(-0.3, 0.3, (count, 2))
    states = np.concatenate([pose, pose[:, :2] - offset], axis=1)
    lit = facets.readings(sensor, states)[:, 2::3].min(axis=1) >= share * sensor.beam.power
    return states[lit]


def with_powers_held(matrix):
    """The 6 x 6 that is left of a Jacobian (9, 8) when offset follows from two powers."""
    by_pose = matrix.copy()
    by_pose[:, :2] += matrix[:, 6:]  # the beam moves along: the offset stays
    spots, powers = [0, 1, 3, 4, 6, 7], [2, 5]
    drift = np.linalg.solve(matrix[np.ix_(powers, [6, 7])], by_pose[powers][:, :6])
    return by_pose[spots][:, :6] - matrix[np.ix_(spots, [6, 7])] @ drift


@pytest.mark.parametrize("name", ["paper", "skewed1", "skewed2"])
def test_random_states_lie_in_the_intervals(name):
    sensor = SENSORS[name]
    ball, shares = held(sensor, SMALL, SHARE)
    inside = intervals(SMALL.low[:6], SMALL.high[:6])
    bounds = np.array([[ends(x) for x in row] for row in jacobian(ball, shares, inside)])
    states = states_in(SMALL, sensor, SHARE, 3000)
    assert len(states) > 100
    for matrix in facets.jacobian(sensor, states):
        found = with_powers_held(matrix)
        assert (found >= bounds[:, :, 0] - 1e-9).all()
        assert (found <= bounds[:, :, 1] + 1e-9).all()


@pytest.mark.parametrize("name", ["paper", "skewed1"])
def test_eq_11_is_the_product_of_its_two_parts(name):
    sensor = SENSORS[name]
    ball, shares = held(sensor, SMALL, SHARE)
    low, high = ends(slope_of_powers(ball, shares))
    for matrix in facets.jacobian(sensor, states_in(SMALL, sensor, SHARE, 500)):
        whole = np.linalg.det(np.delete(matrix, 8, axis=0))
        slope = np.linalg.det(matrix[np.ix_([2, 5], [6, 7])])
        assert whole == pytest.approx(slope * np.linalg.det(with_powers_held(matrix)), rel=1e-9)
        assert low <= slope <= high


@pytest.mark.parametrize("name", ["paper", "skewed1"])
def test_a_box_is_certified_and_its_bound_holds(name):
    sensor = SENSORS[name]
    found = certify(sensor, SMALL, SHARE)
    assert found.regular
    assert found.unique
    matrices = facets.jacobian(sensor, states_in(SMALL, sensor, SHARE, 2000))
    least = np.abs(np.linalg.det(np.delete(matrices, 8, axis=1))).min()
    assert 0 < found.at_least <= least


def test_the_paper_s_sensor_is_one_to_one_over_its_range():
    config = facets.load("paper")
    domain = range_domain(config.sensor, config.range)
    found = certify(config.sensor, domain, 0.108)
    assert found.unique
    assert found.margin > 0.6


def test_a_box_of_offsets_is_covered_by_its_least_share():
    sensor = SENSORS["paper"]
    box = domain_of("tx_mm=1,yaw_mrad=3,offset_x_mm=0.1,offset_y_mm=0.1")
    share = share_over(exact(sensor), fans_of(exact(sensor), box), box)
    states = box.states(np.random.default_rng(2).random((2000, 8)))
    seen = facets.readings(sensor, states)[:, 2::3].min() / sensor.beam.power
    assert 0.3 * seen < share <= seen
    assert certify(sensor, box).unique


def singular():
    return facets.load("singular").sensor


def blind():
    """A detector that looks along its sub-beam's plane."""
    sensor = SENSORS["paper"]
    return replace(sensor, psds=(replace(sensor.psds[0], yaw=np.pi / 2), *sensor.psds[1:]))


def coincident():
    """Detectors at the apex have no lever for rotations."""
    sensor = SENSORS["paper"]
    return replace(sensor, psds=tuple(replace(psd, radius=1e-3) for psd in sensor.psds))


@pytest.mark.parametrize("make", [singular, blind, coincident])
def test_a_bad_design_is_never_certified(make):
    found = certify(make(), SMALL, SHARE, limit=20)
    assert not found.regular
    assert not found.unique
    assert found.doubtful or found.reason


def test_a_share_that_three_facets_can_not_all_have_is_no_proof():
    found = certify(SENSORS["paper"], SMALL, 0.9)
    assert not found.unique
    assert found.reason


def test_light_that_apertures_cut_is_no_proof():
    sensor = replace(SENSORS["paper"], apertures=facets.Apertures(beam=1.0))
    found = certify(sensor, SMALL, SHARE)
    assert not found.unique
    assert "apertures" in found.reason


def test_a_box_where_a_facet_turns_over_is_no_proof():
    found = certify(SENSORS["paper"], domain_of("roll_mrad=1500"), 0.1, limit=20)
    assert not found.unique


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    path = tmp_path_factory.mktemp("proof") / "certificate.json"
    sensor = SENSORS["paper"]
    write_certificate(path, sensor, certify(sensor, SMALL, SHARE), {"config": "paper"})
    return path


def test_the_checker_agrees(certificate):
    assert check(certificate) > 0.5


@pytest.mark.parametrize("spoil", ["piece", "bounds", "inverse", "parameters", "share"])
def test_the_checker_finds_what_is_wrong(certificate, tmp_path, spoil):
    content = json.loads(certificate.read_text())
    if spoil == "piece":
        content["pieces"].pop()
    elif spoil == "bounds":
        content["light"]["turns"][1][0][2] = [-0.01, 0.01]
    elif spoil == "inverse":
        content["inverse"][2] = [2 * x for x in content["inverse"][2]]
    elif spoil == "parameters":
        content["parameters"][12] = 600.0
    else:
        content["least_share"] = 0.002
    path = tmp_path / "spoilt.json"
    path.write_text(json.dumps(content))
    with pytest.raises(AssertionError):
        check(path)


def test_intervals_hold_what_they_should():
    x = between(-1.0, 2.0)
    assert ends(square(x))[0] >= -1e-8
    assert square(x).contains(arb(4))
    assert square(x).contains(arb(0))
    assert ends(positive(between(1, 2), between(3, 4)))[1] == pytest.approx(8)
    assert monotone(lambda y: -y, between(1, 2)).contains(arb(-2))


def test_a_box_has_two_ends():
    with pytest.raises(facets.InputError, match="the box runs"):
        Domain(np.ones(8), -np.ones(8))
