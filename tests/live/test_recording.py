"""A recording meets disks that refuse, folders that are none, and errors while it is closed."""

from __future__ import annotations

import errno
import json
import os
import shutil
import socket
import threading
import time
from contextlib import suppress
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pyarrow.parquet as pq
import pytest
from facets.experiments.studies import kills
from programs import await_true
from recorded import metadata, record

import facets
from facets import InputError
from facets.files import join_columns
from facets.live import (
    SIZE,
    Block,
    Damage,
    Disk,
    Ending,
    Live,
    Pipeline,
    Playback,
    PortError,
    Reader,
    Recording,
    acquire,
    blocks,
    pack,
    parser,
    recorded_poses,
    replay,
    utc_offset,
)

CONFIG = facets.load("bench")
META = metadata()


class Full(Disk):
    """A disk with this many free bytes, which takes what fits and refuses the rest.

    only: the name of a file that alone is refused, as one that is as large as files may be.
    """

    def __init__(self, free, only=""):
        self.free, self.only, self.sync_error, self.handles = free, only, None, {}

    def create(self, path):
        handle = super().create(path)
        self.handles[handle] = path.name
        return handle

    def append(self, handle, data):
        if self.only not in ("", self.handles[handle]):
            return super().append(handle, data)
        if self.free <= 0:
            code = errno.EFBIG if self.only else errno.ENOSPC
            raise OSError(code, os.strerror(code))
        taken = super().append(handle, memoryview(data)[: self.free])
        self.free -= taken
        return taken

    def shorten(self, handle, size):
        self.free += os.fstat(handle).st_size - size
        super().shorten(handle, size)

    def sync(self, handle):
        if self.sync_error:
            raise self.sync_error
        super().sync(handle)

    def close(self, handle):
        del self.handles[handle]
        super().close(handle)


def pieces(count, each=25):
    data = kills.stream(count * each)
    size = each * SIZE
    return [Block(data[n * size : (n + 1) * size], 1.0 + 0.0025 * n, None) for n in range(count)]


@pytest.mark.parametrize("room", [100, 1_650, 5_000, 20_011, 31_999])
def test_what_was_recorded_before_the_disk_was_full_is_readable(tmp_path, room):
    recording = record(tmp_path / "r", count=40, disk=Full(room + len(META)))
    assert "No space left" in recording.messages()[0]
    damage = Damage()
    size = sum(len(block.data) for block in blocks(tmp_path / "r", damage))
    assert damage in (Damage(), Damage(unproven=25 * SIZE))  # the last block, whose row is refused
    assert size + recording.lost == 1_000 * SIZE
    again = [len(poses) for poses in replay(tmp_path / "r", Pipeline(CONFIG))]
    assert sum(again) == size // SIZE
    old = recorded_poses(tmp_path / "r")
    assert not old or np.isin(old["seq"], range(1_000)).all()


def test_a_replay_writes_the_samples_of_many_blocks_together_and_all_of_them(tmp_path):
    recording = Recording(tmp_path / "r", META, CONFIG.resolved)
    for block in pieces(500):
        recording.add_block(block)
    recording.close()
    path, playback = tmp_path / "poses.parquet", Playback(tmp_path / "r", CONFIG)
    poses = list(playback.poses())
    playback.finish(poses, path, False, None)
    file = pq.ParquetFile(path)
    rows = [file.metadata.row_group(n).num_rows for n in range(file.num_row_groups)]
    assert rows == [5_000, 5_000, 2_500]
    table, parts = file.read(), [part.columns() for part in poses]
    for name, column in join_columns(parts).items():
        if name not in ("status", "used"):  # which tables have in words
            np.testing.assert_array_equal(table[name].to_numpy(), column)


def test_blocks_taken_together_give_the_bits_and_counts_of_one_after_the_other(tmp_path):
    """Of blocks that end anywhere, with a spoilt byte, lost samples and darkness on detector B."""
    samples = parser("frames", "").feed(kills.stream(6_000))
    samples.seq[2_000:] += 7
    samples.time[2_000:] += 700
    samples.counts[3_000:3_100, 4:8] = 0
    data = bytearray(pack(samples))
    data[1_000 * SIZE + 9] ^= 1
    recording, alone, parts = (
        Recording(tmp_path / "rec", META, CONFIG.resolved),
        Pipeline(CONFIG),
        [],
    )
    for n in range(0, len(data), 1_300):
        block = Block(bytes(data[n : n + 1_300]), 1.0 + 1e-4 * n / SIZE, None)
        recording.add_block(block)
        parts.append(alone.feed(block.data, block.arrival).columns())
    recording.close()
    together = Pipeline(CONFIG)
    replayed = [poses.columns() for poses in replay(tmp_path / "rec", together)]
    assert len(replayed) < len(parts) / 4
    expected, columns = join_columns(parts), join_columns(replayed)
    assert {name: column.tobytes() for name, column in columns.items()} == {
        name: column.tobytes() for name, column in expected.items()
    }
    assert repr(vars(together.tally)) == repr(vars(alone.tally))
    assert (together.parser.corrupt, together.sequence.lost) == (1, 8)


@pytest.mark.parametrize("only", ["poses.arrows", "index.bin", "events.jsonl"])
def test_a_file_that_is_refused_costs_no_received_byte(tmp_path, only):
    recording = record(tmp_path / "r", count=20, disk=Full(150, only=only))
    (message,) = recording.messages()
    assert f"{only}: cannot be written to: File too large" in message
    assert "bytes" not in message
    assert ("500 poses are not recorded" in message) == (only == "poses.arrows")
    kept = b"".join(block.data for block in blocks(tmp_path / "r"))
    assert kept == kills.stream(500)


@pytest.mark.parametrize("room", [74_000, 90_000, 150_000])
def test_on_a_full_disk_the_poses_make_room_for_the_bytes(tmp_path, room):
    """Bytes, index and events need 73 kB; the poses would need 250 kB more."""
    recording = record(tmp_path / "r", count=40, disk=Full(room + len(META)))
    assert recording.lost == 0
    (message,) = recording.messages()
    assert "poses.arrows: was emptied, to make room for the received bytes" in message
    assert "1000 poses are not recorded" in message
    damage = Damage()
    kept = b"".join(block.data for block in blocks(tmp_path / "r", damage))
    assert (kept, damage) == (kills.stream(1_000), Damage())
    assert recorded_poses(tmp_path / "r") == {}
    seal = json.loads((tmp_path / "r" / "events.jsonl").read_text().splitlines()[-1])
    assert (seal["bytes"], seal["poses"], seal["refused_poses"]) == (1_000 * SIZE, 0, 1_000)


def test_recording_goes_on_when_the_disk_has_space_again(tmp_path, monkeypatch):
    monkeypatch.setattr("facets.live.recording.writer.RETRY_INTERVAL_S", 0.0)
    disk, lost = Full(10_000 + len(META)), 0
    with Recording(tmp_path / "r", META, CONFIG.resolved, disk=disk) as recording:
        for n, block in enumerate(pieces(40)):
            if n == 20:
                lost, disk.free = recording.lost, 10**9
            recording.add_block(block)
    assert recording.lost == lost > 0
    pipeline = Pipeline(CONFIG)
    count = sum(len(poses) for poses in replay(tmp_path / "r", pipeline))
    assert count == 1_000 - lost // SIZE
    assert pipeline.sequence.lost == lost // SIZE
    events = (tmp_path / "r" / "events.jsonl").read_text()
    assert f'"event": "recording again", "lost_bytes": {lost}' in events


class SlowDisk(Disk):
    def append(self, handle, data):
        time.sleep(0.05)
        return super().append(handle, data)


def test_a_slow_disk_does_not_change_the_times_of_the_samples(tmp_path):
    with Recording(tmp_path / "r", META, CONFIG.resolved, disk=SlowDisk()) as recording:
        recording.add_block(Block(kills.stream(1), time.monotonic(), None))
    assert utc_offset(tmp_path / "r") == pytest.approx(time.time() - time.monotonic(), abs=0.02)


def test_a_disk_that_can_not_sync_is_told_and_goes_on(tmp_path):
    disk = Full(10**9)
    recording = Recording(tmp_path / "r", META, CONFIG.resolved, disk=disk)
    disk.sync_error = OSError(errno.EIO, "Input/output error")
    recording.add_block(pieces(1)[0])
    recording.sync()
    recording.close()
    assert "cannot be synced: Input/output error" in recording.messages()[0]
    assert recording.lost == 0
    assert not disk.handles


@pytest.mark.skipif(os.name == "nt", reason="no open file can be deleted")
def test_a_recording_that_is_deleted_during_its_run_is_told(tmp_path):
    recording = Recording(tmp_path / "r", META, CONFIG.resolved)
    recording.sync()
    shutil.rmtree(tmp_path / "r")
    assert not recording.messages()
    recording.close()
    assert "bytes.bin: cannot be synced: it was deleted" in recording.messages()[0]


def test_the_folder_is_synced_before_the_first_byte_and_files_beside_the_writing(tmp_path):
    folders, files = [], set()

    class Watched(Disk):
        def sync_folder(self, folder):
            super().sync_folder(folder)
            folders.append(folder)

        def sync(self, handle):
            super().sync(handle)
            if threading.current_thread().name == "sync":
                files.add(handle)

    with Recording(tmp_path / "r", META, CONFIG.resolved, sync=0.01, disk=Watched()) as recording:
        assert folders[-2:] == [tmp_path / "r", tmp_path]
        recording.add_block(pieces(1)[0])
        await_true(lambda: files == set(recording.files.values()), "the files")
    assert not recording.syncer.is_alive()


def test_a_recording_needs_a_new_folder(tmp_path):
    (tmp_path / "thing").touch()
    with pytest.raises(InputError, match="not empty"):
        Recording(tmp_path, META, CONFIG.resolved)
    with pytest.raises(InputError, match="not a recording"):
        list(blocks(tmp_path))


class Port:
    """A port that gives pieces of a stream, and then is at its end, or fails with an error."""

    waits = ended = closed = False

    def __init__(self, pieces, error=None):
        self.pieces, self.error, self.given = list(pieces), error, b""

    def read(self):
        if not self.pieces and self.error:
            raise self.error
        piece = self.pieces.pop(0)
        self.given += piece
        self.ended = not self.pieces and not self.error
        return piece

    def close(self):
        self.closed = True
        raise OSError(5, "the port is gone")


def begin(folder, tmp_path, tracker=None, disk=None):
    """A run with a recording, and a reader whose port has five blocks."""
    (tmp_path / "empty").touch()
    live = Live(Pipeline(CONFIG), tracker=tracker)
    recording = Recording(folder, META, CONFIG.resolved, disk=disk)
    live.sinks.append(recording)
    reader = Reader(CONFIG, f"file:{tmp_path / 'empty'}", False, live)
    reader.port.close()
    reader.port = Port(block.data for block in pieces(5))
    return live, recording, reader


@pytest.mark.parametrize("is_dead", [True, False])
def test_a_connection_that_has_fallen_silent_is_made_again_on_request(monkeypatch, is_dead):
    """The old one is kept until the new one brings bytes: a board may be silent on purpose."""
    live = Live(Pipeline(CONFIG))
    with socket.create_server(("127.0.0.1", 0)) as server:
        name = f"socket://127.0.0.1:{server.getsockname()[1]}"
        reader = Reader(CONFIG, name, False, live)
        first, (old, _) = reader.port, server.accept()
        monkeypatch.setattr("facets.live.run.reader.HALF_OPEN_S", -1.0)
        reader.step()
        assert reader.spare is None
        reader.reconnect = True
        reader.step()
        new, _ = server.accept()
        with old, new:
            (new if is_dead else old).sendall(b"x" * SIZE)
            await_true(lambda: reader.step() or live.bytes == SIZE, "the bytes")
    assert (reader.port is first, reader.spare) == (not is_dead, None)
    reader.close_port()


@pytest.mark.parametrize(("busy", "error"), [(True, PortError("gone")), (False, None)])
def test_the_reader_keeps_every_byte_in_however_large_blocks(tmp_path, monkeypatch, busy, error):
    monkeypatch.setattr("facets.live.run.reader.MAX_BLOCK_S", np.inf)
    live, recording, reader = begin(tmp_path / "r", tmp_path)
    live.backlog = 100 if busy else 0  # the loop has its hands full, or nothing to do
    pieces = [bytes([n]) * 100 for n in range(50)]
    reader.port = Port(pieces, error)
    if not busy:
        monkeypatch.setattr(reader, "loop_is_idle", lambda: True)
    reader.run()
    recording.close()
    kept = [block.data for block in blocks(tmp_path / "r")]
    assert b"".join(kept) == b"".join(pieces)
    assert len(kept) == (1 if busy else 50)
    assert reader.error is error


@pytest.mark.parametrize("where", ["tracker", "add_poses", "flush", "sync", "show"])
@pytest.mark.parametrize("kind", [RuntimeError, KeyboardInterrupt])
def test_an_error_in_the_end_skips_nothing_of_it(tmp_path, monkeypatch, where, kind):
    """Whatever raises, the stage is stopped, the port closed, every file closed, all bytes kept."""
    envelope = SimpleNamespace(latched="", heartbeat=None)
    tracker = MagicMock(encoder=None, begun=np.inf, error="", note="", envelope=envelope)
    disk = Full(10**9)
    live, recording, reader = begin(tmp_path / "r", tmp_path, tracker, disk)
    port = reader.port

    def fail(*_, **__):
        raise kind("no")

    if where == "tracker":
        tracker.__exit__.side_effect = fail
    elif where != "show":
        monkeypatch.setattr(recording, where, fail)
    # an interruption while it runs ends a run as it should end
    is_end = where in ("show", "add_poses") and kind is KeyboardInterrupt
    with suppress(kind):
        acquire(live, reader, Ending(), fail if where == "show" else lambda _: None)
        assert is_end
        assert live.note == "interrupted"
    assert tracker.__exit__.called
    assert port.closed
    assert not reader.is_alive()
    assert not disk.handles
    assert (tmp_path / "r" / "bytes.bin").read_bytes() == port.given
