"""Keys as they are declared: the way into the code's units and back, and the check of a file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Literal

import pytest

from facets.config import ValueCheck, block_node
from facets.core import KEY_UNITS, Key, block_of, item_of, key, unit_in

SIZE = Key("size_mm", (1.0, 2.0), "width and height", "mm", tuple[float, float], {"gt": 0})


@dataclass(frozen=True)
class Lamp:
    """A lamp.

    What is not said of its keys stands here.
    """

    power: float = key("power_uw", 500.0, "of its light", gt=0, le=1e6)
    width: float = item_of(SIZE, 0)
    height: float = item_of(SIZE, 1)
    delays: tuple[float, ...] = key("delays_us", (0.0, 0.0), "", hint=tuple[float, float])
    limit: float = key("limit_mm", None, "null for none", null=inf)
    is_bright: bool = key("look", "dim", "", words={"dim": False, "bright": True})
    colour: Literal["red", "blue"] = key("colour", "red", "")


BLOCK = block_of(Lamp)
SCHEMA = block_node(BLOCK, {})


def test_the_defaults_of_fields_are_those_of_their_keys_in_the_units_of_the_code():
    assert Lamp() == BLOCK.read({}) == Lamp(0.5, 1.0, 2.0, (0.0, 0.0), inf, False, "red")


def test_a_checked_file_gives_the_object_and_only_changed_keys_are_written():
    values = {
        "power_uw": 0.1 + 0.2,
        "size_mm": [3, 4],
        "delays_us": [0, 6],
        "limit_mm": 7,
        "look": "bright",
    }
    check = ValueCheck()
    checked = check.value(SCHEMA, values)
    assert not check.problems
    lamp = BLOCK.read(checked)
    assert lamp == Lamp(1e-3 * (0.1 + 0.2), 3.0, 4.0, (0.0, 1e-6 * 6), 7.0, True, "red")
    changed = replace(lamp, height=5.0, limit=inf, delays=(0.0, 2e-6))
    written = {"size_mm": [3.0, 5.0], "limit_mm": None, "delays_us": [0.0, 2.0]}
    assert BLOCK.write(checked, changed) == checked | written


@pytest.mark.parametrize(
    "wrong",
    [
        {"power_uw": 0},
        {"power_uw": 1e7},
        {"power_uw": "1"},
        {"power_uw": True},
        {"power_uw": None},
        {"size_mm": [1]},
        {"size_mm": [1, 0]},
        {"limit_mm": inf},
        {"look": True},
        {"colour": "green"},
        {"power": 1},
    ],
)
def test_what_the_declaration_does_not_allow_is_refused(wrong):
    check = ValueCheck()
    check.value(SCHEMA, wrong)
    assert [path[:1] for path, _ in check.problems] == [tuple(wrong)]


def test_every_unit_is_converted_there_and_back():
    for name, unit in KEY_UNITS.items():
        assert unit.to_key(unit.to_code(3.0)) == pytest.approx(3.0, rel=1e-15), name


def test_a_name_ends_with_its_unit():
    names = ("max_speed_mm_s", "acceleration_mm_s2", "tip_um2", "max_steps", "mm", "wait_seconds")
    assert [unit_in(name) for name in names] == ["mm_s", "mm_s2", "um2", "", "", ""]
    labels = [KEY_UNITS[unit_in(f"speed_{unit}")].label for unit in ("m_s", "rad_s", "deg_s")]
    assert labels == ["m/s", "rad/s", "deg/s"]
    assert KEY_UNITS["deg_s"].to_code(180.0) == pytest.approx(3.14159265)
    assert KEY_UNITS["m_s"].to_code(2.0) == 2000


def test_one_over_a_unit_with_a_stroke_has_brackets():
    labels = [KEY_UNITS[name].label for name in ("per_um", "per_mm_s", "per_m_s2")]
    assert labels == ["1/um", "1/(mm/s)", "1/(m/s^2)"]
