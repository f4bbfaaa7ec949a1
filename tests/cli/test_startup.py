"""`facets --help` and `--version` load nothing heavy; the time itself is not tested."""

from __future__ import annotations

import subprocess
import sys

import pytest

import facets

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


def test_the_version_printed_is_the_package_s(tmp_path):
    code = "from facets.cli import main; main()"
    result = subprocess.run(
        [sys.executable, "-c", code, "--version"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout.strip() == f"facets {facets.__version__}"


def test_importing_facets_does_not_import_numpy(tmp_path):
    code = "import sys, facets; print('numpy' in sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "False"
