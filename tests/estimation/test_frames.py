"""Data frames of readings and poses come back as data frames, with their index."""

import pickle

import numpy as np
import pandas as pd
import pytest

import facets
from facets import InputError
from facets.core import STATE_COLUMNS

SENSOR = facets.load("paper").sensor
STATES = np.zeros((100, 8))
STATES[:, 2] = np.linspace(0, 1, 100)
INDEX = pd.date_range("2026-01-01", periods=100, freq="s")
READINGS = pd.DataFrame(facets.readings(SENSOR, STATES), INDEX, facets.READING)
TIP = facets.MeasuredObject(point=(0, 0, 50))


@pytest.mark.parametrize("count", [1, 5, 100])  # a few readings are solved on another way
def test_a_solution_goes_back_to_the_rows_of_its_readings(count):
    solution = facets.solve(SENSOR, READINGS[:count], beam="known")
    frame = pickle.loads(pickle.dumps(solution)).to_frame()
    assert frame.index.equals(INDEX[:count])
    np.testing.assert_allclose(frame.tz_mm, STATES[:count, 2], atol=1e-12)
    np.testing.assert_allclose(frame.u_roll_mrad, 1e3 * solution.uncertainty[:, 3])
    assert frame.status.eq("converged").all()
    assert frame.used.eq("abc").all()
    assert frame.attrs["units"]["u_roll_mrad"] == "mrad"


def test_solutions_of_arrays_of_any_shape_are_rows():
    readings = READINGS.to_numpy()
    assert len(facets.solve(SENSOR, readings[0]).to_frame()) == 1
    assert len(facets.solve(SENSOR, readings.reshape(20, 5, 9)).to_frame()) == 100
    bare = facets.solve(SENSOR, readings, covariance=False)
    assert not any(name.startswith("u_") for name in bare.to_frame())
    with pytest.raises(InputError, match="no covariance"):
        bare.to_frame(covariance=True)


def test_an_objects_pose_of_a_frame_has_the_covariance_of_its_columns():
    solution = facets.solve(SENSOR, READINGS, beam="known")
    expected = facets.transform(solution, TIP).to_frame()
    pd.testing.assert_frame_equal(
        facets.transform(solution.to_frame(covariance=True), TIP).to_frame(), expected
    )
    bare = facets.transform(solution.to_frame(), TIP).to_frame()
    assert list(bare) == list(expected)[:6]
    zero = facets.zero_pose(SENSOR, STATES[:5], beam="known")
    moved = facets.transform(solution.to_frame(covariance=True), TIP, zero)
    assert moved.covariance is None  # what a zero has in common with a frame is not known
    assert moved.to_frame().index.equals(INDEX)


def test_uncertainties_of_a_frame_are_a_frame():
    poses = pd.DataFrame(STATES, INDEX, facets.STATE)
    sizes = facets.mean_uncertainty(SENSOR, poses, 4, beam="known")
    steps = facets.difference_uncertainty(SENSOR, STATES[0], poses, 4, beam="known")
    plain = facets.mean_uncertainty(SENSOR, STATES, 4, beam="known")
    for frame in (sizes, steps):
        assert list(frame) == [f"u_{name}" for name in STATE_COLUMNS]
        assert frame.index.equals(INDEX)
    np.testing.assert_allclose(sizes.u_yaw_mrad, 1e3 * plain[:, 5])
