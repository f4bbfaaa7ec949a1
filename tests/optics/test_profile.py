"""Beams that are not Gaussian: against rays, and the five numbers against modes as they are."""

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.studies.bench_rays import RayBench, spots
from sensors import ASYMMETRY, PROFILE, SENSORS, box

import facets
from facets.core import BenchLight, InputError
from facets.model import (
    derivatives,
)

PAPER = facets.Sensor()
TURNED = replace(PAPER, beam=replace(PAPER.beam, diameter_x=1.0, rotation=0.6, tilt_x=3e-3))


def by_rays(sensor, some):
    return spots(sensor, RayBench.from_sensor(sensor), some)


@pytest.mark.parametrize(
    "sensor", [PAPER, TURNED, SENSORS["skewed3"]], ids=["paper", "turned", "skewed"]
)
def test_readings_are_those_of_rays(sensor):
    ours = replace(sensor, light=BenchLight(profile=PROFILE, asymmetry=ASYMMETRY))
    some = box(3, 1, reach=0.2)
    np.testing.assert_allclose(
        facets.readings(ours, some), by_rays(ours, some), rtol=1e-12, atol=1e-11
    )


def test_a_curved_wavefront_and_worn_edges_see_the_profile():
    """Strips to the second order in their width."""
    light = {"curvature_xx": 1 / 2100, "curvature_yy": 1 / 2100, "strips": (0.001, 0.0014, 0.0008)}
    ours = replace(PAPER, light=BenchLight(profile=PROFILE, asymmetry=ASYMMETRY, **light))
    some = box(3, 2, reach=0.2)
    found, rays = facets.readings(ours, some), by_rays(ours, some)
    np.testing.assert_allclose(found[:, 2::3], rays[:, 2::3], rtol=1e-6)
    np.testing.assert_allclose(found, rays, atol=1e-6)


def test_light_at_edges_and_tip_is_that_of_the_profile():
    """Diffraction to 0.3 um, which the rays count to the first order; roll-off to 0.5, since the
    light across a strip is taken to fall off as a Gaussian beam's does."""
    some = box(4, 3, reach=0.1)
    for light, place, power in (
        ({"wavelength": 633e-6}, 3e-4, 1e-5),
        ({"rolloff": (3e-5,) * 6, "rolloff_width": 0.03}, 5e-4, 1e-12),
        ({"tip": 5e-4}, 1e-5, 3e-6),
    ):
        sensor = replace(PAPER, light=BenchLight(profile=PROFILE, asymmetry=ASYMMETRY, **light))
        away = np.abs(facets.readings(sensor, some) - by_rays(sensor, some))
        assert away[:, [0, 1, 3, 4, 6, 7]].max() < place
        assert away[:, 2::3].max() < power


def test_the_fast_jacobian_is_the_exact_one():
    some, light = box(20, 4, reach=0.2), BenchLight(profile=PROFILE, asymmetry=ASYMMETRY)
    curved = replace(light, curvature_xx=1 / 2100, curvature_yy=1 / 2500)
    for each, close in ((light, 1e-12), (curved, 1e-3)):
        sensor = replace(TURNED, light=each)
        exact = facets.jacobian(sensor, some)
        scale = np.abs(exact).max(axis=(0, 1))
        assert (np.abs(derivatives(sensor, some) - exact) <= close * scale).all()


@pytest.mark.parametrize("profile", [(-0.34, 0, 0, 0, 0), (0, 0, -1, 0, 0), (0, 0.5, 0, 0, 0)])
def test_a_profile_without_light_near_its_middle_is_refused(profile):
    with pytest.raises(InputError, match="within 2 sigma"):
        BenchLight(profile=profile)
    BenchLight(profile=tuple(0.2 * c for c in profile))
