"""Whatever the readings, the solver ends, and a converged pose explains them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensors import SENSORS, states

import facets
from facets import Status

ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)
PLACES = st.floats(-7, 7)
POWERS = st.floats(-0.1, 1)
PLAUSIBLE = st.tuples(*[PLACES, PLACES, POWERS] * 3)
ALMOST = st.tuples(*[st.one_of(PLACES, ANY), PLACES, st.one_of(POWERS, ANY)] * 3)
WAYS = st.sampled_from(
    [
        {},
        {"beam": "known"},
        {"beam": facets.Prior((0, 0), 1e-3)},
        {"power": "unknown"},
        {"power": "unknown", "accept_unchecked": True},
        {"beam": "known", "accept_unchecked": True},
        {"beam": "known", "power": "unknown"},
        {"method": "paper"},
    ]
)


KINDS = ("duo-lateral", "pincushion", "tetra-lateral")
PLAIN = facets.Sensor()
OTHERS = st.sampled_from(
    [
        *(facets.Sensor(electronics=facets.Electronics(kind=kind)) for kind in KINDS),
        facets.Sensor(apertures=facets.Apertures(beam=1.0, detectors=True, tip=0.1, gap=0.01)),
    ]
)


def weighted_residual(sensor, reading, solution) -> float:
    """Root of the sum of squares, from the public functions alone."""
    noise, beam = sensor.noise, facets.Beam(power=float(solution.power))
    bright = facets.Sensor(beam=beam, facets=sensor.facets, psds=sensor.psds)
    sigma = np.full(9, noise.power)
    sigma[0::3] = sigma[1::3] = noise.position * noise.at_power / reading[2::3]
    rest = (reading - facets.readings(bright, solution.state)) / sigma
    return float(np.sqrt((rest[np.repeat(solution.used, 3)] ** 2).sum()))


def check(sensor, reading, way) -> None:
    reading = np.array(reading)
    solution = facets.solve(sensor, reading, **way)
    assert int(solution.status) in set(Status)
    assert solution.iterations <= 100
    assert np.isfinite(solution.state).all() == solution.converged
    assert np.isnan(solution.state).all() != solution.converged
    assert np.isfinite(solution.covariance).all() == solution.converged
    assert solution.converged or not solution.ok
    if solution.converged and not way and sensor is PLAIN:
        explained = weighted_residual(sensor, reading, solution)
        assert explained == pytest.approx(float(solution.residual), rel=1e-3, abs=1e-5)


@given(PLAUSIBLE, WAYS)
@pytest.mark.slow
def test_plausible_readings(reading, way):
    check(PLAIN, reading, way)


@given(ALMOST, WAYS)
def test_readings_with_anything_in_them(reading, way):
    check(PLAIN, reading, way)


@given(OTHERS, ALMOST, WAYS)
@pytest.mark.slow
def test_readings_with_anything_in_them_of_sensors_with_more(sensor, reading, way):
    check(sensor, reading, way)


@pytest.mark.parametrize("name", SENSORS)
def test_far_off_the_beam_the_truth_is_found_or_none(name):
    """To 2.8 sigma of the smallest beam, from zero: no converged pose that is not the true one."""
    sensor = SENSORS[name]
    some = states(20_000, seed=5, offset=0.35)
    some = some[facets.reaches(sensor, some).all(axis=1)]
    solution = facets.solve(sensor, facets.readings(sensor, some), covariance=False, threads=0)
    assert solution.ok.mean() > 0.999
    assert np.abs(solution.state - some)[solution.ok].max() < 1e-9


@pytest.mark.parametrize("angle", [0.05, 0.2])
def test_starts_far_off_end_at_the_truth_or_say_why(angle):
    sensor = facets.Sensor()
    some = states(2000, seed=6, offset=0.1, angle=0.005)
    some = some[facets.reaches(sensor, some).all(axis=1)]
    off = np.random.default_rng(1).uniform(-1, 1, some.shape)
    start = some + off * [0.2, 0.2, 5, angle, angle, angle, 0.2, 0.2]
    solution = facets.solve(sensor, facets.readings(sensor, some), start=start)
    assert np.abs(solution.state - some)[solution.ok].max() < 1e-9
    assert solution.ok.mean() > 0.9


def test_outliers_do_not_hang():
    """One centroid 0.5 mm off: solved to something or not, in the steps allowed."""
    sensor = facets.Sensor()
    some = states(2000, seed=7, offset=0.1, angle=0.005)
    some = some[facets.reaches(sensor, some).all(axis=1)]
    readings = facets.readings(sensor, some)
    places = np.random.default_rng(2).choice([0, 1, 3, 4, 6, 7], len(some))
    readings[np.arange(len(some)), places] += 0.5
    solution = facets.solve(sensor, readings)
    assert solution.iterations.max() <= 50
    assert np.isnan(solution.state[~solution.ok]).all()
