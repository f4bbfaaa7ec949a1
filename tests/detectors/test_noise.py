"""Noise of readings as drawn against noise as stated, by source and by kind of detector."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import Electronics, InputError, Knowledge, add_noise, standard_deviations
from facets.detectors import ELECTRIC, power_floor, step_variances, variances

#: Loud enough that no source hides behind the converter's steps.
LOUD = Electronics(
    voltage_noise=1e-6, current_noise=1e-10, ambient=0.05, bandwidth=1e5, adc_bits=14
)
READING = np.array([1.5, -2.0, 0.1, -4.0, 3.0, 0.08, 0.2, 0.1, 0.12])
MIDDLE = np.array([0, 0, 0.1] * 3)


def make_sensor(kind: str, electronics: Electronics = LOUD) -> facets.Sensor:
    return facets.Sensor(electronics=replace(electronics, kind=kind))


def test_two_layers_written_out_are_the_sum_of_all_sources():
    """Of what has light, and of what has none, is negative, or is no number at all."""
    sensor = make_sensor("duo-lateral")
    rng = np.random.default_rng(4)
    many = READING * rng.uniform(-1, 1.5, (200, 9))
    many[:3] = [[np.nan] * 9, [0.0] * 9, [3.0, -40.0, 0.01] * 3]
    summed = variances(sensor, many).sum(axis=-1)
    np.testing.assert_allclose(standard_deviations(sensor, many) ** 2, summed, rtol=1e-13)


@pytest.mark.parametrize(
    ("kind", "count", "tolerance"),
    [
        ("duo-lateral", 100_000, 0.01),
        ("pincushion", 100_000, 0.01),
        # off its middle, where what one axis takes from the other is left out
        pytest.param("tetra-lateral", 20_000, 0.05, marks=pytest.mark.slow),
        (None, 20_000, 0.03),
    ],
)
def test_noise_is_as_large_as_stated(kind, count, tolerance):
    sensor = make_sensor(kind) if kind else facets.Sensor()
    noise = add_noise(sensor, np.tile(READING, (count, 1)), np.random.default_rng(2)) - READING
    stated = standard_deviations(sensor, READING)
    assert noise.std(axis=0) == pytest.approx(stated, rel=tolerance)
    assert (np.abs(noise.mean(axis=0)) < (0.02 if kind else 0.03) * stated).all()


def test_a_converters_steps_leave_as_much_in_a_mean_as_stated():
    """Means of 400 readings at each of 600 places: variances to 15 %, since 600 draws leave 6 %.

    At a detector's middle opposite electrodes err alike, and the formula takes them as independent.
    """
    step = 10.0 / 2**8 / 1e5
    noise = 0.2 * step / np.sqrt(np.pi / 2 * 1e4)
    quiet = Electronics(adc_bits=8, current_noise=noise, voltage_noise=0.0, resistance=1e12)
    sensor = facets.Sensor(electronics=quiet)
    rng = np.random.default_rng(5)
    off_middle = np.array([1.5, -2.0, 0.1, -4.0, 3.0, 0.08, 2.5, 1.5, 0.12])
    exact = off_middle * (1 + 0.1 * rng.standard_normal((600, 9)))
    noisy = add_noise(sensor, np.repeat(exact[:, None], 400, axis=1), rng)
    spread = (noisy.mean(axis=1) - exact).var(axis=0)
    assert spread == pytest.approx(step_variances(sensor, exact).mean(axis=0), rel=0.15)


def test_each_source_is_what_its_formula_says():
    """Of a spot in the middle of a duo-lateral PSD, by hand."""
    parts = dict(zip(ELECTRIC, variances(make_sensor("duo-lateral"), MIDDLE)[0], strict=True))
    light, q, kt = 0.4 * 1e-4, 1.602176634e-19, 1.380649e-23 * 296
    scale = 13.0**2 / light**2 / 2  # of the variance of one electrode's current
    amplifier = (1e-6 / 1e4) ** 2 + 1e-20 + 4 * kt / 1e5
    assert parts == pytest.approx(
        {
            "shot noise": scale * 2 * q * light / 2 * 1e5,
            "dark and ambient": scale * 2 * q * (1e-8 + 0.4 * 5e-5) / 2 * 1e5,
            "resistance": scale * 4 * kt * 1e5 / 1e4,
            "amplifier": scale * amplifier * 1e5,
            "ADC": scale * (10 / 2**14 / 1e5) ** 2 / 12,
        }
    )


@pytest.mark.parametrize("kind", [None, "tetra-lateral"])
def test_a_spot_past_its_edge_is_no_reading(kind):
    """Every converged pose is right: 0.1 mm past an edge is a thousand standard uncertainties."""
    sensor = make_sensor(kind, Electronics()) if kind else facets.Sensor()
    rng = np.random.default_rng(5)
    states = np.zeros((300, 8))
    states[:, 2] = rng.uniform(-9, 9, 300)
    states[:, 5] = rng.uniform(-0.02, 0.02, 300)
    noisy = add_noise(sensor, facets.readings(sensor, states), rng)
    missed = np.repeat(~facets.reaches(sensor, states), 3, axis=1)
    assert 0 < missed.sum() < missed.size
    assert np.isnan(noisy[missed]).all()
    solution = facets.solve(sensor, noisy, beam="known")
    error = np.abs(solution.state - states)[solution.ok, :6]
    assert (error < 10 * solution.uncertainty[solution.ok, :6]).all()
    assert not (solution.used & missed[:, ::3]).any()


@pytest.mark.parametrize("kind", ["duo-lateral", "pincushion"])
def test_a_spot_up_to_its_edge_is_read_where_it_lies(kind):
    sensor = make_sensor(kind, Electronics(adc_bits=24))
    at_edge = np.array([6.5, -6.5, 0.1, -6.4999, 6.495, 0.1, np.nextafter(6.5, 7), 0, 0.1])
    noisy = add_noise(sensor, np.tile(at_edge, (400, 1)), np.random.default_rng(6))
    assert np.isnan(noisy[:, 6:]).all()
    deviation = standard_deviations(sensor, at_edge)[:6]
    assert (np.abs(noisy[:, :6].mean(axis=0) - at_edge[:6]) < deviation / 4).all()


def test_saturated_amplifiers_give_no_reading():
    small = Electronics(adc_range=1.0)  # 10 uA; half of 400 uA flows into each electrode
    noisy = add_noise(facets.Sensor(electronics=small), 10 * MIDDLE, np.random.default_rng(0))
    assert np.isnan(noisy).all()


def test_the_solver_weighs_by_the_same_model():
    """Estimates of electrode readings reach the bound, spots off their detectors' middles."""
    sensor = make_sensor("duo-lateral")
    states = np.tile([0.05, -0.05, 2.0, 3e-3, -4e-3, 8e-3, 0, 0], (20_000, 1))
    noisy = add_noise(sensor, facets.readings(sensor, states), np.random.default_rng(3))
    solution = facets.solve(sensor, noisy, start=states, threads=0)
    assert solution.converged.all()
    error = (solution.state - states)[:, :6]
    bound = facets.uncertainties(sensor, states[:1], Knowledge())[0]
    assert error.std(axis=0) == pytest.approx(bound, rel=0.03)
    assert (np.abs(error.mean(axis=0)) < 0.05 * bound).all()


def test_the_dark_floor():
    sensor = make_sensor("duo-lateral")
    dark = standard_deviations(sensor, MIDDLE * 1e-11)[2]
    assert power_floor(sensor) == pytest.approx(dark, rel=1e-6)
    assert power_floor(facets.Sensor()) == facets.Noise().power


def test_impossible_electronics_are_refused():
    for wrong in ({"kind": "quadrant"}, {"bandwidth": 0}, {"ambient": -1}):
        with pytest.raises(InputError, match="allowed"):
            Electronics(**wrong)
