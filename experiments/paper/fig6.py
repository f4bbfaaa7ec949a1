"""Fig. 6: the measurement range under a fixed beam, two axes at a time, all fifteen pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import outlines
from .experiment import Claim, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Fig. 6: measurement ranges with a fixed beam"
CONFIG = "paper"
#: Table 2, mm and mrad; and the map that shows it, with the axis's place in it.
RANGES = {
    "tx": (0.36, "mm", ("tx", "ty"), 0, "fitted: the least signal-to-noise ratio, 810, is"),
    "ty": (0.39, "mm", ("tx", "ty"), 1, "the same ratio, fitted to both"),
    "tz": (12.3, "mm", ("tz", "yaw"), 0, "spots inside the 1/e^2 circle stay on the PSD"),
    "roll": (28.0, "mrad", ("roll", "pitch"), 0, "the same"),
    "pitch": (24.5, "mrad", ("roll", "pitch"), 1, "the same"),
    "yaw": (48.0, "mrad", ("tz", "yaw"), 1, "the same"),
}


def compute(quick: bool) -> Table:
    return outlines.traced(CONFIG, outlines.PAIRS, tracking=False)


def claims(table: Table) -> list[Claim]:
    return [
        Claim(f"range in {name}", unit, paper, outlines.symmetric(table, *axes, place), why)
        for name, (paper, unit, axes, place, why) in RANGES.items()
    ]


def picture(table: Table) -> Figure:
    return outlines.drawn(table)
