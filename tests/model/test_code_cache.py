"""Compiled code is kept where that is possible, and works where it is not."""

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import facets
from facets.model import blocks

READ = "import facets; print(facets.__file__, facets.readings(facets.Sensor(), [0] * 8).tolist())"
SOLVE = """
sensor = facets.Sensor()
solution = facets.solve(sensor, facets.readings(sensor, [0, 0, 0.1] + [0] * 5))
print(bool(solution.ok))
"""


def run(code: str, **environment: object) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", f"import sys\n{code}"],
        env={**os.environ, **{name: str(value) for name, value in environment.items()}},
        capture_output=True, text=True, check=True,
    )  # fmt: skip


@pytest.mark.slow
def test_only_a_first_use_compiles_for_a_processor_wherever_the_text_lies(tmp_path):
    """And says so; the folder of machine code is named after the text."""
    package, cache = Path(facets.__file__).parent, tmp_path / "cache"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(package, tmp_path / "elsewhere" / "facets", ignore=ignored)
    first = run(f"{READ}{SOLVE}", FACETS_CACHE_DIR=cache)
    assert first.stderr.count("compiling") == 1
    other = run(
        f"sys.path.insert(0, {str(tmp_path / 'elsewhere')!r})\n{READ}{SOLVE}",
        FACETS_CACHE_DIR=cache,
    )
    assert other.stderr == ""
    (file, *results), (other_file, *same) = first.stdout.split(), other.stdout.split()
    assert (Path(file).parent, Path(other_file).parent.parent) == (package, tmp_path / "elsewhere")
    assert results == same
    plain = "x86-64" if platform.machine() in ("x86_64", "AMD64") else "generic"
    assert "compiling" in run(READ, FACETS_CACHE_DIR=cache, FACETS_CPU=plain).stderr


#: Reads a pose by newly loaded code of two lanes; `load` compiles it if it is not stored.
LOAD = """
import resource, sys
from pathlib import Path
import numpy as np
import facets
from facets.model import blocks, packed_vectors
vectors = packed_vectors(facets.Sensor())
def load():
    found = np.empty((2, 9))
    arrays = vectors, np.zeros((2, 8)), found
    blocks.load_code("readings", 4, 2)(*map(blocks.address_of, arrays), 1)
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
    assert run(LOAD + spoil, FACETS_CACHE_DIR=tmp_path).stdout == "done\n"


def test_a_disk_that_is_full_or_cannot_be_written_keeps_nothing_and_does_no_harm(tmp_path):
    pytest.importorskip("resource")
    (tmp_path / "file").write_text("")
    full = "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)); load(); "
    elsewhere = (
        f"import os; os.environ['FACETS_CACHE_DIR'] = {str(tmp_path / 'file' / 'cache')!r}\n"
    )
    assert (
        run(f"{LOAD}{full}{elsewhere}load(); print('done')", FACETS_CACHE_DIR=tmp_path).stdout
        == "done\n"
    )
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["file"]


def test_changed_text_is_compiled_anew(tmp_path, monkeypatch):
    """That of every file that compiled code calls into or is made by."""
    monkeypatch.setenv("FACETS_CACHE_DIR", str(tmp_path))
    changed, made, read = [], [], Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b"#" * (path.name in changed))

    def recipe():
        made.extend(changed)
        return lambda builder, arguments, width: None

    for name in ("", "wedge.py", "dispatch.py", "block_code.py", "beside.py", ""):
        changed[:] = [name]
        (tmp_path / "beside.py").touch()
        blocks.lane_code("nothing", 2, 2, recipe, tmp_path / "beside.py")
    assert made == ["", "wedge.py", "dispatch.py", "block_code.py", "beside.py"]


def test_compiled_code_takes_no_array_with_gaps():
    with pytest.raises(ValueError, match="contiguous"):
        blocks.address_of(np.zeros((4, 4))[:, ::2])
