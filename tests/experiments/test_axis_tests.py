"""A short case of the study of axis tests."""

import numpy as np
import pytest
from facets.experiments.studies import axis_tests


@pytest.mark.slow
def test_expanded_uncertainties_hold_the_truth_of_drawn_axes():
    """Of 72 quantities of 12 axes each; those of one axis are correlated."""
    held = [axis_tests.compare_with_truth(seed) for seed in range(300, 312)]
    assert np.mean([one.quantities for one in held]) > 0.92
    assert np.mean([one.positions for one in held]) > 0.92
