"""Blocks of readings under the light of a bench: the estimates of one reading at a time."""

import numpy as np
import pytest

import facets
from facets import Status
from facets.estimation import estimates

LIT = facets.load("bench-light").sensor
#: Numbers of readings that blocks cannot estimate.
SPOILT = [3, 11, 18]
WAYS = pytest.mark.parametrize(
    "way", [{}, {"beam": "known"}, {"beam": "known", "power": "unknown"}], ids=str
)


def noisy(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    some = np.zeros((count, 8))
    some[:, :6] = rng.uniform(-1, 1, (count, 6)) * [0.12, 0.12, 2, 6e-3, 6e-3, 6e-3]
    readings = facets.add_noise(LIT, facets.readings(LIT, some), rng)
    for number, place, wrong in zip(SPOILT, (4, 2, 0), (np.nan, 0.0, 50.0), strict=True):
        readings[number, place] = wrong
    return readings


def count_rows(monkeypatch) -> list[int]:
    """How many readings each call estimates one by one, from now on."""
    counts, real = [], estimates.one_by_one

    def counted(model, sensor, readings, *rest) -> None:
        counts.append(len(readings.values))
        real(model, sensor, readings, *rest)

    monkeypatch.setattr(estimates, "one_by_one", counted)
    return counts


@WAYS
def test_blocks_agree_with_one_reading_at_a_time(way, monkeypatch):
    """Near the end a quarter of the steps raise the sum of squares, since their derivatives leave
    out how what happens at the edges changes: blocks damp them, and derive again with all."""
    readings = noisy(200, seed=8)
    counts = count_rows(monkeypatch)
    found = facets.solve(LIT, readings, **way)
    assert sum(counts) == len(SPOILT)
    monkeypatch.setattr(estimates, "block_code", lambda *_, **__: None)
    other = facets.solve(LIT, readings, **way)
    assert sum(counts) > len(readings) + len(SPOILT)  # some of them with all derivatives, too
    np.testing.assert_array_equal(found.status, other.status)
    np.testing.assert_array_equal(found.used, other.used)
    np.testing.assert_array_equal(found.iterations, other.iterations)
    ok = other.converged
    assert ok.sum() >= len(readings) - len(SPOILT)
    assert (np.abs(found.state - other.state) <= 1e-8 * other.uncertainty)[ok].all()
    np.testing.assert_allclose(found.residual[ok], other.residual[ok], atol=1e-6)
    np.testing.assert_allclose(found.uncertainty[ok], other.uncertainty[ok], rtol=1e-9)


@WAYS
def test_a_reading_gives_the_same_bits_wherever_it_stands(way):
    """In any lane, beside any other, and alone; also where its steps are damped."""
    readings = noisy(60, seed=4)
    whole, solver = facets.solve(LIT, readings, **way), facets.Solver(LIT, **way)
    order = np.random.default_rng(1).permutation(60)
    for part, which in [
        (facets.solve(LIT, readings[order], **way), order),
        (facets.solve(LIT, readings[:13], **way), slice(13)),
        *((solver.solve(reading), n) for n, reading in enumerate(readings)),
    ]:
        for name in ("state", "covariance", "status", "residual", "iterations", "used"):
            expected = getattr(whole, name)[which]
            np.testing.assert_array_equal(getattr(part, name), expected)


def test_a_loop_goes_on_from_what_stalled_before():
    """From the pose before, a single reading that stalls ends where it does in a batch."""
    readings = noisy(60, seed=5)
    solver = facets.Solver(LIT, beam="known", start="previous")
    whole = facets.solve(LIT, readings, beam="known", start="previous")
    for reading, state, status in zip(readings, whole.state, whole.status, strict=True):
        found = solver.solve(reading)
        assert found.status == status
        if status == Status.CONVERGED:
            np.testing.assert_allclose(found.state, state, rtol=0, atol=1e-10)


def test_a_step_limit_ends_estimates_in_blocks_as_elsewhere(monkeypatch):
    readings = noisy(40, seed=6)
    found = [facets.solve(LIT, readings, beam="known", max_steps=n) for n in (6, 12)]
    monkeypatch.setattr(estimates, "block_code", lambda *_, **__: None)
    for ours, steps in zip(found, (6, 12), strict=True):
        other = facets.solve(LIT, readings, beam="known", max_steps=steps)
        np.testing.assert_array_equal(ours.status, other.status)
        np.testing.assert_array_equal(ours.iterations, other.iterations)
    assert (found[0].status == Status.MAX_STEPS).any()
