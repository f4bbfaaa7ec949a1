"""Readings of which each has a sensor of its own: the same as one call of solve for each."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import Knowledge, Prior
from facets.estimation import knowledge_of, solve_each
from facets.model import VariedSensors, effects, parameters

PLAIN = facets.load("paper").sensor
LIT = facets.load("bench-light").sensor
STATE = np.array([0.02, -0.01, 0.1, 1e-3, -2e-3, 1e-3, 0, 0])


def draws(sensor: facets.Sensor, count: int) -> tuple[VariedSensors, np.ndarray, Knowledge]:
    rng = np.random.default_rng(1)
    values = parameters(sensor) + 1e-4 * rng.standard_normal((count, 30))
    light = None
    if sensor.light.on:
        light = effects(sensor) * (1 + 1e-3 * rng.standard_normal((count, 36)))
    reading = facets.add_noise(sensor, np.tile(facets.readings(sensor, STATE), (count, 1)), rng)
    place, power = 1e-3 * rng.standard_normal((count, 2)), values[:, 0].copy()
    return (
        VariedSensors(sensor, values, light),
        reading,
        Knowledge(Prior(place, 0.0), Prior(power, 0.0)),
    )


def compare(sensors: VariedSensors, values: np.ndarray, knowledge: Knowledge) -> np.ndarray:
    """Check each row against `facets.solve`; the statuses."""
    found = solve_each(sensors, values, knowledge)
    for row in range(len(values)):
        known = knowledge_of(knowledge, row)
        one = facets.solve(sensors.one(row), values[row], beam=known.beam, power=known.power)
        assert found.status[row] == one.status
        assert found.states[row, :8] == pytest.approx(one.state, rel=1e-9, abs=1e-12, nan_ok=True)
        assert found.used[row].tolist() == one.used.tolist()
    return found.status


@pytest.mark.parametrize("case", ["known", "free", "prior", "power unknown", "both priors"])
def test_each_reading_is_solved_with_its_own_sensor(case):
    sensors, values, knowledge = draws(PLAIN, 21)
    place = knowledge.beam.mean
    knowledge = {
        "known": knowledge,
        "free": replace(knowledge, beam="free"),
        "prior": replace(knowledge, beam=Prior(place, 0.005)),
        "power unknown": replace(knowledge, power="unknown"),
        "both priors": Knowledge(Prior(place, 0.005), Prior(knowledge.power.mean, 0.003)),
    }[case]
    assert (compare(sensors, values, knowledge) == facets.Status.CONVERGED).all()


@pytest.mark.slow
@pytest.mark.parametrize("beam", ["free", "known"])
def test_real_light_is_solved_with_its_own_sensor(beam):
    sensors, values, knowledge = draws(LIT, 19)
    if beam == "free":
        knowledge = replace(knowledge, beam="free")
    assert (compare(sensors, values, knowledge) == facets.Status.CONVERGED).all()


def test_readings_without_a_pose_and_sensors_that_cannot_be_keep_their_places():
    sensors, values, knowledge = draws(PLAIN, 10)
    values[2] = np.nan
    values[3, 2] = 0.0
    values[5, 0] = 6.6
    sensors.parameters[7, 6] = -0.1
    found = solve_each(sensors, values, knowledge)
    assert found.status[7] == facets.Status.NON_FINITE
    good = np.arange(10) != 7
    rest = Knowledge(Prior(knowledge.beam.mean[good], 0.0), Prior(knowledge.power.mean[good], 0.0))
    statuses = compare(sensors.rows(good), values[good], rest)
    assert (found.status[good] == statuses).all()
    assert np.isnan(found.states[[2, 3, 5, 7]]).all()


@pytest.mark.slow
def test_cut_light_is_solved_one_by_one():
    sensor = replace(PLAIN, apertures=facets.core.sensor.Apertures(detectors=True))
    sensors, values, knowledge = draws(sensor, 3)
    assert sensors.kind is None
    assert (compare(sensors, values, knowledge) == facets.Status.CONVERGED).all()
