"""Spots that hang over the edge of a detector's sensitive area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import rigs

import facets
from facets import add_noise
from facets.calibration import Data, choice, states_of
from facets.calibration import verdict as judging
from facets.detectors import correct, invert_correction

CONFIG = facets.load("paper")
NOMINAL = CONFIG.sensor
SETTINGS = replace(CONFIG.calibrate, effects=dict.fromkeys(CONFIG.calibrate.effects, "off"))
WIDE = np.array([0.12, 0.12, 3.0, 8e-3, 8e-3, 1.5e-2])


def over_the_edge(count=200):
    """Readings of a real detector, whose edge takes light; and which samples lost some."""
    rng = np.random.default_rng(2)
    rig = rigs.draw_rig(NOMINAL, rng)
    pose = rng.uniform(-1, 1, (count, 6)) * WIDE
    data = Data(np.empty((count, 9)), pose, rigs.REFERENCE, np.zeros((count, 2)))
    state = states_of(data, np.zeros((count, 9)), rig.values)
    real = replace(rig.sensor, apertures=facets.Apertures(detectors=True))
    exact = facets.readings(real, state)
    lost = np.abs(exact / facets.readings(rig.sensor, state) - 1)[:, 2::3].max(axis=1) > 1e-3
    raw = invert_correction(rig.sensor, add_noise(rig.sensor, exact, rng))
    return rig, data._replace(raw=raw), lost


def worst_ratio(sensor, rig):
    rng = np.random.default_rng(7)
    fresh, state = rigs.sample_motion(rig, 300, rng)
    found, best = (
        rigs.rms((facets.solve(one, correct(one, fresh.raw), beam="known").state - state)[:, :6])
        for one in (sensor, rig.sensor)
    )
    return (found / best).max()


@pytest.mark.slow
def test_what_hangs_over_the_edge_is_left_out(monkeypatch):
    rig, data, lost = over_the_edge()
    assert 10 < lost.sum() < 100
    found = judging.verdict(NOMINAL, data, choice(NOMINAL, SETTINGS), SETTINGS)
    words = " ".join(one.words for one in found.findings)
    assert "to the edge of the sensitive area" in words
    assert found.is_trusted
    assert worst_ratio(found.sensor, rig) < 1.5
    monkeypatch.setattr(judging, "exclude_edge_readings", lambda sensor, data: (data, []))
    without = judging.verdict(NOMINAL, data, choice(NOMINAL, SETTINGS), SETTINGS)
    assert len(without.fitted.raw) < len(found.fitted.raw)  # whole rows go, as outliers


@pytest.mark.parametrize("cut", [False, True], ids=["ideal", "cut"])
def test_a_model_that_knows_the_edge_takes_all(cut):
    _, data, _ = over_the_edge(40)
    sensor = replace(NOMINAL, apertures=facets.Apertures(detectors=cut))
    kept, said = judging.exclude_edge_readings(sensor, data)
    assert bool(said) is not cut
    there = np.isfinite(kept.raw).sum()
    assert (there == np.isfinite(data.raw).sum()) == cut
