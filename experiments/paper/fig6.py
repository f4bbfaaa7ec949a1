"""Fig. 6: the measurement range under a fixed beam, two axes at a time, all fifteen pairs."""

from __future__ import annotations

from . import outlines
from .experiment import PaperClaim, Table
from .table2 import RANGE_MM_MRAD

TITLE = "Fig. 6: measurement ranges with a fixed beam"
CONFIG = "paper"
#: For each axis, the map that shows it, its index in that map, and the reason for its range.
RANGES = {
    "tx": ("mm", ("tx", "ty"), 0, "fitted: the least signal-to-noise ratio, 810, is"),
    "ty": ("mm", ("tx", "ty"), 1, "the same ratio, fitted to both"),
    "tz": ("mm", ("tz", "yaw"), 0, "spots inside the 1/e^2 circle stay on the PSD"),
    "roll": ("mrad", ("roll", "pitch"), 0, "the same"),
    "pitch": ("mrad", ("roll", "pitch"), 1, "the same"),
    "yaw": ("mrad", ("tz", "yaw"), 1, "the same"),
}


def compute(quick: bool) -> Table:
    return outlines.trace_table(CONFIG, outlines.PAIRS, tracking=False)


def claims(table: Table) -> list[PaperClaim]:
    return [
        PaperClaim(
            f"range in {name}", unit, paper, outlines.symmetric_range(table, *axes, place), why
        )
        for paper, (name, (unit, axes, place, why)) in zip(
            RANGE_MM_MRAD, RANGES.items(), strict=True
        )
    ]


picture = outlines.outlines_figure
