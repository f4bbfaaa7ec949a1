"""The light of a bench in the model: against rays, a propagated field, and many digits."""

import hashlib
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from executions import COATED
from facets.experiments.studies.bench_rays import RayBench, spots
from sensors import ALL, ASYMMETRY, DEPTHS, PROFILE, SENSORS, box, states

import facets
from facets import BenchLight, InputError
from facets.model import (
    EFFECTS,
    axes_of,
    effect_jacobian,
    effects,
    parameters,
    replace_effects,
    sensor_with,
    shape_derivatives,
    shape_of,
)

PAPER, BENCH = facets.Sensor(), facets.load("bench-light").sensor
FOLDER = Path(__file__).parent / "references"
REFERENCES = json.loads((FOLDER / "diffraction.json").read_text())
sys.path.insert(0, str(FOLDER))
import make_diffraction  # noqa: E402

PLACES = [0, 1, 3, 4, 6, 7]


def lit(sensor=PAPER, **light):
    return replace(sensor, light=BenchLight(**light))


def by_rays(sensor, some):
    return spots(sensor, RayBench.from_sensor(sensor), some)


#: One effect each, and how far rays and the model may be apart: um, and fraction of the power. Rays
#: have a roll-off's whole profile and a tip's whole disc, the model some moments; the model has the
#: spread of an edge's light along the edge, the rays have not. Edges are straight to astigmatic
#: light near the apex only.
SINGLE_EFFECTS = {
    "curvature": ({"curvature_xx": 1 / 2100, "curvature_yy": 1 / 2100}, 2e-8, 1e-10),
    "astigmatism": (
        {"curvature_xx": 1 / 2100, "curvature_xy": 3e-5, "curvature_yy": -1 / 4000},
        0.05,
        2e-4,
    ),
    "diffraction": ({"wavelength": 632.8e-6}, 0.4, 1e-4),
    "roll-off": ({"rolloff": DEPTHS, "rolloff_width": 0.03}, 0.6, 1e-10),
    "strips": ({"strips": (0.01, 0.014, 0.008)}, 0.05, 1e-5),
    "tip": ({"tip": 0.002}, 0.05, 1e-4),
    "background": ({"background": ((5e-4, 1, 2), (4e-4, -1, 0.5), (6e-4, 0, -2))}, 2e-8, 1e-10),
    "polarisation": ({"index": (1.37, 7.62), "polarization": 0.3}, 2e-8, 1e-10),
}


@pytest.mark.parametrize(("light", "place", "power"), SINGLE_EFFECTS.values(), ids=SINGLE_EFFECTS)
def test_each_effect_is_that_of_rays(light, place, power):
    some = states(4, seed=4, offset=0.12, angle=6e-3)
    some[:, :2] -= some[:, 6:]  # how far the apex stands off the beam, which then stands at (0, 0)
    some[:, 2] /= 3
    some[:, 6:] = 0
    sensor = SENSORS["skewed0" if place < 1e-7 else "paper"]  # exact effects are, on any sensor
    rays = by_rays(lit(sensor, **light), some)
    away = np.abs(facets.readings(lit(sensor, **light), some) - rays)
    assert 1e3 * away[:, PLACES].max() < place
    assert (away[:, 2::3] / rays[:, 2::3]).max() < power
    assert np.abs(facets.readings(sensor, some) - rays).max() > 20 * away.max()


def beneath(case, **light):
    """The sensor of a case, its detector A moved under the window and still square to the light."""
    y, z = case["window"]
    turn = np.arctan2(y, 250.0)
    psd = replace(PAPER.psds[0], radius=250 / np.cos(turn), azimuth=turn, yaw=-turn, height=z)
    (x, y, rotation), (of_b, of_c) = case["axes"], np.radians(case["azimuths"])
    a, b, c = PAPER.facets
    return lit(
        replace(
            PAPER,
            beam=replace(PAPER.beam, diameter_x=2 * x, diameter_y=2 * y, rotation=rotation),
            facets=(a, replace(b, azimuth=of_b), replace(c, azimuth=of_c)),
            psds=(psd, *PAPER.psds[1:]),
        ),
        **light,
    )


@pytest.mark.parametrize("case", REFERENCES["cases"], ids=str)
def test_diffraction_is_that_of_a_propagated_field(case):
    """Centroids to 0.5 um, powers to 1e-4 of the beam's, to 1.2 mm from the window's edges and near
    two of them, where diffraction itself moves them by up to 65 um; with ellipses, unlike facets
    and curved wavefronts."""
    radius = case["wavefront_radius"]
    bend = 0.0 if radius is None else 1 / radius
    light = {"curvature_xx": bend, "curvature_yy": bend}
    sensor = beneath(case, wavelength=REFERENCES["wavelength"], **light)
    ours = facets.readings(sensor, [*case["apex"], 0, 0, 0, 0, 0, 0])[:3]
    assert np.abs(ours[:2] - case["reading"][:2]).max() < 0.5e-3
    assert ours[2] / 0.3 == pytest.approx(case["reading"][2], abs=1e-4)


@pytest.mark.slow
def test_the_field_is_known_better_than_it_is_compared():
    """Its readings come again, and with half as many nodes again: to 1e-5 um. An angular spectrum
    by FFT, which is not paraxial, gives the same as far as its grid is fine."""
    case = REFERENCES["cases"][6]
    for nodes, close in ((48, 1e-9), (72, 1e-8)):
        again = make_diffraction.read(case, case["window"], (nodes, nodes))
        np.testing.assert_allclose(again, case["reading"], atol=close)
    assert len(REFERENCES["by_fft"]) == 46
    for each in REFERENCES["by_fft"]:
        *place, power = np.abs(np.subtract(each["found"], each["reading"]))
        is_fine = each["cells"] == 8192
        assert max(place) < (0.1e-3 if is_fine else 0.3e-3)
        assert power < (1e-5 if is_fine else 2e-5)


def test_the_reference_was_made_by_its_script():
    script, made_by = FOLDER / "make_diffraction.py", REFERENCES["made_by"]
    assert made_by["script_sha256"] == hashlib.sha256(script.read_bytes()).hexdigest()
    assert made_by["seed"] == make_diffraction.SEED


@pytest.mark.parametrize("case", REFERENCES["poses"], ids=str)
def test_poses_from_a_propagated_fields_readings(case):
    """Within a tenth of a reading's own uncertainty, to 1.6 mm from the detectors' edge; 4 to 20
    times it without diffraction in the model."""
    reading = np.array(case["reading"]) * ([1, 1, 0.3] * 3)

    def misfit(sensor):
        solution = facets.solve(sensor, reading, beam="known")
        return (np.abs(solution.state[:3] - case["pose"]) / solution.uncertainty[:3]).max()

    assert misfit(lit(wavelength=REFERENCES["wavelength"])) < 0.1
    assert misfit(PAPER) > 4


@pytest.mark.slow
def test_effects_together_are_those_of_rays():
    """Strips, roll-off, a curved wavefront and other light, up to ten times the signal, at once."""
    rng = np.random.default_rng(1)
    for state in box(20, 2):
        strips, width = tuple(rng.uniform(0, 0.02, 3)), rng.uniform(0.01, 0.03)
        curvature, depths = rng.uniform(-1e-3, 1e-3), rng.uniform(-7e-5, 7e-5, 6)
        other = np.column_stack([rng.uniform(0, 1, 3), rng.uniform(-6, 6, (3, 2))])
        sensor = lit(
            curvature_xx=curvature, curvature_yy=curvature, rolloff=tuple(depths),
            rolloff_width=width, strips=strips, background=tuple(map(tuple, other)),
        )  # fmt: skip
        rays = by_rays(sensor, state[None])[0]
        away = np.abs(facets.readings(sensor, state) - rays).reshape(3, 3)
        assert away[:, :2].max() < 1e-3
        assert (away[:, 2] < 2e-5 * (rays[2::3] - other[:, 0])).all()


CUT = {"apertures": facets.Apertures(beam=0.7), "light": COATED}


@pytest.mark.parametrize("power", ["known", "unknown"])
@pytest.mark.parametrize(
    ("parts", "close"),
    [
        ({"light": ALL}, 1e-9),
        ({"light": BenchLight(profile=PROFILE, asymmetry=ASYMMETRY)}, 1e-9),
        ({"light": BenchLight(background=((1.0, 3, -2),) * 3)}, 1e-8),
        pytest.param(CUT, 1e-9, marks=pytest.mark.slow),
    ],
    ids=["all effects", "profile", "brighter other light", "cut and coated"],
)
def test_poses_are_found_under_the_light_of_a_bench(parts, close, power):
    """Of a laser that has grown dimmer, whose spots other light pulls the more, if its power is
    unknown."""
    sensor, truth = replace(PAPER, **parts), box(20, 13)
    now = replace(PAPER.beam, power={"known": 0.3, "unknown": 0.28}[power])
    readings = facets.readings(replace(sensor, beam=now), truth)
    solution = facets.solve(sensor, readings, beam="known", power=power)
    assert solution.ok.all()
    away = np.abs(solution.state - truth)
    assert away[:, :3].max() < close
    assert away[:, 3:6].max() < close / (100 if close < 1e-8 else 1)


@pytest.mark.parametrize("light", [{"strips": (1.0,) * 3}, {"tip": 10.0}, {"wavelength": 1.0}])
def test_more_lost_than_there_is_reads_nothing(light):
    """The first orders in which these are told are then nonsense; it is not given out as light."""
    reading = facets.readings(lit(**light), np.zeros(8))
    assert np.isnan(reading).all()
    assert not facets.solve(lit(**light), reading, beam="known").ok


def test_a_spot_that_diffraction_all_but_takes_reads_nothing():
    """At its detector's edge such a spot would be told more than a millimetre inside, where it fits
    another pose within the noise. A start there counts as zero."""
    some = [[0.45, 0, height, 0, 0, 0, 0, 0] for height in (5.0, 6.7)]
    inside, at_edge = facets.readings(BENCH, some)
    assert np.isfinite(inside).all()
    assert np.isnan(at_edge).tolist() == [True] * 3 + [False] * 6
    readings = facets.readings(BENCH, np.zeros((3, 8)))
    for reading in (readings, readings[0]):
        assert facets.solve(BENCH, reading, start=some[1]).ok.all()


def test_light_that_is_off_changes_no_bit_and_almost_none_rounds_otherwise():
    some, off = box(100, 6), lit()
    for function in (facets.readings, facets.jacobian, facets.parameter_jacobian):
        assert (function(off, some) == function(PAPER, some)).all()
    for sensor in SENSORS.values():
        faint, exact = lit(sensor, background=((1e-300, 0, 0),) * 3), facets.readings(sensor, some)
        np.testing.assert_allclose(facets.readings(faint, some), exact, rtol=1e-13, atol=3e-12)


def test_derivatives_by_effects_hold_where_all_are_off():
    """So that a calibration can tell which it needs."""
    some = box(3, 9)
    closed = effect_jacobian(PAPER, some)
    for number, name in enumerate(EFFECTS):
        if name.startswith("coating") or name in ("light.polarization", "rolloff.width"):
            assert (closed[..., number] == 0).all()
            continue
        moved = np.zeros(len(EFFECTS))
        moved[EFFECTS.index("coating.n")] = 1.0
        moved[number] = 1e-9
        ahead = facets.readings(replace_effects(PAPER, moved), some)
        slope = (ahead - facets.readings(PAPER, some)) / 1e-9
        np.testing.assert_allclose(
            closed[..., number], slope, rtol=1e-3, atol=2e-3 * max(np.abs(slope).max(), 1)
        )


def test_parameters_and_effects_have_names_and_come_back():
    assert len(facets.PARAMETERS) == len(set(facets.PARAMETERS)) == 30
    assert len(EFFECTS) == len(set(EFFECTS)) == len(effects(PAPER)) == 81
    assert EFFECTS[27:36:4] == ("profile.xxxx", "profile.yyyy", "asymmetry.yyy")
    for sensor in (*SENSORS.values(), replace(SENSORS["skewed1"], light=ALL)):
        assert replace_effects(sensor, effects(sensor)) == sensor
        assert sensor_with(sensor, parameters(sensor)) == sensor
    with pytest.raises(InputError, match="needed: 81"):
        replace_effects(sensor, [0.0])


def test_the_beam_as_a_covariance():
    """Its derivatives are right for a round beam, where an angle has none."""
    some = box(3, 10)
    for beam in (
        PAPER.beam,
        replace(PAPER.beam, diameter_x=0.9, rotation=0.7, tilt_x=2e-3),
        replace(PAPER.beam, diameter_y=0.9, rotation=2.7),
    ):
        shape = np.array(shape_of(beam.diameter_x, beam.diameter_y, beam.rotation))
        for light in (ALL, BenchLight()):
            sensor = replace(PAPER, beam=beam, light=light)
            exact = with_shape(sensor, shape).beam
            assert exact.diameter_x == pytest.approx(beam.diameter_x)
            assert exact.rotation == pytest.approx(beam.rotation)
            closed = shape_derivatives(sensor, some, facets.parameter_jacobian(sensor, some))
            for n, step in enumerate(1e-7 * np.eye(3)):
                ahead = facets.readings(with_shape(sensor, shape + step), some)
                slope = (ahead - facets.readings(sensor, some)) / 1e-7
                np.testing.assert_allclose(closed[..., n], slope, rtol=1e-3, atol=1e-3)
    with pytest.raises(InputError, match="no beam has a cross-section"):
        axes_of(np.array([0.04, 0.04, 0.05]))


def with_shape(sensor, shape):
    diameter_x, diameter_y, rotation = axes_of(shape, sensor.beam.rotation)
    beam = replace(sensor.beam, diameter_x=diameter_x, diameter_y=diameter_y, rotation=rotation)
    return replace(sensor, beam=beam)


@pytest.mark.parametrize(
    "wrong",
    [{"wavelength": -1}, {"strips": (0, 0)}, {"background": ((0, 0),) * 3}, {"index": (0, 1)},
     {"rolloff": (0.0,) * 5}, {"curvature_xx": float("nan")}],
)  # fmt: skip
def test_impossible_light_is_refused(wrong):
    with pytest.raises(InputError, match="allowed"):
        BenchLight(**wrong)


FAR = np.random.default_rng(0).standard_normal((200, 8)) * [2, 2, 5, 0.3, 0.3, 0.3, 2, 2]


@pytest.mark.parametrize("diameters", [(0.85, 0.85), (0.3, 0.3), (0.3, 0.03), (0.004, 0.005)])
def test_derivatives_are_known_where_readings_are(diameters, capfd):
    """Also of a beam so narrow that the light along the edges underflows, and where a division by a
    facet's power fails in compiled code, which says nothing; a facet that has all of the light
    reads as a mirror does."""
    beam = replace(BENCH.beam, diameter_x=diameters[0], diameter_y=diameters[1])
    sensor, sigma = replace(BENCH, beam=beam), diameters[0] / 4
    rng = np.random.default_rng(0)
    near = np.concatenate([rng.normal(0, a * sigma, (100, 2)) for a in (1, 10, 30, 100, 300)])
    poses = np.column_stack([near, rng.normal(0, 3e-3, (500, 6)) * [100, 1, 1, 1, 0, 0]])
    some = np.concatenate([poses, FAR])
    reading, slopes = facets.readings(sensor, some), facets.jacobian(sensor, some)
    assert "Exception" not in capfd.readouterr().err
    known = np.isfinite(reading)
    np.testing.assert_array_equal(np.isfinite(slopes).all(axis=-1), known)
    assert 0 < known.all(axis=1).sum() < 700
    turn = 1e-6 * np.eye(8)[4]
    change = facets.readings(sensor, poses + turn) - facets.readings(sensor, poses - turn)
    whole = np.repeat(np.abs(reading[:500, 2::3] - 0.3) < 0.01, 3, axis=1)
    assert whole.sum() > 100
    expected = 2e-6 * slopes[:500, :, 4]
    np.testing.assert_allclose(change[whole], expected[whole], rtol=1e-5, atol=1e-8)
