"""Samples and their poses as columns."""

import numpy as np
import pytest

import facets
from facets import Measurement, Samples
from facets.estimation import common_detectors, detectors_of, worded_columns

SENSOR = facets.Sensor()


def test_samples_are_numbered_from_one():
    assert Samples(np.zeros((3, 9))).numbers.tolist() == [1, 2, 3]
    assert Samples(np.zeros((2, 9)), np.array([7, 9])).numbers.tolist() == [7, 9]


def test_words_of_columns_lead_back_to_the_detectors():
    readings = np.tile(facets.readings(SENSOR, np.zeros(8)), (3, 1))
    readings[1, 0] = np.nan
    readings[2] = np.nan
    columns = Measurement(facets.load("paper")).poses(Samples(readings)).columns()
    words = worded_columns(columns)
    assert columns["used"].tolist() == [7, 6, 0]
    assert words["used"].tolist() == ["abc", "bc", ""]
    assert words["status"].tolist()[0::2] == ["converged", "non finite"]
    for used in (words["used"], columns["used"]):
        assert detectors_of(used).tolist() == [[True] * 3, [False, True, True], [False] * 3]


@pytest.mark.parametrize(
    ("used", "common"),
    [
        (["abc", "ac", "abc"], [True, False, True]),
        (["abc", "abc"], [True, True, True]),
        # fewer than two are common: the two of most samples
        (["ac", "ab", "ab"], [True, True, False]),
        (["bc", "bc", "ac", "ab"], [False, True, True]),
    ],
)
def test_common_detectors_are_those_of_all_samples_and_two_at_least(used, common):
    assert common_detectors(detectors_of(used)).tolist() == common
