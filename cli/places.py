"""Poses and states on the command line: `tz_mm=1,yaw_mrad=2`."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

from facets.core.errors import InputError
from facets.core.names import POSE, STATE_COLUMNS, STATE_UNITS
from facets.core.plain_numbers import assignments, plain_number

if TYPE_CHECKING:
    from facets.core.units import Floats


def pose_of(text: str | None) -> Floats:
    """Read 'tz_mm=1,yaw_mrad=2' as a pose (6,), mm and rad."""
    import numpy as np

    return np.array(numbers_at(text, STATE_COLUMNS[:6]))


def state_of(text: str | None) -> Floats:
    """Read 'tz_mm=1,bx_mm=2' as a state (8,), mm and rad."""
    import numpy as np

    return np.array(numbers_at(text, STATE_COLUMNS))


def numbers_at(text: str | None, names: Sequence[str]) -> list[float]:
    """Read NAME=NUMBER,... in the order of the names, mm and rad; zero for omitted names."""
    found = [0.0] * len(names)
    form = "NAME=NUMBER"
    given = {} if text is None else assignments(text, "--at", names, form)
    for name, value in given.items():
        number = names.index(name)
        try:
            found[number] = plain_number(value) * STATE_UNITS[number]
        except ValueError:
            raise InputError(
                f"--at has '{name}={value}'; allowed: {form} with NAME one of {', '.join(names)}"
            ) from None
        if not isfinite(found[number]):
            raise InputError(f"--at has '{name}={value}'; allowed: finite numbers")
    return found


def pair_of(text: str) -> tuple[str, str]:
    """Read 'tx,ty' as the names of two axes."""
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or len(set(names)) != 2 or not set(names) <= set(POSE):
        raise InputError(f"--axes is {text!r}; allowed: two of {', '.join(POSE)}, such as tx,ty")
    return names[0], names[1]
