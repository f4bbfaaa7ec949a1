"""Whoever follows the README and the guides sees every command succeed and print what they show."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from pages import DOCS, GUIDES, ROOT, agree, shape, steps
from reader import Reader

import facets

#: Commands of the guides that another test runs, with another folder for their results.
ELSEWHERE = {
    "facets range-map paper --axes tx,ty --folder results/paper-range",  # of the README
    "facets resolution paper --folder results/paper-resolution",  # of its page
    "facets render paper -o results/paper.png",  # tests/pictures
    "facets reproduce all --quick --folder results/paper-report",  # tests/experiments
}
#: Pages of commands whose examples need nobody at a second terminal, in an order in which each
#: finds what an earlier one has written: those of the README's commands, and others.
OF_THE_README = ("simulate", "solve", "range-map")
LONG = (
    "optimize",
    "render",
    "tolerances",
    "jacobian",
    "calibrate",
    "rezero",
    "axis",
    "explore",
    "reproduce",
)


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    """Who has followed the README, but for its Python, which `test_documentation.py` runs."""
    reader = Reader(tmp_path_factory.mktemp("reader"))
    for step in steps(ROOT / "README.md"):
        if step.language != "python":
            reader.follow(step)
    return reader


def show(reader, *pages):
    """Run the examples of commands' pages; each line that they show has to be printed."""
    for page in pages:
        for step in steps(DOCS / "commands" / f"{page}.md"):
            if step.language == "yaml":
                reader.follow(step)
            if step.language != "console":
                continue
            reader.printed = []
            lines = step.block.splitlines()
            for line in lines:
                if line.startswith("$ "):
                    reader.type(line[2:])
            reader.compare(line for line in lines if not line.startswith("$ "))


def test_the_readme_and_the_pages_of_its_commands_show_what_is_printed(reader):
    show(reader, *OF_THE_README)


@pytest.mark.slow
def test_the_page_of_resolution_shows_what_is_printed(reader):
    show(reader, "resolution")


@pytest.mark.study
def test_the_pages_of_long_commands_show_what_is_printed(reader):
    show(reader, *LONG)


@pytest.mark.slow
def test_the_guides_can_be_followed_in_one_folder(tmp_path):
    """By several readers at once, because most of them wait for recordings."""
    with ThreadPoolExecutor(len(GUIDES)) as readers:
        for _ in readers.map(partial(follow, folder=tmp_path), GUIDES):
            pass
    check_calibration(tmp_path)
    assert "breaks a limit" not in (tmp_path / "head.yaml").read_text()


def follow(page, folder):
    reader = Reader(folder)
    reader.outputs = {line: [] for line in ELSEWHERE}
    try:
        for step in steps(page):
            reader.follow(step)
        assert reader.bench is None, f"{page}: nothing says when to stop the first terminal"
    finally:
        reader.end()


def check_calibration(folder):
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


def test_a_line_is_compared_but_for_its_numbers():
    assert shape(" tx  -0.274  1.2e-3  5 %") == shape(" tx     3  +4 12 %")
    assert shape(" tx  0.1  um") != shape(" tx  0.1  mm")
    assert shape(" tx  0.1  0.2") != shape(" tx  0.1")
    assert agree(" tx 1,020 5 ...", " tx 1,000 6 7", 0.02)
    assert not agree(" tx 1,020 8", " tx 1,000 5", 0.02)
