"""Whatever runs the text of the optics agrees with Python's floats, and no pose minds others."""

import contextlib
import io
import os
import platform
import shutil
import subprocess
import sys

import numpy as np
import pytest
from executions import EXECUTIONS, STATES, floats, sensor_of
from hypothesis import given, settings, strategies as st

import facets
from facets.model import arrays

EPSILON = np.finfo(float).eps
#: Turns and places that leave every block, or are no numbers.
SPOILT = (np.nan, np.inf, -np.inf, 1e6, 1.2, -0.8)


def numbers(end: float):
    return st.floats(-end, end)


@st.composite
def states(draw, kinds):
    """A state of the mirror, of one of the kinds of `STATES`."""
    kind = draw(st.sampled_from(kinds))
    reach, turn = 2.0 if kind == "far" else 0.2, 0.3 if kind == "turned" else 0.02
    state = [draw(numbers(end)) for end in (6, 6, 6, turn, turn, turn)]
    state += [place - draw(numbers(reach)) for place in state[:2]]
    if kind == "spoilt":
        state[draw(st.integers(0, 7))] = draw(st.sampled_from(SPOILT))
    return state


def units(task: str, sensor: facets.Sensor, at: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """One rounding of what is compared: of readings, what a rounding of the state moves them by and
    their own, of a place that of a way of 200 mm at least; of derivatives, of the largest of the
    places or powers in a column."""
    far = np.abs(np.nan_to_num(at, posinf=0, neginf=0)).max(axis=1)[:, None, None]
    if task == "footprints":
        # A rounding of the mirror's turn moves a spot by the square of its way over the distance.
        moved = np.nan_to_num(exact) ** 2 / 256
        return EPSILON * np.maximum(moved, np.maximum(256, far))
    power = np.arange(9) % 3 == 2
    if task == "readings":
        slopes = np.abs(np.nan_to_num(arrays.derivatives(sensor, at)))
        moved = slopes @ [10, 10, 10, 1, 1, 1, 10, 10]
        return EPSILON * (moved + np.maximum(np.abs(exact), np.where(power, 0, 200)))
    size, unit = np.abs(np.nan_to_num(exact)), np.empty(exact.shape)
    # Terms cancel that are as large as the way to the mirror; by the sensor, some mm a radian.
    least = 1.0 if task == "parameter_jacobian" else 1e-3
    for rows in (power, ~power):
        largest = size[:, rows].max(axis=1, keepdims=True)
        unit[:, rows] = np.maximum(largest, np.maximum(least, 1e-5 * far))
    return EPSILON * unit


CASES = [
    pytest.param(
        execution, light, id=f"{execution.name}-{light}",
        marks=[pytest.mark.slow] if light in execution.slow else [],
    )
    for execution in EXECUTIONS
    for light in execution.lights
]  # fmt: skip


@pytest.mark.parametrize(("execution", "light"), CASES)
def test_every_execution_agrees_with_floats(execution, light):
    if execution.program and not shutil.which(execution.program):
        pytest.skip(f"needs {execution.program}")
    rows = st.lists(states(execution.states), min_size=1, max_size=execution.rows)

    @settings(max_examples=execution.examples * settings().max_examples // 300)
    @given(st.integers(0, execution.sensors - 1), rows)
    def agrees(seed, rows):
        sensor, at = sensor_of(light, seed), np.array(rows)
        for task, ulps in execution.ulps.items():
            exact = (execution.reference or floats)(task, sensor, at)
            result, unit = execution.compute(task, sensor, at), units(task, sensor, at, exact)
            np.testing.assert_array_equal(np.isnan(result), np.isnan(exact))
            away = np.subtract(result, exact, where=result != exact, out=np.zeros_like(exact))
            off = np.abs(away)
            assert not (off > ulps * unit).any(), (task, np.nanmax(off / unit))

    agrees()


@pytest.mark.parametrize("light", ["ideal", "cut", pytest.param("bench", marks=pytest.mark.slow)])
def test_a_pose_has_the_same_bits_wherever_it_stands(light):
    """In any lane, beside any other, in batches of any length and shape."""
    functions = [facets.readings, facets.jacobian, facets.footprints]
    if light == "ideal":
        functions.append(facets.parameter_jacobian)

    @settings(max_examples=15)
    @given(st.lists(states(STATES), min_size=2, max_size=18), st.randoms())
    def same(rows, random):
        sensor, at = sensor_of(light, 3), np.array(rows)
        order = random.sample(range(len(at)), len(at))
        for function in functions:
            whole = function(sensor, at)
            np.testing.assert_array_equal(function(sensor, at[order]), whole[order])
            np.testing.assert_array_equal(function(sensor, at[None, ::2]), whole[None, ::2])
            for state, result in zip(at, whole, strict=True):
                np.testing.assert_array_equal(function(sensor, state.tolist()), result)

    same()


def test_threads_do_not_change_bits(monkeypatch):
    monkeypatch.setattr("facets.model.threads.MIN_ROWS_PER_THREAD", 1000)
    rng = np.random.default_rng(5)
    at = rng.uniform(-1, 1, (2100, 8)) * ([0.2] * 3 + [0.02] * 3 + [0.2] * 2)
    for function in (facets.readings, facets.jacobian, facets.footprints):
        alone, shared = (function(sensor_of("ideal", 2), at, threads=n) for n in (1, 2))
        np.testing.assert_array_equal(alone, shared)


#: Prints the bits of readings, derivatives and poses, of ideal light and of a bench's, with noise.
SCRIPT = """
import numpy as np
import facets
rng = np.random.default_rng(5)
states = np.zeros((45, 8))
states[:, :6] = rng.uniform(-1, 1, (45, 6)) * [0.15, 0.15, 2, 8e-3, 8e-3, 8e-3]
noise = rng.normal(size=(45, 9)) * ([2.6e-3, 2.6e-3, 4e-5] * 3)
for name in ("paper", "bench-light"):
    sensor = facets.load(name).sensor
    readings = facets.readings(sensor, states)
    solution = facets.solve(sensor, readings + noise, beam="known")
    assert solution.converged.all()
    for result in (readings, facets.jacobian(sensor, states), solution.state, solution.covariance):
        assert np.isfinite(result).all()
        print(result.tobytes().hex())
"""


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="other processors")
def test_another_processors_code_has_the_same_bits():
    """That of a plain processor, whose registers hold two numbers."""
    own = io.StringIO()
    with contextlib.redirect_stdout(own):
        exec(SCRIPT, {})
    environment = {**os.environ, "FACETS_CPU": "x86-64"}
    plain = subprocess.check_output([sys.executable, "-c", SCRIPT], env=environment, text=True)
    assert own.getvalue() == plain
