"""Convert checked keys to plain resolved types, and these to the objects of the code."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

from ..core.keys import block_of
from ..core.motions import KINDS, Motion
from ..core.names import DETECTORS
from ..core.sensor import Electronics, Sensor
from .sensor_keys import SENSOR


def resolve(document: Any) -> dict[str, Any]:
    """Return every key with its value, per detector, as plain types; they load to the same
    configuration."""
    plain: dict[str, Any] = document.model_dump(mode="json", by_alias=True, exclude={"extends"})
    plain["sensor"]["mirror"] = _single_blocks(document.sensor.mirror)
    plain["sensor"]["psd"] = _single_blocks(document.sensor.psd)
    return plain


def _single_blocks(common: Any) -> dict[str, Any]:
    """The blocks a, b and c with all keys: their own, else the common ones, else the nominal
    azimuth."""
    shared = common.model_dump(mode="json", exclude=set(DETECTORS))
    return {
        name: _overlay(
            {**deepcopy(shared), "azimuth_deg": 120.0 * k},
            getattr(common, name).model_dump(mode="json", exclude_unset=True),
        )
        for k, name in enumerate(DETECTORS)
    }


def _overlay(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Return `below` with the keys of `above` laid over it, block by block."""
    blocks = {
        key: _overlay(below[key], value) if isinstance(value, dict) else value
        for key, value in above.items()
    }
    return {**below, **blocks}


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


#: The classes of motions by the word in a file.
MOTIONS = {kind.kind: block_of(kind) for kind in KINDS}


def motion(keys: dict[str, Any]) -> Motion:
    """A motion from its resolved block."""
    made: Motion = MOTIONS[keys["kind"]].read(keys)
    return made
