import numpy as np
import pytest

from facets.characterization import sensitivity


@pytest.mark.parametrize("count", [2000, 2001])
def test_indices_are_the_shares_of_the_variance(count):
    x = np.random.default_rng(3).uniform(size=(3, count))
    rough = 2 * x[1] + np.sin(2 * np.pi * x[0]) ** 2
    table = {"a": x[0], "b": x[1], "c": x[2], "range_tz_mm": rough, "same": np.ones(count)}
    found = sensitivity.sensitivity(table, ["a", "b", "c"], ["range_tz_mm", "same"])
    assert list(found) == ["range_tz_mm"]  # what is the same for all designs follows nothing
    # Variances: 1/8 of the square of a sine, 4/12 of the double of a number from 0 to 1.
    for index, variance in zip(found["range_tz_mm"].values(), (1 / 8, 1 / 3, 0), strict=True):
        assert 0 < index.half < 0.05
        assert abs(index.value - variance / (1 / 8 + 1 / 3)) < 1.5 * index.half


def test_few_designs_have_no_indices():
    assert sensitivity.sensitivity({"range_tz_mm": np.ones(99)}, [], []) == {}
