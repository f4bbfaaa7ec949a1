"""Beams that are not Gaussian: against rays, and the five numbers against modes as they are."""

from dataclasses import replace

import numpy as np
import pytest
from bench_oracle import Bench, by_rays
from sensors import ASYMMETRY, PROFILE, SENSORS

import facets
from facets.core import BenchLight, InputError
from facets.model import EFFECTS, derivatives, effect_jacobian, effects, replace_effects
from facets.simulation import ray_readings

PAPER = facets.Sensor()
TURNED = replace(PAPER, beam=replace(PAPER.beam, diameter_x=1.0, rotation=0.6, tilt_x=3e-3))


def series(x, y):
    """The irradiance that PROFILE and ASYMMETRY say, over a Gaussian's."""
    orders = np.zeros((5, 5))
    orders[[0, 4, 3, 2, 1, 0], [0, 0, 1, 2, 3, 4]] = [1.0, *PROFILE]
    orders[[3, 2, 1, 0], [0, 1, 2, 3]] = ASYMMETRY
    return np.polynomial.hermite_e.hermeval2d(x, y, orders)


def box(count: int, seed: int, reach: float = 0.2) -> np.ndarray:
    some = np.zeros((count, 8))
    width = np.array([reach, reach, 2, 6e-3, 6e-3, 6e-3])
    some[:, :6] = np.random.default_rng(seed).uniform(-1, 1, (count, 6)) * width
    return some


@pytest.mark.parametrize(
    "sensor", [PAPER, TURNED, SENSORS["skewed3"]], ids=["paper", "turned", "skewed"]
)
def test_readings_are_those_of_rays(sensor):
    ours = replace(sensor, light=BenchLight(profile=PROFILE, asymmetry=ASYMMETRY))
    some = box(3, 1)
    rays = np.array([by_rays(sensor, state, Bench(profile=series)) for state in some])
    np.testing.assert_allclose(facets.readings(ours, some), rays, rtol=1e-12, atol=1e-11)
    powers = facets.readings(sensor, some)[:, 2::3] / rays[:, 2::3]
    assert np.abs(powers - 1).max() > 0.01


def test_a_curved_wavefront_and_worn_edges_see_the_profile():
    """Strips to the second order in their width; the ray tracer of simulations agrees, too."""
    light = {"curvature_xx": 1 / 2100, "curvature_yy": 1 / 2100, "strips": (0.001, 0.0014, 0.0008)}
    ours = replace(PAPER, light=BenchLight(profile=PROFILE, asymmetry=ASYMMETRY, **light))
    some = box(3, 2)
    bench = Bench(np.eye(2) / 2100, strips=light["strips"], profile=series)
    rays = np.array([by_rays(PAPER, state, bench) for state in some])
    for found in (facets.readings(ours, some), ray_readings(ours, some)):
        np.testing.assert_allclose(found[:, 2::3], rays[:, 2::3], rtol=1e-6)
        np.testing.assert_allclose(found, rays, atol=1e-6)


def test_light_at_edges_and_tip_is_that_of_the_profile():
    """Beside the ray tracer of simulations, which samples it: diffraction to 0.1 um, roll-off to
    0.4, since the light across a strip is taken to fall off as a Gaussian beam's does."""
    some = box(4, 3, reach=0.1)
    for light, place in (
        ({"wavelength": 633e-6}, 1e-4),
        ({"rolloff": (3e-5,) * 6, "rolloff_width": 0.03}, 4e-4),
        ({"tip": 5e-4}, 1e-5),
    ):
        sensor = replace(PAPER, light=BenchLight(profile=PROFILE, asymmetry=ASYMMETRY, **light))
        away = np.abs(facets.readings(sensor, some) - ray_readings(sensor, some))
        assert away[:, [0, 1, 3, 4, 6, 7]].max() < place
        assert away[:, 2::3].max() < 3e-6


def test_the_fast_jacobian_is_the_exact_one():
    some, light = box(20, 4), BenchLight(profile=PROFILE, asymmetry=ASYMMETRY)
    curved = replace(light, curvature_xx=1 / 2100, curvature_yy=1 / 2500)
    for each, close in ((light, 1e-12), (curved, 1e-3)):
        sensor = replace(TURNED, light=each)
        exact = facets.jacobian(sensor, some)
        scale = np.abs(exact).max(axis=(0, 1))
        assert (np.abs(derivatives(sensor, some) - exact) <= close * scale).all()


#: Irradiance of 5 % of another mode beside a Gaussian beam, over the Gaussian's; x in its sigmas.
MODES = {
    "LG10": lambda x, y: 0.95 + 0.05 * (1 - (x * x + y * y) / 2) ** 2,
    "HG11": lambda x, y: 0.95 + 0.05 * x * x * y * y,
    "HG20": lambda x, y: 0.95 + 0.05 * (x * x - 1) ** 2 / 2,
}


def fit_beam(truth: np.ndarray, some: np.ndarray, profiled: bool) -> np.ndarray:
    """Residuals (n, 9) of readings over their noise, after a fit of power, place, size, profile."""
    noise = np.array([2.6e-3, 2.6e-3, 4e-5] * 3)
    sensor, state = replace(PAPER, light=BenchLight(background=((1e-300, 0, 0),) * 3)), some.copy()
    profile = [n for n, name in enumerate(EFFECTS) if name.startswith("profile.")]
    for _ in range(6):
        residual = (truth - facets.readings(sensor, state)) / noise
        whole = facets.parameter_jacobian(sensor, state)
        columns = [whole[:, :, :3], facets.jacobian(sensor, state)[:, :, 6:]]
        if profiled:
            columns.append(effect_jacobian(sensor, state)[:, :, profile])
        slopes = np.concatenate(columns, axis=2) / noise[:, None]
        step = np.linalg.lstsq(slopes.reshape(residual.size, -1), residual.ravel(), rcond=None)[0]
        beam = sensor.beam
        beam = replace(beam, power=beam.power + step[0], diameter_x=beam.diameter_x + step[1],
                       diameter_y=beam.diameter_y + step[2])  # fmt: skip
        state[:, 6:] += step[3:5]
        values = effects(sensor)
        values[profile] += step[5:] if profiled else 0.0
        sensor = replace_effects(replace(sensor, beam=beam), values)
    return residual


@pytest.mark.parametrize("mode", MODES.values(), ids=MODES)
@pytest.mark.slow
def test_five_numbers_describe_five_per_cent_of_another_mode(mode):
    """In powers, up to 0.2 mm off the beam: a tenth of the misfit is left, or less."""
    some = box(40, 6)
    truth = np.array([by_rays(PAPER, state, Bench(profile=mode)) for state in some])
    before, after = (fit_beam(truth, some, profiled)[:, 2::3] for profiled in (False, True))
    before, after = (np.sqrt((residual**2).mean()) for residual in (before, after))
    assert before > 0.3
    assert after < 0.1 * before


@pytest.mark.parametrize(
    "profile", [(-0.34, 0, 0, 0, 0), (0, 0, -1, 0, 0), (0.17, 0, 0, 0, 0), (0, 0.5, 0, 0, 0)]
)
def test_a_profile_without_light_near_its_middle_is_refused(profile):
    with pytest.raises(InputError, match="within 2 sigma"):
        BenchLight(profile=profile)
    BenchLight(profile=tuple(0.2 * c for c in profile))


def test_a_configuration_gives_it(tmp_path):
    file = tmp_path / "modes.yaml"
    file.write_text("extends: paper\nsensor:\n  light:\n    profile: [0.01, 0, 0.02, 0, 0.01]\n")
    assert facets.load(file).sensor.light.profile == (0.01, 0.0, 0.02, 0.0, 0.01)


def test_names_follow_those_of_the_other_effects():
    fourth, third = ("xxxx", "xxxy", "xxyy", "xyyy", "yyyy"), ("xxx", "xxy", "xyy", "yyy")
    assert EFFECTS[27:32] == tuple(f"profile.{n}" for n in fourth)
    assert EFFECTS[32:] == tuple(f"asymmetry.{n}" for n in third)
