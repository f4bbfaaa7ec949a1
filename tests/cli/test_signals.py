"""A command that is told to end, by ^C, by the system, by its terminal: nothing stays half-done."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import uuid
from pathlib import Path

import numpy as np
import pytest
from facets.cli import signals
from programs import Program, await_true, size_of

import facets
from facets.core import READING_COLUMNS

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


def running_with(mark):
    """Processes that have an environment variable of that value."""
    processes = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark.encode() in path.read_bytes():
                processes.append(path.parent.name)
        except OSError:
            continue
    return processes


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.slow
def test_explore_leaves_no_workers(tmp_path, number):
    """Also where it is killed: a worker ends when its parent has."""
    mark = f"mark-{uuid.uuid4()}"
    words = ("explore", "layout", "-d", "found", "--designs", "1000000")
    with Program(*words, cwd=tmp_path, env={"MARK": mark}) as program:
        program.await_true(lambda: len(running_with(mark)) > 1, "workers")
        status = program.end(number)
    assert status == STATUS.get(number, -number)
    await_true(lambda: not running_with(mark), "no workers")
    assert not [file for file in tmp_path.rglob(".*") if file.is_file()]


@pytest.mark.parametrize("number", STATUS)
def test_solve_leaves_no_hidden_file(tmp_path, number):
    sensor = facets.load("paper").sensor
    row = ",".join(f"{x!r}" for x in facets.readings(sensor, np.zeros(8)).tolist())
    table = tmp_path / "readings.csv"
    table.write_text(",".join(READING_COLUMNS) + "\n" + (row + "\n") * 200_000)
    with Program("solve", "paper", "readings.csv", "-o", "poses.csv", cwd=tmp_path) as program:
        program.await_true(
            lambda: sum(size_of(f) for f in tmp_path.glob(".poses*")) > 100_000, "some of the table"
        )
        assert program.end(number) == STATUS[number]
    assert [file.name for file in tmp_path.iterdir()] == ["readings.csv"]
    assert "interrupted" in program.stderr
    assert "Traceback" not in program.stderr


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="reads processor time in /proc")
def test_an_interrupted_optimize_gives_no_verdict(tmp_path):
    """Wherever it is: casadi swallows what a handler raises while IPOPT computes."""
    (tmp_path / "long.yaml").write_text("extends: layout\noptimize: {starts: 1000}\n")
    with Program("optimize", "long.yaml", "-o", "best.yaml", cwd=tmp_path) as program:
        ticks = os.sysconf("SC_CLK_TCK")

        def spent():
            try:
                words = Path(f"/proc/{program.process.pid}/stat").read_text().split()
            except OSError:
                return 0.0
            return (int(words[13]) + int(words[14])) / ticks

        program.await_true(lambda: spent() > 2, "some starts")
        assert program.end(signal.SIGINT) == 130
    assert "no layout" not in program.stdout + program.stderr
    assert "interrupted" in program.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["long.yaml"]


def test_nohup_is_respected():
    """A signal that is ignored when a program starts does not end it."""
    text = "import signal; from facets.cli import signals\n" \
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n" \
        "with signals.interrupting():\n" \
        "    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN\n" \
        "    assert signal.getsignal(signal.SIGTERM) is signals.interrupt\n" \
        "assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL\n"  # fmt: skip
    subprocess.run([sys.executable, "-c", text], check=True)


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="Windows has no SIGUSR1")
def test_the_signal_that_resumes_a_stage_ends_no_program():
    """It may come before the stage is opened, or where no stage is moved."""
    before = signal.getsignal(signal.SIGUSR1)
    with signals.interrupting():
        assert signal.getsignal(signal.SIGUSR1) == signal.SIG_IGN
    assert signal.getsignal(signal.SIGUSR1) == before
