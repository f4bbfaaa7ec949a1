"""Latency of a live run on a virtual bench, from a sample's last byte to its pose.

The bench, the run, and the reader of the page share this machine's cores.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]

#: Runs and their options; with PAGE, a reader receives everything that the page gets.
PAGE = "with the page read"
RUNS: dict[str, list[str]] = {
    "alone": [],
    "with --track": ["--track", "--stage-port", "bench/stage"],
    PAGE: ["--web", "127.0.0.1:0"],
}
#: Duration of a run, and the part at its start that does not count.
SECONDS, BEGINNING = 12, 2


def live(quick: bool, seed: int) -> list[Row]:
    """Measure each run at 10 kHz: the 99th percentile of a sample's age when its pose is solved, ms
    (median and worst over the seconds of the run), and the share of lost samples.

    No row in a quick run, or on a system without pseudoterminals.
    """
    if quick or sys.platform == "win32":
        return [{"run": "left out", "p99_ms": np.nan, "worst_p99_ms": np.nan, "lost": np.nan}]
    return [row(name, seed) for name in RUNS if name != PAGE or find_spec("aiohttp")]


def row(name: str, seed: int) -> Row:
    with tempfile.TemporaryDirectory() as folder, virtual_bench(Path(folder), seed):
        command = [
            sys.executable, "-m", "facets", "acquire", "bench", "--port", "bench/board", "--json",
            "--seconds", str(SECONDS), "-d", "recording", *RUNS[name],
        ]  # fmt: skip
        with subprocess.Popen(
            command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as run:
            threading.Thread(target=read_page, args=(run.stderr,), daemon=True).start()
            told = [json.loads(line) for line in run.stdout or () if line.startswith("{")]
    late = [each["latency_p99_ms"] for each in told if each["seconds"] > BEGINNING]
    late = [each for each in late if each is not None] or [np.nan]
    return {
        "run": name,
        "p99_ms": float(np.median(late)),
        "worst_p99_ms": float(np.max(late)),
        "lost": told[-1]["lost"] / max(told[-1]["samples"], 1) if told else np.nan,
    }


@contextmanager
def virtual_bench(folder: Path, seed: int) -> Iterator[None]:
    """Run the circle of the shipped configuration `bench`, and wait for its ports."""
    command = [sys.executable, "-m", "facets", "emulate", "bench", "--motion", "circle"]
    bench = subprocess.Popen(
        [*command, "--seed", str(seed)], cwd=folder, stdout=subprocess.PIPE, text=True
    )
    try:
        for line in bench.stdout or ():
            if line.startswith("running"):
                break
        yield
    finally:
        bench.terminate()
        bench.communicate()


def read_page(errors: Any) -> None:
    """Read the standard error of a run, and the page that it names, until both end."""
    for line in errors:
        if "the page is at " in line:
            address = line.split("the page is at ")[1].strip()
            threading.Thread(target=asyncio.run, args=(read_stream(address),), daemon=True).start()


async def read_stream(address: str) -> None:
    import aiohttp

    async with aiohttp.ClientSession() as session, session.ws_connect(f"{address}stream") as line:
        async for _ in line:
            pass
