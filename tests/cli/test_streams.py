"""Outputs that end early, fill up or know no µ: results are written, and nothing is a traceback."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import PROGRAM, command, start
from programs import GUARD

from facets import OutputError
from facets.files.tables import refuse_to_overwrite

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="files and pipes of Unix")

WORDS = ("simulate", "paper", "--motion", "yaw-sweep", "-d", "out")
FILES = ["motion.png", "poses.csv", "readings.csv", "ro-crate-metadata.json", "run.yaml"]


def run_into(file, cwd):
    """Simulate with the output sent to a file or pipe: status, and what is said of errors."""
    with (cwd / "errors").open("w+") as errors:
        status = start(*WORDS, cwd=cwd, out=file, err=errors.fileno()).wait(GUARD)
        errors.seek(0)
        return status, errors.read()


@pytest.mark.slow
def test_a_reader_that_is_gone_loses_nothing(tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    assert run_into(writing, tmp_path) == (0, "")
    os.close(writing)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == FILES


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_an_output_that_is_full_is_told_and_loses_nothing(tmp_path):
    with Path("/dev/full").open("w") as full:
        status, errors = run_into(full.fileno(), tmp_path)
    assert status == 2
    assert "standard output cannot be written: No space left" in errors
    assert "Traceback" not in errors
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == FILES


@pytest.mark.parametrize(
    "closed",
    [
        *(pytest.param(one, marks=pytest.mark.slow) for one in (">&-", "2>&-", "<&-")),
        "<&- >&- 2>&-",
    ],
)
def test_a_closed_stream_loses_nothing(tmp_path, closed):
    """In fresh interpreters, which find the streams closed."""
    script = f'"$@" {closed}'
    for words, status in (
        (("resolution", "paper", "-d", "r"), 0),
        (("resolution", "none such.yaml"), 2),
        (("solve", "paper", "no.csv", "-o", "-"), 2),
    ):
        done = subprocess.run(
            ["sh", "-c", script, "sh", *PROGRAM, *words], cwd=tmp_path, capture_output=True,
            text=True, check=False,
        )  # fmt: skip
        assert (done.returncode, "Traceback" in done.stderr) == (status, False), done.stderr
        assert "error" not in done.stdout
    made = sorted(file.name for file in (tmp_path / "r").iterdir())
    assert made == ["budget.png", "resolution.csv", "ro-crate-metadata.json", "run.yaml"]


def test_a_table_does_not_go_to_a_closed_output(monkeypatch):
    def write(number, data):
        raise OSError(errno.EBADF, "Bad file descriptor")

    monkeypatch.setattr(os, "write", write)
    with pytest.raises(OutputError, match="-: cannot be written: Bad file"):
        refuse_to_overwrite([Path("-")], force=False)


def test_pictures_depend_on_no_settings_of_the_user(tmp_path):
    """In fresh interpreters, which have not loaded matplotlib."""
    (tmp_path / "matplotlibrc").write_text(
        "text.usetex: True\nfont.family: none such\nimage.cmap: none such\nsavefig.bbox: tight\n"
        "axes.formatter.use_locale: True\nfont.sans-serif: none such\nno such key: 1\n"
    )
    for name, backend in (("a.svg", "module://ipympl.backend_nbagg"), ("b.svg", "")):
        done = subprocess.run(
            [*PROGRAM, "render", "paper", "--spots", "-o", name], cwd=tmp_path,
            capture_output=True, text=True, check=False, env={**os.environ, "MPLBACKEND": backend},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        (tmp_path / "matplotlibrc").unlink(missing_ok=True)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_a_picture_that_can_not_be_drawn_loses_no_table(tmp_path, run_in_process, monkeypatch):
    assert run_in_process(*WORDS)[0] == 0

    def fail(*_):
        raise RuntimeError("no font")

    monkeypatch.setattr("facets.pictures.style.save", fail)
    status, out, err = run_in_process(*WORDS, "--force")
    assert (status, err) == (1, "out/motion.png: not drawn: RuntimeError: no font\n")
    assert out.endswith("out/: readings.csv, poses.csv, run.yaml\n")
    assert not (tmp_path / "out" / "motion.png").exists()


@pytest.mark.slow
def test_ascii_gets_letters_for_the_micro_sign(tmp_path):
    """In a fresh interpreter, which reads this variable at its start."""
    done = subprocess.run(
        [*PROGRAM, *WORDS], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"}, check=True,
    )  # fmt: skip
    assert done.stdout.isascii()
    assert " urad" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("columns", ["40", "200"])
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


PICTURE = ("render", "paper", "--width", "200", "--height", "200")
FILM = (*PICTURE, "--motion", "yaw-sweep", "--frames", "2")


@pytest.mark.parametrize(
    "words",
    [
        ("render", "paper", "-o", "rig.gltf"),
        (*PICTURE, "-o", "rig.png"),
        (*FILM, "-o", "film.mp4"),
        (*FILM, "-o", "film.gif"),
    ],
    ids=lambda words: next(word for word in words if "." in word),
)
@pytest.mark.slow
def test_a_file_that_can_not_be_finished_is_not_there(tmp_path, words):
    done = command(*words, cwd=tmp_path, limit=1024)
    assert done.returncode == 2, done.stderr
    assert "cannot be written" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_help_has_a_short_form_everywhere(run_in_process):
    for words in ([], ["simulate"], ["config"], ["config", "check"], ["range-map"]):
        status, out, _ = run_in_process(*words, "-h")
        assert status == 0
        assert out.startswith("Usage: ")
