"""The page on hazards names, for each of them, tests that exist."""

from __future__ import annotations

import ast
import re
from functools import cache

import pytest
from pages import ROOT

ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in (ROOT / "docs/hazards.md").read_text("utf-8").splitlines()
    if line.startswith("| **")
]


@cache
def names_of_tests() -> set[str]:
    """The names of all tests."""
    return {
        node.name
        for path in (ROOT / "tests").rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


def test_the_hazards_of_a_stage_are_all_there() -> None:
    text = " ".join(row[0] for row in ROWS).lower()
    for hazard in ("runaway", "stale data", "wrong sign", "wrong units", "two programs", "cable",
                   "power", "stalls", "laser"):  # fmt: skip
        assert hazard in text
    assert "ISO 13849" in (ROOT / "docs/hazards.md").read_text("utf-8")


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0].strip("* ")[:30])
def test_each_hazard_names_tests_that_exist_and_what_is_not_covered(row: list[str]) -> None:
    assert len(row) == 4
    named = re.findall(r"`(test_\w+)`", row[2])
    assert named
    assert set(named) <= names_of_tests()
    assert row[3]


def test_a_hazard_that_has_no_test_says_so() -> None:
    """Nothing in the package could turn a laser off, and the page does not pretend that."""
    (laser,) = (row for row in ROWS if "laser" in row[0].lower())
    assert laser[1].startswith("Nothing.")
