"""A test of acquisition from a virtual bench with faults: accepted samples must be right, and
losses counted.

`python -m facets.experiments.studies.soak [--seconds 600] [--rate 10000] [--readers 0]`:
`--readers` is the number of other programs that receive every sample by `zmq://`.
"""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import facets
from facets.core.names import STATE_COLUMNS, STATE_UNITS
from facets.core.settings import Config
from facets.files.provenance import run_record
from facets.live import Subscription
from facets.live.recording.pose_table import recorded_poses
from facets.live.recording.writer import Recording
from facets.live.run.live import Live
from facets.live.run.loop import Ending, acquire
from facets.live.run.pipeline import Pipeline
from facets.live.run.reader import Reader
from facets.live.streams.publication import Publications
from facets.live.virtual import SENT, Bench, BenchSetup, Faults, truth_of

from .options import parse_options

FAULTS = "flip=1e-4,lose=1e-4,double=1e-4,drop=1e-4,stall=0.1,block=0.1,saturate=0.1"
#: An error of more than this many standard uncertainties is wrong: once in 1e10 numbers, by chance.
WRONG = 6.5
#: Longest time that a reader may take to begin, and to report, s.
PATIENCE_S = 60.0


def emulate(folder: Path, rate: float, faults: str, ending: Any) -> None:
    """Run the bench until the ending is set."""

    def go_on(_: Bench) -> None:
        """End the bench when the ending is set."""
        if ending.is_set():
            raise KeyboardInterrupt

    setup = BenchSetup(
        facets.load("bench"), "wobble", rate, Faults.from_text(faults), 3, truth=True
    )
    Bench(setup, folder).run(float("inf"), go_on)


@contextmanager
def running_bench(folder: Path, rate: float, faults: str) -> Iterator[None]:
    """Run a bench in another process; its port is `board` in the folder."""
    context = multiprocessing.get_context("fork")
    ending = context.Event()
    other = context.Process(target=emulate, args=(folder, rate, faults, ending))
    other.start()
    while not (folder / "board").exists():
        time.sleep(0.01)
    yield
    ending.set()
    other.join()


def read(address: str, counts: Any) -> None:
    """Receive every sample in another program; report their number and latency."""
    count, late = 0, [np.zeros(0)]
    with Subscription(address) as subscription:
        counts.put("here")
        for rows in subscription:
            count += len(rows)
            late.append(time.monotonic() - rows["host_s"])
    counts.put((count, float(np.quantile(np.concatenate(late), 0.99)) if count else np.nan))


def start_readers(publications: Publications, count: int) -> Any:
    """Start `count` subscribing programs; return the queue of their reports."""
    context = multiprocessing.get_context("spawn")
    counts = context.Queue()
    for address in publications.places() * count:
        context.Process(target=read, args=(address, counts), daemon=True).start()
        while counts.empty():
            publications.outlet.hear(wait_ms=10)
        counts.get()
    return counts


def follow(live: Live, reader: Reader, ending: Ending) -> dict[str, Any]:
    """Run until the ending; return the load, the latency, and the memory at the start and end."""
    memory: list[float] = []
    spent, live.begin = time.process_time(), time.monotonic()

    def show(_: Live) -> None:
        """Note the memory, MB, once a second."""
        if len(memory) < time.monotonic() - live.begin:  # once a second
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)

    acquire(live, reader, ending, show)
    return {
        "cores": (time.process_time() - spent) / (time.monotonic() - live.begin),
        "p99_ms": 1e3 * live.latency_p99(),
        "memory_mb": (memory[min(3, len(memory) - 1)], memory[-1]),
    }


def recorded_run(config: Config, folder: Path) -> Live:
    """A run that is recorded, with its solver compiled."""
    live = Live(Pipeline(config))
    live.pipeline.warm_up()
    story = run_record(config, None, 0, {})
    recording = Recording(folder / "recording", story, config.resolved, config.acquire.sync)
    live.sinks.append(recording)
    return live


def soak(
    folder: Path, ending: Ending, rate: float, faults: str = FAULTS, readers: int = 0
) -> dict[str, Any]:
    """Run a bench and an acquisition of it; return the findings."""
    config = facets.load("bench")
    facets.readings(config.sensor, np.zeros(8))  # compiled before both need it
    live = recorded_run(config, folder)
    publications = Publications(["zmq://127.0.0.1:0"] if readers else [], config)
    live.sinks.append(publications)
    with running_bench(folder, rate, faults):
        counts = start_readers(publications, readers)
        outcome = follow(live, Reader(config, str(folder / "board"), True, live), ending)
    outcome["received_and_p99_s"] = [counts.get(timeout=PATIENCE_S) for _ in range(readers)]
    outcome["published"] = publications.counts()
    return outcome | count_samples(live) | check_recording(folder)


def count_samples(live: Live) -> dict[str, Any]:
    """Numbers of late, skipped, lost and corrupt samples of the run."""
    pipeline = live.pipeline
    return {
        "late": live.late,
        "skipped": pipeline.tally.skipped_count,
        "lost": pipeline.sequence.lost,
        "corrupt": pipeline.parser.corrupt,
    }


def check_recording(folder: Path) -> dict[str, Any]:
    """Compare the recording with the bench's true states."""
    truth, poses = truth_of(folder), recorded_poses(folder / "recording")
    first, last = int(poses["seq"][0]), int(poses["seq"][-1])
    accepted = np.zeros(last - first + 1, dtype=bool)
    accepted[poses["seq"] - first] = True
    sent = truth["fate"][first : last + 1] == SENT
    good = poses["status"] == 0
    wrong = np.zeros(len(good), dtype=bool)
    for i, name in enumerate(STATE_COLUMNS):
        error = poses[name] - truth["state"][poses["seq"], i] / STATE_UNITS[i]
        wrong |= good & ~(np.abs(error) < WRONG * poses[f"u_{name}"])
    return {
        "samples": len(good),
        "solved": int(good.sum()),
        "wrong": int(wrong.sum()),
        "bench_lost": int((~sent).sum()),
        "accepted_though_spoilt": int((accepted & ~sent).sum()),
        "refused_though_sound": int((~accepted & sent).sum()),
    }


def main() -> None:
    options = parse_options(__doc__, seconds=600.0, rate=10_000.0, readers=0)
    with tempfile.TemporaryDirectory() as place:
        ending = Ending(options.seconds)
        results = soak(Path(place), ending, options.rate, readers=options.readers)
    for name, value in results.items():
        print(f"{name:24} {value}")


if __name__ == "__main__":
    main()
