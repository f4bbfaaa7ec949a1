"""Every command of the program once, in chains: each takes what those before it have written.

`tests/cli` runs them in the checkout, `tests/installed` as installed; a new command needs a line.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from textwrap import dedent

import typer
from facets.cli import whole_app

#: What the live commands are given: a mirror at rest, and a converter that is finer than the noise.
FILES = {
    "my bench.yaml": """
        extends: bench
        sensor: {electronics: {adc_bits: 24}}
        motions:
          rest: {kind: sine, amplitude: {tx_mm: 0}, samples: 1000, rate_hz: 100}
          runs: {kind: runs, to: {tz_mm: 1}, steps: 3, runs: 2, dwell_ms: 60, move_ms: 20}
          shaken:
            kind: vibration
            modes: {bounce: {frequency_hz: 60, damping_percent: 3, per_newton: {tz_um: 20}}}
        """,
}

#: The commands that need no extra.
PLAIN = """
    simulate paper --motion multi-axis -d 'a motion'
    solve paper 'a motion/readings.csv' -o 'poses again.csv' --beam known
    range-map paper --axes tx,ty -d 'a range'
    resolution paper -d 'a resolution'
    jacobian paper -d 'a jacobian'
    emulate bench --motion wobble --rate 250 --folder 'virtual bench' &
    acquire bench --port 'virtual bench/board' --samples 500 -d 'a run' --plain
    replay 'a run' --compare -o 'a run again.csv'
    """

#: Commands by chain. `&`: runs until the chain ends.
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
        emulate 'my bench.yaml' --motion rest --rate 250 --folder 'virtual bench' &
        acquire 'my bench.yaml' --port 'virtual bench/board' --samples 500 -d 'a run' --plain
        acquire 'my bench.yaml' --port virtual:rest,rate=250
          --check-stage --write 'my checked bench.yaml' -d 'checked' --plain
        acquire 'my checked bench.yaml' --port virtual:rest,rate=250
          --track --samples 200 -d 'tracked' --plain
        replay 'a run' --compare -o 'a run again.mcap'
        replay 'a run' --recover
        noise 'a run' -d 'the noise' --write 'with noise.yaml'
        """,
    "range": """
        range-map paper --axes tx,ty -d 'a range'
        resolution paper --coverage 0.95 -d 'a resolution'
        tolerances layout --heads 10 -d 'a yield'
        """,
    "jacobian": "jacobian paper -d 'a jacobian'",
    "optimize": """
        optimize layout -o 'a layout.yaml'
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

#: What the commands of `NEEDS` are given.
GIVEN = {
    "board.bin": "",
    "readings.csv": "psi_a_mm\n1\n",
    "readings.parquet": "PAR1",
    "readings.tdms": "TDSm",
}

#: A package that an extra brings, and a command that needs it.
NEEDS = [
    ("pyarrow", ["explore", "layout", "-d", "y"]),
    ("mpmath", ["bench", "-d", "y"]),
    ("flint", ["jacobian", "paper", "-d", "y", "--certify"]),
    ("flint", ["optimize", "layout", "-o", "x.yaml"]),
    ("flint", ["reproduce", "-d", "y"]),
    ("pyarrow", ["solve", "paper", "readings.parquet", "-o", "x.csv"]),
    ("pyarrow", ["simulate", "paper", "-d", "y", "--table", "parquet"]),
    ("h5py", ["simulate", "paper", "-d", "y", "--table", "h5"]),
    ("h5py", ["solve", "paper", "readings.csv", "-o", "x.h5"]),
    ("h5py", ["replay", "rec", "-o", "x.h5"]),
    ("nptdms", ["solve", "paper", "readings.tdms"]),
    ("mcap", ["replay", "rec", "-o", "x.mcap"]),
    ("aiohttp", ["replay", "rec", "--web", "0"]),
    ("pylsl", ["acquire", "bench", "--port", "file:board.bin", "--publish", "lsl:x"]),
    ("aiohttp", ["acquire", "bench", "--port", "file:board.bin", "--web", "0"]),
    ("nidaqmx", ["acquire", "bench", "--port", "ni:Dev1/ai0:11"]),
    ("pylablib", ["acquire", "bench", "--port", "thorlabs:1,2,3"]),
    ("plotly", ["explore", "layout", "--report", "x.html"]),
    ("pyvista", ["render", "paper", "-o", "x.png"]),
    ("pyvista", ["render", "paper", "-o", "x.gltf"]),
    ("av", ["render", "paper", "--motion", "multi-axis", "-o", "x.mp4"]),
    ("casadi", ["optimize", "layout", "-o", "x.yaml"]),
    ("casadi", ["explore", "layout", "--front", "-d", "y"]),
    ("distributed", ["explore", "layout", "--scheduler", "tcp://127.0.0.1:1"]),
]


def lines(chain: str) -> list[str]:
    """The commands of a chain; a line that is indented further goes on with the one before."""
    return re.sub(r"\n +", " ", dedent(CHAINS[chain]).strip()).splitlines()


def command_names(group: typer.core.TyperGroup | None = None, above: str = "") -> Iterator[str]:
    """The commands that the program has, `config list` and its like among them."""
    group = group or typer.main.get_command(whole_app())
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from command_names(command, f"{above}{name} ")
        else:
            yield f"{above}{name}"


#: What stands for a blank in the names of files: on Linux a byte that is not UTF-8 before it.
BLANK = "\udce9 " if sys.platform == "linux" else " "


def run_chain(
    chain: str,
    folder: Path,
    run: Callable[[list[str]], None],
    keep_running: Callable[[list[str]], AbstractContextManager[None]],
) -> None:
    """Run a chain in a folder; `keep_running` is for a command that ends with the chain."""
    for name, text in FILES.items():
        (folder / name.replace(" ", BLANK)).write_text(text)
    words = [[w.replace(" ", BLANK) for w in shlex.split(line)] for line in lines(chain)]
    run_lines(words, run, keep_running)


def run_lines(commands, run, keep_running) -> None:  # type: ignore[no-untyped-def]
    for n, words in enumerate(commands):
        if words[-1] == "&":
            with keep_running(words[:-1]):
                return run_lines(commands[n + 1 :], run, keep_running)
        run(words)
    return None
