"""A short recording, written without a port or a clock."""

from __future__ import annotations

import json

from facets.experiments.studies import kills

import facets
from facets.files import run_record
from facets.live import SIZE, Block, Pipeline, Recording

CONFIG = facets.load("bench")
BLOCKS, EACH = 12, 25


def events_of(folder):
    """The events of a recording."""
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def metadata(first=0):
    """The metadata of a recording that starts at sample `first`."""
    return run_record(CONFIG, None, 0.0, {"first": first})


def record(folder, first=0, count=BLOCKS, close=True, disk=None):
    """Record `count` blocks of the stream, starting at sample `first`; return the recording."""
    recording = Recording(folder, metadata(first), CONFIG.resolved, disk=disk)
    pipeline = Pipeline(CONFIG)
    recording.add_event("connected")
    data = kills.stream(first + count * EACH)[first * SIZE :]
    for n in range(count):
        part = data[n * EACH * SIZE : (n + 1) * EACH * SIZE]
        block = Block(part, 1.0 + 0.0025 * n - 1e-5 * n**1.5, None)
        recording.add_block(block)
        recording.add_poses(pipeline.feed(block.data, block.arrival))
        recording.flush()
    if close:
        recording.close()
    return recording
