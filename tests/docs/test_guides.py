"""Whoever follows the guides in one folder, after the README, sees every command succeed."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pages import GUIDES, ROOT, Step, shape, steps

import facets

#: In the order in which one reader might follow them: README first, then all three.
FOLLOWED = (ROOT / "README.md", *GUIDES)


class Reader:
    """Types what a page says: a block for the first terminal runs until the text stops it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bench: subprocess.Popen[str] | None = None
        self.printed: list[str] = []
        here = str(Path(sys.executable).parent)
        self.environment = {**os.environ, "PATH": f"{here}{os.pathsep}{os.environ['PATH']}"}

    def follow(self, step: Step) -> None:
        if "Ctrl-C" in step.text:
            self.stop()
        if step.language == "yaml":
            (self.folder / step.file).write_text(step.block)
        elif step.language == "bash" and "first terminal" in step.text:
            self.start(step.block)
        elif step.language == "bash":
            for line in step.block.splitlines():
                self.type(line)
        elif step.language in ("", "text") and self.printed:
            self.compare(step)

    def start(self, line: str) -> None:
        assert self.bench is None, f"the first terminal is still busy: {line}"
        self.bench = subprocess.Popen(
            ["bash", "-c", line], cwd=self.folder, env=self.environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        assert self.bench.stdout is not None
        assert "board" in self.bench.stdout.readline()

    def stop(self) -> None:
        """Ctrl-C in the first terminal."""
        bench, self.bench = self.bench, None
        if bench is None:
            return
        os.killpg(bench.pid, signal.SIGINT)
        printed, _ = bench.communicate(timeout=60)
        assert bench.returncode == 0, printed

    def type(self, line: str) -> None:
        """In the second terminal; a comment in the line states its exit status if that is not 0."""
        done = subprocess.run(
            ["bash", "-c", line], cwd=self.folder, env=self.environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=600,
        )  # fmt: skip
        told = re.search(r"# ends with status (\d+)", line)
        assert done.returncode == (int(told[1]) if told else 0), f"{line}\n{done.stdout}"
        self.printed += done.stdout.splitlines()

    def compare(self, step: Step) -> None:
        """What the page shows has been printed in this run, but for its numbers."""
        printed = {shape(line) for line in self.printed}
        for line in step.block.splitlines():
            assert shape(line) in printed or line.strip() == "...", line


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reader")


@pytest.fixture
def reader(folder: Path) -> Iterator[Reader]:
    reader = Reader(folder)
    yield reader
    reader.stop()


@pytest.mark.slow
@pytest.mark.parametrize("page", FOLLOWED, ids=lambda page: page.stem)
def test_a_page_can_be_followed_from_top_to_bottom(page: Path, reader: Reader) -> None:
    for step in steps(page):
        reader.follow(step)
    assert reader.bench is None, "nothing says when to stop the first terminal"


@pytest.mark.slow
def test_the_guides_end_where_they_say(folder: Path) -> None:
    """A rig that was built otherwise is calibrated; a head keeps its limits as often as asked."""
    if not (folder / "calibrated.yaml").exists():
        pytest.skip("the guides were not followed in this run")
    built, drawn, calibrated = (
        facets.load(folder / f"{name}.yaml").sensor for name in ("built", "quiet", "calibrated")
    )
    states = np.zeros((2, 8))
    states[1, :6] = [0.05, -0.05, 1.0, 0.003, -0.003, 0.01]
    readings = facets.readings(built, states)
    assert (facets.solve(drawn, readings, beam="known").residual > 100).all()
    assert (facets.solve(calibrated, readings, beam="known").residual < 3).all()
    head = pd.read_csv(folder / "results" / "head-tolerances" / "heads.csv", comment="#")
    assert len(head) == 100
    assert "breaks a limit" not in (folder / "head.yaml").read_text()
