"""The independent program beside which distributions are propagated."""

import numpy as np
import pytest
from facets.experiments.studies import propagation

import facets
from facets.model import parameters


@pytest.mark.slow
@pytest.mark.parametrize("case", list(propagation.cases()))
def test_both_programs_solve_the_same_draws_alike(case):
    sensor, options, state = propagation.cases()[case]
    numbers = np.array([parameters(sensor)])
    own = propagation.integrate_facets(numbers, np.append(state, sensor.beam.power)[None])[0]
    assert own == pytest.approx(facets.readings(sensor, state), abs=1e-11)
    assert propagation.compare_pairs(sensor, options, state, 25, 3) < 1e-6
