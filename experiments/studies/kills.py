"""Completeness of recordings whose acquisition is killed at random moments.

`python -m facets.experiments.studies.kills [TIMES [SIGNAL ...]]`: 200 by default, by SIGKILL. Other
signals (SIGTERM, SIGHUP), which are used in turn, end it as ^C does; then the recording must be
complete, poses included.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import facets
from facets.detectors.counts import readings_to_counts
from facets.files.provenance import run_record
from facets.live.recording.comparison import PoseComparison
from facets.live.recording.pose_table import recorded_parts
from facets.live.recording.replay import recorded_config, replay
from facets.live.recording.writer import Recording
from facets.live.run.live import Live
from facets.live.run.loop import Ending, acquire
from facets.live.run.pipeline import Pipeline
from facets.live.run.reader import Reader
from facets.live.sources.frames import SIZE, RawSamples, pack

BLOCK, RATE = 50, 400.0


def stream(count: int) -> bytes:
    """Make the bytes of a wobbling mirror."""
    config = facets.load("bench")
    state = np.zeros((count, 8))
    state[:, 5] = 1e-3 * np.sin(np.arange(count) / 100)
    counts = readings_to_counts(
        config.sensor, config.electronics, facets.readings(config.sensor, state)
    )
    number = np.arange(count, dtype=np.uint32)
    kind = np.ones(count, np.uint8)
    return pack(RawSamples(kind, 0 * kind, number, 100 * number, counts))


class StreamSource:
    """A port that returns the stream block by block and counts the returned bytes."""

    ended = waits = False

    def __init__(self, data: bytes, byte_count: Any) -> None:
        self.data, self.byte_count = data, byte_count

    def read(self) -> bytes:
        """The next block, at the rate of a board."""
        time.sleep(1 / RATE)
        start = self.byte_count.value
        block = self.data[start : start + BLOCK * SIZE]
        self.byte_count.value = start + len(block)
        return block

    def close(self) -> None:
        """Do nothing, as a source must have this method."""


def run_acquisition(folder: Path, data: bytes, byte_count: Any) -> None:
    """Record the data until it is killed. byte_count: shared counter of the bytes read."""
    config = facets.load("bench")
    live = Live(Pipeline(config))
    recording = Recording(folder, run_record(config, None, 0, {}), config.resolved)
    live.sinks.append(recording)
    reader = Reader(config, f"file:{os.devnull}", False, live)
    reader.port = StreamSource(data, byte_count)
    for number in (signal.SIGTERM, signal.SIGHUP):  # as the command has it
        signal.signal(number, signal.default_int_handler)
    acquire(live, reader, Ending())


def kill(folder: Path, data: bytes, after: float, number: int = signal.SIGKILL) -> dict[str, int]:
    """Kill an acquisition and check its recording; after: time of the signal after the first bytes,
    s."""
    context = multiprocessing.get_context("fork")
    byte_count = context.Value("q", 0, lock=False)
    process = context.Process(target=run_acquisition, args=(folder, data, byte_count))
    process.start()
    while byte_count.value == 0:  # some processes take longer than others to load their modules
        time.sleep(0.001)
    time.sleep(after)
    assert process.pid
    os.kill(process.pid, number)
    process.join()
    recorded = (folder / "bytes.bin").read_bytes()
    assert data.startswith(recorded)
    comparison = PoseComparison(recorded_parts(folder))
    poses = replay(folder, Pipeline(recorded_config(folder)))
    solved = sum(map(len, comparison.following(poses)))
    events = (folder / "events.jsonl").read_text()
    return {
        "given": byte_count.value,
        "kept": len(recorded),
        "lost": byte_count.value - len(recorded),
        "recovered": solved,
        "unrecovered": len(recorded) // SIZE - solved,
        "poses": comparison.recorded,
        "different": comparison.different,
        "closed": events.count('"end"'),
        "status": process.exitcode or 0,
    }


if __name__ == "__main__":
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    numbers = [signal.Signals[name] for name in sys.argv[2:]] or [signal.SIGKILL]
    data = stream(40_000)
    Pipeline(facets.load("bench")).feed(data[: 100 * SIZE], 0.0)  # compiled before the first fork
    rng = np.random.default_rng(1)
    rows = []
    for n in range(times):
        with tempfile.TemporaryDirectory() as place:
            after, number = rng.uniform(0, 0.8), numbers[n % len(numbers)]
            rows.append(kill(Path(place) / "recording", data, after, number))
    print(f"{times} kills, {sum(row['kept'] for row in rows) // SIZE} samples kept in all")
    most = max(row["lost"] for row in rows) / SIZE
    print(f"most lost: {most:g} samples; the source gives {BLOCK} at once")
    print(f"kept but not recovered: {max(row['unrecovered'] for row in rows)}")
    print(f"with poses on disk as well: {sum(row['poses'] > 0 for row in rows)}")
    print(f"poses on disk that a replay does not repeat: {sum(row['different'] for row in rows)}")
    complete = sum(row["closed"] == 1 and row["poses"] == row["recovered"] for row in rows)
    print(f"closed, with all poses: {complete}")
