"""The live chain on a virtual bench: recorded, replayed, salvaged, tracked; and the commands."""

from __future__ import annotations

import json
import resource
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from commands import command
from facets.experiments.studies import kills, soak
from measured import measure
from programs import Program, count_lines, size_of
from recorded import events_of

import facets
from facets import BenchLight, Samples
from facets.detectors import align
from facets.live import (
    MAX_BLOCK_S,
    SIZE,
    Ending,
    Pipeline,
    Pty,
    Recording,
    Run,
    RunOptions,
    join_poses,
    pack,
    parser,
    recorded_poses,
    truth_of,
)

CONFIG = facets.load("bench")
DATA = kills.stream(20_000)

#: A circle once in 40 s, and a stage that waits for half a second for a busy machine, and goes on.
CALM = """extends: bench
stage: {stale_ms: 500, resume: auto, resumes_per_hour: 3600}
motions:
  circle: {kind: sine, amplitude: {tx_mm: 4, ty_mm: 4}, phase_deg: {tx_mm: 90}, samples: 4000,
    rate_hz: 100}
"""


def end_of(folder):
    """The event with which a run ended."""
    (end,) = (event for event in events_of(folder) if event["event"] == "end")
    return end


@pytest.fixture
def emulator(tmp_path):
    """Starts `facets emulate` in the test's folder, once it runs; ends it after the test."""
    programs = []

    def start(*words):
        programs.append(Program("emulate", *words, cwd=tmp_path))
        programs[-1].await_output("running")
        return programs[-1]

    yield start
    for program in programs:
        program.__exit__()


@pytest.fixture
def acquire(tmp_path, run_in_process):
    """Records from a port, by default a file with the bytes given: status, output, errors."""

    def call(data, *words, port="file:board.bin"):
        (tmp_path / "board.bin").write_bytes(data)
        return run_in_process("acquire", "bench", "--port", port, "--plain", "-d", "rec", *words)

    return call


@pytest.fixture
def board(tmp_path):
    """A board at the port `board`, unplugged for a moment whenever 20 kB more are recorded; then
    its numbers begin anew."""
    is_here, is_over, recording = threading.Event(), threading.Event(), tmp_path / "rec/bytes.bin"

    def send():
        samples = parser("frames", "").feed(DATA)
        while not is_over.is_set():
            port, recorded = Pty(tmp_path / "board"), size_of(recording)
            is_here.set()
            samples.time[:] += 7
            for first in range(0, len(samples), 20):
                port.write(pack(samples.where(slice(first, first + 20))))
                time.sleep(2e-3)
                if size_of(recording) > recorded + 20_000 or is_over.is_set():
                    break
            port.close()
            is_over.wait(0.3)

    thread = threading.Thread(target=send)
    thread.start()
    is_here.wait()
    yield "board"
    is_over.set()
    thread.join()


def test_no_pose_depends_on_the_blocks_where_detectors_are_read_one_after_the_other():
    sensor = replace(CONFIG.sensor, light=BenchLight(delays=(0.0, 5e-6, 1e-5)))
    pipeline = Pipeline(replace(CONFIG, sensor=sensor))
    size = 37 * SIZE
    parts = [pipeline.feed(DATA[n : n + size], 1.0 + n) for n in range(0, 16 * size, size)]
    poses = join_poses([*parts, *map(pipeline.solve, pipeline.release())])
    np.testing.assert_array_equal(poses.seq, np.arange(16 * 37))
    exact = align(sensor, 1e-6 * poses.time.astype(float), poses.readings)
    expected = measure(sensor, CONFIG.solve, Samples(exact))
    np.testing.assert_allclose(poses.solution.state, expected.state, atol=1e-12)


@pytest.mark.slow
def test_a_soak_counts_every_loss_accepts_nothing_wrong_and_is_replayed(tmp_path, run_in_process):
    """Also by a port that is looked at every 20 ms, and a slow clock that wraps after a second."""
    faults = "flip=1e-3,lose=1e-3,double=1e-3,drop=1e-3,block=0.5"
    faults += ",jitter_ms=20,drift_ppm=50,uptime_s=4294"
    outcome = soak.soak(tmp_path, Ending(samples=6_000), 2000.0, faults)
    assert outcome["samples"] >= 6_000
    assert outcome["wrong"] == 0
    assert outcome["lost"] == outcome["bench_lost"]
    assert outcome["accepted_though_spoilt"] == 0
    assert outcome["refused_though_sound"] == 0
    status, output, errors = run_in_process("replay", "recording", "--compare", "-o", "poses.csv")
    assert status == 0, errors
    assert "recorded poses: identical" in output
    assert (tmp_path / "poses.csv").stat().st_size > 100_000
    poses, truth = recorded_poses(tmp_path / "recording"), truth_of(tmp_path)
    error = poses["host_s"] - truth["host"][poses["seq"]]
    assert error[3_000:].std() < 2e-3  # of a port whose own times scatter by 6 ms


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_recording_loses_no_more_than_its_last_block(tmp_path, run_in_process, number):
    """A block is what came within MAX_BLOCK_S, and the read that was under way. To recover it
    changes nothing of it."""
    counts = kills.kill(tmp_path / "rec", DATA, 0.25, number)
    blocks = int(MAX_BLOCK_S * kills.RATE) + 2  # the source waits before it gives one
    assert counts["lost"] <= blocks * kills.BLOCK * SIZE
    assert counts["unrecovered"] == counts["different"] == 0
    if number != signal.SIGKILL:
        assert counts["closed"] == 1
        assert counts["poses"] == counts["recovered"]
        return
    before = {file.name: file.read_bytes() for file in (tmp_path / "rec").iterdir()}
    status, _, errors = run_in_process("replay", "rec", "--recover", "-o", "poses.parquet")
    assert status == 0, errors
    assert {file.name: file.read_bytes() for file in (tmp_path / "rec").iterdir()} == before
    assert (tmp_path / "poses.parquet").exists()


@pytest.mark.slow
def test_tracking_follows_a_circle_within_the_noise_until_a_signal(tmp_path, emulator):
    """Until the stage has moved 100 times, however long a busy machine takes for that."""
    (tmp_path / "calm.yaml").write_text(CALM)
    bench = emulator("calm.yaml", "--motion", "circle", "--rate", "1000", "--truth")
    with Program("acquire", "calm.yaml", "--track", "--port", "bench/board",
                 "--stage-port", "bench/stage", "--plain", "-d", "rec", "--max-loss=1",
                 cwd=tmp_path) as run:  # fmt: skip
        events = tmp_path / "rec" / "events.jsonl"
        run.await_true(lambda: count_lines(events, '"move"') > 100, "100 moves")
        assert run.end(signal.SIGTERM) == 143, run.stderr
    assert "since the stage first moved" in run.stdout
    poses, truth = recorded_poses(tmp_path / "rec"), truth_of(tmp_path / "bench")
    good = poses["status"] == 0
    assert good.sum() > 500
    assert np.hypot(poses["tx_mm"][good], poses["ty_mm"][good]).min() > 3.9
    true = truth["state"][poses["seq"][good]]
    for i, name in enumerate(("tx_mm", "ty_mm", "tz_mm")):
        error = (poses[name][good] - true[:, i]) / poses[f"u_{name}"][good]
        assert np.abs(error).max() < 6.5
        assert 0.85 < error.std() < 1.15
    names = [event["event"] for event in events_of(tmp_path / "rec")]
    assert "stop" in names[len(names) - names[::-1].index("move") :]
    end = end_of(tmp_path / "rec")
    assert (end["exit_status"], end["reasons"]) == (143, ["the program was ended by SIGTERM"])
    assert command("replay", "rec", "--compare", cwd=tmp_path).returncode == 0
    assert bench.end(signal.SIGHUP) == 129


@pytest.mark.slow
def test_a_board_is_waited_for_and_the_stage_never_moves_without_track(tmp_path, emulator):
    (tmp_path / "waits.yaml").write_text(
        "extends: bench\nacquire: {wait_seconds: 3600, mark: pps}\n"
    )
    with Program("acquire", "waits.yaml", "--port", "bench/board", "--samples", "500", "--json",
                 "--no-record", cwd=tmp_path) as run:  # fmt: skip
        run.await_output("Waiting up to 3600 s")
        bench = emulator("bench", "--motion", "wobble", "--rate", "1000")
        assert run.end(None) == 0, run.stderr
    assert "acquire.mark: pps has no effect" in run.stderr
    assert bench.end() == 0
    assert json.loads((tmp_path / "bench" / "counts.json").read_text())["moves"] == 0
    assert not (tmp_path / "recordings").exists()


def test_an_unplugged_cable_ends_with_a_message_and_an_intact_recording(
    tmp_path, acquire, board, run_in_process
):
    status, _, errors = acquire(b"", port=board)
    assert status == 2
    assert "went away" in errors
    end = end_of(tmp_path / "rec")
    assert end["exit_status"] == 2
    assert "went away" in end["reasons"][0]
    status, output, _ = run_in_process("replay", "rec", "--compare")
    assert status == 0, output
    assert run_in_process("replay", "rec", "--recover")[0] == 0
    assert (tmp_path / "rec" / "recovered.parquet").exists()
    (tmp_path / "there.csv").write_text("x")
    assert run_in_process("replay", "rec", "-o", "there.csv")[0] == 2
    assert (tmp_path / "there.csv").read_text() == "x"


def test_reconnect_goes_on(tmp_path, acquire, board):
    status, _, errors = acquire(
        b"", "--reconnect", "--samples", "800", "--max-loss", "1", port=board
    )
    assert status == 0, errors
    names = [event["event"] for event in events_of(tmp_path / "rec")]
    assert names[0] == "connected"
    assert names.count("unplugged") >= names.count("connected again") >= 2
    poses = recorded_poses(tmp_path / "rec")
    assert (poses["status"] == 0).all()
    assert (np.diff(poses["seq"]) > 0).all()
    assert (np.diff(poses["board_us"]) > 0).all()
    apart = np.diff(poses["board_us"]) - 1e6 * np.diff(poses["host_s"])
    assert np.abs(apart).max() < 60e6  # no jump by an hour; a busy machine may read late


def test_messages_say_what_to_do(tmp_path, run_in_process):
    (tmp_path / "hasty.yaml").write_text("extends: bench\nacquire: {wait_seconds: 0}\n")
    (tmp_path / "file").write_text("x")
    (tmp_path / "board.bin").write_bytes(DATA[: 20 * SIZE])
    here = "acquire bench --port file:board.bin"
    for words, text in (
        ("acquire bench", "use --port, or set acquire.port"),
        ("acquire hasty.yaml --port /dev/nothing", "check that it is plugged in"),
        ("acquire hasty.yaml --port board.bin", "to read a file of received bytes, give file:PATH"),
        ("acquire bench --port file:none.bin", "cannot be read"),
        (f"{here} --seconds 0", "would end at once"),
        (f"{here} --plain --json", "give one of them"),
        (f"{here} -d file", "is a file"),
        (f"{here} -d file/deeper", "cannot be written"),
        ("replay nothing", "the folder does not exist"),
        ("replay nothing --recover", "the folder does not exist"),
        ("emulate bench --motion cirkel", "no motion cirkel; its motions: "),
        ("emulate bench --motion circle --seconds 0", "would end at once"),
        ("emulate bench --motion circle --faults flop=1", "--faults"),
        ("emulate bench --motion circle --faults flip=-1", "--faults"),
        ("emulate bench --motion circle --folder file", "not a folder that can be"),
    ):
        status, _, errors = run_in_process(*words.split())
        assert status == 2, words
        assert text in errors
        assert "Traceback" not in errors
    assert not list(tmp_path.glob("recordings/*"))


def make_dark(data):
    """The same frames without light."""
    samples = parser("frames", "").feed(data)
    return pack(replace(samples, counts=0 * samples.counts))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (
            DATA[: 100 * SIZE] + DATA[110 * SIZE : 200 * SIZE],
            "10 samples were lost, 5 % of all; --max-loss allows 0.1 %.",
        ),
        (make_dark(DATA[: 200 * SIZE]), "no sample gave a pose: 200 non finite."),
        (
            bytes(100_000),
            "no sample came; if bytes did, check acquire.baud, acquire.format and "
            "acquire.channels.",
        ),
    ],
)
def test_the_reason_for_exit_status_1_is_said_and_recorded(
    tmp_path, acquire, run_in_process, data, reason
):
    status, _, errors = acquire(data)
    assert status == 1
    assert f"exit status 1: {reason}" in errors
    end = end_of(tmp_path / "rec")
    assert (end["exit_status"], end["reasons"]) == (1, [reason])
    if "pose" in reason:
        status, _, errors = run_in_process("replay", "rec")
        assert status == 1
        assert f"exit status 1: {reason}" in errors


def test_a_board_that_falls_silent_is_a_reason_for_the_exit_status(tmp_path):
    (tmp_path / "board.bin").write_bytes(DATA[: 20 * SIZE])
    run = Run.from_config(CONFIG, f"file:{tmp_path / 'board.bin'}", RunOptions(record=False))
    assert run.live.tracker is None  # no stage moves without --track
    run.acquire()
    assert not run.complaints()
    run.live.first = run.live.last = run.live.end - 5.0
    (reason,) = run.complaints()
    assert "0 samples were lost and none came for 5.0 s, 100 % of all" in reason


def test_a_signal_while_a_recording_begins_leaves_none(tmp_path, acquire, monkeypatch):
    begin = Recording.begin

    def interrupt(*arguments):
        begin(*arguments)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Recording, "begin", interrupt)
    assert acquire(DATA[: 20 * SIZE])[0] == 130
    assert [path.name for path in tmp_path.iterdir()] == ["board.bin"]


@pytest.fixture
def small_files():
    """The system's own limit on the size of a file: 100 kB, without the board's."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_is_told_and_the_stream_is_read_to_its_end(
    tmp_path, small_files, run_in_process
):
    (tmp_path / "board.bin").write_bytes(DATA[: 3_000 * SIZE])
    small_files()
    words = ("acquire", "bench", "--port", "file:board.bin", "--plain", "-d", "rec")
    status, output, errors = run_in_process(*words)
    assert status == 1, errors
    assert "3000 samples, 0.0000 % lost" in output
    assert "cannot be written to: File too large" in errors
    status, output, errors = run_in_process("replay", "rec", "--compare")
    assert status == 0, output + errors
    assert size_of(tmp_path / "rec" / "bytes.bin") > 60_000
