"""Compiled code is kept where that is possible, and works where it is not."""

import doctest
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import facets

PC = platform.machine() in ("x86_64", "AMD64")
READ = "import facets; print(facets.readings(facets.Sensor(), [0] * 8)[2])"
#: The code that this asks for.
KERNEL = "readings_in_2_lanes"


def run(code: str, cache: str) -> subprocess.CompletedProcess:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )


@pytest.mark.slow
def test_the_first_use_says_that_it_compiles_and_the_second_does_not(tmp_path):
    solve = f"{READ}; s = facets.Sensor(); facets.solve(s, facets.readings(s, [0] * 8))"
    first, second = run(solve, str(tmp_path)), run(solve, str(tmp_path))
    assert len(list(tmp_path.rglob("*.o"))) > 2
    assert first.stderr.count("compiling") == 1
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


@pytest.mark.slow
def test_what_a_disk_has_spoilt_is_made_again(tmp_path):
    """LLVM would end the process on an object that is cut short."""
    first = run(READ, str(tmp_path))
    (kept,) = tmp_path.rglob(f"{KERNEL}-*.o")
    code = kept.read_bytes()
    for spoilt in (code[:1000], b"", code[:-1] + bytes([code[-1] ^ 1])):
        kept.write_bytes(spoilt)
        again = run(READ, str(tmp_path))
        assert "compiling" in again.stderr
        assert again.stdout == first.stdout
        assert kept.read_bytes() == code
    assert [path.suffix for path in kept.parent.iterdir()] == [".o"]


def test_a_disk_that_is_full_keeps_nothing_and_does_no_harm(tmp_path):
    pytest.importorskip("resource")
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000)); "
    done = run(full + READ, str(tmp_path))
    assert float(done.stdout) > 0.09
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.slow
def test_code_for_one_processor_is_not_taken_for_another(tmp_path, monkeypatch):
    run(READ, str(tmp_path))
    monkeypatch.setenv("NUMBA_CPU_NAME", "x86-64" if PC else "generic")
    assert "compiling" in run(READ, str(tmp_path)).stderr


@pytest.mark.slow
def test_plain_readings_and_poses_are_had_without_numba(tmp_path):
    """Importing it would take longer than all else that a short command does."""
    code = "import sys, facets; s = facets.Sensor(); r = facets.readings(s, [0, 0, 0.1] + [0] * 5)"
    told = f"{code}; print(bool(facets.solve(s, r).ok), 'numba' in sys.modules)"
    assert run(told, str(tmp_path)).stdout.split() == ["True", "False"]


def test_numbas_own_settings_are_left_alone(tmp_path):
    code = "import numba; import facets.model.jit; print(numba.config.CACHE_DIR)"
    assert run(code, str(tmp_path)).stdout.strip() == str(tmp_path)


def test_changed_text_is_compiled_anew(tmp_path, monkeypatch):
    """The folder's name follows every file that compiled code calls into."""
    from facets.model import code_folder

    assert {file.stem for file in code_folder.text_of(())} >= {"wedge", "forward", "dispatch"}
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "text").mkdir()
    (tmp_path / "own.py").write_text("")
    monkeypatch.setattr(code_folder, "TEXT", (*code_folder.TEXT, tmp_path / "text"))
    for part in (tmp_path / "text" / "part.py", tmp_path / "own.py"):
        folders = []
        for text in ("x = 1", "x = 2", "x = 1"):
            part.write_text(text)
            folders.append(code_folder.code_folder("", tmp_path / "own.py")[0])
        assert folders[0] == folders[2] != folders[1]


def test_the_example_in_the_package_runs():
    assert doctest.testmod(facets).failed == 0
