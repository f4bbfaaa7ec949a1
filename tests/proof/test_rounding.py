"""Where rounding or a wide interval once let an untrue bound through, it does no more."""

from __future__ import annotations

import json
import re
from fractions import Fraction

import numpy as np
import pytest
from facets.cli.sentences import bounds
from facets.experiments import certificate_pieces, check_certificate as checker
from flint import arb

from facets.characterization import parse_box
from facets.proof import pieces
from facets.scalars import intervals

pytestmark = pytest.mark.installed


def test_intervals_hold_what_they_should():
    """-1 times -2 is 2, which bounds nothing from below."""
    square = intervals.square(intervals.interval(-1, 2))
    assert intervals.ends(square)[0] >= -1e-8
    assert square.contains(arb(4))
    assert square.contains(arb(0))
    for first, second, least, largest in (((1, 2), (3, 4), 3, 8), ((-1, 2), (-2, 3), 0, 6)):
        product = intervals.nonnegative_product(
            intervals.interval(*first), intervals.interval(*second)
        )
        assert intervals.ends(product) == pytest.approx((least, largest), abs=1e-6)
        assert product.contains(arb(least))
        assert product.contains(arb(largest))
    assert checker.nonnegative(intervals.interval(-1, 2)) == 0
    around = intervals.interval_around(0.3, 0.1)
    assert around.lower() <= arb(0.3) - arb(0.1)
    assert around.upper() >= arb(0.3) + arb(0.1)


@pytest.mark.parametrize("value", [4575461.9, -15.3249, 0.3, 1 / 3, -2e-9, 24.3, 9.9996, 0.0])
@pytest.mark.parametrize("per_unit", [1, 1000])
def test_a_number_is_told_on_its_safe_side_and_no_further_than_its_last_digit(value, per_unit):
    exact = Fraction(value) * per_unit
    down, up = (Fraction(told(value, 4, per_unit)) for told in
                (bounds.round_down, bounds.round_up))  # fmt: skip
    assert down <= exact <= up
    assert up - down <= abs(exact) / 999
    assert value < 0 or float(checker.round_down(Fraction(value))) <= value


def test_a_box_of_a_proof_is_told_rounded_inwards_and_a_piece_without_one_outwards():
    low, high = np.full(6, -0.0218349), np.full(6, 0.0155486)
    for line in bounds.box_lines(low, high)[3:]:
        assert line.split()[1:] == ["-21.83", "to", "15.54"]
    piece = pieces.ProvedPiece((-0.0218311,) * 6, (0.0155481,) * 6, 0.0)
    assert "roll_mrad -21.84 to 15.55" in bounds.piece_text(piece)


def test_the_command_tells_what_was_proved_for_the_brightest_laser(run_in_process, tmp_path):
    """The box is proved to the ends that were asked for, and told as it was asked for."""
    (tmp_path / "mine.yaml").write_text(
        "extends: paper\ncalibrate: {before: {laser_percent: 10}}\n"
    )
    status, text, errors = run_in_process(
        "jacobian", "mine.yaml", "--box", "tx_mm=0.3,roll_mrad=0.7,yaw_mrad=-0.7:2.43",
        "--certify", "--tolerances", "1", "--states", "100", "--no-search-worst", "-d", "out",
    )  # fmt: skip
    assert status == 0, errors
    content = json.loads((tmp_path / "out" / "certificate.json").read_text())
    share = Fraction(content["least_share"])
    percent, light = map(Fraction, re.search(
        r"at least (\S+) % of the light on each detector \((\S+) µW of a laser of 0.33 mW or less",
        text,
    ).groups())  # fmt: skip
    assert 100 * share <= percent <= Fraction("100.1") * share
    assert 330 * share <= light <= Fraction("330.4") * share
    for low, high, axis in (("-0.3", "0.3", 0), ("-0.7", "0.7", 3), ("-0.7", "2.43", 5)):
        unit = 1 if axis == 0 else 1000
        assert Fraction(content["low"][axis]) * unit <= Fraction(low)
        assert Fraction(content["high"][axis]) * unit >= Fraction(high)
        assert re.search(rf"_(mm|mrad) +{low} to {high}\n", text)
    for words in ("every facet faces the beam", " or more", "taken as exact: "):
        assert words in text


def test_parts_of_a_side_reach_its_ends_to_the_last_digit():
    for high in (0.0243, 0.0486, 0.1 + 0.2, 1.1):
        box = parse_box(f"yaw_mrad=-7:{1e3 * high}")
        places = sorted((low[5], top[5]) for low, top in pieces.initial_pieces(box))
        assert places[0] == (box.low[5], places[1][0])
        assert places[-1] == (places[1][1], box.high[5])
    # low + (high - low) 3 / 3 is below high by the last digit for these
    low, high = -0.0343, 0.034297
    parts = checker.parts_of(low, high, 3)
    assert [parts[0], len(parts), parts[-1]] == [low, 4, high]
    assert certificate_pieces.as_fraction((arb(1) / 3).lower()) < Fraction(1, 3)
    assert certificate_pieces.as_fraction((arb(1) / 3).upper()) > Fraction(1, 3)
