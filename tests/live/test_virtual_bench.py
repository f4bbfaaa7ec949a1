"""Where the virtual bench has its beam, and what a reference beside it says."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import facets
from facets.core import STATE_UNITS, Mode, Random, Sine, Vibration
from facets.live import Bench, Faults
from facets.simulation import shake

CONFIG = facets.load("bench")
ZERO = (0.0,) * 8
ONES = (1.0,) * 8


def bench(folder, motion, reference=False):
    config = replace(CONFIG, motions={"it": motion})
    return Bench(config, "it", 1000.0, Faults(), 1, folder, reference=reference)


def sine(centre, amplitude):
    phase = (np.pi / 2, *ZERO[1:])
    return Sine((*centre, *ZERO[2:]), (amplitude, *ZERO[1:]), ONES, phase, 100, 100.0)


@pytest.mark.parametrize(
    ("centre", "amplitude", "place", "waits"),
    [
        ((0, 0), 0.3, (0, 0), False),  # begins 0.3 mm beside the beam, and is lit all the way
        ((0, 0), 4, (4, 0), True),  # goes where no fixed beam lights it
        ((2, 1), 0.1, (2.1, 1), False),  # is lit by a beam that is set up on it
    ],
)
def test_the_beam_stands_at_the_origin_where_that_lights_the_motion(
    tmp_path, centre, amplitude, place, waits
):
    made = bench(tmp_path, sine(centre, amplitude))
    try:
        assert made.model.place == pytest.approx(place)
        assert np.isinf(made.mirror.begin) == waits
    finally:
        made.begin = 0.0
        made.end()


def test_a_reference_reads_the_pose_as_well_as_the_configuration_says(tmp_path):
    motion = Random(ZERO, (0.1, 0.1, 1, 1e-3, 1e-3, 1e-3, 0, 0), 50, 10.0)
    made = bench(tmp_path, motion, reference=True)
    made.begin = 100.0  # the host's clock, s
    try:
        for _ in range(400):  # 4 s of 10 samples at a time
            first = made.count.made
            made.make(10, (first + 10) / 1000)
    finally:
        made.end()
    said = pd.DataFrame(made.reference.columns())
    assert len(said) == pytest.approx(400, abs=2)
    truth = made.mirror.interpolate(said["time_s"].to_numpy() - 100.0)
    error = said.iloc[:, 1:] - (truth / STATE_UNITS)[:, :6]
    sigma = np.array(CONFIG.calibrate.reference) / STATE_UNITS[:6]
    assert (error.abs().max() < 6 * sigma).all()
    assert (error.std() > 0.3 * sigma).all()


def test_a_shaken_mirror_follows_its_force_from_the_beginning(tmp_path):
    motion = Vibration({"bounce": Mode(60.0, 0.01, (0.0, 0.0, 0.01, 0.0, 0.0, 0.0))}, samples=500)
    made = bench(tmp_path, motion)
    try:
        time = np.arange(1200) / 1000
        force, state = made.mirror.force(time), made.mirror.interpolate(time)
    finally:
        made.begin = 0.0
        made.end()
    expected = shake(motion, np.random.default_rng(1))
    assert force == pytest.approx(np.tile(expected[0], 3)[:1200])
    assert state[:, 2] == pytest.approx(np.tile(expected[1][:, 2], 3)[:1200], abs=1e-12)
