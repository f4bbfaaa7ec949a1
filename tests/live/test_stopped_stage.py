"""A stage that is stopped, and what lets it go on: the commands beside a virtual bench."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import termios
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import PROGRAM, command
from programs import Program, await_true, count_lines

import facets
from facets.detectors import readings_to_counts
from facets.live.run.doubts import Trust
from facets.live.run.keys import watch_keys
from facets.live.virtual.board import HEARTBEAT_PATIENCE_S, HeartbeatWatch
from facets.tracking import heartbeat_frame

PORTS = ("--port", "bench/board", "--stage-port", "bench/stage")
CALM = """extends: bench
stage: {stale_ms: 500, permit: "file:permit", heartbeat: board}
motions:
  circle: {kind: sine, amplitude: {tx_mm: 4, ty_mm: 4}, phase_deg: {tx_mm: 90}, samples: 4000,
    rate_hz: 100}
"""


def moves(folder):
    return count_lines(folder / "rec" / "events.jsonl", '"move"')


@pytest.mark.slow
def test_a_stop_lasts_until_a_person_says_go_and_a_killed_run_stops_the_stage(tmp_path):
    """The permit is taken away and given back, then SIGUSR1 comes, then the run is killed."""
    (tmp_path / "calm.yaml").write_text(CALM)
    (tmp_path / "permit").write_text("1")
    with Program("emulate", "calm.yaml", "--folder", "bench", "--motion", "circle",
                 "--rate", "1000", cwd=tmp_path) as bench:  # fmt: skip
        bench.await_output("running")
        with Program("acquire", "calm.yaml", "--track", *PORTS, "--plain", "-d", "rec",
                     "--max-loss=1", cwd=tmp_path) as run:  # fmt: skip

            def go_on():
                time.sleep(0.5)  # refused before the stage stands
                run.process.send_signal(signal.SIGUSR1)

            def await_moves(count):
                run.await_true(lambda: go_on() or moves(tmp_path) > count, f"{count} moves")

            # on a busy machine the loop may stall, and the stage be stopped, before the permit goes
            run.await_true(lambda: (tmp_path / "rec" / "events.jsonl").exists(), "a recording")
            run.await_true(lambda: "stage " in run.stdout, "a line")
            await_moves(20)
            (tmp_path / "permit").write_text("0")
            no_permit = "the external permit is not given"
            run.await_true(lambda: go_on() or no_permit in run.stdout, no_permit)
            (tmp_path / "permit").write_text("1")
            await_moves(moves(tmp_path) + 20)
            run.process.send_signal(signal.SIGKILL)
            run.end(None)
        events = [json.loads(x) for x in (tmp_path / "rec/events.jsonl").read_text().splitlines()]
        bench.end()
    names = [event["event"] for event in events]
    after = names[names.index("stop") :]
    assert "move" not in after[: after.index("resume")]
    assert {event["by"] for event in events if event["event"] == "resume"} == {"SIGUSR1"}
    assert "because no heartbeat came" in bench.stdout


@pytest.mark.slow
def test_a_stage_must_be_checked_before_it_follows(tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "extends: bench\nstage: {port: bench/stage, step_um: 0.2}\nacquire: {port: bench/board}\n"
    )
    result = command("acquire", "mine.yaml", "--track", cwd=tmp_path)
    assert result.returncode == 2
    assert "--check-stage" in result.stderr
    assert "is not the stage that is configured now" in result.stderr
    assert not (tmp_path / "recordings").exists()
    with Program("emulate", "bench", "--motion", "rest", "--rate", "1000", cwd=tmp_path) as bench:
        bench.await_output("running")
        check = ("acquire", "bench", "--check-stage", *PORTS, "--plain", "--max-loss", "1")
        result = command(*check, "--write", "good.yaml", "-d", "a", cwd=tmp_path)
        assert result.returncode == 0, result.stdout + result.stderr
        assert "The stage is wired as the configuration says." in result.stdout
        wrong = ("acquire", "mine.yaml", "--check-stage", "--plain", "--max-loss", "1")
        result = command(*wrong, "--write", "bad.yaml", "-d", "b", cwd=tmp_path)
    assert result.returncode == 1, result.stdout + result.stderr
    assert "correct stage.step_um" in result.stderr
    assert "checked: 20" in (tmp_path / "good.yaml").read_text()
    assert not (tmp_path / "bad.yaml").exists()


def test_bad_uses_of_the_check_are_refused(tmp_path):
    (tmp_path / "old.yaml").write_text("extends: bench\n")
    (tmp_path / "text.yaml").write_text(
        "extends: bench\nacquire: {format: text}\nstage: {permit: board}\n"
    )
    (tmp_path / "file.yaml").write_text("extends: bench\nstage: {heartbeat: board}\n")
    (tmp_path / "board.bin").write_bytes(b"")
    here = ("--port", "file:board.bin", "--stage-port", "bench/stage")
    for words, text in (
        (("bench", "--track", "--check-stage"), "check it first"),
        (("bench", "--write", "new.yaml"), "--write needs --check-stage"),
        (("bench", "--check-stage", "--write", "new.txt"), "ends in .yaml"),
        (("bench", "--check-stage", "--write", "old.yaml"), "old.yaml"),
        (("bench", "--track", "--stage-port", "/dev/ttyUSB0"), "which is not the stage"),
        (("text.yaml", "--track"), "no flag for it"),
        (("file.yaml", "--track"), "nothing can be sent to file:board.bin"),
    ):
        result = command("acquire", *words, *(() if "/dev/ttyUSB0" in words else here[2:]),
                         *here[:2], cwd=tmp_path)  # fmt: skip
        assert result.returncode == 2, words
        assert text in result.stderr, result.stderr
        assert "Traceback" not in result.stderr
    assert not (tmp_path / "recordings").exists()


def test_a_heartbeat_is_heard_among_noise_and_one_that_hangs_is_none():
    watch, now = HeartbeatWatch(), 5.0
    assert not watch.is_alive(now)
    for count in range(1, 6):
        now += 0.02
        data = b"\xa5\x00\xa5" + heartbeat_frame(count, True)
        watch.feed(data[:7], now)
        watch.feed(data[7:] + b"\xa5\x5a", now)
        assert watch.is_alive(now)
    spoilt = bytearray(heartbeat_frame(9, True))
    spoilt[5] ^= 1
    for _ in range(10):
        now += 0.02
        watch.feed(heartbeat_frame(5, True) + bytes(spoilt), now)
    assert now - 5.1 > HEARTBEAT_PATIENCE_S
    assert not watch.is_alive(now)
    watch.feed(heartbeat_frame(6, True), now)
    assert watch.is_alive(now)
    watch.feed(heartbeat_frame(7, False), now)
    assert not watch.is_alive(now)


@pytest.mark.parametrize("bits", [16, 9])
def test_a_frozen_converter_is_told_from_a_mirror_that_stands_still(bits):
    """Counts at 1 kHz with noise, which the coarse converter hardly sees; then the same ones."""
    config = facets.load("bench")
    electronics = replace(config.electronics, adc_bits=bits)
    trust = Trust(replace(config, electronics=electronics))
    exact = np.repeat(facets.readings(config.sensor, np.zeros((1, 8))), 2000, axis=0)
    counts = readings_to_counts(config.sensor, electronics, exact, np.random.default_rng(1))
    time = 1000 * np.arange(2000)
    for part in range(0, 2000, 20):
        trust.add_counts(counts[part : part + 20], time[part : part + 20])
        assert not trust.doubt
    frozen = np.repeat(counts[-1:], 20, axis=0)
    for n in range(4):
        trust.add_counts(frozen, time[-1] + 1000 + 1000 * np.arange(20 * n, 20 * n + 20))
        assert bool(trust.doubt) == (bits == 16 and n > 1)
    trust.add_counts(frozen + 1, time[-1] + 100_000 + 1000 * np.arange(20))
    assert not trust.doubt


def test_poses_that_mostly_misfit_are_doubted_after_a_while():
    trust, all_three = Trust(facets.load("bench")), np.full(3, True)
    for n in range(200):  # at 100 Hz, and one second in the middle that does not fit
        beyond = np.array([n % 3 == 0, 50 <= n < 150, 50 <= n < 150])
        poses = SimpleNamespace(converged=all_three, checks=np.ones(3), misfit=beyond)
        trust.add_poses(poses, 0.01 * n)
        if n < 50 or n > 185:
            assert not trust.doubt
        if 110 < n < 150:
            assert trust.doubt == "most poses have a residual beyond chance"


def test_a_key_calls_its_action_and_the_terminal_is_as_it_was(tmp_path):
    """In a process of its own, whose terminal is a pty."""
    script = tmp_path / "keys.py"
    script.write_text(
        "import threading\nfrom facets.live.run.keys import watch_keys\n"
        "pressed = threading.Event()\n"
        "with watch_keys({'r': pressed.set}):\n    print('ready', flush=True)\n    pressed.wait()\n"
        "print('resumed', flush=True)\n"
    )
    end, other = pty.openpty()
    before = termios.tcgetattr(other)
    process = subprocess.Popen(
        [PROGRAM[0], str(script)], stdin=other, stdout=subprocess.PIPE, text=True,
        start_new_session=True, preexec_fn=lambda: os.close(os.open(os.ttyname(other), os.O_RDWR)),
    )  # fmt: skip
    assert process.stdout.readline() == "ready\n"
    await_true(lambda: not termios.tcgetattr(other)[3] & termios.ICANON, "each key at once")
    os.write(end, b"xqr")
    assert process.stdout.readline() == "resumed\n"
    assert process.wait() == 0
    process.stdout.close()
    assert termios.tcgetattr(other)[3] == before[3]
    os.close(end)
    os.close(other)


def test_no_key_is_read_where_the_input_is_no_terminal(monkeypatch, tmp_path):
    with (tmp_path / "empty").open("w+") as file:
        monkeypatch.setattr("sys.stdin", file)
        threads = threading.active_count()
        with watch_keys({"r": lambda: None}):
            assert threading.active_count() == threads
