"""Cut light: apertures, rims, gaps and detectors' edges, against strips of traced rays; and a
coating and other light beside them, against Fresnel."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from executions import APERTURES, COATED, floats
from sensors import SENSORS, box, states

import facets
from facets import Apertures, BenchLight, InputError
from facets.model import effect_jacobian

CUTS = {
    "beam at 1/e^2": Apertures(beam=1.0),
    "beam at half of it": Apertures(beam=0.5),
    "gap": Apertures(gap=0.02),
    "tip": Apertures(tip=0.05),
    "rim": Apertures(rim=0.3),
    "detectors": Apertures(detectors=True),
    "all": APERTURES,
}
EACH_CUT = pytest.mark.parametrize("cut", CUTS.values(), ids=CUTS)
PAPER = facets.Sensor()
#: A distance of 250 mm is rounded to 3e-14 mm, and a dozen steps of the chain add up.
ROUNDING = 1e-12


def draw(cut: Apertures, count: int, reach: float = 7.5, seed: int = 5) -> np.ndarray:
    """States of the mirror; with spots on the detectors' edges, if those are to cut."""
    some = states(count, seed)
    if cut.detectors:
        rng = np.random.default_rng(seed)
        some[:, 2] = rng.uniform(-reach, reach, count)
        some[:, 5] = rng.uniform(-0.03, 0.03, count)
    return some


@EACH_CUT
def test_readings_of_cut_light(cut):
    """Power to 1e-12 of the beam's; places as well, and as many times worse as the spot is dimmer:
    a landing point's rounding moves a detector's edge, and so what little is left of a spot."""
    for name in ("paper", "skewed1", "skewed4"):
        sensor = replace(SENSORS[name], apertures=cut)
        for state in draw(cut, 5):
            ours = facets.readings(sensor, state).reshape(3, 3)
            exact = oracle.by_strips(sensor, state).reshape(3, 3)
            assert (np.isnan(ours) == np.isnan(exact)).all()
            share = exact[:, 2] / sensor.beam.power
            away = np.abs(ours - exact)
            assert np.nanmax(away[:, 2], initial=0) < ROUNDING * sensor.beam.power
            assert np.nanmax(away[:, :2] * share[:, None], initial=0) < ROUNDING


def reflected(sensor, state) -> np.ndarray:
    """What each facet reflects of the polarised light, over what it does of unpolarised light at 45
    degrees; by Fresnel's amplitudes, with complex numbers: (3,)."""
    index, shares = complex(*COATED.index), []
    level = oracle.setup(replace(sensor, beam=replace(sensor.beam, rotation=0.0)), state)
    field = level.across @ [np.cos(COATED.polarization), np.sin(COATED.polarization)]

    def powers(cosine):
        inside = np.sqrt(1 - (1 - cosine**2) / index**2)
        s = (cosine - index * inside) / (cosine + index * inside)
        p = (index * cosine - inside) / (index * cosine + inside)
        return abs(s) ** 2, abs(p) ** 2

    for normal in level.normals:
        s, p = powers(-(normal @ level.down))
        across = np.cross(level.down, normal)
        share = (across @ field) ** 2 / (across @ across)
        shares.append((share * s + (1 - share) * p) / (sum(powers(np.sqrt(0.5))) / 2))
    return np.array(shares)


@pytest.mark.parametrize("cut", ["beam at half of it", "gap", "detectors", "all"])
def test_readings_of_cut_light_on_a_coating_beside_other_light(cut):
    """By the text in floats, which compiled code is compared with elsewhere."""
    other = np.array(COATED.background)
    for name in ("paper", "skewed1"):
        sensor = replace(SENSORS[name], apertures=CUTS[cut], light=COATED)
        for state in draw(CUTS[cut], 3, reach=6.5):
            spots = oracle.by_strips(replace(sensor, light=BenchLight()), state).reshape(3, 3)
            share = np.nan_to_num(spots[:, 2:]) * reflected(sensor, state)[:, None]
            whole = share + other[:, :1]
            places = (spots[:, :2] * share + other[:, 1:] * other[:, :1]) / whole
            ours = floats("readings", sensor, state[None]).reshape(3, 3)
            lit = ~np.isnan(spots[:, 0])
            exact = np.column_stack([places, whole])
            np.testing.assert_allclose(ours[lit], exact[lit], atol=1e-11, rtol=1e-11)


@pytest.mark.parametrize(
    "cut", [Apertures(detectors=True), Apertures(rim=5.0), Apertures(beam=5.0)]
)
def test_where_nothing_is_cut_the_results_are_the_same(cut):
    """Readings to the bit; derivatives are made otherwise."""
    some, sensor = box(100, 1), replace(PAPER, apertures=cut)
    some[:, 2] = 0
    np.testing.assert_array_equal(facets.readings(sensor, some), facets.readings(PAPER, some))
    slopes = facets.jacobian(sensor, some)
    np.testing.assert_allclose(slopes, facets.jacobian(PAPER, some), atol=1e-11)
    slopes = facets.parameter_jacobian(sensor, some)
    np.testing.assert_allclose(slopes, facets.parameter_jacobian(PAPER, some), atol=1e-9)


def test_poses_are_found_from_cut_light():
    """All but the tenth whose spots an edge may cut: these are out of range, not doubtful poses."""
    sensor = replace(PAPER, apertures=APERTURES)
    truth = states(200, seed=7, offset=0.1, angle=1e-4)
    truth[:, :2] -= truth[:, 6:]
    truth[:, 6:] = 0
    truth[:, 2] = np.random.default_rng(0).uniform(5.5, 6.3, 200)
    solution = facets.solve(sensor, facets.readings(sensor, truth))
    assert set(solution.status[~solution.ok]) == {facets.Status.OUT_OF_RANGE}
    assert solution.ok.mean() > 0.85
    away = np.abs(solution.state - truth)[solution.ok]
    assert away[:, [0, 1, 2, 6, 7]].max() < 1e-9
    assert away[:, 3:6].max() < 1e-11


def test_margins_to_the_rim_and_footprints_to_the_aperture():
    rimmed, narrow = (
        replace(PAPER, apertures=each) for each in (Apertures(rim=2.0), Apertures(beam=0.5))
    )
    margin = facets.margins(rimmed, np.zeros(8))[:, 4]
    assert margin == pytest.approx(2.0 - 0.425)  # the 1/e^2 circle about the apex
    assert np.isinf(facets.margins(PAPER, np.zeros(8))[:, 4]).all()
    assert facets.footprints(narrow, np.zeros(8))[:, 4] == pytest.approx(0.2125)


@pytest.mark.parametrize("wrong", [{"beam": 0}, {"rim": 0.1, "tip": 0.2}, {"tip": float("nan")}])
def test_impossible_apertures_are_refused(wrong):
    with pytest.raises(InputError, match="allowed"):
        Apertures(**wrong)


@pytest.mark.parametrize(
    ("light", "remedy"),
    [
        ({"strips": (0.01, 0.01, 0.01)}, r"light\.strips.*apertures\.gap"),
        ({"wavelength": 6e-4}, r"light\.wavelength.*diffract"),
        ({"curvature_yy": 1e-4}, r"light\.curvature_yy.*collimated"),
        ({"rolloff": (1e-5,) * 6}, r"light\.rolloff.*edge"),
        ({"profile": (0.01, 0, 0, 0, 0)}, r"light\.profile.*modelled as Gaussian only"),
    ],
)
def test_effects_at_edges_that_are_cut_are_refused(light, remedy):
    with pytest.raises(InputError, match=remedy):
        replace(PAPER, light=BenchLight(**light), apertures=Apertures(gap=0.01))


def test_a_calibration_of_cut_light_with_effects_is_refused():
    sensor = replace(PAPER, apertures=CUTS["gap"], light=COATED)
    for function in (facets.parameter_jacobian, effect_jacobian):
        with pytest.raises(InputError, match="leave one of the two out"):
            function(sensor, np.zeros((1, 8)))
