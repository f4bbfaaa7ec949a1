"""A virtual bench full of faults: is every accepted sample right, and every loss counted?

`python -m facets.experiments.studies.soak`: ten minutes at 10 kHz. `--readers` is how many other
programs get every sample meanwhile, by `zmq://`.

`python -m facets.experiments.studies.soak --runs 20 --busy 2` repeats the live example of the
documentation instead, `emulate bench --motion circle` and `acquire bench --track` for 20 s each,
beside two processes that do nothing but calculate. It prints for each run for what share of the
time the beam was lost, the latency, the exit status and its reasons. The share counts each sample
that the board took between the first pose and the last sample and that has no pose, whatever the
reason. Where the user may ask for a real-time priority the runs have one.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import facets
from facets.core.names import STATE_COLUMNS, STATE_UNITS
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

FAULTS = "flip=1e-4,lose=1e-4,double=1e-4,drop=1e-4,stall=0.1,block=0.1,saturate=0.1"
#: An error of more than this many standard uncertainties is wrong: once in 1e10 numbers, by chance.
WRONG = 6.5
#: Longest time that a reader may take to begin, and to report, s.
PATIENCE_S = 60.0

#: A program that calculates without end.
BUSY = "while True: pass"
PROGRAM = [sys.executable, "-c", "from facets.cli import main; main()"]


def bench(folder: Path, rate: float, faults: str, ending: Any) -> None:
    def go_on(_: Bench) -> None:
        if ending.is_set():
            raise KeyboardInterrupt

    config = facets.load("bench")
    setup = BenchSetup(config, "wobble", rate, Faults.from_text(faults), 3, truth=True)
    bench = Bench(setup, folder)
    bench.run(float("inf"), go_on)


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


def soak(
    folder: Path,
    seconds: float,
    rate: float,
    faults: str = FAULTS,
    samples: float = np.inf,
    readers: int = 0,
) -> dict[str, Any]:
    """Run both for a number of seconds or samples; return the findings."""
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
    publications = Publications(["zmq://127.0.0.1:0"] if readers else [], config)
    counts = start_readers(publications, readers)
    story = run_record(config, None, 0, {})
    recording = Recording(folder / "recording", story, config.resolved, config.acquire.sync)
    live.begin = time.monotonic()
    live.sinks += [recording, publications]
    reader = Reader(config, str(folder / "board"), True, live)
    memory: list[float] = []
    spent = time.process_time()

    def show(_: Live) -> None:
        if len(memory) < time.monotonic() - live.begin:  # once a second
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)

    acquire(live, reader, Ending(seconds, samples), show)
    spent = (time.process_time() - spent) / (time.monotonic() - live.begin)
    ending.set()
    other.join()
    heard = [counts.get(timeout=PATIENCE_S) for _ in range(readers)]
    published = [(count["sent"], count["dropped"]) for count in publications.counts()]
    return {
        **check_recording(folder, live),
        "published_and_dropped": published,
        "received_and_p99_ms": [(count, 1e3 * late) for count, late in heard],
        "cores": spent,
        "p99_ms": 1e3 * live.latency_p99(),
        "memory_mb": (memory[min(3, len(memory) - 1)], memory[-1]),
    }


def check_recording(folder: Path, live: Live) -> dict[str, Any]:
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
        "late": live.late,
        "skipped": live.pipeline.tally.skipped_count,
        "wrong": int(wrong.sum()),
        "lost": live.pipeline.sequence.lost,
        "bench_lost": int((~sent).sum()),
        "accepted_though_spoilt": int((accepted & ~sent).sum()),
        "refused_though_sound": int((~accepted & sent).sum()),
        "corrupt": live.pipeline.parser.corrupt,
    }


@contextmanager
def load(busy: int) -> Iterator[None]:
    """Context in which a number of other programs run."""
    with ExitStack() as closing:
        for _ in range(busy):
            process = subprocess.Popen([sys.executable, "-c", BUSY])
            closing.callback(process.wait)
            closing.callback(process.kill)
        yield


@contextmanager
def virtual_bench(folder: Path) -> Iterator[None]:
    """Run the circle of the shipped configuration `bench`, and wait for its ports."""
    bench = subprocess.Popen(
        [*PROGRAM, "emulate", "bench", "--motion", "circle", "--seed", "1"],
        cwd=folder, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        for line in bench.stdout or ():
            if line.startswith("running"):
                break
        yield
    finally:
        bench.terminate()
        bench.communicate()


def follow_circle(folder: Path, seconds: float) -> dict[str, Any]:
    """Run the live example of the README in a new folder; return its outcome."""
    with virtual_bench(folder):
        run = subprocess.run(
            [*PROGRAM, "acquire", "bench", "--track", "--port", "bench/board",
             "--stage-port", "bench/stage", "--plain", "--seconds", str(seconds), "-d", "recorded"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
    (folder / "output.txt").write_text(run.stdout + run.stderr, "utf-8")
    return {
        "status": run.returncode,
        "p99": p99_of(run.stdout),
        **recording_outcome(folder, run.stderr),
    }


def p99_of(output: str) -> str:
    """The last latency that the command printed, with its unit."""
    words = output.split()
    places = [n for n, word in enumerate(words) if word == "p99"]
    return " ".join(words[places[-1] + 1 : places[-1] + 3]) if places else "-"


def recording_outcome(folder: Path, errors: str) -> dict[str, Any]:
    """The outcome of a run by its recording, or by its errors if it did not begin."""
    path = folder / "recorded"
    if not path.exists():
        return {"lost": 1.0, "urgent": False, "reasons": [errors.strip().splitlines()[-1]]}
    events = map(json.loads, (path / "events.jsonl").read_text("utf-8").splitlines())
    end: dict[str, Any] = next((event for event in events if event["event"] == "end"), {})
    poses = recorded_poses(path)
    good = poses["seq"][poses["status"] == 0] if poses else np.zeros(0)
    made = int(poses["seq"].max() - good.min() + 1) if len(good) else 1
    return {
        "lost": 1 - len(good) / made,
        "urgent": end.get("is_urgent", False),
        "reasons": end.get("reasons", ["the recording has no end"]),
    }


def count_runs(runs: int, busy: int, seconds: float) -> None:
    """Repeat the run, and print a table."""
    print(f"{runs} runs of {seconds:g} s beside {busy} busy processes")
    print(" run   beam lost   p99        load   status   reasons", flush=True)
    shares = []
    with load(busy):
        for run in range(1, runs + 1):
            with tempfile.TemporaryDirectory() as place:
                outcome = follow_circle(Path(place), seconds)
            shares.append(outcome["lost"])
            print(
                f"{run:4}   {100 * outcome['lost']:7.2f} %   {outcome['p99']:8}  "
                f"{os.getloadavg()[0]:5.1f}   {outcome['status']:6}   "
                f"{' '.join(outcome['reasons']) or '-'}",
                flush=True,
            )
    priority = "with a real-time priority" if outcome["urgent"] else "without a real-time priority"
    print(
        f"{priority}: {shares.count(0.0)} of {runs} runs without loss, at most "
        f"{100 * max(shares):.2f} % lost, {100 * np.mean(shares):.2f} % in the mean"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, help="of a run: 600, of the live example 20")
    parser.add_argument("--rate", type=float, default=10_000.0, help="samples per second")
    parser.add_argument("--readers", type=int, default=0, help="programs that get every sample")
    parser.add_argument("--runs", type=int, default=0, help="repeat the live example this often")
    parser.add_argument("--busy", type=int, default=0, help="processes that calculate beside it")
    given = parser.parse_args()
    if given.runs:
        count_runs(given.runs, given.busy, given.seconds or 20.0)
        return
    with tempfile.TemporaryDirectory() as place:
        seconds = given.seconds or 600.0
        for name, value in soak(Path(place), seconds, given.rate, readers=given.readers).items():
            print(f"{name:24} {value}")


if __name__ == "__main__":
    main()
