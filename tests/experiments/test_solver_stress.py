"""The short form of `facets.experiments.solver_stress`: no wrong pose that nothing tells of."""

from collections import Counter

import numpy as np
import pytest
from facets.experiments.solver_stress import KNOWLEDGE, TROUBLES, count_outcomes, every_sensor, mask

SOME = ("paper", "bench", "catalogue", "bench-light", "singular", "skewed5 of the studies")


@pytest.mark.parametrize("trouble", TROUBLES, ids=lambda trouble: trouble.name)
@pytest.mark.slow
def test_no_wrong_pose_is_believed(trouble):
    rng, sensors = np.random.default_rng(3), every_sensor()
    total: Counter[str] = Counter()
    for known in KNOWLEDGE:
        for name in SOME:
            total.update(count_outcomes(trouble, sensors[name], known, 200, rng))
    # a tail of a cut spot, a ten-thousandth of the light, can look like a whole one
    assert total["nothing"] <= (0 if trouble.aware else 2)
    assert trouble.spoil is mask or total["poses"] > 10
    if trouble.name == "one number spoilt":
        assert total["misfit"] > 1000
        assert total["unseen"] > 100
    elif trouble.aware:
        assert total["wrong"] == 0
