"""Compiled code is kept where that is possible, and works where it is not."""

import doctest
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import facets
from facets.model import blocks, code_folder, packed_vectors

READ = "import facets; print(facets.readings(facets.Sensor(), [0] * 8)[2])"


def run(code: str, cache: Path, **environment: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), **environment},
        capture_output=True, text=True, check=True,
    )  # fmt: skip


@pytest.mark.slow
def test_the_first_use_says_that_it_compiles_and_the_second_does_not(tmp_path):
    solve = f"{READ}; s = facets.Sensor(); facets.solve(s, facets.readings(s, [0] * 8))"
    first, second = run(solve, tmp_path), run(solve, tmp_path)
    assert first.stderr.count("compiling") == 1
    assert second.stderr == ""
    assert first.stdout == second.stdout


@pytest.mark.slow
def test_another_checkout_of_the_same_text_compiles_nothing_but_another_processor_does(tmp_path):
    """The folder of machine code is named after the text, not after where it lies."""
    package, cache = Path(facets.__file__).parent, tmp_path / "cache"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(package, tmp_path / "elsewhere" / "facets", ignore=ignored)
    first = run(READ, cache)
    where = f"import sys; sys.path.insert(0, {str(tmp_path / 'elsewhere')!r})\n"
    other = run(f"{where}{READ}\nprint(facets.__file__)", cache)
    assert str(tmp_path) in other.stdout
    assert other.stdout.startswith(first.stdout)
    assert other.stderr == ""
    plain = "x86-64" if platform.machine() in ("x86_64", "AMD64") else "generic"
    assert "compiling" in run(READ, cache, NUMBA_CPU_NAME=plain).stderr


def test_plain_readings_and_poses_are_had_without_numba_whose_settings_are_left_alone(tmp_path):
    """Importing it would take longer than all else that a short command does."""
    code = """
import sys, facets
sensor = facets.Sensor()
readings = facets.readings(sensor, [0, 0, 0.1] + [0] * 5)
print(bool(facets.solve(sensor, readings).ok), 'numba' in sys.modules)
import numba, facets.model.jit
print(numba.config.CACHE_DIR)
"""
    assert run(code, tmp_path).stdout.split() == ["True", "False", str(tmp_path)]


#: Reads a pose by newly loaded code of two lanes; `load` compiles it if it is not stored.
LOAD = """
import resource, sys
from pathlib import Path
import numpy as np
import facets
from facets.model import blocks, packed_vectors
vectors = packed_vectors(facets.Sensor())
def load():
    found, left = np.empty((2, 9)), np.zeros(1, np.int64)
    arrays = vectors, np.zeros((2, 8)), found, left
    blocks.load_code("readings", 5, 2)(*map(blocks.address_of, arrays), 1)
    assert not left[0]
    return found.tobytes()
"""


def test_what_a_disk_has_spoilt_is_made_again(tmp_path):
    """LLVM would end the process on an object that is cut short."""
    spoil = f"""
first = load()
(kept,) = Path({str(tmp_path)!r}).rglob("readings_in_2_lanes-*.o")
code = kept.read_bytes()
for spoilt in (code[:1000], b"", code[:-1] + bytes([code[-1] ^ 1])):
    kept.write_bytes(spoilt)
    assert load() == first
    assert kept.read_bytes() == code
assert [path.suffix for path in kept.parent.iterdir()] == [".o"]
print("done")
"""
    assert run(LOAD + spoil, tmp_path).stdout == "done\n"


def test_a_disk_that_is_full_or_cannot_be_written_keeps_nothing_and_does_no_harm(tmp_path):
    pytest.importorskip("resource")
    (tmp_path / "file").write_text("")
    full = "resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000)); load(); "
    elsewhere = f"import os; os.environ['NUMBA_CACHE_DIR'] = {str(tmp_path / 'file' / 'cache')!r}\n"
    assert run(f"{LOAD}{full}{elsewhere}load(); print('done')", tmp_path).stdout == "done\n"
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["file"]


def test_changed_text_is_compiled_anew(tmp_path, monkeypatch):
    """The folder's name follows every file that compiled code calls into."""
    assert {file.stem for file in code_folder.text_of(())} >= {"wedge", "forward", "dispatch"}
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "text").mkdir()
    (tmp_path / "beside.py").write_text("")
    monkeypatch.setattr(code_folder, "TEXT", (*code_folder.TEXT, tmp_path / "text"))
    for part in (tmp_path / "text" / "part.py", tmp_path / "beside.py"):
        folders = []
        for text in ("x = 1", "x = 2", "x = 1"):
            part.write_text(text)
            folders.append(code_folder.code_folder("", tmp_path / "beside.py")[0])
        assert folders[0] == folders[2] != folders[1]


def test_a_copy_of_a_sensor_from_another_process_is_packed_again():
    """Its vectors hold an address of that process, which faint facets would jump to."""
    sensor, away = facets.Sensor(), [1.5, 0, 0, 0, 0, 0, 0, 0]
    expected = facets.readings(sensor, away)
    stale = packed_vectors(sensor).copy()
    stale[-1] = 0.0
    sensor.__dict__["_packed"] = stale
    np.testing.assert_array_equal(facets.readings(sensor, away), expected)


def test_compiled_code_takes_no_array_with_gaps():
    with pytest.raises(ValueError, match="contiguous"):
        blocks.address_of(np.zeros((4, 4))[:, ::2])


def test_the_example_in_the_package_runs():
    assert doctest.testmod(facets).failed == 0
