"""A stage that is stopped, and what lets it go on: the commands beside a virtual bench."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import termios
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import PROGRAM
from programs import Program, await_true, count_lines
from recorded import events_of
from streams import samples_of

import facets
from facets.live import Live, Pipeline, pack

CONFIG = facets.load("bench")
PORTS = ("--port", "bench/board", "--stage-port", "bench/stage")
#: A mirror that never leaves the light of a stage that stands still.
CALM = """extends: bench
stage: {stale_ms: 500, permit: "file:permit", heartbeat: board}
motions:
  circle: {kind: sine, amplitude: {tx_mm: 0.2, ty_mm: 0.2}, phase_deg: {tx_mm: 90}, samples: 400,
    rate_hz: 100}
"""


@pytest.mark.slow
def test_a_stop_lasts_until_a_person_says_go_and_a_killed_run_stops_the_stage(tmp_path):
    """The permit is taken away and given back, then SIGUSR1 comes, then the run is killed."""
    (tmp_path / "calm.yaml").write_text(CALM)
    (tmp_path / "permit").write_text("1")
    path = tmp_path / "rec" / "events.jsonl"
    words = ("--motion", "circle", "--rate", "1000")
    with Program("emulate", "calm.yaml", *words, cwd=tmp_path) as bench:
        bench.await_output("running")
        with Program("acquire", "calm.yaml", "--track", *PORTS, "--plain", "-d", "rec",
                     "--max-loss=1", cwd=tmp_path) as run:  # fmt: skip

            def go_on():
                time.sleep(0.2)  # refused before the stage stands
                run.process.send_signal(signal.SIGUSR1)

            def await_moves():
                goal = count_lines(path, '"move"') + 20
                run.await_true(lambda: go_on() or count_lines(path, '"move"') > goal, "20 moves")

            # on a busy machine the loop may stall, and the stage be stopped, before the permit goes
            run.await_true(lambda: "stage " in run.stdout, "a line")
            await_moves()
            (tmp_path / "permit").write_text("0")
            no_permit = "the external permit is not given"
            run.await_true(lambda: go_on() or no_permit in run.stdout, no_permit)
            (tmp_path / "permit").write_text("1")
            await_moves()
            run.process.send_signal(signal.SIGKILL)
            run.end(None)
        events = events_of(tmp_path / "rec")
        time.sleep(0.3)  # the board waits for a heartbeat for 0.1 s
        bench.end()
    names = [event["event"] for event in events]
    after = names[names.index("stop") :]
    assert "move" not in after[: after.index("resume")]
    assert {event["by"] for event in events if event["event"] == "resume"} == {"SIGUSR1"}
    assert "because no heartbeat came" in bench.stdout


def test_bad_uses_of_the_check_are_refused(tmp_path, run_in_process):
    (tmp_path / "old.yaml").write_text("extends: bench\n")
    (tmp_path / "text.yaml").write_text(
        "extends: bench\nacquire: {format: text}\nstage: {permit: board}\n"
    )
    (tmp_path / "file.yaml").write_text("extends: bench\nstage: {heartbeat: board}\n")
    (tmp_path / "board.bin").write_bytes(b"")
    for words, text in (
        ("bench --track --check-stage", "check it first"),
        ("bench --write new.yaml", "--write needs --check-stage"),
        ("bench --check-stage --write new.txt", "ends in .yaml"),
        ("bench --check-stage --write old.yaml", "old.yaml"),
        ("bench --track --stage-port /dev/ttyUSB0", "which is not the stage"),
        ("text.yaml --track", "no flag for it"),
        ("file.yaml --track", "nothing can be sent to file:board.bin"),
    ):
        status, _, errors = run_in_process("acquire", *words.split(), "--port", "file:board.bin")
        assert status == 2, words
        assert text in errors
    assert not (tmp_path / "recordings").exists()


@pytest.mark.parametrize("bits", [16, 9])
def test_a_frozen_converter_is_told_from_a_mirror_that_stands_still(bits):
    """Counts at 1 kHz with noise, which the coarse converter hardly sees; then the same ones; then
    others. A message says so while it lasts."""
    electronics = replace(CONFIG.electronics, adc_bits=bits)
    readings = facets.readings(CONFIG.sensor, np.zeros((2_100, 8)))
    samples = samples_of(readings, np.random.default_rng(1), electronics=electronics)
    samples.time[:] *= 10
    samples.counts[2_000:] = samples.counts[1_999]
    samples.counts[2_080:] += 1
    pipeline = Pipeline(replace(CONFIG, electronics=electronics))
    live = Live(pipeline, begin=np.inf)  # no run, which could be silent
    for first in range(0, 2_100, 20):
        pipeline.take(pack(samples.where(slice(first, first + 20))), 1e-3 * first)
        is_frozen = bits == 16 and 2_040 <= first < 2_080
        assert pipeline.trust.doubt == "the readings do not change" * is_frozen
        assert live.messages() == [
            "the readings do not change: check the converter, its connections and the light"
        ] * is_frozen  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "electrodes", "count", "words"),
    [
        ("duo-lateral", [6], None, "the two layers of detector B measure different currents"),
        ("duo-lateral", [4, 5, 6, 7], None, "detector B does not change while the others do"),
        ("pincushion", [6], None, "electrode 3 of detector B does not change while the others do"),
        ("pincushion", [6], 0, ""),  # dark
        ("pincushion", [6], 2**18 - 1, ""),  # saturated, which is told elsewhere
        ("duo-lateral", [6], 2**18 - 1, ""),
        ("duo-lateral", [], None, ""),
    ],
)
def test_counts_that_freeze_while_others_change_are_told(kind, electrodes, count, words):
    """Of a mirror that moves for 2 s, at 1 kHz, on a converter that sees the noise."""
    electronics = replace(CONFIG.electronics, adc_bits=18, kind=kind)
    sensor = replace(CONFIG.sensor, electronics=electronics)
    states = np.zeros((2_000, 8))
    states[:, :6] = np.sin(np.arange(2_000) / 300)[:, None] * [0.5, 0.4, 0.3, 2e-3, 2e-3, 3e-3]
    rng = np.random.default_rng(1)
    samples = samples_of(facets.readings(sensor, states), rng, electronics=electronics)
    samples.time[:] *= 10
    held = samples.counts[999, electrodes] if count is None else count
    samples.counts[1_000:, electrodes] = held
    pipeline, doubts = Pipeline(replace(CONFIG, electronics=electronics, sensor=sensor)), []
    for first in range(0, 2_000, 20):
        pipeline.take(pack(samples.where(slice(first, first + 20))), 1e-3 * first)
        doubts.append(pipeline.trust.doubt)
    assert not any(doubts[:50])
    assert words in doubts[65:]
    assert {*doubts, ""} == {words, ""}  # a moment may look sound


def test_poses_that_mostly_misfit_are_doubted_after_a_while():
    trust, all_three = Pipeline(CONFIG).trust, np.full(3, True)
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
