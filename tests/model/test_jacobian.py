"""The derivatives, against differences of the forward text at many digits."""

import numpy as np
import pytest
from digits import differences, many_digits, precise
from sensors import SENSORS, states

import facets
from facets.model import parameters
from facets.optics import build_geometry
from facets.optics.forward import readings

NOMINAL = np.zeros(8)
ON_AN_EDGE = np.array([-0.1, 0, 0.3, 0, 0, 0, 0, 0])
CASES = [
    ("paper", NOMINAL),
    ("paper", ON_AN_EDGE),
    *((name, states(1, seed=20 + n)[0]) for n, name in enumerate(SENSORS)),
]
#: So many of them in the suite; all of them are a study.
FEW = 6


def forward(sensor_parameters: list, state: list) -> np.ndarray:
    rows = readings(build_geometry(tuple(sensor_parameters)), tuple(state))
    return np.array(rows, dtype=object).ravel()


def assert_close(closed: np.ndarray, exact: np.ndarray) -> None:
    """1e-10 of the entry; of 1e-4 of the largest in its column, or of 1e-4, where that is more.

    Entries that are zero by symmetry are left with the rounding of the terms that cancel in them.
    """
    scale = np.maximum(np.maximum(np.abs(exact), 1e-4 * np.abs(exact).max(axis=0)), 1e-4)
    assert (np.abs(closed - exact) <= 1e-10 * scale).all()


@pytest.mark.parametrize(
    ("name", "state"),
    [*CASES[:FEW], *(pytest.param(*case, marks=pytest.mark.study) for case in CASES[FEW:])],
    ids=range(len(CASES)),
)
@pytest.mark.slow
def test_derivatives_by_state_and_by_parameters(name, state):
    sensor = SENSORS[name]
    with many_digits():
        given, at = precise(parameters(sensor)), precise(state)
        by_state = differences(at, lambda moved: forward(given, moved))
        by_parameters = differences(given, lambda moved: forward(moved, at))
    assert_close(facets.jacobian(sensor, state), by_state)
    assert_close(facets.parameter_jacobian(sensor, state), by_parameters)


@pytest.mark.parametrize("name", SENSORS)
def test_the_error_of_central_differences_falls_as_the_square_of_the_step(name):
    """On the public functions; steps large enough that rounding plays no part."""
    sensor, scale = SENSORS[name], np.array([0.02, 0.02, 0.02, 1e-3, 1e-3, 1e-3, 0.02, 0.02])
    for state in states(5, seed=30):
        closed = facets.jacobian(sensor, state) * scale
        errors = []
        for step in (1.0, 0.1):
            moved = step * np.diag(scale)
            difference = facets.readings(sensor, state + moved) - facets.readings(
                sensor, state - moved
            )
            errors.append(np.abs(difference.T / (2 * step) - closed).max())
        assert errors[1] < errors[0] / 90


def test_shapes_do_not_change_bits():
    sensor, some_states = SENSORS["skewed3"], states(6, seed=31)
    batch = facets.jacobian(sensor, some_states)
    assert batch.shape == (6, 9, 8)
    assert facets.parameter_jacobian(sensor, some_states.reshape(2, 3, 8)).shape == (2, 3, 9, 30)
    for state, rows in zip(some_states, batch, strict=True):
        assert (facets.jacobian(sensor, state) == rows).all()


def test_an_unlit_detector_has_no_derivatives():
    tilted = np.zeros(8)
    tilted[4] = 0.8
    assert np.isnan(facets.jacobian(facets.Sensor(), tilted)[:3]).all()
    assert np.isnan(facets.parameter_jacobian(facets.Sensor(), tilted)[:3]).all()


def test_parameters_have_names():
    assert len(facets.PARAMETERS) == len(set(facets.PARAMETERS)) == 30
    assert facets.PARAMETERS[0] == "beam.power"
    assert facets.PARAMETERS[-1] == "psd_c.yaw"
