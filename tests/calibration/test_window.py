"""Spots that hang over the edge of a detector's sensitive area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from facets.experiments.studies import rigs
from rig_samples import judge, pose_errors, sample_motion, sample_rig, words_of

import facets


def cut_light(sensor, state, exact):
    """Readings of a real detector, whose edge takes light."""
    apertures = facets.Apertures(detectors=True)
    return facets.readings(replace(sensor, apertures=apertures), state)


def test_what_hangs_over_the_edge_is_left_out():
    box = np.array([0.12, 0.12, 3.0, 8e-3, 8e-3, 1.5e-2])
    rig, data, state = sample_rig(200, 2, box=box, alter=cut_light)
    lost = np.abs(cut_light(rig.sensor, state, None) / facets.readings(rig.sensor, state) - 1)
    assert 10 < (lost[:, 2::3].max(axis=1) > 1e-3).sum() < 100
    judged = judge(data)
    assert "from the edge of the sensitive area" in words_of(judged)
    assert judged.is_trusted
    assert not judged.search.outliers  # the other detectors of these samples stay
    assert np.isfinite(judged.fitted.raw).mean() < 1
    fresh, state = sample_motion(rig, 300, np.random.default_rng(7))
    error, best = (
        rigs.rms(pose_errors(sensor, fresh, state)) for sensor in (judged.sensor, rig.sensor)
    )
    assert (error / best).max() < 1.5
