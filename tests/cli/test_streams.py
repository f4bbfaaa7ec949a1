"""Outputs that end early, fill up or know no µ: results are written, and nothing is a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import PROGRAM, command

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="files and pipes of Unix")


def run(words, cwd, stdout, env=None):
    """A command in a fresh interpreter, with its output sent elsewhere."""
    return subprocess.run(
        [*PROGRAM, *words], cwd=cwd, stdout=stdout, stderr=subprocess.PIPE, text=True,
        env={**os.environ, **(env or {})}, timeout=600, check=False,
    )  # fmt: skip


def closed_pipe() -> int:
    """The writing end of a pipe that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


WAY = ("simulate", "paper", "--motion", "yaw-sweep", "-d", "out")
FILES = ["motion.png", "poses.csv", "readings.csv", "ro-crate-metadata.json", "run.yaml"]


@pytest.mark.slow
def test_a_reader_that_is_gone_loses_nothing(tmp_path):
    pipe = closed_pipe()
    done = run(WAY, tmp_path, pipe)
    os.close(pipe)
    assert done.returncode == 0
    assert done.stderr == ""
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == FILES


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.slow
def test_an_output_that_is_full_is_told_and_loses_nothing(tmp_path):
    with Path("/dev/full").open("w") as full:
        done = run(WAY, tmp_path, full)
    assert done.returncode == 2
    assert "standard output cannot be written: No space left" in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == FILES


@pytest.mark.slow
def test_ascii_gets_letters_for_the_micro_sign(tmp_path):
    done = run(WAY, tmp_path, subprocess.PIPE, {"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()
    assert " urad" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("columns", ["40", "60", "200"])
@pytest.mark.slow
def test_numbers_and_names_are_whole_at_any_width(tmp_path, columns):
    done = command("resolution", "paper", "-d", "r", cwd=tmp_path, env={"COLUMNS": columns})
    assert done.returncode == 0, done.stderr
    assert "…" not in done.stdout
    lines = done.stdout.splitlines()
    for name in ("paper: 8 readings", "beam free", "beam within 5 µm", "beam known"):
        assert any(line.strip().startswith(name) for line in lines)
    table = lines[: next(n for n, line in enumerate(lines) if line.startswith("  The box"))]
    assert max(len(line) for line in table if "standard uncertainty" not in line) <= int(columns)
    assert sum("0.067" in line for line in table) >= 1


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("simulate", "paper", "--motion", "yaw-sweep", "-d", "out"), "out"),
        (("render", "paper", "-o", "rig.gltf"), "rig.gltf"),
        (("render", "paper", "-o", "rig.html"), "rig.html"),
        (("render", "paper", "-o", "rig.png"), "rig.png"),
        (("render", "paper", "--motion", "yaw-sweep", "--frames", "6", "--width", "400",
          "--height", "300", "-o", "film.mp4"), "film.mp4"),
        (("render", "paper", "--motion", "yaw-sweep", "--frames", "6", "--width", "400",
          "--height", "300", "-o", "film.gif"), "film.gif"),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_a_file_that_can_not_be_finished_is_not_there(tmp_path, words, name):
    done = command(*words, cwd=tmp_path, limit=8192)
    assert done.returncode == 2, done.stderr
    assert "cannot be written" in done.stderr
    assert "Traceback" not in done.stderr
    path = tmp_path / name
    left = list(path.iterdir() if path.is_dir() else tmp_path.iterdir())
    assert all(file.stat().st_size < 8192 for file in left)
    assert not any(file.name.startswith(".") for file in left)
    assert path.is_dir() or not path.exists()


def test_help_has_a_short_form_everywhere(tmp_path):
    for words in ([], ["simulate"], ["config"], ["config", "check"], ["range-map"]):
        done = command(*words, "-h", cwd=tmp_path)
        assert done.returncode == 0
        assert done.stdout.startswith("Usage: ")
