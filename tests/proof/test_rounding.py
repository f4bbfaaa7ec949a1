"""Where rounding or a wide interval once let an untrue bound through, it does no more."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from facets.cli import bounds, certificate_text, claims
from facets.experiments import certificate_optics, certificate_pieces
from facets.experiments import check_certificate as checker
from flint import arb
from sensors import SENSORS

import facets
from facets.characterization import parse_box
from facets.proof import Certificate, Tolerances, certify, light_sharing, pieces
from facets.proof.interval_matrix import determinant, distance_from_zero, regularity
from facets.scalars import intervals

pytestmark = pytest.mark.installed


@pytest.mark.parametrize("least_sine", [light_sharing.least_sine, certificate_optics.least_sine])
def test_the_sine_of_an_opening_about_a_right_angle_is_not_taken_as_1(least_sine):
    right = math.pi / 2
    assert least_sine(intervals.interval(right - 0.3, right + 0.4)) <= math.sin(right + 0.4) + 1e-12
    assert least_sine(intervals.interval(right + 0.1, right + 0.2)) <= math.sin(right + 0.2) + 1e-12
    assert least_sine(intervals.interval(right - 0.3, right - 0.1)) == 1


def test_a_product_whose_factors_may_be_below_zero_is_not_above_it():
    """-1 times -2 is 2, which bounds nothing from below."""
    low, high = intervals.ends(
        intervals.nonnegative_product(intervals.interval(-1, 2), intervals.interval(-2, 3))
    )
    assert low <= 0
    assert high >= 6
    assert checker.nonnegative(intervals.interval(-1, 2)) == 0


@pytest.mark.parametrize("value", [4575461.9, 4579999.9, 0.99999, 1.0, 0.3, 9.995e-7])
def test_a_bound_is_told_rounded_down(value):
    assert float(bounds.round_down(value)) <= value
    assert float(checker.round_down(Fraction(value))) <= value


@pytest.mark.parametrize("value", [15.5486, -15.3249, 0.3, 1 / 3, -2e-9, 24.3, 9.9996, 0.0])
@pytest.mark.parametrize("per_unit", [1, 100, 1000])
def test_a_number_is_told_on_its_safe_side_and_no_further_than_its_last_digit(value, per_unit):
    exact = Fraction(value) * per_unit
    down, up = (Fraction(told(value, 4, per_unit)) for told in
                (bounds.round_down, bounds.round_up))  # fmt: skip
    assert down <= exact <= up
    assert up - down <= abs(exact) / 999


def test_a_box_of_a_proof_is_told_rounded_inwards():
    low, high = np.full(6, -0.0218349), np.full(6, 0.0155486)
    for line in bounds.box_lines(low, high)[3:]:
        assert line.split()[1:] == ["-21.83", "to", "15.54"]
    piece = pieces.ProvedPiece((-0.0218311,) * 6, (0.0155481,) * 6, 0.0)
    assert "roll_mrad -21.84 to 15.55" in bounds.piece_text(piece)


def test_a_box_that_is_asked_for_is_proved_to_its_ends_and_told_as_it_was_asked_for():
    box = parse_box("tx_mm=0.3,roll_mrad=24.3,yaw_mrad=-0.7:5.1")
    for low, high, axis, unit in ((-0.3, 0.3, 0, 1), (-24.3, 24.3, 3, 1000), (-0.7, 5.1, 5, 1000)):
        assert Fraction(box.low[axis]) * unit <= Fraction(str(low))
        assert Fraction(box.high[axis]) * unit >= Fraction(str(high))
        told = bounds.box_lines(box.low, box.high)[axis].split()[1:]
        assert told == [f"{low:g}", "to", f"{high:g}"]


def test_the_light_is_told_as_a_share_and_for_the_brightest_laser():
    """0.108 of a laser of 0.3 mW are 32.4 uW, but of one of 0.33 mW they are 35.64."""
    config = facets.load("paper")
    box = parse_box("tx_mm=1")
    off = Tolerances((0.03, *[0.0] * 29), "a test", (), ())
    for known, told in (
        (None, "10.8 % of the light on each detector (32.4 µW of a laser of 0.3 mW or less)"),
        (off, "10.8 % of the light on each detector (35.64 µW of a laser of 0.33 mW or less)"),
    ):
        claim = claims.Claim(config, box, 0.108, False, known, None)
        found = Certificate(box, share=0.108 * (1 - 1e-12))
        assert told in certificate_text.describe_set(claim, found, None)[0]


def test_the_checker_takes_a_ball_s_end_as_it_is():
    assert certificate_pieces.as_fraction((arb(1) / 3).lower()) < Fraction(1, 3)
    assert certificate_pieces.as_fraction((arb(1) / 3).upper()) > Fraction(1, 3)


def test_parts_of_a_side_reach_its_ends_to_the_last_digit():
    for high in (0.0243, 0.0486, 0.1 + 0.2, 1.1):
        box = parse_box(f"yaw_mrad=-7:{1e3 * high}")
        places = [(low[5], top[5]) for low, top in pieces.initial_pieces(box)]
        assert min(places)[0] == box.low[5]
        assert max(places)[1] == box.high[5]
        assert sorted(places)[0][1] == sorted(places)[1][0]


def test_the_checker_s_parts_of_the_yaw_reach_its_end(monkeypatch):
    """low + (high - low) 3 / 3 is below high by the last digit for these."""
    low, high = -0.0343, 0.034297
    seen = []

    def keep(rig, angles):
        seen.append(angles[2])
        raise checker.Refused("enough")

    monkeypatch.setattr(checker, "edges_of", keep)
    places = checker.parts_of(low, high, 3)
    assert len(places) == 4
    assert places[0] == low
    assert places[-1] == high
    content = {"low": [0.0] * 5 + [low], "high": [0.0] * 5 + [high], "least_share": 0.1}
    with pytest.raises(checker.Refused, match="enough"):
        checker.check_light(None, content)
    assert seen[0].contains(arb(low))


def test_no_number_is_no_bound():
    nan = arb("nan")
    assert intervals.magnitude(nan) == np.inf
    assert distance_from_zero(nan) == 0
    eye = [[arb(float(i == j)) for j in range(6)] for i in range(6)]
    eye[2][3] = nan
    assert not regularity(eye)[0] > 0
    assert distance_from_zero(determinant(eye)) == 0


def test_a_tolerance_holds_both_ends():
    low, high = (
        intervals.interval_around(0.3, 0.1).lower(),
        intervals.interval_around(0.3, 0.1).upper(),
    )
    assert low <= arb(0.3) - arb(0.1)
    assert high >= arb(0.3) + arb(0.1)


def test_imperfections_and_what_is_taken_for_granted_are_told():
    sensor = SENSORS["paper"]
    gains = replace(sensor.imperfections, tip=0.01)
    config = facets.load("paper")
    box = parse_box("tx_mm=1")
    claim = claims.Claim(
        replace(config, sensor=replace(sensor, imperfections=gains)), box, 0.3, False, None, None
    )
    found = certify(sensor, box, 0.3)
    text = "\n".join(certificate_text.describe_set(claim, found, None))
    assert "imperfections" in text
    assert "every facet faces the beam" in text
    assert " or more" in "\n".join(certificate_text.verdict(found, None))
