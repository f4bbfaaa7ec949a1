"""One solver, and one sensor, for many calls at once: each has memory of its own."""

import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.estimation import prepared

SENSOR = facets.Sensor()


def path_of(seed: int) -> np.ndarray:
    """Eight paths of 200 states."""
    size = np.array([0.1, 0.1, 3, 5e-3, 5e-3, 5e-3, 0, 0])
    return size * np.random.default_rng(seed).uniform(-1, 1, (8, 200, 8))


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
        (SENSOR, {}),
        (SENSOR, {"start": "previous"}),
        (SENSOR, {"power": "unknown", "accept_unchecked": True}),
        (replace(SENSOR, electronics=facets.Electronics()), {}),
        (facets.load("bench-light").sensor, {"start": "previous"}),
    ],
    ids=["plain", "warm", "unknown power", "electronics", "bench light"],
)
def test_threads_may_share_a_solver(eager_threads, sensor, options):
    """Eight of them solve eight paths by one solver, and each gets what it would get alone."""
    path = path_of(8)
    readings = facets.readings(sensor, path)
    solver = facets.Solver(sensor, **options)
    expected = np.empty((8, 200, 8))
    for k in range(8):
        alone = facets.Solver(sensor, **options)
        expected[k] = [alone.solve(reading).state for reading in readings[k]]

    def solved(k: int) -> list[np.ndarray]:
        return [solver.solve(reading).state for reading in readings[k]]

    found = eager_threads(solved)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_allclose(found, path, atol=1e-8)


def test_threads_may_ask_for_single_readings_of_one_sensor(eager_threads):
    path = path_of(9)
    readings, slopes = facets.readings(SENSOR, path), facets.jacobian(SENSOR, path)

    def there_and_back(k: int) -> None:
        for n, state in enumerate(path[k]):
            np.testing.assert_array_equal(facets.readings(SENSOR, state), readings[k, n])
            np.testing.assert_array_equal(facets.jacobian(SENSOR, state), slopes[k, n])
            found = facets.solve(SENSOR, readings[k, n]).state
            np.testing.assert_allclose(found, state, atol=1e-8)

    eager_threads(there_and_back)


def test_a_solve_may_interrupt_another_one(monkeypatch):
    """As a signal's handler does: both have memory of their own."""
    sensor = replace(SENSOR, electronics=facets.Electronics())
    states = path_of(1)[0, :2]
    readings, solver = facets.readings(sensor, states), facets.Solver(sensor)
    inner, plain = [], prepared.standard_deviations

    def interrupt(*arguments):
        monkeypatch.setattr(prepared, "standard_deviations", plain)
        inner.append(solver.solve(readings[1]))
        return plain(*arguments)

    monkeypatch.setattr(prepared, "standard_deviations", interrupt)
    outer = solver.solve(readings[0])
    np.testing.assert_allclose(outer.state, states[0], atol=1e-8)
    np.testing.assert_allclose(inner[0].state, states[1], atol=1e-8)
