"""Fig. 10: the measurement range in x and y with the beam following the mirror."""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import outlines
from .experiment import Claim, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Fig. 10: the measurement range in x and y with the beam following"
CONFIG = "paper"
WHY = "the nominal geometry; a rig's own detectors stand a few tenths of a mm off"


def compute(quick: bool) -> Table:
    return outlines.traced(CONFIG, (("tx", "ty"),), tracking=True)


def claims(table: Table) -> list[Claim]:
    return [
        Claim("range in tx", "mm", 13.6, outlines.symmetric(table, "tx", "ty", 0), WHY),
        Claim("range in ty", "mm", 11.8, outlines.symmetric(table, "tx", "ty", 1), WHY),
    ]


def picture(table: Table) -> Figure:
    return outlines.drawn(table)
