"""The light of a bench in the model: against rays, a propagated field, and many digits."""

import hashlib
import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from bench_oracle import Bench, by_rays
from hypothesis import given, settings
from hypothesis.strategies import floats, integers, lists
from sensors import ALL, ASYMMETRY, DEPTHS, PROFILE, SENSORS, states

import facets
from facets import BenchLight, ConfigError, InputError
from facets.model import (
    EFFECTS,
    axes_of,
    effect_jacobian,
    effects,
    light_effects,
    replace_effects,
    shape_derivatives,
    shape_of,
)

PAPER = facets.Sensor()
FOLDER = Path(__file__).parent / "references"
REFERENCES = json.loads((FOLDER / "diffraction.json").read_text())
sys.path.insert(0, str(FOLDER))
import make_diffraction  # noqa: E402


def lit(sensor=PAPER, **light):
    return replace(sensor, light=BenchLight(**light))


def box(count: int, seed: int) -> np.ndarray:
    """States of the mirror in the paper's box, the beam at rest."""
    rng = np.random.default_rng(seed)
    some = np.zeros((count, 8))
    some[:, :6] = rng.uniform(-1, 1, (count, 6)) * [0.12, 0.12, 2, 6e-3, 6e-3, 6e-3]
    return some


def apart(sensor, bench, some) -> tuple[float, float]:
    """Largest difference of places (um) and of powers (relative) from the rays'."""
    rays = np.array([by_rays(sensor, state, bench) for state in some])
    ours = facets.readings(sensor, some)
    away = np.abs(ours - rays)
    powers = away[:, 2::3] / rays[:, 2::3]
    return 1e3 * max(away[:, 0::3].max(), away[:, 1::3].max()), powers.max()


WIDTHS = (0.01, 0.014, 0.008)
ASTIGMATIC = {"curvature_xx": 1 / 2100, "curvature_yy": -1 / 4000, "curvature_xy": 3e-5}
ROLLED = Bench(depths=(DEPTHS[:2], DEPTHS[2:4], DEPTHS[4:]), width=0.1)


@pytest.mark.parametrize(
    ("light", "bench", "place_um", "power"),
    [
        # edges are straight to astigmatic light near the apex only
        (ASTIGMATIC, Bench(np.array([[1 / 2100, 3e-5], [3e-5, -1 / 4000]])), 0.05, 2e-4),
        ({"strips": WIDTHS}, Bench(strips=WIDTHS), 0.05, 1e-5),
        # a tenth of a wave over 0.1 mm moves spots by some 60 um
        ({"rolloff": DEPTHS, "rolloff_width": 0.1}, ROLLED, 0.6, 1e-12),
        ({"tip": np.pi * 0.025**2}, Bench(tip=0.025), 0.02, 1e-4),
    ],
    ids=["astigmatic", "strips", "roll-off", "tip"],
)
def test_each_effect_is_that_of_rays(light, bench, place_um, power):
    some = box(3, 3)
    moved = np.abs(facets.readings(lit(**light), some) - facets.readings(PAPER, some))
    assert 1e3 * moved.max() > 10 * place_um
    place, share = apart(lit(**light), bench, some)
    assert place < place_um
    assert share < power


@pytest.mark.parametrize(
    ("name", "radius"),
    [("paper", 2100.0), ("paper", -1000.0), ("paper", 500.0), ("skewed0", 2100.0)],
)
def test_a_curved_wavefront_is_that_of_rays(name, radius):
    """To 1e-5 um, where the second-order term alone is some 1e-3 um."""
    sensor = lit(SENSORS[name], curvature_xx=1 / radius, curvature_yy=1 / radius)
    some = box(3, 1) if name == "paper" else states(2, seed=3)
    place, power = apart(sensor, Bench(np.eye(2) / radius), some)
    assert place < 1e-5
    assert power < 1e-12


def test_what_is_left_of_strips_is_of_second_order_in_their_width():
    whole, tenth = (
        apart(lit(strips=widths), Bench(strips=widths), box(2, 3))
        for widths in (WIDTHS, tuple(width / 10 for width in WIDTHS))
    )
    assert tenth[0] < whole[0] / 50
    assert tenth[1] < whole[1] / 50


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
    for nodes, close in (((48, 48), 1e-9), ((72, 72), 1e-8)):
        again = make_diffraction.read(case, case["window"], nodes)
        np.testing.assert_allclose(again, case["reading"], atol=close)
    for cells, place, power in ((5120, 0.3e-3, 2e-5), (8192, 0.1e-3, 1e-5)):
        found = [each for each in REFERENCES["by_fft"] if each["cells"] == cells]
        assert len(found) == 23
        for each in found:
            away = np.abs(np.subtract(each["found"], each["reading"]))
            assert away[:2].max() < place
            assert away[2] < power


def test_the_reference_was_made_by_its_script():
    script, made_by = FOLDER / "make_diffraction.py", REFERENCES["made_by"]
    assert made_by["script_sha256"] == hashlib.sha256(script.read_bytes()).hexdigest()
    assert made_by["seed"] == make_diffraction.SEED


@pytest.mark.parametrize("case", REFERENCES["poses"], ids=str)
def test_poses_from_a_propagated_fields_readings(case):
    """Within a tenth of a reading's own uncertainty, to 1.6 mm from the detectors' edge; 4 to 20
    times it without diffraction in the model."""
    reading = np.array(case["reading"])
    reading[2::3] *= 0.3
    truth = np.array([*case["pose"], 0, 0, 0])
    sensor = lit(wavelength=REFERENCES["wavelength"])
    for known, worst in ((sensor, 0.1), (PAPER, None)):
        solution = facets.solve(known, reading, beam="known")
        over = np.abs(solution.state[:6] - truth) / solution.uncertainty[:6]
        assert (over.max() < worst) if worst else (over.max() > 4)


signed = partial(floats, allow_nan=False, allow_infinity=False)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    curvature=signed(-1e-3, 1e-3),
    depths=lists(signed(-7e-5, 7e-5), min_size=6, max_size=6),
    width=floats(0.03, 0.1),
    strips=lists(floats(0, 0.02), min_size=3, max_size=3),
    powers=lists(floats(0, 1), min_size=3, max_size=3),
    places=lists(signed(-6, 6), min_size=6, max_size=6),
    seed=integers(0, 1000),
)
@pytest.mark.slow
def test_effects_together_are_those_of_rays(
    curvature, depths, width, strips, powers, places, seed
):  # fmt: skip
    """Strips, roll-off, a curved wavefront and other light, up to ten times the signal, at once."""
    other = np.column_stack([powers, np.reshape(places, (3, 2))])
    bench = Bench(
        np.eye(2) * curvature, tuple(strips), (depths[:2], depths[2:4], depths[4:]), width
    )
    sensor = lit(
        curvature_xx=curvature, curvature_yy=curvature, rolloff=tuple(depths), rolloff_width=width,
        strips=tuple(strips), background=tuple(map(tuple, other.tolist())),
    )  # fmt: skip
    (state,) = box(1, seed)
    spots = by_rays(sensor, state, bench).reshape(3, 3)
    whole = spots[:, 2:] + other[:, :1]
    exact = (spots[:, :2] * spots[:, 2:] + other[:, 1:] * other[:, :1]) / whole
    ours = facets.readings(sensor, state).reshape(3, 3)
    assert np.abs(ours[:, :2] - exact).max() < 1e-3
    assert (np.abs(ours[:, 2] - whole[:, 0]) < 2e-5 * spots[:, 2]).all()


@pytest.mark.parametrize("power", ["known", "unknown"])
@pytest.mark.parametrize(
    ("light", "close"),
    [
        (ALL, 1e-9),
        (BenchLight(profile=PROFILE, asymmetry=ASYMMETRY), 1e-9),
        (BenchLight(background=((1.0, 3, -2),) * 3), 1e-8),
    ],
    ids=["all effects", "profile", "brighter other light"],
)
def test_poses_are_found_under_the_light_of_a_bench(light, close, power):
    sensor, truth = replace(PAPER, light=light), box(20, 13)
    solution = facets.solve(sensor, facets.readings(sensor, truth), beam="known", power=power)
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
    another pose within the noise."""
    sensor = facets.load("bench-light").sensor
    inside, at_edge = facets.readings(
        sensor, [[0.45, 0, height, 0, 0, 0, 0, 0] for height in (5.0, 6.7)]
    )
    assert np.isfinite(inside).all()
    assert np.isnan(at_edge).tolist() == [True] * 3 + [False] * 6


def test_a_start_without_a_reading_counts_as_zero():
    sensor = facets.load("bench-light").sensor
    blind = [0.45, 0, 6.7, 0, 0, 0, 0, 0]
    for shape in ((), (3,)):
        reading = facets.readings(sensor, np.zeros((*shape, 8)))
        assert facets.solve(sensor, reading, start=blind).ok.all()


def test_a_configuration_of_wide_strips_is_refused(tmp_path):
    file = tmp_path / "wide.yaml"
    file.write_text(
        "extends: paper\nsensor:\n  light:\n    strips_um: [10, 900, 10]\n    tip_um2: 1e6\n"
        "    rolloff_width_um: 300\n"
    )
    with pytest.raises(ConfigError) as error:
        facets.load(file)
    told = str(error.value)
    assert f"{file}:4: sensor.light.strips_um is not small beside the beam" in told
    assert f"{file}:5: sensor.light.tip_um2" in told
    assert f"{file}:6: sensor.light.rolloff_width_um" in told


def test_light_that_is_off_changes_no_bit_and_almost_none_rounds_otherwise():
    some, off = box(100, 6), replace(PAPER, light=BenchLight())
    for function in (facets.readings, facets.jacobian, facets.parameter_jacobian):
        assert (function(off, some) == function(PAPER, some)).all()
    for sensor in SENSORS.values():
        faint, some = lit(sensor, background=((1e-300, 0, 0),) * 3), states(20, seed=7)
        np.testing.assert_allclose(
            facets.readings(faint, some), facets.readings(sensor, some), rtol=1e-13, atol=3e-12
        )


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


def test_effects_have_names_and_come_back():
    assert len(EFFECTS) == len(set(EFFECTS)) == len(effects(PAPER)) == 36
    sensor = replace(PAPER, light=ALL)
    assert replace_effects(sensor, effects(sensor)) == sensor
    assert replace_effects(PAPER, effects(PAPER)) == PAPER
    assert not PAPER.light.on
    assert light_effects(sensor).numbers["wavelength"] == (632.8e-6,)
    with pytest.raises(InputError, match="needed: 36"):
        replace_effects(sensor, [0.0])


def test_the_beam_as_a_covariance():
    """Its derivatives are right for a round beam, where an angle has none."""
    for beam in (
        PAPER.beam,
        replace(PAPER.beam, diameter_x=0.9, rotation=0.7, tilt_x=2e-3),
        replace(PAPER.beam, diameter_y=0.9, rotation=2.7),
    ):
        sensor = replace(PAPER, beam=beam, light=ALL)
        shape = np.array(shape_of(beam.diameter_x, beam.diameter_y, beam.rotation))
        for each in (sensor, replace(sensor, light=BenchLight())):
            some, exact = box(3, 10), with_shape(each, shape)
            assert exact.beam.diameter_x == pytest.approx(beam.diameter_x)
            assert exact.beam.rotation == pytest.approx(beam.rotation)
            closed = shape_derivatives(each, some, facets.parameter_jacobian(each, some))
            for n, step in enumerate(1e-7 * np.eye(3)):
                ahead = facets.readings(with_shape(each, shape + step), some)
                slope = (ahead - facets.readings(each, some)) / 1e-7
                np.testing.assert_allclose(closed[..., n], slope, rtol=1e-3, atol=1e-3)
    with pytest.raises(InputError, match="no beam has a cross-section"):
        axes_of(np.array([0.04, 0.04, 0.05]))


def with_shape(sensor, shape):
    diameter_x, diameter_y, rotation = axes_of(shape, sensor.beam.rotation)
    beam = replace(sensor.beam, diameter_x=diameter_x, diameter_y=diameter_y, rotation=rotation)
    return replace(sensor, beam=beam)


def test_background_is_weighed_against_the_unknown_power():
    """Where the laser has grown dimmer, other light pulls a spot the more."""
    sensor = lit(background=((5e-3, 3, 2),) * 3)
    dim = replace(sensor, beam=replace(sensor.beam, power=0.2))
    truth = box(20, 12)
    solution = facets.solve(sensor, facets.readings(dim, truth), beam="known", power="unknown")
    assert np.abs(solution.state - truth)[:, :3].max() < 1e-9


@pytest.mark.parametrize(
    "wrong",
    [{"wavelength": -1}, {"strips": (0, 0)}, {"background": ((0, 0),) * 3}, {"index": (0, 1)},
     {"index": (1, 0)}, {"rolloff": (0.0,) * 5}, {"curvature_xx": float("nan")},
     {"rolloff_width": -1.0}],
)  # fmt: skip
def test_impossible_light_is_refused(wrong):
    with pytest.raises(InputError, match="allowed"):
        BenchLight(**wrong)


def test_states_without_light_read_nan_and_say_nothing(capfd):
    """Also where a facet has so little that a division by its power fails in compiled code."""
    sensor = facets.load("bench-light").sensor
    far = np.random.default_rng(0).standard_normal((200, 8)) * [2, 2, 5, 0.3, 0.3, 0.3, 2, 2]
    found, slopes = facets.readings(sensor, far), facets.jacobian(sensor, far)
    assert "Exception" not in capfd.readouterr().err
    dark = np.isnan(found).any(axis=1)
    assert 40 < dark.sum() < 200
    assert np.isnan(slopes[dark]).any(axis=(1, 2)).all()
    assert np.isfinite(slopes[~dark]).all()


@pytest.mark.parametrize("diameters", [(0.3, 0.3), (0.3, 0.03), (0.004, 0.005)])
def test_derivatives_are_known_where_readings_are(diameters):
    """Also of a beam so narrow that the light along the edges underflows; a facet that has all of
    it reads as a mirror does."""
    sensor = facets.load("bench-light").sensor
    sensor = replace(
        sensor, beam=replace(sensor.beam, diameter_x=diameters[0], diameter_y=diameters[1])
    )
    rng, sigma = np.random.default_rng(0), diameters[0] / 4
    near = np.concatenate([rng.normal(0, a * sigma, (100, 2)) for a in (1, 10, 30, 100, 300)])
    poses = np.column_stack([near, rng.normal(0, 3e-3, (500, 6)) * [100, 1, 1, 1, 0, 0]])
    found, slopes = facets.readings(sensor, poses), facets.jacobian(sensor, poses)
    np.testing.assert_array_equal(np.isfinite(slopes).all(axis=-1), np.isfinite(found))
    assert np.isfinite(found).any(axis=1).mean() > 0.9
    step = 1e-6 * np.eye(8)[4]
    change = facets.readings(sensor, poses + step) - facets.readings(sensor, poses - step)
    whole = np.repeat(np.abs(found[:, 2::3] - 0.3) < 0.01, 3, axis=1)
    assert whole.sum() > 100
    np.testing.assert_allclose(change[whole], 2e-6 * slopes[..., 4][whole], rtol=1e-5, atol=1e-8)
