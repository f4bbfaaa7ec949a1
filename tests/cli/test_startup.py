"""`facets --help` and `--version` load nothing heavy; the time itself is not tested."""

from __future__ import annotations

import subprocess
import sys

import pytest
from commands import PROGRAM

import facets

pytestmark = pytest.mark.installed

HEAVY = (
    "numpy", "numba", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "ruamel", "rich",
)  # fmt: skip
PROBE = f"""
import sys
from facets.cli import app
sys.argv = ["facets", *sys.argv[1:]]
try:
    app()
except SystemExit as end:
    assert not end.code, end.code
print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
"""


@pytest.mark.parametrize(("option", "says"), [("--help", "Commands:"), ("--version", "facets ")])
def test_nothing_heavy_is_imported(option, says, tmp_path):
    result = subprocess.run(
        [sys.executable, "-c", PROBE, option],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert says in result.stdout
    assert result.stderr.strip() == "[]"


def run(*words, cwd):
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)


def test_the_version_printed_is_the_package_s(tmp_path):
    result = run(*PROGRAM, "--version", cwd=tmp_path)
    assert result.returncode == 0
    assert result.stdout.strip() == f"facets {facets.__version__}"


def test_a_command_does_not_pay_for_the_others(tmp_path):
    code = (
        "import sys, atexit\n"
        "from facets.cli import program\n"
        "sys.argv = ['facets', 'solve', '--help']\n"
        "try:\n    program()\n"
        "finally:\n    print('simulate' in ' '.join(sys.modules), file=sys.stderr)\n"
    )
    result = run(sys.executable, "-c", code, cwd=tmp_path)
    assert result.stdout.startswith("Usage: ")
    assert result.stderr.strip() == "False"


@pytest.mark.parametrize("status", [0, 3])
def test_the_program_ends_with_its_status_once_all_is_tidied(status, tmp_path):
    """What was registered to be done at the end is done, and what was printed is out."""
    code = (
        "import atexit, sys, facets.cli\n"
        "def main():\n"
        "    atexit.register(print, 'tidied')\n"
        f"    facets.cli._ended.append({status})\n"
        f"    sys.exit({status})\n"
        "facets.cli.main = main\n"
        "facets.cli.program()\n"
    )
    result = run(sys.executable, "-c", code, cwd=tmp_path)
    assert result.stdout == "tidied\n"
    assert result.returncode == status


def test_a_failure_that_nobody_expected_is_a_traceback(tmp_path):
    code = "import facets.cli\nfacets.cli.main = lambda: 1 / 0\nfacets.cli.program()"
    result = run(sys.executable, "-c", code, cwd=tmp_path)
    assert result.returncode == 1
    assert "ZeroDivisionError" in result.stderr


def test_importing_facets_does_not_import_numpy(tmp_path):
    code = "import sys, facets; print('numpy' in sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "False"
