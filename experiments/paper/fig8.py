"""Fig. 8: a turn about z, with errors in six axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import motion
from .experiment import PaperClaim, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Fig. 8: turn about z"
CONFIG = "paper"


def compute(quick: bool) -> Table:
    return motion.simulate_table(CONFIG, "yaw-sweep")


def claims(table: Table) -> list[PaperClaim]:
    return motion.errors_in_six_axes(table)


def picture(table: Table) -> Figure:
    return motion.motion_figure(table, ("yaw",))
