"""Cost of a start: of a process, and of a command with an empty and with a full code cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from .calls import child_cpu_seconds

Row = dict[str, Any]

SENSOR = "import facets; sensor = facets.Sensor()"
LIT = "import facets; from facets.bench.light import LIT as sensor"
SOLVE = "facets.solve(sensor, [0.1, 0, 0.1] * 3)"
CALIBRATION = "calibration"
#: Python arguments of each start; CALIBRATION is a folder with a rig's readings.
STARTS = {
    "import facets": ["-c", "import facets"],
    "facets --help": ["-m", "facets", "--help"],
    "facets solve --help": ["-m", "facets", "solve", "--help"],
}
#: Starts that compile code if the cache is empty; a quick run leaves them out.
FIRST_USES = {
    "facets.solve in ideal light": ["-c", f"{SENSOR}; {SOLVE}"],
    "facets.solve in the light of a bench": ["-c", f"{LIT}; {SOLVE}"],
    "facets simulate paper": ["-m", "facets", "simulate", "paper", "-d", "motions"],
    "facets resolution paper": ["-m", "facets", "resolution", "paper", "-d", "resolution"],
    "facets range-map paper": ["-m", "facets", "range-map", "paper", "-d", "range"],
    "facets calibrate rig": [
        "-m", "facets", "calibrate", "rig", f"{CALIBRATION}/readings.csv", "-o", "found.yaml",
    ],
}  # fmt: skip
SIMULATION = ["-m", "facets", "simulate", "rig", "--motion", "calibration", "--with-reference"]


def starts(quick: bool, seed: int) -> list[Row]:
    """Measure processor and clock seconds of a first run and of the next run."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [row(name, arguments, Path(folder)) for name, arguments in STARTS.items()]
        if not quick:
            run([*SIMULATION, "-d", CALIBRATION], Path(folder), {})
            rows += [row(name, arguments, Path(folder)) for name, arguments in FIRST_USES.items()]
    return rows


def row(name: str, arguments: list[str], folder: Path) -> Row:
    first, again = np.nan, np.nan
    seconds = {"start": name, "first_cpu_s": first, "first_s": first, "cpu_s": again, "s": again}
    with tempfile.TemporaryDirectory() as empty:
        cache = {"FACETS_CACHE_DIR": empty}
        if name in FIRST_USES:
            seconds["first_cpu_s"], seconds["first_s"] = run(arguments, folder, cache)
        seconds["cpu_s"], seconds["s"] = run(arguments, folder, cache)
    return seconds


def run(arguments: list[str], folder: Path, environment: dict[str, str]) -> tuple[float, float]:
    """Processor and clock seconds of a separate process, in a folder."""
    force = ["--force"] if {"-o", "-d"} & set(arguments) else []
    before, begin = child_cpu_seconds(), time.perf_counter()
    subprocess.run(
        [sys.executable, *arguments, *force], cwd=folder, env={**os.environ, **environment},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True,
    )  # fmt: skip
    return child_cpu_seconds() - before, time.perf_counter() - begin
