"""What the pages of the commands show as printed is what the commands print today."""

from __future__ import annotations

from pathlib import Path

import pytest
from pages import DOCS, agree, shape, steps
from reader import Reader

#: Pages whose examples need nobody at a second terminal, in an order in which each finds what an
#: earlier one has written. `README.md` and the guides are followed by `test_guides.py`.
QUICK = ("simulate", "solve", "range-map", "resolution")
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


def show(folder: Path, page: str) -> None:
    """Runs the examples of a page; each line that it shows has to be printed."""
    reader = Reader(folder)
    for step in steps(DOCS / "commands" / f"{page}.md"):
        if step.language == "yaml":
            (folder / step.file).write_text(step.block)
        if step.language != "console":
            continue
        reader.printed = []
        for line in step.block.splitlines():
            if line.startswith("$ "):
                reader.type(line[2:])
        reader.compare(line for line in step.block.splitlines() if not line.startswith("$ "))


@pytest.mark.slow
def test_examples_show_what_quick_commands_print(tmp_path: Path) -> None:
    for page in QUICK:
        show(tmp_path, page)


@pytest.mark.study
def test_examples_show_what_long_commands_print(tmp_path: Path) -> None:
    for page in LONG:
        show(tmp_path, page)


def test_a_line_is_compared_but_for_its_numbers() -> None:
    assert shape(" tx  -0.274  1.2e-3  5 %") == shape(" tx     3  +4 12 %")
    assert shape(" tx  0.1  um") != shape(" tx  0.1  mm")
    assert shape(" tx  0.1  0.2") != shape(" tx  0.1")
    assert agree(" tx 1,020 5 ...", " tx 1,000 6 7", 0.02)
    assert not agree(" tx 1,020 8", " tx 1,000 5", 0.02)
