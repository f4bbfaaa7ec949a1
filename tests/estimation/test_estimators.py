"""All executions of the estimator give the same poses: see `tests/helpers/estimators.py`."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from estimators import EXECUTIONS, Execution, Question, solve_batch
from facets.experiments.sensors import skew_sensor
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import facets
from facets import Prior, Status
from facets.estimation import has_fold

PAPER = facets.Sensor()
SENSORS = {
    "paper": PAPER,
    "bench": facets.load("bench").sensor,
    "pincushion": replace(PAPER, electronics=facets.Electronics(kind="pincushion")),
}
#: Those whose code takes seconds to compile, or which have second solutions.
SLOW_SENSORS = SENSORS | {
    "tetra-lateral": replace(PAPER, electronics=facets.Electronics(kind="tetra-lateral")),
    "light": facets.load("bench-light").sensor,
    "cut": replace(
        skew_sensor(0),
        apertures=facets.Apertures(beam=1.0, detectors=True, rim=5.0, tip=0.01, gap=0.005),
    ),
    "singular": facets.load("singular").sensor,
}
COUNT = 40
BEAMS = ("free", "known", Prior((0.01, -0.02), 0.005), Prior((0.01, -0.02), 0.0), "of each")
POWERS = ("known", "unknown", Prior(0.3, 0.003))
#: Half widths of a box of states, mm and rad.
BOX = np.array([0.15, 0.15, 3, 8e-3, 8e-3, 12e-3, 0.05, 0.05])
#: Statuses before a step is made.
SCREENED = (Status.NON_FINITE, Status.NO_LIGHT, Status.OUT_OF_RANGE, Status.UNCHECKED)


def states_in_light(sensor: facets.Sensor, rng: np.random.Generator) -> np.ndarray:
    states = rng.uniform(-1, 1, (30 * COUNT, 8)) * BOX
    return states[facets.reaches(sensor, states).all(axis=1)][:COUNT]


def spoil(readings: np.ndarray, rng: np.random.Generator) -> None:
    """Put into some readings what no pose gives, and leave out detectors of others."""
    rows, detector = rng.permutation(len(readings)), 3 * rng.integers(0, 3, len(readings))
    readings[rows[:3], detector[:3] + 1] = np.nan
    readings[rows[3:6], detector[3:6] + 2] = 0
    readings[rows[6:8], detector[6:8]] = 50
    readings[rows[8], detector[8] + 1] = -np.inf
    readings[rows[9]] += 0.3
    readings[rows[10:13], detector[10:13] + 2] *= 1.02


@st.composite
def questions(draw, sensors):
    """Noisy and spoilt readings of a sensor, and what is known of its beam."""
    sensor = draw(st.sampled_from([*sensors.values(), None]))
    if sensor is None:
        sensor = skew_sensor(draw(st.integers(0, 50)))
    rng = np.random.default_rng(draw(st.integers(0, 2**16)))
    states = states_in_light(sensor, rng)
    readings = facets.add_noise(sensor, facets.readings(sensor, states), rng)
    spoil(readings, rng)
    question = Question(sensor, readings)
    special = ["paper", "previous", "started", "few steps"]
    way = draw(st.sampled_from([*special, *product(BEAMS, POWERS, (False, True))]))
    if way == "paper":
        return question._replace(method="paper")
    if way == "previous":
        return question._replace(start=way, beam="known")
    if way == "few steps":
        return question._replace(beam="known", max_steps=draw(st.integers(2, 12)))
    if way == "started":
        off = rng.uniform(-1, 1, states.shape) * [0.2, 0.2, 3, 0.1, 0.1, 0.1, 0.2, 0.2]
        return question._replace(start=states + off)
    beam, power, accept = way
    beam = Prior(states[:, 6:], 0.003) if beam == "of each" else beam
    if isinstance(power, Prior):
        power = Prior(sensor.beam.power, power.sigma)
    return question._replace(beam=beam, power=power, accept_unchecked=accept)


def compare(execution: Execution, question: Question) -> None:
    answer, expected = execution.solve(question), solve_batch(question)
    converged = expected.status == Status.CONVERGED
    # where a sensor has a second solution, or a reading starts from the one before, rows are used
    sigmas, spread = execution.sigmas, execution.spread
    if sigmas == 0 and (has_fold(question.sensor) or not question.is_of_each()):
        sigmas = spread = 1e-6
    compared = converged.copy()
    if not execution.misfits:
        compared &= ~(expected.residual > expected.limit)
    if execution.screens:
        alike = execution.misfits | compared | np.isin(expected.status, SCREENED)
        np.testing.assert_array_equal(answer.status[alike], expected.status[alike])
        np.testing.assert_array_equal(answer.used, expected.used)
        assert np.isnan(answer.state[answer.status != Status.CONVERGED]).all()
    else:
        fitting = compared.sum()
        compared &= answer.status == Status.CONVERGED
        assert compared.sum() >= 0.9 * fitting
    if sigmas == 0:
        for name, ours, theirs in zip(answer._fields, answer, expected, strict=True):
            if ours is not None:
                np.testing.assert_array_equal(ours, theirs, name)
        return
    size = np.sqrt(np.einsum("nii->ni", expected.covariance))
    off = np.abs(answer.state - expected.state)
    rounding = 1e-12 if sigmas < 1e-3 else 1e-8
    assert (off <= sigmas * size + rounding)[compared].all()
    assert np.abs(answer.residual - expected.residual)[compared].max(initial=0) <= sigmas
    np.testing.assert_allclose(answer.power[compared], expected.power[compared], rtol=sigmas)
    if answer.covariance is not None:
        off = np.abs(answer.covariance - expected.covariance)
        scale = size[:, :, None] * size[:, None, :]
        assert (off <= spread * scale + 1e-300)[compared].all()
    if answer.limit is not None:
        np.testing.assert_allclose(answer.limit, expected.limit, rtol=1e-12)


def check(name: str, sensors: dict[str, facets.Sensor], count: int) -> None:
    """Compare an execution with batches for some questions that it can answer."""
    execution = EXECUTIONS[name]
    if not execution.exists:
        pytest.skip("this machine has no program that it needs")

    examples = max(1, count // execution.effort)

    @settings(max_examples=examples, phases=[Phase.generate], suppress_health_check=HealthCheck)
    @given(questions(sensors).filter(execution.can_answer))
    def compare_all(question: Question) -> None:
        compare(execution, question)

    compare_all()


@pytest.mark.parametrize("name", [name for name in EXECUTIONS if "light" not in name])
def test_an_execution_gives_the_poses_of_all_others(name):
    check(name, SENSORS, 4)


@pytest.mark.slow
@pytest.mark.parametrize("name", EXECUTIONS)
def test_an_execution_gives_the_poses_of_all_others_for_any_sensor(name):
    check(name, SLOW_SENSORS, 10)
