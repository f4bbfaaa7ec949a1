"""A virtual bench full of faults: is every accepted sample right, and every loss counted?

`python -m facets.experiments.soak [SECONDS] [RATE] [READERS]`: ten minutes at 10 kHz by default.
READERS, 0 by default, is how many other programs get every sample meanwhile, by `tcp://`.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import facets
from facets.core.names import STATE_COLUMNS, STATE_UNITS
from facets.files.provenance import run_record
from facets.live.acquire import Ending, Live, Reader, acquire
from facets.live.pipeline import Pipeline
from facets.live.publication import Publications
from facets.live.recording import Recording, recorded_poses
from facets.live.subscription import Subscription
from facets.live.virtual import SENT, Bench, Faults, truth_of

FAULTS = "flip=1e-4,lose=1e-4,double=1e-4,drop=1e-4,stall=0.1,block=0.1,saturate=0.1"
#: An error of more than this many standard uncertainties is wrong: once in 1e10 numbers, by chance.
WRONG = 6.5
#: So long a reader may take to begin, and to tell, s.
PATIENCE = 60.0


def bench(folder: Path, rate: float, faults: str, ending: Any) -> None:
    def go_on(_: Bench) -> None:
        if ending.is_set():
            raise KeyboardInterrupt

    config = facets.load("bench")
    Bench(config, "wobble", rate, Faults.of(faults), 3, folder).run(float("inf"), go_on)


def read(address: str, told: Any) -> None:
    """Another program: takes every sample, and tells how many came, and how late after each."""
    count, late = 0, [np.zeros(0)]
    with Subscription(address) as subscription:
        told.put("here")
        for rows in subscription:
            count += len(rows)
            late.append(time.monotonic() - rows["host_s"])
    told.put((count, float(np.quantile(np.concatenate(late), 0.99)) if count else np.nan))


def start_readers(publications: Publications) -> Any:
    """One at each address; what they have told, once they are there."""
    context = multiprocessing.get_context("spawn")
    told = context.Queue()
    for address in publications.places():
        context.Process(target=read, args=(address, told), daemon=True).start()
        told.get(timeout=PATIENCE)
    return told


def soak(
    folder: Path,
    seconds: float,
    rate: float,
    faults: str = FAULTS,
    samples: float = np.inf,
    readers: int = 0,
) -> dict[str, Any]:
    """Runs both, for so many seconds or samples; returns what was found."""
    config = facets.load("bench")
    facets.readings(config.sensor, np.zeros(8))  # compiled before both need it
    live = Live(Pipeline(config))
    live.pipeline.warm_up()
    context = multiprocessing.get_context("fork")
    ending = context.Event()
    other = context.Process(target=bench, args=(folder, rate, faults, ending))
    other.start()
    while not (folder / "board").exists():
        time.sleep(0.01)
    live.publications = Publications(["tcp://127.0.0.1:0"] * readers, config)
    told = start_readers(live.publications)
    story = run_record(config, None, 0, {})
    recording = Recording(folder / "recording", story, config.resolved, config.acquire.sync)
    live.begin = time.monotonic()
    reader = Reader(config, str(folder / "board"), recording, True, live)
    memory: list[float] = []
    spent = time.process_time()

    def show(_: Live) -> None:
        if len(memory) < time.monotonic() - live.begin:  # once a second
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)

    acquire(live, reader, recording, Ending(seconds, samples), show)
    spent = (time.process_time() - spent) / (time.monotonic() - live.begin)
    ending.set()
    other.join()
    heard = [told.get(timeout=PATIENCE) for _ in range(readers)]
    published = [(one["sent"], one["dropped"]) for one in live.publications.counts()]
    return {
        **judged(folder, live),
        "published_and_dropped": published,
        "received_and_p99_ms": [(count, 1e3 * late) for count, late in heard],
        "cores": spent,
        "p99_ms": 1e3 * live.ninety_nine(),
        "memory_mb": (memory[min(3, len(memory) - 1)], memory[-1]),
    }


def judged(folder: Path, live: Live) -> dict[str, Any]:
    """The recording against the bench's truth."""
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
        "late": live.late,
        "skipped": live.pipeline.tally.skipped,
        "wrong": int(wrong.sum()),
        "lost": live.pipeline.sequence.lost,
        "bench_lost": int((~sent).sum()),
        "accepted_though_spoilt": int((accepted & ~sent).sum()),
        "refused_though_sound": int((~accepted & sent).sum()),
        "corrupt": live.pipeline.parser.corrupt,
    }


if __name__ == "__main__":
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    rate = float(sys.argv[2]) if len(sys.argv) > 2 else 10_000.0
    readers = int(sys.argv[3]) if len(sys.argv) > 3 else 0
    with tempfile.TemporaryDirectory() as place:
        for name, value in soak(Path(place), seconds, rate, readers=readers).items():
            print(f"{name:24} {value}")
