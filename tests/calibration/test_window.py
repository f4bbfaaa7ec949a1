"""Spots that hang over the edge of a detector's sensitive area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from facets.experiments import rigs
from rig_samples import NOMINAL, judge, sample_rig, words_of

import facets

CUT = facets.Apertures(detectors=True)


def cut_light(sensor, state, exact):
    """Readings of a real detector, whose edge takes light."""
    return facets.readings(replace(sensor, apertures=CUT), state)


def sample_over_the_edge(count):
    box = np.array([0.12, 0.12, 3.0, 8e-3, 8e-3, 1.5e-2])
    return sample_rig(count, 2, box=box, alter=cut_light)


def test_what_hangs_over_the_edge_is_left_out():
    rig, data, state = sample_over_the_edge(200)
    lost = np.abs(cut_light(rig.sensor, state, None) / facets.readings(rig.sensor, state) - 1)
    assert 10 < (lost[:, 2::3].max(axis=1) > 1e-3).sum() < 100
    judged = judge(data)
    assert "to the edge of the sensitive area" in words_of(judged)
    assert judged.is_trusted
    assert not judged.search.outliers  # the other detectors of these samples stay
    assert np.isfinite(judged.fitted.raw).mean() < 1
    fresh, state = rigs.sample_motion(rig, 300, np.random.default_rng(7))
    error, best = (
        rigs.rms(rigs.errors(sensor, fresh, state)) for sensor in (judged.sensor, rig.sensor)
    )
    assert (error / best).max() < 1.5


def test_a_model_that_knows_the_edge_takes_all():
    _, data, _ = sample_over_the_edge(40)
    judged = judge(data, sensor=replace(NOMINAL, apertures=CUT))
    assert "to the edge of the sensitive area" not in words_of(judged)
    read = [np.isfinite(part.raw).sum() for part in (judged.fitted, judged.held)]
    assert sum(read) + 9 * len(judged.search.outliers) == np.isfinite(data.raw).sum()
