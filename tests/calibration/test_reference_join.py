"""A reference's own table beside a recording: joined by time, its offset found."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments import rigs

import facets
from facets import InputError
from facets.calibration import REFERENCE, recording_time
from facets.calibration.reference_join import join_tables
from facets.core import READING_COLUMNS, STATE_UNITS
from facets.files import tables

CONFIG = facets.load("paper")
LATE = 0.0123


def pose(at):
    cycles, phase = np.array([1.3, 2.1, 1.7, 2.9, 3.3, 2.3]), np.arange(6)
    return 0.8 * rigs.BOX * np.sin(2 * np.pi * cycles * at[:, None] + phase)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Readings at 500 Hz, a reference at 97 Hz whose clock is ahead by `LATE`."""
    folder = tmp_path_factory.mktemp("join")
    rng = np.random.default_rng(1)
    rig = rigs.draw_rig(CONFIG.sensor, rng)
    time = np.arange(600) / 500
    empty = rigs.Data(np.zeros((600, 9)), pose(time), rigs.REFERENCE, np.zeros((600, 2)))
    raw = rigs.read(rig, empty, rng).raw
    columns = {name: raw[:, n] for n, name in enumerate(READING_COLUMNS)}
    tables.write_table(folder / "readings.csv", {"time_s": time, **columns}, {})
    clock = np.arange(-0.2, 1.5, 1 / 97)
    said = pose(clock - LATE)
    columns = {name: said[:, n] / STATE_UNITS[n] for n, name in enumerate(REFERENCE)}
    tables.write_table(folder / "ref.csv", {"time_s": clock, **columns}, {})
    tables.write_table(folder / "later.csv", {"time_s": clock + 100, **columns}, {})
    return folder


def test_the_offset_of_the_clocks_is_found(folder):
    found = join_tables(
        folder / "readings.csv", folder / "ref.csv", CONFIG.sensor, CONFIG.calibrate
    )
    assert found.offset == pytest.approx(LATE, abs=5e-4)
    assert found.likeness > 0.98
    at = np.arange(600) / 500
    speed = np.gradient(pose(at), at, axis=0)
    left = found.data.pose - pose(at)
    delay = (left * speed).sum() / (speed**2).sum()
    assert np.abs(left - delay * speed).max(axis=0) == pytest.approx(0, abs=2e-3)
    np.testing.assert_allclose(found.data.velocity[5:-5], speed[5:-5], atol=0.02 * speed.max())


def test_a_recording_brings_the_time_of_its_computer(folder, tmp_path):
    text = (folder / "readings.csv").read_text()
    for name in ("host_s", "clock"):
        (tmp_path / f"{name}.csv").write_text(text.replace("time_s", name))
    wanted = join_tables(
        folder / "readings.csv", folder / "ref.csv", CONFIG.sensor, CONFIG.calibrate
    )
    found = join_tables(
        tmp_path / "host_s.csv", folder / "ref.csv", CONFIG.sensor, CONFIG.calibrate
    )
    assert found.offset == wanted.offset
    with pytest.raises(InputError, match=r"clock\.csv: missing columns: time_s"):
        join_tables(tmp_path / "clock.csv", folder / "ref.csv", CONFIG.sensor, CONFIG.calibrate)


def test_a_busy_machine_does_not_move_the_times_of_a_recording():
    board = np.arange(20_000) / 1000
    host = 500 + (1 + 20e-6) * board
    late = host.copy()
    late[:1500] -= 0.07  # until the line of arrivals has settled
    late[9000:9400] += 0.03
    assert recording_time(late, board) == pytest.approx(host, abs=3e-4)
    board[10_000:] -= 5  # the board restarted
    assert recording_time(late, board) is late


def test_tables_that_share_no_time_are_refused(folder):
    with pytest.raises(InputError, match=r"they share no time; .* offset of"):
        join_tables(folder / "readings.csv", folder / "later.csv", CONFIG.sensor, CONFIG.calibrate)


def test_a_reference_without_an_axis_is_refused(folder):
    with pytest.raises(InputError, match="missing columns: ref_tx_mm"):
        join_tables(
            folder / "readings.csv", folder / "readings.csv", CONFIG.sensor, CONFIG.calibrate
        )
