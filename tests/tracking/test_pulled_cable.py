"""`facets acquire --track` on a virtual bench whose stage's cable is pulled in the middle."""

from __future__ import annotations

import threading
import time
from functools import partial

import pytest
from programs import Program
from recorded import events_of

import facets
from facets.live import Bench, BenchSetup, recorded_poses

CONFIG = facets.load("bench")
SAMPLES = 1000


@pytest.fixture
def bench(tmp_path):
    """Goes round in a thread, slowly enough for a busy machine, until the test ends."""
    bench = Bench(BenchSetup(CONFIG, "wobble", 500.0), tmp_path / "bench")
    ending = threading.Event()

    def turn():
        bench.begin = time.monotonic()
        while not ending.is_set():
            bench.round()
            bench.answer()

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
    with Program(*words, cwd=tmp_path) as program:
        program.await_true(lambda: bench.count.moves >= 20, "the stage follows")
        pull(bench)
        assert program.end(None) == 1, program.stderr
    assert "Traceback" not in program.stderr
    assert "the stage" in program.stderr + program.stdout
    when = {event["event"]: event["monotonic"] for event in events_of(tmp_path / "rec")}
    assert "stop not answered" in when
    poses = recorded_poses(tmp_path / "rec")
    assert len(poses["seq"]) >= SAMPLES
    assert poses["host_s"].max() > when["stage error"]
