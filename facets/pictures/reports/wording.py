"""Names of quantities, keys and limits in words with units, for the pages of designs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from textwrap import wrap

from ...core.names import DETECTORS
from ..style import WORDS

#: Labels of measures that their columns' names do not explain.
LABELS = {
    "head_mm": "diameter of the head, mm",
    "room_mm": "least clearance of a spot, mm",
    "least_power_mw": "least power on a detector, mW",
    "condition": "condition number",
}
#: Kinds of measures by the first part of a column's name.
MEASURES = {"u": "uncertainty of", "range": "range of"}
#: Units by the last part of a column's name.
UNITS = {"mm": "mm", "um": "µm", "mrad": "mrad", "urad": "µrad", "deg": "deg", "mw": "mW",
         "uw": "µW", "percent": "%"}  # fmt: skip
LETTERS = {"a": "A", "b": "B", "c": "C", "psd": "PSD"}
BLOCKS = {"beam": "beam", "mirror": "facets", "psd": "PSDs"}
SINGULARS = {"mirror": "facet", "psd": "PSD"}
#: Bounds of a design by the search's names.
ENDS = {"at its least": "at its lower bound", "at its most": "at its upper bound"}
LIMITS = ("spot on", "uncertainty of", "power on")
#: Objectives by their names in a configuration.
AIMS = {
    "resolution": "the least worst uncertainty over the volume",
    "mean-resolution": "the least uncertainty over the volume, root mean square",
    "range": "the largest volume",
    "condition": "the least condition number",
    "size": "the smallest head",
    "weighted": "the least weighted sum",
}
#: Maximum number of characters in a line of a label below a plot.
WIDTH = 12


def label(key: str) -> str:
    """Write a column in words: "u_roll_urad" is "uncertainty of roll, µrad"."""
    name, _, unit = key.rpartition("_")
    if key in LABELS or unit not in UNITS:
        return LABELS.get(key, key.replace("_", " "))
    kind, _, axis = name.partition("_")
    if kind in MEASURES and axis in WORDS:
        return f"{MEASURES[kind]} {WORDS[axis]}, {UNITS[unit]}"
    words = WORDS.get(name) or " ".join(LETTERS.get(word, word) for word in name.split("_"))
    return f"{words}, {UNITS[unit]}"


def lines_of(text: str) -> list[str]:
    """Split a label into lines of at most 12 characters; a unit after the last comma has a line
    of its own."""
    name, comma, unit = text.rpartition(", ")
    return [*wrap(name if comma else text, WIDTH), *([unit] if comma else [])]


def amount(key: str, value: float, sign: str = "") -> str:
    """Write a column with its value: "shift in x ±0.1 mm"."""
    name, _, unit = label(key).partition(", ")
    return f"{name} {sign}{value:g} {unit}".rstrip()


def between(key: str, low: float, high: float) -> str:
    """Write a column with its bounds: "radius 100 to 250 mm"."""
    name, _, unit = label(key).partition(", ")
    return typeset(f"{name} {low:g} to {high:g} {unit}".rstrip())


def rows_in_words(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Write the cells of a table's rows in words where they are columns, keys or limits."""
    return [[cell_in_words(cell) for cell in row] for row in rows]


def cell_in_words(cell: str) -> str:
    """Write a key, a column or a limit in words, and other cells with typographic signs."""
    block = cell.partition(".")[0]
    if block in BLOCKS:
        return key_in_words(cell)
    if cell in LABELS or (cell.isidentifier() and cell.rpartition("_")[2] in UNITS):
        return label(cell)
    words = limit_in_words(cell) if cell.startswith(LIMITS) or cell.endswith(tuple(ENDS)) else cell
    return words.replace("+- ", "±").replace(" uW", " µW").replace(" um", " µm")


def key_in_words(path: str) -> str:
    """Write a key of a sensor in words: "psd.b.azimuth_deg" is "PSD B, azimuth, deg"."""
    block, *inner = path.split(".")
    part = BLOCKS.get(block, block)
    if inner and inner[0] in DETECTORS:
        part = f"{SINGULARS.get(block, block)} {inner.pop(0).upper()}"
    return ", ".join([part, *map(label, inner)])


def typeset(words: str) -> str:
    """Replace hyphens before numbers by minus signs."""
    return re.sub(r"(?<![\w.])-(?=[\d.])", "\N{MINUS SIGN}", words)


def limit_in_words(group: str) -> str:
    """Write a limit in words: "radius_mm at its most" is "radius at its upper bound"."""
    for end, words in ENDS.items():
        if group.endswith(end):
            key = group.removesuffix(end).strip()
            return f"{label(key).partition(', ')[0]} {words}"
    axis = group.removeprefix("uncertainty of ").partition(" ")[0]
    if axis in WORDS:
        return group.replace(axis, WORDS[axis], 1)
    return group.replace("-z", "\N{MINUS SIGN}z").replace("-y", "\N{MINUS SIGN}y")
