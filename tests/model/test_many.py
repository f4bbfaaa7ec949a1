"""Many sensors in one call: the same bits as one by one, also where states leave their block."""

from __future__ import annotations

import numpy as np
import pytest

import facets
from facets.model import arrays, evaluate, vectors_of

SENSORS = [facets.load(name).sensor for name in ("paper", "singular", "skewed")]


@pytest.mark.parametrize("count", [1, 3, 8, 21])
def test_each_sensor_gives_what_it_gives_alone(count):
    rng = np.random.default_rng(count)
    states = rng.normal(size=(3 * count, 8)) * ([0.3] * 3 + [0.01] * 3 + [0.3] * 2)
    states[count // 2] = [2.0, 1.5, 0, 0, 0, 0, 0, 0]  # a facet is faint
    owner = np.repeat([0, 2, 3], count)  # the second has no states
    some = [SENSORS[0], SENSORS[0], *SENSORS[1:]]
    vectors = vectors_of(np.array([arrays.parameters(sensor) for sensor in some]))
    for name in ("readings", "derivatives", "footprints"):
        found = evaluate(name, vectors, owner, states)
        alone = [getattr(arrays, name)(some[n], states[owner == n]) for n in (0, 2, 3)]
        np.testing.assert_array_equal(found, np.concatenate(alone))
