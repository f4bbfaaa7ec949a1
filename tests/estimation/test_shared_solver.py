"""One solver, and one sensor, for many calls at once: each has memory of its own."""

import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import facets

SENSOR = facets.Sensor()
WITH_ELECTRONICS = replace(SENSOR, electronics=facets.Electronics())
#: Eight paths of 80 states.
PATHS = np.random.default_rng(8).uniform(-1, 1, (8, 80, 8))
PATHS *= [0.1, 0.1, 3, 5e-3, 5e-3, 5e-3, 0, 0]


@pytest.fixture
def eager_threads():
    """Calls a function of 0 to 7 in a thread each; they take turns as often as Python lets them."""
    interval, together = sys.getswitchinterval(), threading.Barrier(8)
    sys.setswitchinterval(1e-6)

    def in_threads(function):
        def run(k):
            together.wait()
            return function(k)

        with ThreadPoolExecutor(8) as pool:
            return list(pool.map(run, range(8)))

    yield in_threads
    sys.setswitchinterval(interval)


@pytest.mark.parametrize(
    ("sensor", "options"),
    [
        (SENSOR, {"start": "previous"}),
        (WITH_ELECTRONICS, {}),
    ],
)
def test_threads_may_share_a_solver(eager_threads, sensor, options):
    """Eight of them solve eight paths by one solver, and each gets what it would get alone."""
    readings = facets.readings(sensor, PATHS)

    def solve(solver, k):
        return [solver.solve(reading).state for reading in readings[k]]

    expected = [solve(facets.Solver(sensor, **options), k) for k in range(8)]
    shared = facets.Solver(sensor, **options)
    states = eager_threads(lambda k: solve(shared, k))
    np.testing.assert_array_equal(states, expected)
    np.testing.assert_allclose(states, PATHS, atol=1e-8)


def test_threads_may_ask_for_single_readings_of_one_sensor(eager_threads):
    readings, slopes = facets.readings(SENSOR, PATHS), facets.jacobian(SENSOR, PATHS)

    def there_and_back(k: int) -> None:
        for state, reading, slope in zip(PATHS[k], readings[k], slopes[k], strict=True):
            np.testing.assert_array_equal(facets.readings(SENSOR, state), reading)
            np.testing.assert_array_equal(facets.jacobian(SENSOR, state), slope)
            np.testing.assert_allclose(facets.solve(SENSOR, reading).state, state, atol=1e-8)

    eager_threads(there_and_back)
