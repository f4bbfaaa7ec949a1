"""The power goes at any moment: a recording recovers or says what it lost; nothing is made up."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from power_cut import Log, image
from streams import samples_of, yawing

import facets
from facets import InputError
from facets.files import join_columns, run_record
from facets.live import (
    Block,
    Damage,
    Pipeline,
    Recording,
    encode,
    meta_of,
    recorded_poses,
    replay,
)
from facets.tracking import Encoder

BLOCKS, EACH = 40, 12
CUTS = 40
CONFIG = facets.load("bench")


def record(config):
    """A run: the log of what its recording did, how much of that came before the first byte, its
    poses, and pairs: after how many operations how many blocks were sure to be on the disk."""
    log, queue, pipeline = Log(), make_blocks(config.acquire.format), Pipeline(config)
    meta = run_record(config, None, 0.0, {})
    recording = Recording(Path("nowhere"), meta, config.resolved, disk=log)
    begun, poses, sure = len(log.done), [], []

    def write():
        block = queue.pop(0)
        recording.add_block(block)
        poses.append(pipeline.feed(block.data, block.arrival, block.encoder))
        recording.add_poses(poses[-1])

    def on_sync(name):
        if name == "bytes.bin" and queue:  # the reader goes on while the disk is busy
            write()

    log.on_sync = on_sync
    while queue:
        for _ in range(min(5, len(queue))):
            write()
        written = BLOCKS - len(queue)
        recording.add_event("synced")
        recording.sync()
        sure.append((len(log.done), written))
    assert [name for what, name, _ in log.done if what == "append"].count("poses.arrows") >= BLOCKS
    recording.close()
    return log, begun, join_columns([part.columns() for part in poses]), sure


def make_blocks(form):
    readings = facets.readings(CONFIG.sensor, yawing(BLOCKS * EACH, samples_per_radian=40))
    sent, blocks = samples_of(readings, np.random.default_rng(1)), []
    for n in range(BLOCKS):
        data = encode(form, sent.where(slice(n * EACH, (n + 1) * EACH)))
        arrival = 50.0 + 1e-4 * EACH * (n + 1)
        blocks.append(Block(data, arrival, Encoder(arrival, np.array([1e-4, 0.0]), np.zeros(2))))
    return blocks


@pytest.mark.parametrize("form", ["frames", pytest.param("text", marks=pytest.mark.slow)])
def test_a_recording_survives_the_power_going_at_any_moment(form, tmp_path, monkeypatch):
    monkeypatch.setattr("facets.live.recording.writer.FLUSH_INTERVAL_S", 0.0)
    config = replace(CONFIG, acquire=replace(CONFIG.acquire, format=form))
    log, begun, whole, sure = record(config)
    rng, damaged = np.random.default_rng(7), 0
    meta = b"".join(data for _, name, data in log.done if name == "meta.yaml")
    for cut in range(CUTS):
        moment = int(rng.integers(1, len(log.done) + 1))
        folder = tmp_path / str(cut)
        folder.mkdir()
        for name, data in image(log, moment, rng).items():
            (folder / name).write_bytes(data)
        damage, pipeline = Damage(), Pipeline(config)
        if moment < begun:  # there was no recording yet; half of one says that it is none
            with suppress(InputError):
                meta_of(folder)
                assert not list(replay(folder, pipeline))
            continue
        assert (folder / "meta.yaml").read_bytes() == meta
        parts = [part.columns() for part in replay(folder, pipeline, damage=damage)]
        poses = join_columns(parts) if parts else {"seq": np.zeros(0, np.int64)}
        check_nothing_is_made_up(poses, whole)
        synced = max((written for end, written in sure if end <= moment), default=0)
        check_what_was_synced_is_there(poses, whole, synced * EACH)
        check_losses_are_told(poses, pipeline, damage)
        check_nothing_is_made_up(recorded_poses(folder), whole, to_the_last_bit=True)
        damaged += bool(damage.words)
    assert damaged > CUTS / 4


def check_nothing_is_made_up(poses, whole, to_the_last_bit=False):
    if not poses:
        return
    assert (np.diff(poses["seq"]) > 0).all()
    for name in whole if to_the_last_bit else [n for n in whole if n.startswith(("psi", "power"))]:
        if name in poses:
            assert np.array_equal(poses[name], whole[name][poses["seq"]], equal_nan=True), name


def check_what_was_synced_is_there(poses, whole, count):
    np.testing.assert_array_equal(poses["seq"][:count], np.arange(count))
    for name in whole if count else ():
        assert np.array_equal(poses[name][:count], whole[name][:count], equal_nan=True), name


def check_losses_are_told(poses, pipeline, damage):
    """Samples that miss between others are counted, and show as damage."""
    count = len(poses["seq"])
    if count:
        missing = int(poses["seq"][-1] - poses["seq"][0]) + 1 - count
        assert pipeline.sequence.lost == missing
        assert pipeline.sequence.restarts == 0
        if missing:
            assert damage.words
