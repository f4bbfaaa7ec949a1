"""Whoever follows the guides in one folder, after the README, sees every command succeed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pages import GUIDES, ROOT, steps
from reader import Reader

import facets

#: In the order in which one reader might follow them: README first, then all three.
FOLLOWED = (ROOT / "README.md", *GUIDES)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("reader")


@pytest.fixture
def reader(folder: Path) -> Iterator[Reader]:
    reader = Reader(folder)
    yield reader
    reader.end()


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
