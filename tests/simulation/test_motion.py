"""Motions become states."""

import numpy as np
import pytest

from facets import InputError
from facets.core import Random, Sine, Steps, Sweep, Table
from facets.simulation import states

ZERO = (0.0,) * 8
START = (-1.0, 0.0, 0.0, 0.0, 0.0, -0.01, 0.0, 0.0)
STOP = (1.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0)
RNG = np.random.default_rng(1)


def test_steps_stand_still_at_each_place():
    time, state = states(Steps(START, STOP, 3, 2, 10.0), RNG)
    assert state[:, 0].tolist() == [-1, -1, 0, 0, 1, 1]
    assert state[:, 5] == pytest.approx([-0.01, -0.01, 0, 0, 0.01, 0.01])
    assert time == pytest.approx(np.arange(6) / 10)


def test_a_sweep_ends_where_it_should():
    _, state = states(Sweep(START, STOP, 5, 1.0), RNG)
    assert state[:, 0] == pytest.approx([-1, -0.5, 0, 0.5, 1])


def test_a_sine_closes_on_itself():
    amplitude = (2.0, *ZERO[1:])
    cycles, phase = (1.0,) * 8, (np.pi / 2, *ZERO[1:])
    _, state = states(Sine(START, amplitude, cycles, phase, 4, 1.0), RNG)
    assert state[:, 0] == pytest.approx([1, -1, -3, -1])
    assert state[:, 5] == pytest.approx([-0.01] * 4)


def test_random_states_fill_their_box_and_follow_the_seed():
    box = (0.5, *ZERO[1:])
    motion = Random(START, box, 1000, 1.0)
    _, state = states(motion, np.random.default_rng(3))
    assert -1.5 <= state[:, 0].min() < -1.45
    assert -0.55 < state[:, 0].max() <= -0.5
    assert (state[:, 1] == 0).all()
    assert (states(motion, np.random.default_rng(3))[1] == state).all()


def test_a_table_is_read_in_its_units(tmp_path):
    file = tmp_path / "poses.csv"
    file.write_text("yaw_mrad,time_s,tx_mm\n1,0.5,0.1\n2,0.75,0.2\n")
    time, state = states(Table(file, 1, 100.0), RNG)
    assert time.tolist() == [0.5, 0.75]
    assert state[:, 0].tolist() == [0.1, 0.2]
    assert state[:, 5] == pytest.approx([0.001, 0.002])


def test_a_table_without_times_takes_the_rate(tmp_path):
    file = tmp_path / "poses.csv"
    file.write_text("tx_mm\n1\n2\n3\n")
    assert states(Table(file, 1, 100.0), RNG)[0] == pytest.approx([0, 0.01, 0.02])


def test_a_table_without_times_may_stand_still_at_each_row(tmp_path):
    file = tmp_path / "poses.csv"
    file.write_text("tx_mm\n1\n2\n")
    time, state = states(Table(file, 3, 100.0), RNG)
    assert time == pytest.approx(np.arange(6) / 100)
    assert state[:, 0].tolist() == [1, 1, 1, 2, 2, 2]


def test_a_table_with_times_does_not_stand_still(tmp_path):
    file = tmp_path / "poses.csv"
    file.write_text("tx_mm,time_s\n1,0\n2,1\n")
    with pytest.raises(InputError, match=r"poses\.csv: .* time_s.* samples_per_step: 3"):
        states(Table(file, 3, 100.0), RNG)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tx_mm\n1\nhere\n", r"poses\.csv:3: this row"),
        ("tx_mm\n1\n\n\nnan\n", r"poses\.csv:5: .* finite"),
        ("x\n1\n", "no column of a state"),
        ("tx_mm\n", "no rows"),
    ],
)
def test_a_bad_table_is_named_with_its_line(tmp_path, text, words):
    file = tmp_path / "poses.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=words):
        states(Table(file, 1, 1.0), RNG)
