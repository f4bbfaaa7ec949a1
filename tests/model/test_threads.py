"""Threads share the work and change nothing else."""

import numpy as np
import pytest
from sensors import SENSORS, states

import facets
from facets.core.errors import InputError
from facets.model.threads import cores, part_of, share


@pytest.mark.parametrize(("rows", "threads"), [(0, 1), (5, 4), (2000, 2), (10_001, 3), (4000, 0)])
def test_every_row_is_done_once(rows, threads):
    done = np.zeros(rows, int)

    def run(part):
        done[part] += 1

    share(run, rows, threads)
    assert (done == 1).all()


def test_results_do_not_depend_on_threads():
    sensor, some_states = SENSORS["skewed4"], states(5000, seed=2)
    one, three = (facets.readings(sensor, some_states, threads=k) for k in (1, 3))
    assert (one == three).all()
    one, three = (facets.jacobian(sensor, some_states, threads=k) for k in (1, 3))
    assert (one == three).all()
    beam = facets.Prior(some_states[:, 6:], 0.01)
    a, b = (facets.solve(sensor, facets.readings(sensor, some_states), beam=beam, threads=k)
            for k in (1, 3))  # fmt: skip
    np.testing.assert_array_equal(a.state, b.state)
    np.testing.assert_array_equal(a.covariance, b.covariance)


def test_what_all_share_is_not_split():
    shared = np.zeros((1, 3))
    assert part_of(shared, slice(0, 2), 10) is shared


def test_bad_numbers_of_threads_are_named():
    assert cores() >= 1
    with pytest.raises(InputError, match="threads is -1"):
        share(print, 10, -1)
