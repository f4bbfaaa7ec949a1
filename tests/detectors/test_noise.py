"""The electrode model: currents and back, and noise as drawn against noise as stated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import facets
from facets import (
    Electronics,
    InputError,
    Knowledge,
    add_noise,
    budgets,
    standard_deviations,
    uncertainties,
)
from facets.characterization import sources
from facets.detectors import ELECTRIC, electrodes, power_floor, step_variances, variances

#: Loud enough that no source hides behind the converter's steps.
LOUD = Electronics(
    voltage_noise=1e-6, current_noise=1e-10, ambient=0.05, bandwidth=1e5, adc_bits=14
)
READING = np.array([1.5, -2.0, 0.1, -4.0, 3.0, 0.08, 0.2, 0.1, 0.12])


def sensor(kind: str, electronics: Electronics = LOUD) -> facets.Sensor:
    return facets.Sensor(electronics=replace(electronics, kind=kind))


def test_two_layers_written_out_are_the_sum_of_all_sources():
    """Of what has light, and of what has none, is negative, or is no number at all."""
    one = sensor("duo-lateral")
    rng = np.random.default_rng(4)
    many = READING * rng.uniform(-1, 1.5, (200, 9))
    many[:3] = [[np.nan] * 9, [0.0] * 9, [3.0, -40.0, 0.01] * 3]
    summed = variances(one, many).sum(axis=-1)
    np.testing.assert_allclose(standard_deviations(one, many) ** 2, summed, rtol=1e-13)


@pytest.mark.parametrize("kind", electrodes.KINDS)
@pytest.mark.parametrize("aspect", [1.0, 0.6])
def test_currents_lead_back_to_the_place(kind, aspect):
    y, z = np.random.default_rng(1).uniform(-0.9, 0.9, (2, 500))
    shares = electrodes.fractions(kind, y, z, aspect)
    assert (shares > 0).all()
    assert electrodes.total(kind, shares) == pytest.approx(np.ones(500), abs=1e-11)
    found = electrodes.places(kind, shares, aspect)
    assert found == pytest.approx(np.stack([y, z], axis=-1), abs=1e-9)


def test_a_tetra_laterals_currents_are_those_of_a_conducting_sheet():
    """Against a relaxation of Laplace's equation on a grid, whose own error is some 1e-3."""
    n = 61
    sheet = np.zeros((n, n))
    sheet[:, -1] = 1.0  # the side at +y; rows run along z
    for _ in range(6000):
        sheet[1:-1, 1:-1] = (
            sheet[2:, 1:-1] + sheet[:-2, 1:-1] + sheet[1:-1, 2:] + sheet[1:-1, :-2]
        ) / 4
    for row, column in ((30, 30), (20, 45), (45, 15), (30, 50)):
        y, z = column / 30 - 1, row / 30 - 1
        share = electrodes.fractions("tetra-lateral", np.array(y), np.array(z))
        assert share[1] == pytest.approx(sheet[row, column], abs=2e-3)


def test_a_tetra_lateral_bends_and_the_others_do_not():
    place = np.array([0.5, 0.3])
    for kind in electrodes.KINDS:
        raw = electrodes.ratios(kind, electrodes.fractions(kind, *place))
        assert (np.abs(raw - place).max() > 0.05) == (kind == "tetra-lateral")


@pytest.mark.parametrize("kind", electrodes.KINDS)
@pytest.mark.slow
def test_noise_is_as_large_as_stated(kind):
    """100,000 draws: standard deviations to 1 %; a tetra-lateral's to 5 % off its middle, where
    what one axis takes from the other is left out, so that 20,000 do."""
    one = sensor(kind)
    exact = np.tile(READING, (20_000 if kind == "tetra-lateral" else 100_000, 1))
    noisy = add_noise(one, exact, np.random.default_rng(2))
    stated = standard_deviations(one, READING)
    tolerance = 0.05 if kind == "tetra-lateral" else 0.01
    assert (noisy - exact).std(axis=0) == pytest.approx(stated, rel=tolerance)
    assert (np.abs((noisy - exact).mean(axis=0)) < 0.02 * stated).all()


def test_noise_without_electronics_is_as_large_as_stated():
    """20,000 draws: standard deviations to 3 %."""
    exact = facets.readings(facets.Sensor(), np.zeros(8))
    noisy = add_noise(facets.Sensor(), np.tile(exact, (20_000, 1)), np.random.default_rng(2))
    stated = standard_deviations(facets.Sensor(), exact)
    assert (noisy - exact).std(axis=0) == pytest.approx(stated, rel=0.03)
    assert (np.abs((noisy - exact).mean(axis=0)) < 0.03 * stated).all()


def test_a_converters_steps_leave_as_much_in_a_mean_as_stated():
    """Means of 400 readings at each of 600 places: variances to 15 %, since 600 draws leave 6 %.

    At a detector's middle opposite electrodes err alike, and the formula takes them as independent.
    """
    step = 10.0 / 2**8 / 1e5
    noise = 0.2 * step / np.sqrt(np.pi / 2 * 1e4)
    quiet = Electronics(adc_bits=8, current_noise=noise, voltage_noise=0.0, resistance=1e12)
    one = facets.Sensor(electronics=quiet)
    rng = np.random.default_rng(5)
    off_middle = np.array([1.5, -2.0, 0.1, -4.0, 3.0, 0.08, 2.5, 1.5, 0.12])
    exact = off_middle * (1 + 0.1 * rng.standard_normal((600, 9)))
    noisy = add_noise(one, np.repeat(exact[:, None], 400, axis=1), rng)
    found = (noisy.mean(axis=1) - exact).var(axis=0)
    assert found == pytest.approx(step_variances(one, exact).mean(axis=0), rel=0.15)


def test_each_source_is_what_its_formula_says():
    """Of a spot in the middle of a duo-lateral PSD, by hand."""
    e = replace(LOUD, kind="duo-lateral")
    middle = np.array([0, 0, 0.1] * 3)
    parts = dict(zip(ELECTRIC, variances(sensor("duo-lateral"), middle)[0], strict=True))
    light, q, kt = 0.4 * 1e-4, 1.602176634e-19, 1.380649e-23 * 296
    scale = 13.0**2 / light**2 / 2  # of the variance of one electrode's current
    assert parts["shot noise"] == pytest.approx(scale * 2 * q * light / 2 * 1e5)
    assert parts["dark and ambient"] == pytest.approx(scale * 2 * q * (1e-8 + 0.4 * 5e-5) / 2 * 1e5)
    assert parts["resistance"] == pytest.approx(scale * 4 * kt * 1e5 / 1e4)
    amplifier = (1e-6 / 1e4) ** 2 + 1e-20 + 4 * kt / 1e5
    assert parts["amplifier"] == pytest.approx(scale * amplifier * 1e5)
    assert parts["ADC"] == pytest.approx(scale * (10 / 2**14 / 1e5) ** 2 / 12)
    assert e.adc_bits == 14


def test_place_noise_grows_as_the_light_falls():
    """Where the amplifiers dominate, as 1/power: what ends the range in x and y."""
    weak = standard_deviations(sensor("duo-lateral"), np.array([0, 0, 0.01] * 3))
    strong = standard_deviations(sensor("duo-lateral"), np.array([0, 0, 0.1] * 3))
    assert weak[0] / strong[0] == pytest.approx(10, rel=0.05)


@pytest.mark.parametrize("kind", [None, *electrodes.KINDS])
def test_a_spot_past_its_edge_is_no_reading(kind):
    """Every converged pose is right: 0.1 mm past an edge is a thousand standard uncertainties."""
    one = facets.Sensor() if kind is None else sensor(kind, Electronics())
    rng = np.random.default_rng(5)
    states = np.zeros((300, 8))
    states[:, 2] = rng.uniform(-9, 9, 300)
    states[:, 5] = rng.uniform(-0.02, 0.02, 300)
    exact = facets.readings(one, states)
    noisy = add_noise(one, exact, rng)
    missed = np.repeat(~facets.reaches(one, states), 3, axis=1)
    assert 0 < missed.sum() < missed.size
    assert np.isnan(noisy[missed]).all()
    solution = facets.solve(one, noisy, beam="known")
    error = np.abs(solution.state - states)[solution.ok, :6]
    assert (error < 10 * solution.uncertainty[solution.ok, :6]).all()
    assert not (solution.used & missed[:, ::3]).any()


@pytest.mark.parametrize("kind", ["duo-lateral", "pincushion"])
def test_a_spot_up_to_its_edge_is_read_where_it_lies(kind):
    one = sensor(kind, Electronics(adc_bits=24))
    at_edge = np.array([6.5, -6.5, 0.1, -6.4999, 6.495, 0.1, np.nextafter(6.5, 7), 0, 0.1])
    noisy = add_noise(one, np.tile(at_edge, (400, 1)), np.random.default_rng(6))
    assert np.isnan(noisy[:, 6:]).all()
    deviation = standard_deviations(one, at_edge)[:6]
    assert (np.abs(noisy[:, :6].mean(axis=0) - at_edge[:6]) < deviation / 4).all()


def test_saturated_amplifiers_give_no_reading():
    bright = np.tile([0, 0, 1.0], 3)
    small = Electronics(adc_range=1.0)  # 10 uA; half of 400 uA flows into each electrode
    noisy = add_noise(facets.Sensor(electronics=small), bright, np.random.default_rng(0))
    assert np.isnan(noisy).all()


def test_the_solver_weighs_by_the_same_model():
    """Estimates of electrode readings reach the bound, spots off their detectors' middles: within
    3 %, and chi-square distributed."""
    one = sensor("duo-lateral")
    state = np.array([0.05, -0.05, 2.0, 3e-3, -4e-3, 8e-3, 0, 0])
    states = np.repeat(state[None], 100_000, axis=0)
    noisy = add_noise(one, facets.readings(one, states), np.random.default_rng(3))
    solution = facets.solve(one, noisy, start=states, threads=0)
    assert solution.converged.all()
    error = (solution.state - states)[:, :6]
    bound = uncertainties(one, state[None], Knowledge())[0]
    assert error.std(axis=0) == pytest.approx(bound, rel=0.03)
    assert (np.abs(error.mean(axis=0)) < 0.05 * bound).all()
    matrix = np.linalg.inv(solution.covariance[0, :6, :6])
    square = np.einsum("ni,ij,nj->n", error, matrix, error)
    assert (square < stats.chi2(6).ppf(0.95)).mean() == pytest.approx(0.95, abs=0.01)


def test_a_budget_names_its_sources():
    one = sensor("pincushion")
    budget = budgets(one, np.zeros((1, 8)), Knowledge())[0]
    assert sources(one) == (*ELECTRIC, "beam position")
    assert budget.shape == (6, 6)
    quiet = replace(one, electronics=replace(one.electronics, adc_bits=24))
    finer = budgets(quiet, np.zeros((1, 8)), Knowledge())[0]
    assert (finer[:, 4] < 1e-5 * budget[:, 4]).all()
    assert finer[:, :4] == pytest.approx(budget[:, :4], rel=1e-6)


def test_the_dark_floor():
    assert power_floor(facets.Sensor()) == facets.Noise().power
    dark = standard_deviations(sensor("duo-lateral"), np.array([0, 0, 1e-12] * 3))[2]
    assert power_floor(sensor("duo-lateral")) == pytest.approx(dark, rel=1e-6)


@pytest.mark.parametrize("wrong", [{"kind": "quadrant"}, {"bandwidth": 0}, {"ambient": -1}])
def test_impossible_electronics_are_refused(wrong):
    with pytest.raises(InputError, match="allowed"):
        Electronics(**wrong)
