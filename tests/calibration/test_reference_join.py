"""A reference's own table beside a recording: joined by time, its offset found."""

from __future__ import annotations

import numpy as np
import pytest
from facets.experiments.studies import rigs
from rig_samples import CONFIG, move, read

from facets import InputError
from facets.calibration import REFERENCE, Data, join_tables, recording_time
from facets.core import READING_COLUMNS, STATE_UNITS
from facets.files import tables

LATE = 0.0123
TIME = np.arange(600) / 500


def pose(at):
    return move(at / 4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Readings at 500 Hz, a reference at 97 Hz whose clock is ahead by `LATE`."""
    folder = tmp_path_factory.mktemp("join")
    rng = np.random.default_rng(1)
    rig = rigs.draw_rig(CONFIG.sensor, rng)
    empty = Data(np.zeros((600, 9)), pose(TIME), rigs.REFERENCE, np.zeros((600, 2)))
    raw = read(rig, empty, rng)
    columns = dict(zip(READING_COLUMNS, raw.T, strict=True))
    for name in ("time_s", "host_s", "clock"):
        tables.write_table(folder / f"{name}.csv", {name: TIME, **columns}, {})
    clock = np.arange(-0.2, 1.5, 1 / 97)
    columns = dict(zip(REFERENCE, (pose(clock - LATE) / STATE_UNITS[:6]).T, strict=True))
    for name, start in (("ref", 0), ("later", 100)):
        tables.write_table(folder / f"{name}.csv", {"time_s": clock + start, **columns}, {})
    return folder


def join(folder, readings, reference="ref"):
    paths = (folder / f"{name}.csv" for name in (readings, reference))
    return join_tables(*paths, CONFIG.sensor, CONFIG.calibrate)


def test_the_offset_of_the_clocks_is_found(folder):
    joined = join(folder, "time_s")
    assert joined.offset == pytest.approx(LATE, abs=5e-4)
    assert joined.likeness > 0.98
    speed = np.gradient(pose(TIME), TIME, axis=0)
    off = joined.data.pose - pose(TIME)
    delay = (off * speed).sum() / (speed**2).sum()
    assert np.abs(off - delay * speed).max(axis=0) == pytest.approx(0, abs=2e-3)
    np.testing.assert_allclose(joined.data.velocity[5:-5], speed[5:-5], atol=0.02 * speed.max())
    # a recording brings the time of its computer
    assert join(folder, "host_s").offset == joined.offset


@pytest.mark.parametrize(
    ("readings", "reference", "reason"),
    [
        ("clock", "ref", r"clock\.csv: missing columns: time_s"),
        ("time_s", "later", "they share no time; .* offset of"),
        ("time_s", "time_s", "missing columns: ref_tx_mm"),
    ],
)
def test_tables_that_cannot_be_joined_are_refused(folder, readings, reference, reason):
    with pytest.raises(InputError, match=reason):
        join(folder, readings, reference)


def test_a_busy_machine_does_not_move_the_times_of_a_recording():
    board = np.arange(20_000) / 1000
    host = 500 + (1 + 20e-6) * board
    late = host.copy()
    late[:1500] -= 0.07  # until the line of arrivals has settled
    late[9000:9400] += 0.03
    assert recording_time(late, board) == pytest.approx(host, abs=3e-4)
    board[10_000:] -= 5  # the board restarted
    assert recording_time(late, board) is late
