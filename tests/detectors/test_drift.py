"""Slow noise as drawn against its law; its density: tests/characterization/test_pose_density.py."""

import numpy as np
import pytest
from scipy import stats

from facets.detectors import draw_walk

COUNT, STEP, DRAWS = 400, 0.05, 300
AMPLITUDE = 1.5


def draw_walks(count=COUNT, seed=7):
    rng = np.random.default_rng(seed)
    return draw_walk(np.full(DRAWS, AMPLITUDE**2), count, STEP, rng)


@pytest.mark.parametrize("place", [1, COUNT // 10, COUNT // 2, COUNT - 1])
def test_a_walk_spreads_by_its_law_up_to_the_end_of_the_record(place):
    """Over 300 draws, within what chance leaves in 9999 of 10000 cases."""
    walks = draw_walks()
    assert (walks[0] == 0).all()
    ratio = (walks[place] ** 2).sum() / (2 * np.pi**2 * AMPLITUDE**2 * place * STEP)
    low, high = stats.chi2.interval(0.9999, DRAWS)
    assert low < ratio < high


def test_the_second_half_of_a_walk_goes_its_own_way():
    walks = draw_walks()
    first, second = walks[COUNT // 2], walks[-1] - walks[COUNT // 2]
    assert abs(np.corrcoef(first, second)[0, 1]) < 4 / np.sqrt(DRAWS)


def test_a_seed_gives_the_same_walk_and_a_longer_record_goes_on_from_it():
    np.testing.assert_array_equal(draw_walks(), draw_walks())
    np.testing.assert_array_equal(draw_walks(2 * COUNT)[:COUNT], draw_walks())
    assert draw_walks(1).tolist() == [[0.0] * DRAWS]
