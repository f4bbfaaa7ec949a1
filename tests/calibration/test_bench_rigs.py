"""A rig with the light of a bench, read by rays that share no optics with the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import bench_rays, disturbed_rigs, rigs

import facets

NOMINAL = facets.Sensor()
IDEAL = bench_rays.RayBench(
    np.eye(2) * (NOMINAL.beam.diameter_x / 4) ** 2, np.zeros((2, 2)), 0.0, None, 0.0, np.zeros(3),
    np.zeros((3, 2)), 0.03, np.zeros((3, 3)),
)  # fmt: skip


def states(count=20):
    rng = np.random.default_rng(1)
    state = np.zeros((count, 8))
    state[:, :6] = rng.uniform(-1, 1, (count, 6)) * rigs.BOX
    state[:, 6:] = 0.01 * rng.normal(size=(count, 2))
    return state


@pytest.mark.parametrize(
    ("bench", "light", "place", "power"),
    [
        ({}, {}, 1e-11, 1e-13),
        ({"curvature": np.array([[3e-4, 1e-4], [1e-4, -2e-4]])},
         {"curvature_xx": 3e-4, "curvature_xy": 1e-4, "curvature_yy": -2e-4}, 2e-5, 1e-5),
        # the rays have the leading terms alone, and come to 1.2 mm from a detector's edges
        ({"wavelength": 633e-6}, {"wavelength": 633e-6}, 1e-3, 2e-5),
        ({"strips": np.array([0.01, 0.005, 0.008])}, {"strips": (0.01, 0.005, 0.008)}, 3e-5, 1e-6),
        ({"background": np.array([[5e-4, 1, -2], [3e-4, 0, 1], [1e-4, 2, 2]])},
         {"background": ((5e-4, 1.0, -2.0), (3e-4, 0.0, 1.0), (1e-4, 2.0, 2.0))}, 1e-10, 1e-12),
    ],
    ids=["ideal", "curvature", "diffraction", "strips", "background"],
)  # fmt: skip
def test_the_model_reads_what_the_rays_read(bench, light, place, power):
    state = states()
    rays = bench_rays.spots(NOMINAL, IDEAL._replace(**bench), state)
    off = rays - facets.readings(replace(NOMINAL, light=replace(NOMINAL.light, **light)), state)
    assert np.abs(np.delete(off, [2, 5, 8], axis=1)).max() < place
    assert np.abs(off[:, 2::3]).max() < power


@pytest.mark.slow
def test_a_rig_with_every_effect_at_once_is_calibrated():
    """One of the twenty of `experiments/rigs.py --bench`, with fewer samples."""
    one = rigs.try_bench_rig(0, 300, "paper", fresh=300)
    assert one.verdict.is_trusted
    taken = {row.key for row in one.verdict.search.rows if row.accepted}
    assert {"curvature", "diffraction", "strips", "background"} <= taken
    assert (one.over[2:] < 1.35).all()
    assert (one.over[:2] < 3).all()
    assert (one.inside > 0.8).all()


@pytest.mark.slow
def test_a_beam_with_another_mode_is_calibrated_and_named():
    """3 % of LG10, which made x and y ten times wrong while the model's beam was Gaussian."""
    case = next(one for one in disturbed_rigs.cases() if one.name == "3 % LG10")
    one = rigs.try_bench_rig(1, 300, "paper", fresh=300, wrong=case.wrong)
    assert one.verdict.is_trusted
    assert any("profile is not Gaussian" in said.words for said in one.verdict.findings)
    assert max(one.verdict.sensor.light.profile) == pytest.approx(0.015, abs=0.003)
    assert (one.over < 1.5).all()
    assert (one.inside > 0.85).all()
