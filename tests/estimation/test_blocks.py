"""Blocks of readings: the same estimates as one reading at a time, whatever stands beside them."""

from dataclasses import replace

import numpy as np
import pytest
from sensors import SENSORS, states

import facets
from facets import Prior, Status
from facets.estimation import blocks, estimates, plan, problem, solution, straight
from facets.model import evaluators, packed_vectors

SENSOR = facets.Sensor()
WAYS = [
    {},
    {"beam": "known"},
    {"power": "unknown", "accept_unchecked": True},
    {"beam": "known", "accept_unchecked": True},
    {"beam": "known", "power": "unknown"},
    {"beam": Prior((0.01, -0.02), 0.005)},
    {"power": Prior(0.3, 1e-3)},
]


def seen(sensor: facets.Sensor, count: int, seed: int, offset: float = 0.1) -> np.ndarray:
    """States whose spots all lie on their detectors."""
    some = states(12 * count, seed=seed, offset=offset, angle=0.01)
    kept = some[facets.reaches(sensor, some).all(axis=1)]
    assert len(kept) >= count
    return kept[:count]


def one_by_one(sensor, readings, beam="free", power="known", start="zero", max_steps=50,
               accept_unchecked=False):  # fmt: skip
    """The estimates of the code for one reading, without blocks."""
    shape = readings.shape[:1]
    todo = plan.make_plan(sensor, facets.Knowledge(beam, power), shape=shape)
    found = problem.empty_results(len(readings), True)
    sigmas = np.empty((0, 9))
    if sensor.electronics is not None:
        sigmas = plan.standard_deviations(sensor, readings)
    estimates.one_by_one(
        evaluators.linearisation(sensor),
        sensor,
        problem.Readings(readings, sigmas),
        todo.limits,
        problem.FitProblem(
            todo.means, todo.weights, todo.free,
            plan.start_states(sensor, start, todo, readings, shape), False, max_steps, True,
            accept_unchecked,
        ),
        found,
    )  # fmt: skip
    return solution.solution(found, shape, plan.chance_of(sensor, todo))


def agree(ours: facets.Solution, other: facets.Solution, sensor: facets.Sensor) -> None:
    """The same statuses, and the same poses as near as rounding and the last step let them be.

    A fit has arrived when its next step would change it by less than 1e-6 sigma.
    """
    np.testing.assert_array_equal(ours.status, other.status)
    np.testing.assert_array_equal(ours.used, other.used)
    assert np.abs(ours.iterations - other.iterations).max() <= 1
    np.testing.assert_array_equal(ours.checks, other.checks)
    ok = other.converged
    away = np.abs(ours.state - other.state)[ok]
    assert (away <= 1e-12 + 1e-6 * other.uncertainty[ok]).all()
    np.testing.assert_allclose(ours.residual[ok], other.residual[ok], atol=1e-5, rtol=1e-6)
    scale = other.uncertainty[ok][:, :, None] * other.uncertainty[ok][:, None, :]
    assert (np.abs(ours.covariance - other.covariance)[ok] <= 1e-5 * scale + 1e-300).all()


def noisy(sensor: facets.Sensor, count: int, seed: int, offset: float = 0.15) -> np.ndarray:
    """Noisy readings of states some of which are far off, with a few that are spoilt."""
    readings = facets.readings(sensor, seen(sensor, count, seed, offset))
    readings = facets.add_noise(sensor, readings, np.random.default_rng(seed))
    readings[3, 4], readings[11, 2], readings[18, 0] = np.nan, 0.0, 50.0
    readings[30] += 0.3
    return readings


@pytest.mark.parametrize("name", ["paper", "skewed1", "skewed4"])
@pytest.mark.parametrize("way", WAYS, ids=str)
def test_blocks_agree_with_one_reading_at_a_time(name, way):
    sensor = SENSORS[name]
    readings = noisy(sensor, 300, seed=8)
    found = facets.solve(sensor, readings, **way)
    assert found.converged.sum() > 150
    agree(found, one_by_one(sensor, readings, **way), sensor)


def test_blocks_agree_where_starts_are_far_off():
    """Steps that are damped, go into the dark or stall are those of one reading at a time."""
    some = seen(SENSOR, 400, 6)
    off = np.random.default_rng(1).uniform(-1, 1, some.shape)
    start = some + off * [0.2, 0.2, 5, 0.2, 0.2, 0.2, 0.2, 0.2]
    readings = facets.readings(SENSOR, some)
    found, other = (
        facets.solve(SENSOR, readings, start=start),
        one_by_one(SENSOR, readings, start=start),
    )
    np.testing.assert_array_equal(found.status, other.status)
    assert np.abs(found.state - other.state)[found.converged].max() < 1e-10


def test_blocks_weigh_by_electronics_as_one_at_a_time_does():
    sensor = replace(SENSOR, electronics=facets.Electronics(kind="pincushion"))
    readings = facets.readings(SENSOR, seen(SENSOR, 60, 2))
    agree(facets.solve(sensor, readings), one_by_one(sensor, readings), sensor)


def test_most_readings_stay_in_their_blocks():
    readings = facets.readings(SENSOR, seen(SENSOR, 200, 3, 0.15))
    todo = plan.make_plan(SENSOR, facets.Knowledge())
    asked = problem.FitProblem(
        todo.means, todo.weights, todo.free,
        plan.start_states(SENSOR, "zero", todo, readings, (200,)), False, 50, True, False,
    )  # fmt: skip
    given = problem.Readings(readings, np.empty((0, 9)))
    found = problem.empty_results(200, True)
    code = estimates.block_code(SENSOR, asked)
    left = blocks.estimate(code, packed_vectors(SENSOR), given, todo.limits, asked, found)
    assert len(left) < 40
    found = problem.empty_results(200, True)
    one = asked._replace(max_steps=1)
    left = blocks.estimate(code, packed_vectors(SENSOR), given, todo.limits, one, found)
    assert len(left) == 200


@pytest.mark.parametrize("way", [{}, {"beam": "known", "power": "unknown"}], ids=str)
def test_a_reading_gives_the_same_bits_wherever_it_stands(way):
    """In any lane, beside any other, in batches of any length; among them what leaves its block."""
    readings = noisy(SENSOR, 44, seed=4)
    whole = facets.solve(SENSOR, readings, **way)
    names = ("state", "covariance", "status", "residual", "iterations", "power", "used")

    def same(part: facets.Solution, which) -> None:
        for name in names:
            np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[which])

    order = np.random.default_rng(1).permutation(44)
    same(facets.solve(SENSOR, readings[order], **way), order)
    for length in range(1, 18):
        same(facets.solve(SENSOR, readings[:length], **way), slice(length))
        same(facets.solve(SENSOR, readings[-length:], **way), slice(-length, None))
    one = facets.Solver(SENSOR, **way)
    for n, reading in enumerate(readings):
        same(facets.solve(SENSOR, reading, **way), n)
        same(one.solve(reading), n)


def test_starts_and_means_of_each_reading_stay_with_it():
    some = seen(SENSOR, 11, 9)
    readings = facets.readings(SENSOR, some)
    beam = Prior(some[:, 6:], 1e-3)
    whole = facets.solve(SENSOR, readings, beam=beam, start=some + 1e-4)
    for n in range(11):
        one = facets.solve(SENSOR, readings[n], beam=Prior(some[n, 6:], 1e-3), start=some[n] + 1e-4)
        np.testing.assert_array_equal(one.state, whole.state[n])
    assert (whole.status == Status.CONVERGED).all()


def test_threads_do_not_change_bits():
    readings = facets.readings(SENSOR, seen(SENSOR, 2050, 5))
    one, two = (facets.solve(SENSOR, readings, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.state, two.state)
    np.testing.assert_array_equal(one.covariance, two.covariance)


class Floats:
    """What straight code asks of a writer, for plain floats."""

    @staticmethod
    def function(name: str, x: float) -> float:
        assert name == "sqrt"
        return float(np.sqrt(x))


@pytest.mark.parametrize("count", [6, 8, 9])
def test_straight_linear_algebra_agrees_with_lapack_or_says_no(count):
    rng = np.random.default_rng(3)
    matrix, residuals = rng.normal(size=(9, count)), rng.normal(size=9)
    normal, right = straight.normal_equations(matrix.T.tolist(), residuals.tolist())
    factor, fine = straight.cholesky(Floats, normal)
    assert fine
    step, gain = straight.solution(factor, right)
    exact, rest = np.linalg.lstsq(matrix, residuals, rcond=None)[:2]
    np.testing.assert_allclose(step, exact, rtol=1e-8)
    assert gain == pytest.approx(residuals @ residuals - (rest[0] if len(rest) else 0), rel=1e-9)
    np.testing.assert_allclose(
        straight.inverse(factor), np.linalg.inv(matrix.T @ matrix), rtol=1e-7
    )
    matrix[:, -1] = matrix[:, 0] * (1 + 1e-6 * rng.normal(size=9))
    normal, _ = straight.normal_equations(matrix.T.tolist(), residuals.tolist())
    assert not straight.cholesky(Floats, normal)[1]
