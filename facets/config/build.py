"""Convert checked keys to plain resolved types, and these to the objects of the code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..core.keys import block_of
from ..core.motions import Motion
from ..core.sensor import Electronics, Sensor
from .keys import MOTIONS
from .sensor_keys import SENSOR


def differences(
    old: dict[str, Any], new: dict[str, Any], write: Callable[[Any], Any] = lambda value: value
) -> dict[str, Any]:
    """Return the nested keys of `new` whose values differ from those of `old`, in the form that
    `write` gives them."""
    changed = {}
    for key, value in new.items():
        before = old.get(key)
        if isinstance(value, dict) and isinstance(before, dict):
            if inner := differences(before, value, write):
                changed[key] = inner
        elif write(value) != write(before):
            changed[key] = write(value)
    return changed


def sensor(keys: dict[str, Any]) -> Sensor:
    """A Sensor from the resolved `sensor` block."""
    built: Sensor = SENSOR.read(keys)
    return built


def electronics(keys: dict[str, Any]) -> Electronics:
    built: Electronics = block_of(Electronics).read(keys)
    return built


def motion(keys: dict[str, Any]) -> Motion:
    """A motion from its resolved block."""
    made: Motion = MOTIONS[keys["kind"]].read(keys)
    return made
