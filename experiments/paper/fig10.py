"""Fig. 10: the measurement range in x and y with the beam following the mirror."""

from __future__ import annotations

from . import outlines
from .experiment import PaperClaim, Table
from .table2 import FOLLOWING

TITLE = "Fig. 10: the measurement range in x and y with the beam following"
CONFIG = "paper"
WHY = "the nominal geometry; where the detectors of the paper's rig really stood is not known"


def compute(quick: bool) -> Table:
    return outlines.trace_table(CONFIG, (("tx", "ty"),), tracking=True)


def claims(table: Table) -> list[PaperClaim]:
    return [
        PaperClaim(
            f"range in t{axis}", "mm", paper, outlines.symmetric_range(table, "tx", "ty", n), WHY
        )
        for n, (axis, paper) in enumerate(zip("xy", FOLLOWING, strict=True))
    ]


picture = outlines.outlines_figure
