"""Imperfect optics by rays: nothing where nothing is imperfect, textbook values where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensors import states

import facets
from facets import Apertures, BenchLight, Imperfections, InputError
from facets.core import Sweep
from facets.simulation import imperfect_readings, ray_readings

PAPER = facets.Sensor()
AWAY = np.array([[0.06, -0.04, 0.3, 3e-3, -2e-3, 5e-3, 0, 0]])


def flawed(**flaws):
    return replace(PAPER, imperfections=Imperfections(**flaws))


def test_a_dome_enlarges_them_as_a_mirror_of_its_radius():
    """R = D^2 / 8 sag; along the plane of incidence at 45 degrees its power is 2 sqrt 2 / R."""
    rest, radius = np.zeros((1, 8)), 5.0**2 / 8 / 1e-4
    plain = facets.readings(PAPER, rest)
    wide = imperfect_readings(flawed(sag=(1e-4,) * 3, sag_over=5.0), rest)
    assert wide[0, 1] / plain[0, 1] == pytest.approx(1 + 250 * 2 * np.sqrt(2) / radius, rel=2e-3)


def test_simulations_have_them_and_the_solver_does_not():
    config = replace(facets.load("paper"), sensor=flawed(index=(1.37, 7.62), polarization=0.3))
    (segment,) = facets.simulate(config, ["yaw-sweep"], noise=False)
    assert np.abs(segment.error[:, 0]).max() > 1e-3  # 6 % of the power apart is microns in x


def test_each_detector_is_read_late_by_its_own_delay():
    """The bench's converters read along a motion along z, at 1 mm/s."""
    delays = (0.0, 2e-3, 5e-3)
    sweep = Sweep((0.0,) * 8, (0.0, 0.0, 0.1, *(0.0,) * 5), 101, 1000.0)
    sensor = replace(PAPER, light=BenchLight(delays=delays))
    config = replace(facets.load("paper"), motions={"sweep": sweep}, sensor=sensor)
    (segment,) = facets.simulate(config, noise=False)
    for k, delay in enumerate(delays):
        late = segment.truth.copy()
        late[:, 2] += delay
        part = np.s_[10:-10, 3 * k : 3 * k + 3]
        expected = facets.readings(PAPER, late)[part]
        np.testing.assert_allclose(segment.readings[part], expected, atol=1e-9)


def test_apertures_do_not_go_with_it():
    with pytest.raises(InputError, match="imperfections"):
        replace(flawed(index=(1.37, 7.62)), apertures=Apertures(beam=1.0))


DEPTHS = (6e-5, 3e-5, 5e-5, 7e-5, 2e-5, 4e-5)
#: One effect each, told by rays and by the model, and how far apart they may be: um, and share of
#: the power. Rays know an edge's whole light, a roll-off's whole profile and a tip's whole disc,
#: the model some moments.
EFFECTS = {
    "curvature": ({"wavefront_radius": 2100.0}, 1e-5, 1e-10),
    "diffraction": ({"wavelength": 632.8e-6}, 0.1, 1e-5),
    "roll-off": ({"rolloff": DEPTHS, "rolloff_width": 0.1}, 0.6, 1e-10),
    "strips": ({"strips": (0.01, 0.014, 0.008)}, 0.05, 1e-5),
    "tip": ({"tip": 0.002}, 0.05, 1e-4),
    "background": ({"background": ((5e-4, 1, 2), (4e-4, -1, 0.5), (6e-4, 0, -2))}, 1e-6, 1e-10),
    "polarisation": ({"index": (1.37, 7.62), "polarization": 0.3}, 1e-6, 1e-10),
}


@pytest.mark.parametrize(("flaws", "place", "power"), EFFECTS.values(), ids=EFFECTS)
def test_rays_and_the_model_agree(flaws, place, power):
    some = states(4, seed=4, offset=0.12, angle=6e-3)
    some[:, :2] -= some[:, 6:]  # how far the apex stands off the beam, which then stands at (0, 0)
    some[:, 2] /= 3
    some[:, 6:] = 0
    rays = imperfect_readings(flawed(**flaws), some)
    model = dict(flaws)
    if "wavefront_radius" in model:
        bend = 1 / model.pop("wavefront_radius")
        model |= {"curvature_xx": bend, "curvature_yy": bend}
    lit = replace(PAPER, light=BenchLight(**model))
    away = np.abs(facets.readings(lit, some) - rays)
    plain = np.abs(facets.readings(PAPER, some) - rays)
    assert 1e3 * np.delete(away, [2, 5, 8], axis=1).max() < place
    assert (away[:, 2::3] / rays[:, 2::3]).max() < power
    assert plain.max() > 20 * away.max()
    np.testing.assert_allclose(ray_readings(lit, some), rays, atol=1e-12)


def test_imperfections_come_on_top_of_the_light_and_cost_nothing_where_there_are_none():
    both = replace(flawed(tip=1e-3), light=BenchLight(tip=1e-3, background=((1e-3, 1, 0),) * 3))
    sums = flawed(tip=2e-3, background=((1e-3, 1, 0),) * 3)
    ours, theirs, perfect = (imperfect_readings(sensor, AWAY) for sensor in (both, sums, PAPER))
    np.testing.assert_allclose(ours, theirs, rtol=1e-14)
    np.testing.assert_array_equal(perfect, facets.readings(PAPER, AWAY))
