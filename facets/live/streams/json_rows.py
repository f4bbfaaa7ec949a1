"""Samples as texts in JSON, as PlotJuggler and MCAP files take them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ...core.names import READING_COLUMNS, STATE_COLUMNS
from ...estimation.solution import UNCERTAINTY_PARTS
from .sample_rows import HEAD as HEAD_COLUMNS
from .sample_rows import NUMBERS, PARTS

Rows = NDArray[np.void]

GROUPS = {
    "reading": READING_COLUMNS,
    "pose": STATE_COLUMNS,
    "u": tuple(f"u_{name}" for name in STATE_COLUMNS),
}
PART_GROUPS = {
    f"u_{part}": tuple(f"u_{part}_{name}" for name in STATE_COLUMNS) for part in UNCERTAINTY_PARTS
}


def json_template(groups: dict[str, tuple[str, ...]]) -> str:
    """The text of a sample with a place for each of its numbers."""
    parts = []
    for group, names in groups.items():
        parts.append(f'"{group}":{{' + ",".join(f'"{name}":%.9g' for name in names) + "}")
    return ",".join(parts)


#: Columns that every program's text names by itself.
KNOWN = {*NUMBERS, *PARTS}
#: The beginnings of columns by the group of a text; those of no group are auxiliary channels.
FURTHER_GROUPS = {
    "object": re.compile(r"((u|u_noise|u_calibration)_)?(object|displacement)_|cov_"),
    "channels": re.compile(""),
}


def further_groups(names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the columns beyond `KNOWN`, by their group in the text."""
    groups: dict[str, tuple[str, ...]] = dict.fromkeys(FURTHER_GROUPS, ())
    for name in names:
        if name not in KNOWN:
            group = next(key for key, begins in FURTHER_GROUPS.items() if begins.match(name))
            groups[group] += (name,)
    return groups


HEAD = '"timestamp":%.9f,"seq":%d,"status":%d,"flags":%d'


@cache
def template_of(names: tuple[str, ...]) -> str:
    """The text of a sample with these columns."""
    parts = [HEAD, json_template(GROUPS), '"residual":%.9g']
    further = further_groups(names)
    parts += [
        json_template(groups)
        for groups, is_there in (
            (PART_GROUPS, "u_noise_tx_mm" in names),
            *(({group: further[group]}, bool(further[group])) for group in ("object", "channels")),
        )
        if is_there
    ]
    return "{" + ",".join(parts) + "}"


def json_of(rows: Rows) -> list[str]:
    """A text for each sample, without the numbers that are not known: JSON has no word for them."""
    heads = rows[["utc_s", "seq", "status", "flags"]].tolist()
    names = numbers_of(rows.dtype)
    template = template_of(names)
    numbers = np.column_stack([rows[name] for name in names])
    whole = np.isfinite(numbers).all(axis=1)
    return [
        template % (*head, *row) if fine else sparse_json(template, head, row)
        for head, row, fine in zip(heads, numbers.tolist(), whole.tolist(), strict=True)
    ]


def numbers_of(dtype: np.dtype[np.void]) -> tuple[str, ...]:
    """The columns of rows after those of the head."""
    return (dtype.names or ())[len(HEAD_COLUMNS) :]


def sparse_json(template: str, head: tuple[float, ...], row: list[float]) -> str:
    """The text of a sample without those of its numbers that are not finite."""
    known = json.loads(template % (*head, *(1.0 if np.isfinite(value) else 0.0 for value in row)))
    numbers = json.loads(template % (*head, *(v if np.isfinite(v) else 0.0 for v in row)))
    for name, value in known.items():
        if isinstance(value, dict):
            numbers[name] = {key: numbers[name][key] for key, there in value.items() if there}
        elif name == "residual" and not value:
            del numbers[name]
    return json.dumps(numbers, separators=(",", ":"))
