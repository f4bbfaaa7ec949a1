"""Poses, points and zeros on the command line: `tz_mm=1,yaw_mrad=2`, `0,0,50`, `2s`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from facets.core.errors import InputError
from facets.core.names import POSE, STATE_COLUMNS, STATE_UNITS
from facets.core.plain_numbers import assignments, plain_number

if TYPE_CHECKING:
    from facets.config import Config
    from facets.core.rules import Rules
    from facets.core.units import Floats
    from facets.estimation.zero import ZeroRequest


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
    numbers = [0.0] * len(names)
    form = "NAME=NUMBER"
    values = {} if text is None else assignments(text, "--at", names, form)
    for name, value in values.items():
        number = names.index(name)
        try:
            numbers[number] = plain_number(value) * STATE_UNITS[number]
        except ValueError:
            raise InputError(
                f"--at has '{name}={value}'; allowed: {form} with NAME one of {', '.join(names)}"
            ) from None
        if not isfinite(numbers[number]):
            raise InputError(f"--at has '{name}={value}'; allowed: finite numbers")
    return numbers


def pair_of(text: str) -> tuple[str, str]:
    """Read 'tx,ty' as the names of two axes."""
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or len(set(names)) != 2 or not set(names) <= set(POSE):
        raise InputError(f"--axes is {text!r}; allowed: two of {', '.join(POSE)}, such as tx,ty")
    return names[0], names[1]


def choose_point(settings: Config, text: str | None) -> Config:
    """The configuration with the object at the point '0,0,50' of --point; the orientation stays."""
    from facets.core.rigid_body import MIRROR

    if text is None:
        return settings
    try:
        x, y, z = (plain_number(part) for part in text.split(","))
        body = replace(settings.object or MIRROR, point=(x, y, z))
    except (ValueError, InputError):
        raise InputError(
            f"--point is {text!r}; allowed: three numbers in mm up to 10,000 in magnitude, such as "
            "0,0,50"
        ) from None
    return replace(settings, object=body, layout=replace(settings.layout, object=body))


def object_rules(settings: Config, track: bool) -> Rules:
    """The rules of the range, for the axes of the configuration's object."""
    return replace(settings.range, tracking=track, object=settings.object)


def displacement_at(settings: Config, text: str | None) -> Floats:
    """Read the mirror's pose 'tz_mm=1' of --at in the axes of the configuration's object (6,)."""
    from facets.core.rigid_body import object_displacements

    pose, body = pose_of(text), settings.object
    return pose if body is None else object_displacements(pose, 0 * pose, body)[0]


def report_object(settings: Config) -> None:
    """Print to which object the axes of the tables belong, unless it is the mirror."""

    if settings.object is not None:
        print(f"axes: displacement of the object, {settings.object.text}\n")


def zero_of(text: str | None) -> ZeroRequest | None:
    """Read '2s', 'row:1' or the name of a table as the zero of displacements."""
    from facets.estimation.zero import ZeroRequest
    from facets.files import tables

    if text is None:
        return None
    if re.fullmatch(r"(\d+\.?\d*|\.\d+)s", text) and float(text[:-1]) > 0:
        return ZeroRequest(seconds=float(text[:-1]))
    if re.fullmatch(r"row:0*[1-9]\d{0,14}", text):
        return ZeroRequest(row=int(text[4:]))
    if not text.lower().endswith(tables.ENDINGS):
        raise InputError(
            f"--zero is {text!r}; allowed: seconds such as 2s, a row such as row:1 (the first), or "
            "a table of poses, FILE.csv, FILE.parquet or FILE.h5"
        )
    tables.require_table(Path(text))
    return ZeroRequest(file=Path(text))
