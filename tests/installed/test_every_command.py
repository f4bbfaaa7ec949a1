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
from importlib.metadata import distributions
from pathlib import Path

import pytest
from chains import CHAINS, GIVEN, NEEDS, PLAIN, command_names, run_chain, run_lines
from programs import GUARD

import facets
from facets.core.extras import EXTRAS

pytestmark = pytest.mark.wheel

PROGRAM = Path(sysconfig.get_path("scripts")) / "facets"


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


@pytest.mark.parametrize("chain", CHAINS)
def test_the_commands_of_a_chain_end_with_0(chain, tmp_path):
    before, folder = package_files(), tmp_path / "a folder"
    (tmp_path / "temporary files").mkdir()
    folder.mkdir()
    env = {"TMPDIR": str(tmp_path / "temporary files")}
    run_chain(
        chain,
        folder,
        lambda words: run([PROGRAM, *words], folder, **env),
        lambda words: running(words, folder),
    )
    assert package_files() == before


def test_the_command_that_export_c_prints_can_be_copied(tmp_path):
    """It is quoted for the shell, and it compiles."""
    printed = run([PROGRAM, "export-c", "bench", "-d", "the board's C"], tmp_path)
    command = printed.splitlines()[-1].removeprefix("next: ")
    assert shlex.split(command) == ["make", "-C", "the board's C", "test"]


@pytest.mark.parametrize("home", ["/dev/null", None])
def test_a_program_runs_without_a_home(home, tmp_path):
    """A system's service has none, or one that cannot be written."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("XDG_", "FACETS_"))}
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
    env = {**os.environ, "FACETS_CACHE_DIR": str(tmp_path / "the cache")}
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


@pytest.mark.plain
def test_a_plain_installation_has_no_package_of_an_extra():
    installed = {each.name.lower() for each in distributions()}
    assert "pandas" in installed
    assert not installed & {name.lower() for name in (*EXTRAS, "python-flint")}


@pytest.mark.plain
def test_seven_commands_need_no_extra(tmp_path):
    run_lines(
        [shlex.split(line) for line in PLAIN.strip().splitlines()],
        lambda words: run([PROGRAM, *words], tmp_path),
        lambda words: running(words, tmp_path),
    )


@pytest.mark.plain
@pytest.mark.parametrize("name", [*command_names()])
def test_help_and_completion_need_no_extra(name, tmp_path):
    assert "Usage: " in run([PROGRAM, *name.split(), "--help"], tmp_path)
    words = {"COMP_WORDS": f"facets {name} --", "COMP_CWORD": str(1 + len(name.split()))}
    assert "--help" in run([PROGRAM], tmp_path, _FACETS_COMPLETE="complete_bash", **words)


@pytest.mark.plain
@pytest.mark.parametrize("words", [words for _, words in NEEDS if "rec" not in words])
def test_a_command_that_lacks_an_extra_says_what_to_type(words, tmp_path):
    for name, text in GIVEN.items():
        (tmp_path / name).write_text(text)
    before = sorted(tmp_path.rglob("*"))
    done = subprocess.run(
        [PROGRAM, *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    error = re.sub("^facets: compiling .*\n", "", done.stderr)  # where the cache is cold
    assert re.fullmatch(r'error: .+: pip install "facets-6dof\[[a-z0-9]+\]" \(.+\)\n', error)
    assert sorted(tmp_path.rglob("*")) == before
