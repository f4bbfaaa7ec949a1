"""Differences of two resolved blocks of keys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def differences(
    old: dict[str, Any], new: dict[str, Any], write: Callable[[Any], Any] = lambda value: value
) -> dict[str, Any]:
    """Return the nested keys of `new` whose values differ from those of `old`.

    write: converts a value for comparison and output.
    """
    changed = {}
    for key, value in new.items():
        before = old.get(key)
        if isinstance(value, dict) and isinstance(before, dict):
            if inner := differences(before, value, write):
                changed[key] = inner
        elif write(value) != write(before):
            changed[key] = write(value)
    return changed
