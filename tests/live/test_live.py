"""The live chain on a virtual bench: recorded, replayed, salvaged, tracked; and the commands."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from facets.experiments.kills import killed, stream
from facets.experiments.soak import soak

import facets
from facets.core.errors import InputError
from facets.live.frames import SIZE
from facets.live.pipeline import Pipeline
from facets.live.recording import Recording, blocks, joined, pose_columns, recorded_poses
from facets.live.virtual import Faults, truth_of

CONFIG = facets.load("bench")


def test_an_unread_stream_is_solved_to_the_truth():
    data = stream(500)
    pipeline = Pipeline(CONFIG)
    parts = [pipeline.feed(data[n : n + 1000], n * 1e-6) for n in range(0, len(data), 1000)]
    poses = joined([pose_columns(part) for part in parts if part is not None])
    assert len(poses["seq"]) == 500
    assert (poses["status"] == 0).all()
    truth = np.sin(np.arange(500) / 100)
    assert np.abs(poses["yaw_mrad"] - truth).max() < 5 * poses["u_yaw_mrad"].max()
    assert pipeline.tally.samples == 500


@pytest.mark.parametrize("faults", ["", "flip=1e-3,lose=1e-3,double=1e-3,drop=1e-3,block=0.5"])
def test_a_soak_counts_every_loss_and_accepts_nothing_wrong(tmp_path, faults):
    found = soak(tmp_path, 4.0, 5000.0, faults)
    assert found["samples"] > 15_000
    assert found["wrong"] == 0
    assert found["lost"] == found["bench_lost"]
    assert found["accepted_though_spoilt"] == 0
    assert found["refused_though_sound"] == 0
    if not faults:
        assert found["solved"] == found["samples"]


def test_a_replay_is_the_run_again(tmp_path):
    soak(tmp_path, 2.0, 5000.0, "drop=1e-3,flip=1e-3")
    recording = tmp_path / "recording"
    result = run("replay", str(recording), "--compare", "-o", "poses.csv", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "recorded poses: identical" in result.stdout
    assert (tmp_path / "poses.csv").stat().st_size > 100_000


def test_a_killed_recording_loses_no_more_than_its_last_block(tmp_path):
    data = stream(20_000)
    for n, after in enumerate((0.05, 0.2, 0.45)):
        row = killed(tmp_path / str(n), data, after)
        assert row["lost"] <= 50 * SIZE
        assert row["unrecovered"] == 0
    before = sorted((tmp_path / "2").iterdir())
    result = run("recover", str(tmp_path / "2"), "-o", "poses.parquet", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert sorted((tmp_path / "2").iterdir()) == before
    assert recorded_poses(tmp_path / "2")["seq"].size > 0


def test_a_torn_index_and_a_torn_stream_are_read_up_to_there(tmp_path):
    data = stream(1000)
    killed(tmp_path / "r", data, 0.3)
    for name in ("index.bin", "poses.arrows"):
        path = tmp_path / "r" / name
        path.write_bytes(path.read_bytes()[:-7])
    joined_bytes = b"".join(block.data for block in blocks(tmp_path / "r"))
    assert joined_bytes == (tmp_path / "r" / "bytes.bin").read_bytes()
    recorded_poses(tmp_path / "r")


def test_a_recording_needs_a_new_folder(tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "thing").touch()
    with pytest.raises(InputError, match="not empty"):
        Recording(tmp_path / "old", "", facets.load("bench").resolved)
    with pytest.raises(InputError, match="no recording"):
        list(blocks(tmp_path / "old"))


def test_faults_are_checked():
    assert Faults.of("flip=1e-3, stall=2").stall == 2
    for text in ("flop=1", "flip", "flip=-1", "flip=x"):
        with pytest.raises(InputError, match="--faults"):
            Faults.of(text)


def run(*arguments, cwd):
    return subprocess.run(
        [sys.executable, "-c", "from facets.cli import main; main()", *arguments],
        cwd=cwd, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip


class Emulator:
    """`facets emulate` in a process of its own."""

    def __init__(self, folder, *arguments):
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from facets.cli import main; main()", "emulate", *arguments],
            cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        while "running" not in self.process.stdout.readline():
            assert self.process.poll() is None, self.process.stderr.read()

    def end(self):
        if self.process.poll() is None:
            os.kill(self.process.pid, signal.SIGINT)
        return self.process.communicate(timeout=20)[0]


@pytest.fixture
def emulator(tmp_path):
    made = []

    def start(*arguments):
        made.append(Emulator(tmp_path, *arguments))
        return made[-1]

    yield start
    for one in made:
        one.process.kill()
        one.process.communicate()


def events_of(folder):
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


PORTS = ("--port", "bench/board", "--stage-port", "bench/stage")


def test_tracking_follows_a_circle_within_the_noise(tmp_path, emulator):
    bench = emulator("bench", "--motion", "circle", "--rate", "2000")
    result = run("acquire", "bench", "--track", *PORTS, "--seconds", "6", "--plain", "-o", "rec",
                 "--max-loss", "1", cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "beam is lost above" in result.stderr
    bench.end()
    poses, truth = recorded_poses(tmp_path / "rec"), truth_of(tmp_path / "bench")
    good = poses["status"] == 0
    assert good.mean() > 0.5  # a machine that stalls may lose the mirror; what is solved is right
    assert np.hypot(poses["tx_mm"][good], poses["ty_mm"][good]).min() > 3.9
    true = truth["state"][poses["seq"][good]]
    for i, name in ((0, "tx_mm"), (1, "ty_mm"), (2, "tz_mm")):
        error = (poses[name][good] - true[:, i]) / poses[f"u_{name}"][good]
        assert np.abs(error).max() < 6.5
        assert 0.9 < error.std() < 1.1
    events = events_of(tmp_path / "rec")
    assert sum(event["event"] == "move" for event in events) > 100
    assert events[-1]["event"] == "stop"


def test_the_stage_never_moves_without_track(tmp_path, emulator):
    bench = emulator("bench", "--motion", "wobble", "--rate", "1000")
    result = run("acquire", "bench", "--port", "bench/board", "--samples", "500", "--json",
                 "--no-record", cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert json.loads(bench.end().splitlines()[-1])["moves"] == 0
    assert not (tmp_path / "recordings").exists()


def test_an_unplugged_cable_ends_with_a_message_and_an_intact_recording(tmp_path, emulator):
    bench = emulator("bench", "--motion", "wobble", "--rate", "1000", "--seconds", "4")
    result = run("acquire", "bench", "--port", "bench/board", "--plain", "-o", "rec", cwd=tmp_path)
    assert result.returncode == 2
    assert "went away" in result.stderr
    assert "Traceback" not in result.stderr
    bench.end()
    assert run("recover", "rec", cwd=tmp_path).returncode == 0
    assert (tmp_path / "rec" / "recovered.parquet").exists()


def test_reconnect_goes_on(tmp_path, emulator):
    emulator("bench", "--motion", "wobble", "--rate", "1000", "--faults", "unplug=1")
    result = run("acquire", "bench", "--port", "bench/board", "--plain", "-o", "rec", "--reconnect",
                 "--seconds", "6", "--max-loss", "1", cwd=tmp_path)  # fmt: skip
    assert result.returncode == 0, result.stderr
    names = [event["event"] for event in events_of(tmp_path / "rec")]
    assert "unplugged" in names
    assert "connected again" in names


def test_messages_say_what_to_do(tmp_path):
    cases = [
        (("acquire", "bench"), "give --port, or acquire.port"),
        (("acquire", "bench", "--port", "/dev/nothing"), "is it plugged in?"),
        (("acquire", "bench", "--port", "file:none.bin"), "can not be read"),
        (("replay", "nothing"), "no meta.yaml"),
        (("recover", "nothing"), "no meta.yaml"),
        (("emulate", "bench", "--motion", "cirkel"), "no motion cirkel; it has: "),
    ]
    for arguments, words in cases:
        result = run(*arguments, cwd=tmp_path)
        assert result.returncode == 2, arguments
        assert words in result.stderr
        assert "Traceback" not in result.stderr
    assert list(tmp_path.glob("recordings/*")) == []


def test_a_stream_of_the_wrong_kind_says_so(tmp_path):
    (tmp_path / "noise.bin").write_bytes(os.urandom(100_000))
    result = run(
        "acquire", "bench", "--port", "file:noise.bin", "--plain", "-o", "rec", cwd=tmp_path
    )
    assert result.returncode == 1
    assert "0 samples" in result.stdout
