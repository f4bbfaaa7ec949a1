"""Samples as texts in JSON, as PlotJuggler and MCAP files take them."""

from __future__ import annotations

import re
from functools import cache

import numpy as np

from ...core.names import READING_COLUMNS, STATE_COLUMNS
from ...core.units import Rows
from ...estimation.solution import UNCERTAINTY_PARTS
from .sample_rows import HEAD as HEAD_COLUMNS

#: The group of a text that has a column.
GROUPS = {
    **dict.fromkeys(READING_COLUMNS, "reading"),
    **dict.fromkeys(STATE_COLUMNS, "pose"),
    **{f"u_{name}": "u" for name in STATE_COLUMNS},
    **{f"u_{part}_{name}": f"u_{part}" for part in UNCERTAINTY_PARTS for name in STATE_COLUMNS},
    "residual": "",
}
#: The beginnings of the columns of an object; all others that are in no group are channels.
OF_OBJECT = re.compile(r"((u|u_noise|u_calibration)_)?(object|displacement)_|cov_")
HEAD = '"timestamp":%.9f,"seq":%d,"status":%d,"flags":%d'
UNKNOWN = re.compile(r'"\w+":(nan|-?inf),?')


def group_columns(names: tuple[str, ...]) -> dict[str, list[str]]:
    """Return columns by their groups in the text of a sample; "" has those of no group."""
    groups: dict[str, list[str]] = {}
    for name in names:
        other = "object" if OF_OBJECT.match(name) else "channels"
        groups.setdefault(GROUPS.get(name, other), []).append(name)
    return groups


@cache
def template_of(names: tuple[str, ...]) -> str:
    """The text of a sample with a place for each of its numbers."""
    parts = [HEAD]
    for group, members in group_columns(names).items():
        text = ",".join(f'"{name}":%.9g' for name in members)
        parts.append(f'"{group}":{{{text}}}' if group else text)
    return "{" + ",".join(parts) + "}"


def json_of(rows: Rows) -> list[str]:
    """Return a text for each sample, without unknown numbers, which JSON cannot represent."""
    heads = rows[["utc_s", "seq", "status", "flags"]].tolist()
    names = numbers_of(rows.dtype)
    template = template_of(names)
    numbers = np.column_stack([rows[name] for name in names])
    is_finite = np.isfinite(numbers).all(axis=1)
    texts = [template % (*head, *row) for head, row in zip(heads, numbers.tolist(), strict=True)]
    return [
        text if fine else UNKNOWN.sub("", text).replace(",}", "}")
        for text, fine in zip(texts, is_finite.tolist(), strict=True)
    ]


def numbers_of(dtype: np.dtype[np.void]) -> tuple[str, ...]:
    """The columns of rows after those of the head."""
    return (dtype.names or ())[len(HEAD_COLUMNS) :]
