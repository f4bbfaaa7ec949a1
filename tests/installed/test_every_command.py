"""Every command of the program, as it is installed: outside of a checkout, in paths with spaces.

`make installed` and `make lowest` run these, each with an environment of its own.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import dedent

import pytest
import typer
from facets.cli import app
from programs import GUARD

import facets

pytestmark = pytest.mark.wheel

PROGRAM = Path(sysconfig.get_path("scripts")) / "facets"

#: What the live commands are given: a mirror at rest, a converter that is finer than the noise, and
#: a stage that waits for a busy machine.
FILES = {
    "my bench.yaml": """
        extends: bench
        sensor: {electronics: {adc_bits: 24}}
        stage: {stale_ms: 500, resume: auto}
        motions:
          rest: {kind: sine, amplitude: {tx_mm: 0}, samples: 1000, rate_hz: 100}
          runs: {kind: runs, to: {tz_mm: 1}, steps: 3, runs: 2, dwell_ms: 60, move_ms: 20}
          shaken:
            kind: vibration
            modes: {bounce: {frequency_hz: 60, damping_percent: 3, per_newton: {tz_um: 20}}}
        """,
}

#: Commands by chain; each takes what those before it have written. `&`: runs until the chain ends.
CHAINS = {
    "motion": """
        simulate paper --motion multi-axis -d 'a motion' --plot svg --table parquet
        solve paper 'a motion/readings.parquet' -o 'a motion/poses again.csv' --beam known
        simulate rig --motion calibration --with-reference -d 'a rig'
        calibrate paper 'a rig/readings.csv' -o 'a rig/calibrated.yaml'
        solve 'a rig/calibrated.yaml' 'a rig/readings.csv' -o 'a rig/poses by it.csv' --beam known
        simulate 'my bench.yaml' --motion shaken -d 'a vibration'
        response 'a vibration/poses.csv' --config 'my bench.yaml' --input force_n
          -d 'a response' --uff 'a body.uff'
        simulate 'my bench.yaml' --motion rest -d 'a stop'
        rezero 'a rig/calibrated.yaml' 'a stop/readings.csv' 'a stop/readings.csv' -o 'a zero.yaml'
        """,
    "axis": """
        simulate 'my bench.yaml' --motion runs -d 'a stage'
        axis 'a stage/poses.csv' --config 'my bench.yaml' --axis Z --dwell 0.04
          --commands 'a stage/commands-runs.csv' -d 'an axis'
        """,
    "live": """
        emulate 'my bench.yaml' --motion rest --rate 1000 --folder 'virtual bench' &
        acquire 'my bench.yaml' --port 'virtual bench/board' --samples 2000 -d 'a run' --plain
        acquire 'my bench.yaml' --port 'virtual bench/board' --stage-port 'virtual bench/stage'
          --check-stage --write 'my checked bench.yaml' -d 'checked' --plain
        acquire 'my checked bench.yaml' --port 'virtual bench/board'
          --stage-port 'virtual bench/stage' --track --samples 200 -d 'tracked' --plain
        replay 'a run' --compare -o 'a run again.mcap'
        replay 'a run' --recover
        noise 'a run' -d 'the noise' --write 'with noise.yaml'
        """,
    "range": """
        range-map paper --axes tx,ty -d 'a range'
        resolution paper -d 'a resolution'
        tolerances layout --heads 10 -d 'a yield'
        """,
    "jacobian": "jacobian paper -d 'a jacobian'",
    "optimize": """
        optimize layout -o 'a layout.yaml' --sheets 'a layout.xlsx'
          --report 'a layout.html' --certify 0
        render 'a layout.yaml' -o 'the picture of a layout.png'
        """,
    "explore": "explore layout --designs 4 -d 'a space' --report 'a space.html'",
    "render": """
        render paper -o 'a rig.html'
        render paper --spots -o 'the spots.svg'
        render paper --motion multi-axis --frames 3 -o 'a film.mp4'
        """,
    "firmware": "export-c bench -d 'the firmware'",
    "bench": "bench --quick -d 'the times'",
    "reproduce": "reproduce table1 fig4 --quick -d 'the paper'",
    "config": """
        config list
        config check paper bench
        config show paper
        config schema
        """,
}


def lines(chain: str) -> list[str]:
    """The commands of a chain; a line that is indented further goes on with the one before."""
    return re.sub(r"\n +", " ", dedent(CHAINS[chain]).strip()).splitlines()


def command_names(group: typer.core.TyperGroup | None = None, above: str = "") -> Iterator[str]:
    """The commands that the program has, `config list` and its like among them."""
    group = group or typer.main.get_command(app)
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from command_names(command, f"{above}{name} ")
        else:
            yield f"{above}{name}"


@contextmanager
def running(words: list[str], cwd: Path) -> Iterator[None]:
    """The program, from when it says that it runs until the end of the `with`."""
    with subprocess.Popen([PROGRAM, *words], cwd=cwd, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert any("running" in line for line in process.stdout), words
            yield
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=GUARD)
            assert process.returncode == 0, words
        finally:
            process.kill()


def run(words: list[str | Path], cwd: Path, **env: str) -> str:
    """What a program prints, which must end with 0 and warn of nothing."""
    done = subprocess.run(
        words, cwd=cwd, env={**os.environ, **env}, capture_output=True, text=True,
        timeout=GUARD, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    assert "Warning" not in done.stderr, f"{words}\n{done.stderr}"
    return done.stdout


def package_files() -> set[Path]:
    return set(Path(facets.__file__).parent.rglob("*"))


def test_the_package_is_the_one_that_is_installed():
    """And neither a folder that happens to lie here, nor a checkout."""
    assert Path(facets.__file__).is_relative_to(sysconfig.get_path("purelib"))


def test_every_command_is_run():
    """A new command needs a line in CHAINS."""
    run_here = {line.partition(" -")[0] for chain in CHAINS for line in lines(chain)}
    missing = [n for n in command_names() if not any(f"{r} ".startswith(f"{n} ") for r in run_here)]
    assert missing == []


@pytest.mark.parametrize("chain", CHAINS)
def test_the_commands_of_a_chain_end_with_0(chain, tmp_path):
    before, folder = package_files(), tmp_path / "a folder"
    (tmp_path / "temporary files").mkdir()
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    run_chain(lines(chain), folder, TMPDIR=str(tmp_path / "temporary files"))
    assert package_files() == before


def run_chain(commands: list[str], folder: Path, **env: str) -> None:
    for n, line in enumerate(commands):
        words = shlex.split(line)
        if words[-1] == "&":
            with running(words[:-1], folder):
                run_chain(commands[n + 1 :], folder, **env)
            return
        run([PROGRAM, *words], folder, **env)


def test_the_command_that_export_c_prints_can_be_copied(tmp_path):
    """It is quoted for the shell, and it compiles."""
    printed = run([PROGRAM, "export-c", "bench", "-d", "the board's C"], tmp_path)
    command = printed.splitlines()[-1].removeprefix("next: ")
    assert shlex.split(command) == ["make", "-C", "the board's C", "test"]


@pytest.mark.parametrize("home", ["/dev/null", None])
def test_a_program_runs_without_a_home(home, tmp_path):
    """A system's service has none, or one that cannot be written."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("XDG_", "NUMBA_"))}
    env.pop("HOME", None)
    if home:
        env["HOME"] = home
    words = [PROGRAM, "simulate", "paper", "--motion", "multi-axis", "-d", "moved"]
    done = subprocess.run(
        words, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=GUARD, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "moved" / "poses.csv").exists()


def test_two_processes_may_compile_first_at_the_same_time(tmp_path):
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "the cache")}
    words = [PROGRAM, "simulate", "paper", "--motion", "multi-axis", "-d"]
    both = [
        subprocess.Popen([*words, name], cwd=tmp_path, env=env, stderr=subprocess.PIPE, text=True)
        for name in ("one", "two")
    ]
    for process in both:
        _, errors = process.communicate(timeout=GUARD)
        assert process.returncode == 0, errors
    tables = [(tmp_path / name / "poses.csv").read_text() for name in ("one", "two")]
    one, two = ([x for x in text.splitlines() if not x.startswith("#")] for text in tables)
    assert one == two


def test_a_module_is_the_program(tmp_path):
    asked = [sys.executable, "-m", "facets", "--version"]
    assert run(asked, tmp_path) == run([PROGRAM, "--version"], tmp_path)
