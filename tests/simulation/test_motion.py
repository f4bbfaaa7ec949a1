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


@pytest.mark.parametrize(
    ("motion", "rate", "tx"),
    [
        (Steps(START, STOP, 3, 2, 10.0), 10, [-1, -1, 0, 0, 1, 1]),
        (Sweep(START, STOP, 5, 1.0), 1, [-1, -0.5, 0, 0.5, 1]),
        (Sine(START, STOP, (1.0,) * 8, (np.pi / 2,) * 8, 4, 2.0), 2, [0, -1, -2, -1]),
    ],
)
def test_a_motion_has_its_form(motion, rate, tx):
    time, state = states(motion, RNG)
    assert time == pytest.approx(np.arange(len(tx)) / rate)
    assert state[:, 0] == pytest.approx(tx)
    assert state[:, 5] == pytest.approx(0.01 * state[:, 0])


def test_random_states_fill_their_box_and_follow_the_seed():
    motion = Random(START, (0.5, *ZERO[1:]), 1000, 1.0)
    state, again = (states(motion, np.random.default_rng(3))[1] for _ in range(2))
    assert (state == again).all()
    assert [state[:, 0].min(), state[:, 0].max()] == pytest.approx([-1.5, -0.5], abs=0.05)
    assert np.ptp(state[:, 1:]) == pytest.approx(0.01)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "poses.csv"


@pytest.mark.parametrize(
    ("text", "hold", "times", "tx", "yaw"),
    [
        ("yaw_mrad,time_s,tx_mm\n1,0.5,0.1\n2,0.75,0.2\n", 1, [0.5, 0.75],
         [0.1, 0.2], [1e-3, 2e-3]),
        ("tx_mm\n1\n2\n", 3, np.arange(6) / 100, [1, 1, 1, 2, 2, 2], [0] * 6),
    ],
)  # fmt: skip
def test_a_table_has_its_units_and_its_times_or_the_rate_and_stands(
    file, text, hold, times, tx, yaw
):
    file.write_text(text)
    time, state = states(Table(file, hold, 100.0), RNG)
    assert time == pytest.approx(times)
    assert state[:, [0, 5]] == pytest.approx(np.stack([tx, yaw], axis=1))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tx_mm\n1\nhere\n", r"poses\.csv:3: this row"),
        ("tx_mm\n1\n\n\nnan\n", r"poses\.csv:5: .* finite"),
        ("x\n1\n", "no column of a state"),
    ],
)
def test_a_bad_table_is_named_with_its_line(file, text, words):
    file.write_text(text)
    with pytest.raises(InputError, match=words):
        states(Table(file, 1, 1.0), RNG)
