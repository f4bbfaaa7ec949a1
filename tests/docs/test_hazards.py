"""The page on hazards names, for each of them, tests that exist."""

import re

import pytest
from pages import ROOT

ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in (ROOT / "docs/hazards.md").read_text("utf-8").splitlines()
    if line.startswith("| **")
]


@pytest.fixture(scope="module")
def names_of_tests():
    """The names of all tests."""
    paths = (ROOT / "tests").rglob("test_*.py")
    return {
        name
        for path in paths
        for name in re.findall(r"^ *def (test_\w+)", path.read_text("utf-8"), re.MULTILINE)
    }


def test_the_hazards_of_a_stage_are_all_there():
    text = " ".join(row[0] for row in ROWS).lower()
    for hazard in ("runaway", "stale data", "wrong sign", "wrong units", "two programs", "cable",
                   "power", "stalls", "laser"):  # fmt: skip
        assert hazard in text
    assert "ISO 13849" in (ROOT / "docs/hazards.md").read_text("utf-8")


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0].strip("* ")[:30])
def test_each_hazard_names_tests_that_exist_and_what_is_not_covered(row, names_of_tests):
    _, _, tests, uncovered = row
    named = set(re.findall(r"`(test_\w+)`", tests))
    assert named
    assert named <= names_of_tests
    assert uncovered


def test_a_hazard_that_has_no_test_says_so():
    """Nothing in the package could turn a laser off, and the page does not pretend that."""
    (laser,) = (row for row in ROWS if "laser" in row[0].lower())
    assert laser[1].startswith("Nothing.")
