"""The drawing of the folders is that of the code, and the code is that of the contract."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
from facets.experiments import draw_packages

ROOT = Path(__file__).parents[2]
REDRAW = "run: python -m facets.experiments.draw_packages docs/packages.svg"


@pytest.fixture(scope="module")
def arrows():
    return draw_packages.arrows()


def test_the_committed_drawing_shows_the_arrows_of_the_code(arrows):
    drawn = draw_packages.arrows_of((ROOT / "docs" / "packages.svg").read_text())
    assert drawn == arrows, REDRAW


def test_every_folder_is_drawn_and_in_the_contract():
    names = {name for row in draw_packages.layers() for name in row}
    folders = {file.parent.name for file in (ROOT / "facets").glob("*/__init__.py")}
    assert names == folders | {"cli", "experiments"}
    drawing = ElementTree.parse(ROOT / "docs" / "packages.svg")
    groups = drawing.iter("{http://www.w3.org/2000/svg}g")
    assert {group.get("id") for group in groups} == names


def test_every_arrow_runs_down_the_contract(arrows):
    floor = {name: n for n, row in enumerate(draw_packages.layers()) for name in row}
    assert [(a, b) for a, b in sorted(arrows) if floor[a] >= floor[b]] == []


def test_known_arrows_are_found(arrows):
    """One at run time, one for type checkers alone or inside a function, one between programs."""
    assert {("model", "optics"), ("cli", "live"), ("cli", "experiments")} <= arrows


def test_what_another_way_implies_is_left_out():
    every = {("a", "b"), ("b", "c"), ("a", "c"), ("c", "d"), ("a", "d")}
    assert draw_packages.plain_arrows(every) == {("a", "b"), ("b", "c"), ("c", "d")}
