"""Cut light: apertures, rims, gaps and detectors' edges, against strips of traced rays."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from sensors import SENSORS, states

import facets
from facets import Apertures, InputError
from facets.model import evaluators, packed_vectors, parameters
from facets.optics import BEAM, FACET, PSD

CUTS = {
    "beam at 1/e^2": Apertures(beam=1.0),
    "beam at half of it": Apertures(beam=0.5),
    "gap": Apertures(gap=0.02),
    "tip": Apertures(tip=0.05),
    "rim": Apertures(rim=0.3),
    "detectors": Apertures(detectors=True),
    "all": Apertures(beam=1.1, detectors=True, tip=0.03, rim=0.4, gap=0.01),
}
PAPER = facets.Sensor()
#: A distance of 250 mm is rounded to 3e-14 mm, and a dozen steps of the chain add up.
ROUNDING = 1e-12


def drawn(cut: Apertures, count: int, seed: int = 5) -> np.ndarray:
    """States of the mirror; with spots on the detectors' edges, if those are to cut."""
    some = states(count, seed)
    if cut.detectors:
        rng = np.random.default_rng(seed)
        some[:, 2] = rng.uniform(-7.5, 7.5, count)
        some[:, 5] = rng.uniform(-0.03, 0.03, count)
    return some


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("cut", CUTS.values(), ids=CUTS)
def test_readings_of_cut_light(name, cut):
    """Power to 1e-12 of the beam's; places as well, and as many times worse as the spot is dimmer:
    a landing point's rounding moves a detector's edge, and so what little is left of a spot."""
    sensor = replace(SENSORS[name], apertures=cut)
    for state in drawn(cut, 8):
        ours = facets.readings(sensor, state).reshape(3, 3)
        exact = oracle.by_strips(sensor, state).reshape(3, 3)
        assert (np.isnan(ours) == np.isnan(exact)).all()
        share = exact[:, 2] / sensor.beam.power
        away = np.abs(ours - exact)
        assert np.nanmax(away[:, 2], initial=0) < ROUNDING * sensor.beam.power
        assert np.nanmax(away[:, :2] * share[:, None], initial=0) < ROUNDING


def test_the_oracle_itself_finds_the_uncut_readings():
    for state in states(3, seed=2):
        strips = oracle.by_strips(PAPER, state)
        assert strips == pytest.approx(oracle.by_quadrature(PAPER, state), abs=1e-12)


def convergence(worst_at, steps) -> float:
    """By how much the error of central differences falls from the first step to the second."""
    first, second = (worst_at(step) for step in steps)
    return first / second


@pytest.mark.parametrize("cut", CUTS.values(), ids=CUTS)
def test_derivatives_converge_as_the_square_of_the_step(cut):
    """A tenth of the step, a hundredth of the error: of the derivatives by the state."""
    units = np.array([1, 1, 1, 1 / 300, 1 / 300, 1 / 300, 1, 1])

    def worst(step: float) -> float:
        found = []
        for name in ("paper", "skewed1", "skewed4"):
            sensor = replace(SENSORS[name], apertures=cut)
            some = drawn(cut, 20)
            closed = facets.jacobian(sensor, some)
            ahead = facets.readings(sensor, some[:, None] + step * units * np.eye(8))
            behind = facets.readings(sensor, some[:, None] - step * units * np.eye(8))
            moved = (ahead - behind).swapaxes(1, 2) / (2 * step * units)
            lit = np.repeat(facets.readings(sensor, some)[:, 2::3] > 0.01 * 0.3, 3, axis=1)
            away = np.abs(closed - moved) / np.nanmax(np.abs(closed), axis=(0, 1))
            found.append(np.nanmax(away[lit]))
        return max(found)

    assert 95 < convergence(worst, (3e-4, 3e-5)) < 105


def with_parameters(sensor: facets.Sensor, values: np.ndarray) -> facets.Sensor:
    facet_values, psd_values = values[6:12].reshape(3, 2), values[12:].reshape(3, 6)
    return replace(
        sensor,
        beam=replace(sensor.beam, **dict(zip(BEAM, values[:6], strict=True))),
        facets=tuple(
            replace(facet, **dict(zip(FACET, row, strict=True)))
            for facet, row in zip(sensor.facets, facet_values, strict=True)
        ),
        psds=tuple(
            replace(psd, **dict(zip(PSD, row, strict=True)))
            for psd, row in zip(sensor.psds, psd_values, strict=True)
        ),
    )


@pytest.mark.parametrize("cut", [CUTS["detectors"], CUTS["all"]], ids=["detectors", "all"])
@pytest.mark.slow
def test_derivatives_by_parameters(cut):
    sensor = replace(SENSORS["skewed2"], apertures=cut)
    some = drawn(cut, 10, seed=9)
    closed = facets.parameter_jacobian(sensor, some)
    origin = np.array(parameters(sensor))
    lit = np.repeat(facets.readings(sensor, some)[:, 2::3] > 0.01 * 0.3, 3, axis=1)
    units = np.array([1, 1, 1, 1, 1, 1] + [1] * 6 + [1, 0.01, 1, 0.05, 0.05, 0.05] * 3)

    def worst(step: float) -> float:
        away = []
        for p in range(30):
            move = step * units[p] * np.eye(30)[p]
            ahead = facets.readings(with_parameters(sensor, origin + move), some)
            behind = facets.readings(with_parameters(sensor, origin - move), some)
            moved = (ahead - behind) / (2 * step * units[p])
            scale = max(1, np.nanmax(np.abs(closed[..., p])))
            away.append(np.nanmax(np.abs(closed[..., p] - moved)[lit]) / scale)
        return max(away)

    assert 90 < convergence(worst, (3e-5, 3e-6)) < 110


@pytest.mark.parametrize(
    "cut", [Apertures(detectors=True), Apertures(rim=5.0), Apertures(beam=5.0)]
)
def test_where_nothing_is_cut_the_results_are_the_same_bit_for_bit(cut):
    """As those of the code for one pose at a time; blocks round otherwise."""
    some = np.zeros((1000, 8))
    some[:, :2] = np.random.default_rng(1).uniform(-0.1, 0.1, (1000, 2))
    some[:, 3:6] = np.random.default_rng(2).uniform(-3e-3, 3e-3, (1000, 3))
    same = replace(PAPER, apertures=cut)
    readings, slopes = np.empty((1000, 9)), np.empty((1000, 10, 10))
    evaluators.fill("readings_of_plain", packed_vectors(PAPER), some, readings)
    with_power = np.insert(some, 8, PAPER.beam.power, axis=1)
    evaluators.fill("approximate_linearisation_of_plain", packed_vectors(PAPER), with_power, slopes)
    assert (facets.readings(same, some) == readings).all()
    assert (facets.jacobian(same, some) == slopes[:, 1:, :8]).all()
    assert (facets.parameter_jacobian(same, some) == facets.parameter_jacobian(PAPER, some)).all()


@pytest.mark.parametrize("cut", [Apertures(detectors=True), Apertures(rim=5.0)])
def test_where_nothing_is_cut_the_results_are_those_of_blocks(cut):
    some = np.zeros((200, 8))
    some[:, :2] = np.random.default_rng(1).uniform(-0.1, 0.1, (200, 2))
    same, exact = replace(PAPER, apertures=cut), facets.readings(PAPER, some)
    assert np.abs(facets.readings(same, some) - exact).max() < ROUNDING
    away = facets.solve(same, exact).state - facets.solve(PAPER, exact).state
    assert np.abs(away).max() < ROUNDING


def test_a_beam_cut_at_1_over_e2_keeps_86_percent():
    reading = facets.readings(replace(PAPER, apertures=Apertures(beam=1.0)), np.zeros(8))
    assert reading[2::3].sum() / 0.3 == pytest.approx(1 - np.exp(-2), rel=1e-15)
    assert reading[2::3] == pytest.approx(reading[2])


def test_a_detector_takes_what_falls_on_it():
    """Half the light of a symmetric spot is lost when its middle lies on the edge."""
    sensor = replace(PAPER, apertures=Apertures(detectors=True))
    on, off = np.zeros((2, 8))
    on[2] = 6.5  # the image of the apex comes to lie on the upper edge; the light hangs below
    assert facets.readings(sensor, on)[2::3].sum() == pytest.approx(0.3, rel=1e-12)
    off[2] = 8.0
    assert np.isnan(facets.readings(sensor, off)).all()


@pytest.mark.parametrize("cut", CUTS.values(), ids=CUTS)
def test_poses_are_found_from_cut_light(cut):
    """All but the tenth whose spots an edge may cut: these are out of range, not doubtful poses."""
    sensor = replace(PAPER, apertures=cut)
    truth = states(300, seed=7, offset=0.1, angle=5e-3)
    truth[:, :2] -= truth[:, 6:]
    truth[:, [2, 6, 7]] = 0
    if cut.detectors:
        truth[:, 2] = np.random.default_rng(0).uniform(5.5, 6.3, 300)
        truth[:, 3:6] *= 0.02
    exact = facets.readings(sensor, truth)
    solution = facets.solve(sensor, exact)
    assert set(solution.status[~solution.ok]) <= {facets.Status.OUT_OF_RANGE}
    assert solution.ok.mean() > (0.85 if cut.detectors else 0.99)
    away = np.abs(solution.state - truth)[solution.ok]
    assert away[:, [0, 1, 2, 6, 7]].max() < 1e-9
    assert away[:, 3:6].max() < 1e-11


def test_margins_to_the_rim():
    sensor = replace(PAPER, apertures=Apertures(rim=2.0))
    margin = facets.margins(sensor, np.zeros(8))
    assert margin[:, 4] == pytest.approx(2.0 - 0.425)  # the 1/e^2 circle about the apex
    assert np.isinf(facets.margins(PAPER, np.zeros(8))[:, 4]).all()


def test_footprints_end_at_the_aperture():
    narrow = replace(PAPER, apertures=Apertures(beam=0.5))
    assert facets.footprints(narrow, np.zeros(8))[:, 4] == pytest.approx(0.2125)


@pytest.mark.parametrize(
    "wrong", [{"beam": 0}, {"gap": -1}, {"rim": 0.1, "tip": 0.2}, {"tip": float("nan")}]
)
def test_impossible_apertures_are_refused(wrong):
    with pytest.raises(InputError, match="allowed"):
        Apertures(**wrong)
