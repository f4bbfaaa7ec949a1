"""Everything that makes poses of a bench's samples, by one signature.

A way that is added to the package, or replaces one, is a line of RUN_PATHS, and the test that goes
over these (`tests/estimation/test_paths.py`) holds it to what all others give.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from commands import command
from streams import samples_of

import facets
from facets import live
from facets.core import READING_COLUMNS
from facets.detectors import TEMPERATURE, counts_to_readings
from facets.estimation import PoseColumns, ZeroRequest, worded_columns
from facets.files import write_table

#: Standard uncertainties of what was calibrated: a height, what the model leaves, and how the
#: sensor follows the temperature.
SIGMAS = {"psd_a.height": 2e-4, "misfit_b.psi": 1e-3} | dict.fromkeys(TEMPERATURE, 1e-4)
CONFIG = """extends: bench
object: {point_mm: [10, -20, 50], roll_deg: 1, pitch_deg: 2, yaw_deg: 3}
sensor:
  calibration: {file: covariance.csv, degrees_of_freedom: 12}
THERMAL
solve: {beam: known, beam_offset_um: [3, -2], accept_unchecked: true}
motions:
  far: {kind: sweep, from: {tx_mm: -0.6}, to: {tx_mm: 0.5, tz_mm: 8}, samples: 300}
"""
FOLLOWS = """  temperature: {beam_um_per_k: [2, -1], places_um_per_k: [0, -2, 1, -2, 0, 3]}
acquire:
  channels:
    - {name: force, unit: N, scale: 0.01, offset: 0.5}
    - {name: temperature, unit: degC}"""
COUNT, STILL = 600, 320
#: More samples than a run solves at once.
ZERO, FIRST = ("--zero", "0.03s", "--covariance"), ("--zero", "row:1", "--covariance")


class PathResult(NamedTuple):
    """poses: a row for each sample.  said: what the user was told."""

    poses: pd.DataFrame
    said: str


def write_config(folder: Path, follows_temperature: bool) -> facets.Config:
    sizes = np.diag(np.square(list(SIGMAS.values())))
    write_table(folder / "covariance.csv", dict(zip(SIGMAS, sizes, strict=True)), {})
    path = folder / "mine.yaml"
    path.write_text(CONFIG.replace("THERMAL", FOLLOWS if follows_temperature else ""), "utf-8")
    return facets.load(path)


def make_bench(folder: Path) -> None:
    """Write the bytes of a board and the table of its readings: a mirror stands still and then
    moves while everything warms up; some temperatures are missing, some detectors have no light, or
    too much, and some readings are spoilt."""
    config, time = write_config(folder, follows_temperature=True), np.arange(COUNT)
    phase = np.maximum(time - STILL, 0) / 60
    states = np.zeros((COUNT, 8))
    states[:, 0], states[:, 2] = 0.05 * np.sin(phase / 3), 0.2 * np.sin(phase / 2)
    states[:, 5] = 1e-3 * np.sin(phase)
    temperature, thermal = np.linspace(17.0, 24.0, COUNT), config.sensor.thermal
    warmer = (temperature - thermal.reference)[:, None]
    states[:, 6:] = config.solve.beam_offset + warmer * thermal.beam
    readings = facets.readings(config.sensor, states)
    readings[:, [0, 1, 3, 4, 6, 7]] += warmer * thermal.places
    readings[400:410, 3:6] = np.nan
    readings[450:455] = np.nan
    readings[500:510, 0] += 0.2
    readings[550:560, 2::3] *= 1.05
    temperature[[5, 420]] = np.nan
    channels = np.column_stack([time, temperature])
    samples = samples_of(readings, np.random.default_rng(4), channels)
    samples.counts[[7, 430, 431], 2] = samples.counts[432, [2, 5]] = (
        2**config.electronics.adc_bits - 1
    )
    (folder / "board.bin").write_bytes(live.encode("frames", samples))
    raw, _ = counts_to_readings(
        config.sensor, config.electronics, samples.counts, False, np.zeros(12)
    )
    table = {"time_s": 1e-6 * samples.time, **dict(zip(READING_COLUMNS, raw.T, strict=True))}
    table["temperature_c"] = samples.channels[:, 1].astype(float)
    write_table(folder / "readings.csv", table, {})


def run_command(folder: Path, *words: str) -> str:
    done = command(*words, cwd=folder)
    assert done.returncode == 0, done.stderr
    return " ".join(done.stdout.split())


def solve_table(folder: Path, *words: str, readings: str = "readings.csv") -> PathResult:
    """`facets solve`, with which all others are compared."""
    poses = readings.replace(".csv", "-poses.csv")
    said = run_command(folder, "solve", "mine.yaml", readings, "-o", poses, "--force", *words)
    return PathResult(pd.read_csv(folder / poses, comment="#"), said)


def acquire(folder: Path) -> PathResult:
    """What a run records of the poses that it solved."""
    words = ("--port", "file:board.bin", "--folder", "rec", "--plain", *ZERO)
    said = run_command(folder, "acquire", "mine.yaml", *words)
    poses = worded_columns(live.recorded_poses(folder / "rec"))
    return PathResult(pd.DataFrame(poses), said)


def replay(folder: Path) -> PathResult:
    """A run that is solved again from its bytes; it is recorded first."""
    if not (folder / "rec").exists():
        acquire(folder)
    said = run_command(folder, "replay", "rec", "-o", "replay.csv", "--force", *ZERO)
    return PathResult(pd.read_csv(folder / "replay.csv", comment="#"), said)


def solve_replay(folder: Path) -> PathResult:
    """The table that a replay wrote, as one of readings, with its time by the name of a table."""
    replay(folder).poses.to_csv(folder / "again.csv", index=False)
    return solve_table(folder, *ZERO, readings="again.csv")


def iterate(folder: Path) -> PathResult:
    """The poses that a program in Python gets in a loop."""
    config = facets.load(folder / "mine.yaml")
    columns = PoseColumns(ZeroRequest(seconds=0.03), covariance=True)
    parts = live.poses(config, f"file:{folder / 'board.bin'}", columns=columns)
    joined = live.join_poses(list(parts))
    return PathResult(pd.DataFrame(worded_columns(joined.columns())), "")


def simulate(folder: Path) -> PathResult:
    """What a simulation says of its own samples, of one motion."""
    words = ("--motion", "far", "--folder", "sim", "--force", *FIRST)
    said = run_command(folder, "simulate", "mine.yaml", *words)
    return PathResult(pd.read_csv(folder / "sim" / "poses.csv", comment="#"), said)


#: The ways of the samples of a run.
RUN_PATHS = {
    "run": acquire,
    "replay": replay,
    "table of a replay": solve_replay,
    "loop in Python": iterate,
}
