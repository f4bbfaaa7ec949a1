"""Compiled code is kept where that is possible, and works where it is not."""

import doctest
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import facets

READ = "import facets; print(facets.readings(facets.Sensor(), [0] * 8)[2])"


def run(code: str, cache: str) -> subprocess.CompletedProcess:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )


def test_the_first_use_says_that_it_compiles_and_the_second_does_not(tmp_path):
    first, second = run(READ, str(tmp_path)), run(READ, str(tmp_path))
    assert "compiling readings, once" in first.stderr
    assert second.stderr == ""
    assert first.stdout == second.stdout


def test_another_checkout_of_the_same_text_compiles_nothing(tmp_path):
    """The folder of machine code is named after the text, not after where it lies."""
    package = Path(facets.__file__).parent
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(package, tmp_path / "elsewhere" / "facets", ignore=ignored)
    first = run(READ, str(tmp_path / "cache"))
    where = f"import sys; sys.path.insert(0, {str(tmp_path / 'elsewhere')!r})\n"
    other = run(f"{where}{READ}\nprint(facets.__file__)", str(tmp_path / "cache"))
    assert str(tmp_path) in other.stdout
    assert other.stdout.startswith(first.stdout)
    assert other.stderr == ""


def test_a_cache_folder_that_can_not_be_written_does_no_harm(tmp_path):
    (tmp_path / "file").write_text("")
    done = run(READ, str(tmp_path / "file" / "cache"))
    assert float(done.stdout) > 0.09


def test_numbas_own_settings_are_left_alone(tmp_path):
    code = "import numba; import facets.model.jit; print(numba.config.CACHE_DIR)"
    assert run(code, str(tmp_path)).stdout.strip() == str(tmp_path)


def test_changed_text_is_compiled_anew(tmp_path, monkeypatch):
    """The folder's name follows every file that compiled code calls into."""
    from facets.model import jit

    assert {Path(module.__file__).stem for module in jit.TEXT} >= {"wedge", "forward"}
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    part = SimpleNamespace(__file__=str(tmp_path / "part.py"))
    monkeypatch.setattr(jit, "TEXT", (*jit.TEXT, part))
    folders = []
    for text in ("x = 1", "x = 2", "x = 1"):
        Path(part.__file__).write_text(text)
        folders.append(jit.cache_folder()[0])
    assert folders[0] == folders[2] != folders[1]


def test_the_example_in_the_package_runs():
    assert doctest.testmod(facets).failed == 0
