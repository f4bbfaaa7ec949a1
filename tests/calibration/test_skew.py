"""Channels that are read one after the other, found from a motion in time."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments import rigs
from rig_samples import NOMINAL, accepted_effects, judge, settings

import facets
from facets import add_noise
from facets.calibration import Data, states_of, velocities
from facets.detectors import invert_correction

DELAYS = (0.0, 4e-5, 1e-4)


def pose(at):
    cycles, phase = np.array([5.2, 8.4, 6.8, 11.6, 13.2, 9.2]), np.arange(6)
    return 0.9 * rigs.BOX * np.sin(2 * np.pi * cycles * at[:, None] + phase)


def test_channels_read_in_turn_are_found():
    """Detectors are read where the mirror really is then: no derivative, no model of skew."""
    rng, count = np.random.default_rng(3), 120
    rig, time = rigs.draw_rig(NOMINAL, rng), np.arange(count) / 1000
    data = Data(np.zeros((count, 9)), pose(time), rigs.REFERENCE, np.zeros((count, 2)))
    exact = np.empty((count, 9))
    for k, delay in enumerate(DELAYS):
        later = states_of(data._replace(pose=pose(time + delay)), np.zeros((count, 9)), rig.values)
        exact[:, 3 * k : 3 * k + 3] = facets.readings(rig.sensor, later)[:, 3 * k : 3 * k + 3]
    data = data._replace(raw=invert_correction(rig.sensor, add_noise(rig.sensor, exact, rng)))
    asked = settings(channel_skew="auto")
    judged = judge(data._replace(velocity=velocities(time, data.pose)), asked)
    assert accepted_effects(judged) == {"channel_skew"}
    assert judged.sensor.light.delays == pytest.approx(DELAYS, abs=1e-5)
    assert judged.is_trusted
    rows = judge(data.part(slice(0, 30)), asked).search.rows
    assert [(row.key, row.accepted, row.why) for row in rows] == [
        ("channel_skew", False, "no time_s of a motion")
    ]
