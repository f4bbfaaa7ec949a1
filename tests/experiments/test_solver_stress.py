"""The short form of the study `solver_stress`: no wrong pose that nothing reveals."""

from collections import Counter

import numpy as np
import pytest
from facets.experiments.studies import solver_stress

SOME = ("paper", "bench", "catalogue", "bench-light", "singular", "skewed5 of the studies")


@pytest.mark.parametrize("trouble", solver_stress.TROUBLES)
@pytest.mark.slow
def test_no_wrong_pose_is_believed(trouble):
    rng, sensors = np.random.default_rng(3), solver_stress.every_sensor()
    total = Counter()
    for known in solver_stress.KNOWLEDGE:
        for name in SOME:
            total.update(solver_stress.count_outcomes(trouble, sensors[name], known, 200, rng))
    # a tail of a cut spot, a ten-thousandth of the light, can look like a whole one
    assert total["nothing"] <= (0 if trouble.aware else 2)
    assert trouble.corrupt is solver_stress.mask or total["poses"] > 10
    if trouble.name == "one number corrupted":
        assert total["misfit"] > 1000
        assert total["unseen"] > 100
    elif trouble.aware:
        assert total["wrong"] == 0
