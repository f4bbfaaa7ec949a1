"""The live chain on a virtual bench: recorded, replayed, salvaged, tracked; and the commands."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from commands import PROGRAM, command
from facets.cli.acquire import run_to_end
from facets.experiments import kills, soak
from programs import Program, count_lines, size_of

import facets
from facets import BenchLight, InputError
from facets.detectors import align
from facets.estimation import solve_readings
from facets.live import (
    MAX_BLOCK_S,
    SIZE,
    Faults,
    Pipeline,
    Recording,
    Run,
    blocks,
    join_columns,
    join_poses,
    pack,
    parser,
    pose_columns,
    recorded_config,
    recorded_poses,
    replay,
    truth_of,
)

CONFIG = facets.load("bench")
PORTS = ("--port", "bench/board", "--stage-port", "bench/stage")


#: A circle once in 40 s, and a stage that waits for half a second for a busy machine, and goes on.
CALM = """extends: bench
stage: {stale_ms: 500, resume: auto, resumes_per_hour: 3600}
motions:
  circle: {kind: sine, amplitude: {tx_mm: 4, ty_mm: 4}, phase_deg: {tx_mm: 90}, samples: 4000,
    rate_hz: 100}
"""


def events_of(folder):
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def end_of(folder):
    """The event with which a run ended."""
    (end,) = (event for event in events_of(folder) if event["event"] == "end")
    return end


@pytest.fixture
def emulator(tmp_path):
    """Starts `facets emulate` in the test's folder, once it runs; ends it after the test."""
    made = []

    def start(*words):
        made.append(Program("emulate", *words, cwd=tmp_path))
        made[-1].await_output("running")
        return made[-1]

    yield start
    for program in made:
        program.__exit__()


def test_an_unread_stream_is_solved_to_the_truth():
    data = kills.stream(500)
    pipeline = Pipeline(CONFIG)
    parts = [pipeline.feed(data[n : n + 1000], n * 1e-6) for n in range(0, len(data), 1000)]
    poses = join_columns([pose_columns(part) for part in parts if part is not None])
    assert len(poses["seq"]) == 500
    assert (poses["status"] == 0).all()
    truth = np.sin(np.arange(500) / 100)
    assert np.abs(poses["yaw_mrad"] - truth).max() < 5 * poses["u_yaw_mrad"].max()
    assert pipeline.tally.samples == 500


def test_no_pose_depends_on_the_blocks_where_detectors_are_read_one_after_the_other():
    sensor = replace(CONFIG.sensor, light=BenchLight(delays=(0.0, 5e-6, 1e-5)))
    config, data, states = replace(CONFIG, sensor=sensor), kills.stream(600), []
    for size in (37 * SIZE, len(data)):
        pipeline = Pipeline(config)
        parts = [pipeline.feed(data[n : n + size], 1.0 + n) for n in range(0, len(data), size)]
        parts += map(pipeline.solve, pipeline.release())
        found = join_poses([part for part in parts if part is not None])
        np.testing.assert_array_equal(found.seq, np.arange(600))
        states.append(found.solution.state)
    np.testing.assert_array_equal(*states)
    exact = align(sensor, 1e-6 * found.time.astype(float), found.readings)
    expected = solve_readings(sensor, config.solve, exact, None)
    np.testing.assert_allclose(states[0], expected.state, atol=1e-12)


@pytest.mark.parametrize("faults", ["", "flip=1e-3,lose=1e-3,double=1e-3,drop=1e-3,block=0.5"])
@pytest.mark.slow
def test_a_soak_counts_every_loss_and_accepts_nothing_wrong(tmp_path, faults):
    found = soak.soak(tmp_path, np.inf, 2000.0, faults, samples=8_000)
    assert found["samples"] >= 8_000
    assert found["wrong"] == 0
    assert found["lost"] == found["bench_lost"]
    assert found["accepted_though_spoilt"] == 0
    assert found["refused_though_sound"] == 0
    if not faults:
        assert found["solved"] + found["skipped"] == found["samples"]


@pytest.mark.slow
def test_a_replay_is_the_run_again(tmp_path):
    soak.soak(tmp_path, np.inf, 2000.0, "drop=1e-3,flip=1e-3", samples=4_000)
    result = command("replay", "recording", "--compare", "-o", "poses.csv", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "recorded poses: identical" in result.stdout
    assert (tmp_path / "poses.csv").stat().st_size > 100_000


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.slow
def test_a_killed_recording_loses_no_more_than_its_last_block(tmp_path, number):
    """A block is what came within MAX_BLOCK_S, and the read that was under way."""
    data = kills.stream(20_000)
    pieces = int(MAX_BLOCK_S * kills.RATE) + 2  # the source waits before it gives one
    for n, after in enumerate((0.05, 0.45)):
        row = kills.kill(tmp_path / str(n), data, after, number)
        assert row["lost"] <= pieces * kills.BLOCK * SIZE
        assert row["unrecovered"] == row["different"] == 0
        if number != signal.SIGKILL:
            assert row["closed"] == 1
            assert row["poses"] == row["recovered"]


@pytest.mark.slow
def test_what_is_recovered_leaves_the_recording_as_it_was(tmp_path):
    kills.kill(tmp_path / "r", kills.stream(20_000), 0.45)
    before = {file.name: file.read_bytes() for file in (tmp_path / "r").iterdir()}
    result = command("replay", "r", "--recover", "-o", "poses.parquet", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert {file.name: file.read_bytes() for file in (tmp_path / "r").iterdir()} == before
    assert (tmp_path / "poses.parquet").exists()


def test_a_torn_index_and_a_torn_stream_are_read_up_to_there(tmp_path):
    kills.kill(tmp_path / "r", kills.stream(1000), 0.3)
    for name in ("index.bin", "poses.arrows"):
        path = tmp_path / "r" / name
        path.write_bytes(path.read_bytes()[:-7])
    joined_bytes = b"".join(block.data for block in blocks(tmp_path / "r"))
    assert joined_bytes == (tmp_path / "r" / "bytes.bin").read_bytes()
    recorded_poses(tmp_path / "r")


def test_faults_are_checked():
    assert Faults.from_text("flip=1e-3, stall=2").stall == 2
    for text in ("flop=1", "flip", "flip=-1", "flip=x"):
        with pytest.raises(InputError, match="--faults"):
            Faults.from_text(text)


@pytest.mark.slow
def test_tracking_follows_a_circle_within_the_noise(tmp_path, emulator):
    """Until the stage has moved 100 times, however long a busy machine takes for that."""
    (tmp_path / "calm.yaml").write_text(CALM)
    emulator("calm.yaml", "--motion", "circle", "--rate", "1000", "--truth")
    with Program("acquire", "calm.yaml", "--track", *PORTS, "--plain", "-d", "rec", "--max-loss=1",
                 cwd=tmp_path) as run:  # fmt: skip
        events = tmp_path / "rec" / "events.jsonl"
        run.await_true(lambda: count_lines(events, '"move"') > 100, "100 moves")
        assert run.end() == 0, run.stderr
    assert "beam is lost above" in run.stderr
    lines = run.stdout.splitlines()
    (end,) = [n for n, line in enumerate(lines) if "since the stage first moved" in line]
    assert lines[end].startswith("The beam was ")
    assert "% lost" in lines[end + 2]  # the first sentence of the summary, after the last line
    poses, truth = recorded_poses(tmp_path / "rec"), truth_of(tmp_path / "bench")
    good = poses["status"] == 0
    assert good.sum() > 500
    assert np.hypot(poses["tx_mm"][good], poses["ty_mm"][good]).min() > 3.9
    true = truth["state"][poses["seq"][good]]
    for i, name in ((0, "tx_mm"), (1, "ty_mm"), (2, "tz_mm")):
        error = (poses[name][good] - true[:, i]) / poses[f"u_{name}"][good]
        assert np.abs(error).max() < 6.5
        assert 0.85 < error.std() < 1.15
    names = [event["event"] for event in events_of(tmp_path / "rec")]
    last_move = len(names) - names[::-1].index("move")
    assert "stop" in names[last_move:]
    assert names[-2:] == ["end", "closed"]


@pytest.mark.slow
def test_the_stage_never_moves_without_track(tmp_path, emulator):
    bench = emulator("bench", "--motion", "wobble", "--rate", "1000")
    result = command("acquire", "bench", "--port", "bench/board", "--samples", "500", "--json",
                     "--no-record", cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert bench.end() == 0
    assert "The stage never moved." in bench.stdout
    assert "The board made " in bench.stdout
    assert bench.stdout.splitlines()[-1] == "bench/: counts.json"
    assert json.loads((tmp_path / "bench" / "counts.json").read_text())["moves"] == 0
    assert not (tmp_path / "bench" / "truth.bin").exists()
    assert not (tmp_path / "recordings").exists()


@pytest.mark.slow
def test_an_unplugged_cable_ends_with_a_message_and_an_intact_recording(tmp_path, emulator):
    bench = emulator("bench", "--motion", "wobble", "--rate", "1000")
    with Program("acquire", "bench", "--port", "bench/board", "--plain", "-d", "rec",
                 cwd=tmp_path) as run:  # fmt: skip
        run.await_true(lambda: size_of(tmp_path / "rec" / "bytes.bin") > 20_000, "bytes")
        bench.end()
        assert run.end(None) == 2
    assert "went away" in run.stderr
    end = end_of(tmp_path / "rec")
    assert end["exit_status"] == 2
    assert "went away" in end["reasons"][0]
    assert "samples, " in run.stdout
    assert "Traceback" not in run.stderr
    result = command("replay", "rec", "--compare", cwd=tmp_path)
    assert result.returncode == 0, result.stdout
    assert command("replay", "rec", "--recover", cwd=tmp_path).returncode == 0
    assert (tmp_path / "rec" / "recovered.parquet").exists()


@pytest.mark.slow
def test_reconnect_goes_on(tmp_path, emulator):
    emulator("bench", "--motion", "wobble", "--rate", "500", "--faults", "unplug=1,restart=0.5")
    with Program("acquire", "bench", "--port", "bench/board", "--plain", "-d", "rec", "--reconnect",
                 "--max-loss", "1", cwd=tmp_path) as run:  # fmt: skip
        events = tmp_path / "rec" / "events.jsonl"
        run.await_true(lambda: count_lines(events, "connected again") > 1, "connected again")
        assert run.end() == 0, run.stderr
    names = [event["event"] for event in events_of(tmp_path / "rec")]
    assert names[0] == "connected"
    assert names.count("unplugged") >= 2
    poses = recorded_poses(tmp_path / "rec")
    assert (np.diff(poses["seq"]) > 0).all()
    assert (np.diff(poses["board_us"]) > 0).all()
    apart = np.diff(poses["board_us"]) - 1e6 * np.diff(poses["host_s"])
    assert np.abs(apart).max() < 60e6  # no jump by an hour; a busy machine may read late


@pytest.mark.slow
def test_times_do_not_follow_the_ports_jitter(tmp_path, emulator):
    """A port that is looked at every 20 ms, a clock that is slow and wraps after a second."""
    faults = "jitter_ms=20,drift_ppm=50,uptime_s=4294"
    bench = emulator("bench", "--motion", "wobble", "--rate", "500", "--faults", faults, "--truth")
    assert "bench/truth.bin, 2.31 MB a minute" in bench.stdout
    result = command("acquire", "bench", "--port", "bench/board", "--plain", "-d", "rec",
                     "--samples", "3000", "--max-loss=1", cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "the samples' times are known to" in result.stdout
    assert bench.end() == 0
    truth, error = truth_of(tmp_path / "bench"), {}
    for timing in ("envelope", "arrival"):
        acquire = replace(CONFIG.acquire, timing=timing)
        poses = replay(tmp_path / "rec", Pipeline(replace(CONFIG, acquire=acquire)))
        parts = join_columns([pose_columns(part) for part in poses])
        true = truth["host"][parts["seq"]]
        assert (truth["seq"][parts["seq"]] == parts["seq"]).all()
        error[timing] = (parts["host_s"] - true)[1500:]
    assert error["envelope"].std() < 0.3 * error["arrival"].std()
    assert command("replay", "rec", "--compare", cwd=tmp_path).returncode == 0


@pytest.mark.slow
def test_a_recording_of_a_version_without_timing_is_replayed_by_arrival(tmp_path):
    kills.kill(tmp_path / "r", kills.stream(2000), 0.2, signal.SIGTERM)
    meta = tmp_path / "r" / "meta.yaml"
    text = meta.read_text()
    assert "    timing: envelope\n" in text
    assert recorded_config(tmp_path / "r").acquire.timing == "envelope"
    (tmp_path / "r" / "events.jsonl").unlink()  # which that version did not seal the folder by
    changed = text.replace("    timing: envelope\n", "")
    meta.write_text(re.sub("config_sha256: .*\n", "", changed))
    assert recorded_config(tmp_path / "r").acquire.timing == "arrival"


@pytest.mark.slow
def test_a_board_that_is_not_there_yet_is_waited_for(tmp_path, emulator):
    with Program("acquire", "waits.yaml", "--port", "bench/board", "--samples", "100",
                 "-d", "rec", cwd=write(tmp_path, "waits.yaml", wait=3600)) as run:  # fmt: skip
        run.await_output("Waiting up to 3600 s")
        emulator("bench", "--motion", "wobble", "--rate", "1000")
        assert run.end(None) == 0, run.stderr


def write(folder, name, **acquire):
    """A configuration of a bench with other keys of `acquire`; the folder again."""
    keys = {"wait": "wait_seconds", "format": "format"}
    text = ", ".join(f"{keys[key]}: {value}" for key, value in acquire.items())
    (folder / name).write_text(f"extends: bench\nacquire: {{{text}}}\n")
    return folder


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.slow
def test_a_signal_stops_the_stage_and_closes_the_recording(tmp_path, emulator, number):
    (tmp_path / "calm.yaml").write_text(CALM)
    bench = emulator("calm.yaml", "--folder", "bench", "--motion", "circle", "--rate", "1000")
    with Program("acquire", "calm.yaml", "--track", *PORTS, "--plain", "-d", "rec", "--max-loss=1",
                 cwd=tmp_path) as run:  # fmt: skip
        events = tmp_path / "rec" / "events.jsonl"
        run.await_true(lambda: count_lines(events, '"move"') > 20, "20 moves")
        status = run.end(number)
    assert status == (0 if number == signal.SIGINT else 128 + number)
    assert "rec/" in run.stdout
    names = [event["event"] for event in events_of(tmp_path / "rec")]
    assert "stop" in names[len(names) - names[::-1].index("move") :]
    assert names[-2:] == ["end", "closed"]
    end = end_of(tmp_path / "rec")
    assert end["exit_status"] == status
    assert end["reasons"] == ([] if status == 0 else [f"the program was ended by {number.name}"])
    assert command("replay", "rec", "--compare", cwd=tmp_path).returncode == 0
    assert bench.end(number) == (0 if number == signal.SIGINT else 128 + number)
    assert json.loads((tmp_path / "bench" / "counts.json").read_text())["moves"] > 0
    assert not (tmp_path / "bench" / "board").is_symlink()


@pytest.mark.slow
def test_messages_say_what_to_do(tmp_path):
    write(tmp_path, "hasty.yaml", wait=0)
    (tmp_path / "file").write_text("x")
    (tmp_path / "board.bin").write_bytes(kills.stream(200))
    here = ("--port", "file:board.bin")
    cases = [
        (("acquire", "bench"), "use --port, or set acquire.port"),
        (("acquire", "hasty.yaml", "--port", "/dev/nothing"), "check that it is plugged in"),
        (("acquire", "bench", "--port", "file:none.bin"), "cannot be read"),
        (("acquire", "bench", *here, "--seconds", "0"), "would end at once"),
        (("acquire", "bench", *here, "--plain", "--json"), "give one of them"),
        (("acquire", "bench", "--port", "file:none.bin", "--web"), "cannot be read"),
        (("acquire", "bench", *here, "-d", "file"), "is a file"),
        (("acquire", "bench", *here, "-d", "file/deeper"), "cannot be written"),
        (("replay", "nothing"), "the folder does not exist"),
        (("replay", "nothing", "--recover"), "the folder does not exist"),
        (("emulate", "bench", "--motion", "cirkel"), "no motion cirkel; its motions: "),
        (("emulate", "bench", "--motion", "circle", "--seconds", "0"), "would end at once"),
        (
            ("emulate", "bench", "--motion", "circle", "--folder", "file"),
            "not a folder that can be",
        ),
    ]
    for words, text in cases:
        result = command(*words, cwd=tmp_path)
        assert result.returncode == 2, words
        assert text in result.stderr
        assert "Traceback" not in result.stderr
    assert list(tmp_path.glob("recordings/*")) == []


@pytest.mark.slow
def test_a_replay_into_something_that_is_there_is_refused(tmp_path):
    (tmp_path / "board.bin").write_bytes(kills.stream(200))
    words = ("acquire", "bench", "--port", "file:board.bin", "-d", "rec", "--plain")
    assert command(*words, cwd=tmp_path).returncode == 0
    (tmp_path / "there.csv").write_text("x")
    (tmp_path / "folder.csv").mkdir()
    for words in (("-o", "there.csv"), ("-o", "folder.csv"), ("-o", "folder.csv", "--force")):
        result = command("replay", "rec", *words, cwd=tmp_path)
        assert result.returncode == 2, words
        assert "Traceback" not in result.stderr
    assert (tmp_path / "there.csv").read_text() == "x"
    assert not list(tmp_path.glob(".*"))


def test_losses_are_named_as_the_reason_for_the_exit_status(tmp_path):
    data = kills.stream(200)
    (tmp_path / "board.bin").write_bytes(data[: 100 * SIZE] + data[110 * SIZE :])
    result = command("acquire", "bench", "--port", "file:board.bin", "--plain", "-d", "rec",
                     cwd=tmp_path)  # fmt: skip
    assert result.returncode == 1
    assert "exit status 1: 10 samples were lost, 5 % of all" in result.stderr
    end = end_of(tmp_path / "rec")
    assert end["exit_status"] == 1
    assert end["reasons"] == ["10 samples were lost, 5 % of all; --max-loss allows 0.1 %."]


def test_a_board_that_falls_silent_is_a_reason_for_the_exit_status(tmp_path):
    (tmp_path / "board.bin").write_bytes(kills.stream(200))
    run = Run.from_config(CONFIG, f"file:{tmp_path / 'board.bin'}", record=False)
    run.acquire()
    assert not run.complaints()
    run.live.first = run.live.last = run.live.end - 5.0
    (reason,) = run.complaints()
    assert "0 samples were lost and none came for 5.0 s, 100 % of all" in reason


def test_a_run_without_a_single_pose_ends_with_status_1(tmp_path):
    (tmp_path / "dark.bin").write_bytes(dark(kills.stream(200)))
    words = ("acquire", "bench", "--port", "file:dark.bin", "--plain", "-d", "rec")
    for result in (command(*words, cwd=tmp_path), command("replay", "rec", cwd=tmp_path)):
        assert result.returncode == 1
        assert "exit status 1: no sample gave a pose: 200 " in result.stderr


def dark(data):
    """The same frames without light."""
    samples = parser("frames", "").feed(data)
    return pack(replace(samples, counts=0 * samples.counts))


def test_a_signal_while_a_recording_begins_leaves_none(tmp_path, monkeypatch):
    def begin(recording, *more, known=Recording.begin):
        known(recording, *more)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Recording, "begin", begin)
    with pytest.raises(KeyboardInterrupt):
        Run.from_config(CONFIG, "file:board.bin", folder=tmp_path / "new" / "rec")
    assert not list(tmp_path.iterdir())


def test_a_signal_before_the_run_begins_leaves_no_recording(tmp_path):
    (tmp_path / "board.bin").write_bytes(kills.stream(20))
    run = Run.from_config(CONFIG, f"file:{tmp_path / 'board.bin'}", folder=tmp_path / "rec")
    with pytest.raises(KeyboardInterrupt):
        run_to_end(run, Interrupted())
    run.reader.finish()
    assert not (tmp_path / "rec").exists()


class Interrupted:
    """A display during whose beginning the signal comes."""

    def __enter__(self):
        signal.raise_signal(signal.SIGINT)

    def __exit__(self, *_):
        pass


def test_a_stream_of_the_wrong_kind_says_so(tmp_path):
    (tmp_path / "noise.bin").write_bytes(os.urandom(100_000))
    result = command("acquire", "bench", "--port", "file:noise.bin", "--plain", "-d", "rec",
                     cwd=tmp_path)  # fmt: skip
    assert result.returncode == 1
    assert "0 samples" in result.stdout
    assert "no sample came" in result.stderr


@pytest.mark.slow
def test_a_full_disk_is_told_and_the_stream_is_read_to_its_end(tmp_path):
    """By the system's own limit on the size of a file, in a process of its own."""
    (tmp_path / "board.bin").write_bytes(kills.stream(5_000))
    result = subprocess.run(
        [*PROGRAM, "acquire", "bench", "--port", "file:board.bin", "--plain", "-d", "rec"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000)),
    )  # fmt: skip
    assert result.returncode == 1, result.stderr
    assert "5000 samples, 0.0000 % lost" in result.stdout
    assert "cannot be written to: File too large" in result.stderr
    assert "received bytes are not recorded" in result.stderr
    assert "Traceback" not in result.stderr
    replay = command("replay", "rec", "--compare", cwd=tmp_path)
    assert replay.returncode == 0, replay.stdout + replay.stderr
    assert size_of(tmp_path / "rec" / "bytes.bin") > 60_000


def test_a_working_folder_that_is_gone_is_an_error_and_no_traceback(tmp_path):
    text = f"cd {tmp_path} && mkdir gone && cd gone && rmdir ../gone && exec {sys.executable} " \
        "-c 'from facets.cli import main; main()' "  # fmt: skip
    for words in ("acquire bench --port file:x", "emulate bench --motion circle", "replay rec"):
        result = subprocess.run(
            text + words, shell=True, capture_output=True, text=True, check=False
        )
        assert result.returncode == 2, words
        assert "Traceback" not in result.stderr
