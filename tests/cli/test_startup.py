"""Short commands load nothing heavy; the time itself is not tested."""

from __future__ import annotations

import subprocess
import sys

import pytest

import facets

pytestmark = pytest.mark.installed

HEAVY = (
    "numpy", "llvmlite", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "ruamel", "rich",
)  # fmt: skip
PROBE = """
import sys
from facets.cli import app
heavy, sys.argv = sys.argv[1].split(), ["facets", *sys.argv[2:]]
try:
    app()
except SystemExit as end:
    assert not end.code, end.code
print([name for name in heavy if name in sys.modules], file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("words", "says", "heavy"),
    [(["--help"], "Simulate and design:", HEAVY),
     (["--version"], f"facets {facets.__version__}", HEAVY),
     (["config", "list"], "paper: The experimental rig", HEAVY),
     (["config", "check", "paper"], "ok  paper", ("llvmlite", "scipy", "pandas", "pydantic"))],
)  # fmt: skip
def test_nothing_heavy_is_imported(words, says, heavy, tmp_path):
    result = run(sys.executable, "-c", PROBE, " ".join(heavy), *words, cwd=tmp_path)
    assert says in result.stdout
    assert result.stderr.strip() == "[]"


def run(*words, cwd):
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)


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
