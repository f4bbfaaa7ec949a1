"""Fig. 9: a motion of all six axes, with errors in six axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facets.core.names import POSE

from . import motion
from .experiment import PaperClaim, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Fig. 9: motion of all six axes"
CONFIG = "paper"


def compute(quick: bool) -> Table:
    return motion.simulate_table(CONFIG, "multi-axis")


def claims(table: Table) -> list[PaperClaim]:
    return motion.errors_in_six_axes(table)


def picture(table: Table) -> Figure:
    return motion.motion_figure(table, POSE)
