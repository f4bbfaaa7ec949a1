"""Where the virtual bench has its beam, and what a reference beside it says."""

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets.core import STATE_UNITS, Random, Sine
from facets.live import Bench, BenchSetup, Faults

CONFIG = facets.load("bench")
ZERO = (0.0,) * 8
ONES = (1.0,) * 8
NO_FAULTS = Faults()


@pytest.fixture
def bench(tmp_path):
    """Makes a bench with a motion, which begins when its test says so; ends it after the test."""
    benches = []

    def make(motion, faults=NO_FAULTS, reference=False):
        config = replace(CONFIG, motions={"it": motion})
        setup = BenchSetup(config, "it", 1000.0, faults, reference=reference)
        benches.append(Bench(setup, tmp_path))
        benches[0].begin = 100.0  # the host's clock, s
        return benches[0]

    yield make
    benches[0].end()


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
    bench, centre, amplitude, place, waits
):
    model = bench(sine(centre, amplitude))
    assert model.model.place == pytest.approx(place)
    assert np.isinf(model.mirror.begin) == waits


def test_a_late_bench_catches_up_until_the_stage_moves(bench):
    made = bench(sine((0, 0), 0.1))
    made.clock = lambda: made.begin + made.last + 0.15
    assert (made.now(), made.count.slipped) == (pytest.approx(0.15), 0.0)
    made.count.moves = 1
    assert made.now() == pytest.approx(0.155)
    assert made.count.slipped == pytest.approx(0.145)


def test_a_board_is_unplugged_and_restarts(bench):
    made = bench(sine((0, 0), 0.1), Faults(unplug=1e6, restart=1e6))
    board = made.board
    made.count.made = 10
    made.schedule.draw(0.001)
    board.suffer(0.001)
    assert not board.port.link.is_symlink()
    board.suffer(0.4)
    assert board.port.link.is_symlink()
    assert (board.born, made.count.restarts) == (10, 1)


def test_a_reference_reads_the_pose_as_well_as_the_configuration_says(bench):
    motion = Random(ZERO, (0.1, 0.1, 1, 1e-3, 1e-3, 1e-3, 0, 0), 50, 10.0)
    made = bench(motion, reference=True)
    for first in range(0, 4_000, 10):
        made.make(10, (first + 10) / 1000)
    columns = made.reference.columns()
    times, poses = columns.pop("time_s"), np.column_stack(list(columns.values()))
    assert len(times) == pytest.approx(400, abs=2)
    error = poses - (made.mirror.interpolate(times - 100.0) / STATE_UNITS)[:, :6]
    sigma = np.array(CONFIG.calibrate.reference) / STATE_UNITS[:6]
    assert (np.abs(error).max(axis=0) < 6 * sigma).all()
    assert (error.std(axis=0) > 0.3 * sigma).all()
