"""`facets acquire --track` on a virtual bench whose stage's cable is pulled in the middle."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from functools import partial

import pytest
from commands import PROGRAM

import facets
from facets.live import Bench, Faults, recorded_poses

CONFIG = facets.load("bench")
SAMPLES = 6000


@pytest.fixture
def bench(tmp_path):
    """Goes round in a thread, slowly enough for a busy machine, until the test ends."""
    bench = Bench(CONFIG, "wobble", 500.0, Faults(), 1, tmp_path / "bench")
    ending = threading.Event()

    def turn():
        bench.begin = time.monotonic()
        while not ending.is_set():
            bench.round()

    thread = threading.Thread(target=turn)
    thread.start()
    yield bench
    ending.set()
    thread.join()
    bench.end()


def pull(bench):
    """Nobody answers any more, and the port is gone."""
    bench.answer = partial(time.sleep, 1e-3)
    bench.stage.close()
    bench.stage.close = lambda: None


@pytest.mark.slow
def test_a_pulled_stage_is_told_and_the_recording_goes_on(tmp_path, bench):
    (tmp_path / "calm.yaml").write_text(
        "extends: bench\nstage: {stale_ms: 500, resume: auto, resumes_per_hour: 3600}\n"
    )
    words = ["acquire", "calm.yaml", "--track", "--port", "bench/board",
             "--stage-port", "bench/stage",
             "--samples", str(SAMPLES), "--max-loss", "1", "--plain", "-d", "rec"]  # fmt: skip
    process = subprocess.Popen(
        [*PROGRAM, *words], cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    while bench.count.moves < 20:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    pull(bench)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 1, err
    assert "Traceback" not in err
    assert "the stage" in err + out
    events = [json.loads(line) for line in (tmp_path / "rec/events.jsonl").read_text().splitlines()]
    when = {event["event"]: event["monotonic"] for event in events}
    assert "stage error" in when
    assert "stop not answered" in when
    poses = recorded_poses(tmp_path / "rec")
    assert len(poses["seq"]) >= SAMPLES
    assert poses["host_s"].max() > when["stage error"]
