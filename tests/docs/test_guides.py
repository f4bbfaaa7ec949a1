"""Whoever follows the guides in one folder, after the README, sees every command succeed."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from pages import GUIDES, ROOT, steps
from reader import Reader

import facets


@pytest.mark.slow
def test_the_readme_and_the_guides_can_be_followed_in_one_folder(tmp_path: Path) -> None:
    """The guides by three readers at once, because one of them waits for recordings."""
    follow(ROOT / "README.md", folder=tmp_path)
    with ThreadPoolExecutor(len(GUIDES)) as readers:
        for _ in readers.map(partial(follow, folder=tmp_path), GUIDES):
            pass
    check_calibration(tmp_path)
    assert "breaks a limit" not in (tmp_path / "head.yaml").read_text()


def follow(page: Path, folder: Path) -> None:
    reader = Reader(folder)
    try:
        for step in steps(page):
            reader.follow(step)
        assert reader.bench is None, f"{page}: nothing says when to stop the first terminal"
    finally:
        reader.end()


def check_calibration(folder: Path) -> None:
    """The calibrated sensor describes the rig as it was built, which the drawn one does not."""
    built, drawn, calibrated = (
        facets.load(folder / f"{name}.yaml").sensor for name in ("built", "quiet", "calibrated")
    )
    states = np.zeros((2, 8))
    states[1, :6] = [0.05, -0.05, 1.0, 0.003, -0.003, 0.01]
    readings = facets.readings(built, states)
    before, after = (
        facets.solve(sensor, readings, beam="known").residual for sensor in (drawn, calibrated)
    )
    assert (before > 100).all()
    assert (after < 0.01 * before).all()
