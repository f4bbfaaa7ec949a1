"""What the README and the documentation tell people to write and run works."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import facets

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", page.read_text(), flags=re.DOTALL | re.MULTILINE
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_configurations_in_the_text_load(page, tmp_path):
    for n, text in enumerate(blocks(page, "yaml")):
        path = tmp_path / f"{n}.yaml"
        path.write_text(text)
        facets.load(path)


@pytest.mark.parametrize("text", blocks(ROOT / "docs" / "api.md", "python"))
def test_python_in_the_reference_runs(text):
    exec(compile(text, "docs/api.md", "exec"), {})


def test_the_pipeline_of_the_readme_runs(tmp_path):
    """Line for line, each command on what the one before has written."""
    (script,) = blocks(ROOT / "README.md", "bash")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    result = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script], cwd=tmp_path, env={**os.environ, "PATH": path},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    for name in ("moved/readings.csv", "poses.csv", "better.yaml", "reach", "rig.png"):
        assert (tmp_path / "results" / name).exists(), name


def test_every_link_between_pages_leads_somewhere():
    for page in [*PAGES, ROOT / "experiments" / "README.md"]:
        for link in re.findall(r"\]\(([^)#:\s]+)[)#]", page.read_text()):
            assert (page.parent / link).exists(), (page.name, link)
