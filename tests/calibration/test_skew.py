"""Channels that are read one after the other, found from a motion in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets.experiments import rigs

import facets
from facets import add_noise
from facets.calibration import Data, choice, search, states_of, velocities
from facets.calibration.fit import fit
from facets.calibration.verdict import verdict
from facets.detectors import invert_correction

CONFIG = facets.load("paper")
NOMINAL = CONFIG.sensor
OFF = dict.fromkeys(CONFIG.calibrate.effects, "off")
SETTINGS = replace(CONFIG.calibrate, effects=OFF | {"channel_skew": "auto"})
DELAYS = (0.0, 4e-5, 1e-4)


def pose(at):
    cycles, phase = np.array([5.2, 8.4, 6.8, 11.6, 13.2, 9.2]), np.arange(6)
    return 0.9 * rigs.BOX * np.sin(2 * np.pi * cycles * at[:, None] + phase)


def read_in_turn(count=120, timed=True):
    """Detectors read in turn where the mirror really is then: no derivative, no model of skew."""
    rng = np.random.default_rng(3)
    rig, time = rigs.draw_rig(NOMINAL, rng), np.arange(count) / 1000
    empty = Data(np.zeros((count, 9)), pose(time), rigs.REFERENCE, np.zeros((count, 2)))
    exact = np.empty((count, 9))
    for k, delay in enumerate(DELAYS):
        later = states_of(empty._replace(pose=pose(time + delay)), np.zeros((count, 9)), rig.values)
        exact[:, 3 * k : 3 * k + 3] = facets.readings(rig.sensor, later)[:, 3 * k : 3 * k + 3]
    raw = invert_correction(rig.sensor, add_noise(rig.sensor, exact, rng))
    speed = velocities(time, empty.pose) if timed else None
    return empty._replace(raw=raw, velocity=speed)


def test_channels_read_in_turn_are_found():
    found = verdict(NOMINAL, read_in_turn(), choice(NOMINAL, SETTINGS), SETTINGS)
    assert {row.key for row in found.search.rows if row.accepted} == {"channel_skew"}
    assert found.sensor.light.delays == pytest.approx(DELAYS, abs=1e-5)
    assert found.is_trusted


def test_a_table_without_time_says_that_it_can_not_tell():
    data = read_in_turn(30, timed=False)
    wanted = choice(NOMINAL, SETTINGS)
    rows = search(NOMINAL, data, SETTINGS, fit(NOMINAL, data, wanted)).rows
    assert [(row.key, row.accepted, row.why) for row in rows] == [
        ("channel_skew", False, "no time_s of a motion")
    ]
