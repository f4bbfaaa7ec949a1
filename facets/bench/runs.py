"""Contenders that do what users run: solve tables, replay recordings, start a new process."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ..config.loading import load
from ..core.names import READING_COLUMNS
from ..core.units import Floats
from ..detectors.counts import readings_to_counts
from ..estimation.measurement import Measurement
from ..estimation.table import solve_table
from ..files.provenance import run_record
from ..files.tables import write_table
from ..files.whole import WRITERS
from ..live.playback import Playback
from ..live.recording.writer import Recording
from ..live.sources import Block
from ..live.sources.frames import ELECTRODES, SIZE, RawSamples, encode
from ..model.arrays import readings
from .clock import Contender

#: Number of samples in a block of a recording: about 2 ms at 10 kHz.
BLOCK_SAMPLES = 19
#: Expressions that a new process computes, with nothing compiled before.
FIRST_USES = {
    "facets: the first reading": "facets.readings(sensor, [0.0] * 8)",
    "facets: the first pose": "facets.solve(sensor, facets.readings(sensor, [0.0] * 8))",
}


def run_ways(folder: Path, rows: Floats) -> list[Contender]:
    """Contenders that solve a table of readings, in each installed format, and a recording; they
    write into a folder."""
    endings = [".csv", *(each for each in (".parquet", ".h5") if find_spec(WRITERS[each]))]
    return [
        *(solution_of_table(folder, ending, rows) for ending in endings),
        replay_of_recording(folder, rows),
    ]


def solution_of_table(folder: Path, ending: str, rows: Floats) -> Contender:
    """The contender that solves a table of readings in the format of this ending."""
    config, table = load("paper"), folder / f"readings{ending}"
    write_table(table, dict(zip(READING_COLUMNS, rows[:, :9].T, strict=True)), {})

    def work(_: Floats) -> None:
        solve_table(Measurement(config), table, folder / f"poses{ending}", {})

    return Contender(f"facets: solve a table ({ending})", work, len(rows))


def replay_of_recording(folder: Path, rows: Floats) -> Contender:
    """The contender that solves a recording again and writes a table."""
    config, recording = load("bench"), folder / "recording"
    counts = readings_to_counts(
        config.sensor, config.electronics, readings(config.sensor, 0.1 * rows[:, 9:])
    )
    number, flags = np.arange(len(rows), dtype=np.uint32), np.zeros(len(rows), np.uint8)
    samples = RawSamples(np.full_like(flags, ELECTRODES), flags, number, 100 * number, counts)
    data, step = encode("frames", samples), BLOCK_SAMPLES * SIZE
    with Recording(recording, run_record(config, None, 0.0, {}), config.resolved) as writer:
        for start in range(0, len(data), step):
            writer.add_block(Block(data[start : start + step], 1e-4 * start / SIZE, None))

    def work(_: Floats) -> None:
        playback = Playback(recording)
        playback.finish(playback.poses(), folder / "replayed.csv", False, None)

    return Contender("facets: replay a recording (.csv)", work, len(rows))


def first_use_ways() -> list[Contender]:
    """The first computations of a new process with empty caches, imports included."""
    return [Contender(name, partial(run_first, text), 1) for name, text in FIRST_USES.items()]


def run_first(expression: str, _: Floats) -> None:
    """Run an expression in a new process with an empty folder of compiled code; raises
    `CalledProcessError` if it fails."""
    code = f"import facets; sensor = facets.Sensor(); {expression}"
    with tempfile.TemporaryDirectory() as empty:
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "FACETS_CACHE_DIR": empty},
            stderr=subprocess.DEVNULL, check=True,
        )  # fmt: skip
