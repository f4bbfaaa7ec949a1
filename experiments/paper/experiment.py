"""Interface of an experiment, which computes a table and from it a picture and claims.

Each module of this folder named in `EXPERIMENTS` has

TITLE: the title of the experiment.

CONFIG: the shipped configuration that it runs.

compute(quick): computes the table, column by column; with `quick`, possibly fewer rows.

claims(table): compares the paper's numbers with those of the table.

picture(table): draws a figure; `no_picture` if the claims suffice.

The table is written to a file first; claims and picture are made from that file.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table = dict[str, NDArray[Any]]

#: Experiments in the paper's order, then those that are not in the paper.
EXPERIMENTS = (
    "table1", "fig4", "eq8", "fig6", "fig7", "fig8", "fig9", "eq13", "fig10", "fig11", "table2",
    "section4", "known-beam", "power-drift", "uniqueness",
)  # fmt: skip
NONE = float("nan")
#: Largest relative difference at which a number agrees with the paper's: the paper prints two
#: or three digits, measured on a rig whose errors it does not state.
NEAR = 0.1


class PaperClaim(NamedTuple):
    """A number of the paper and our value of it.

    paper: the paper's value, NaN if it states none.  why: reason for the ratio.  is_input: whether
    the run uses the paper's number, so that the two cannot disagree.
    """

    what: str
    unit: str
    paper: float
    ours: float
    why: str
    is_input: bool = False

    @property
    def ratio(self) -> float:
        """The computed value over the paper's; NaN if the paper states none or 0."""
        return self.ours / self.paper if self.paper else NONE

    @property
    def agrees(self) -> bool | None:
        """Whether a result agrees with the paper's within `NEAR`; None for an input or if the paper
        states none."""
        if self.is_input or self.paper != self.paper:
            return None
        return bool(abs(self.ours - self.paper) <= NEAR * abs(self.paper))


class Experiment(Protocol):
    """Module of an experiment.

    `compute` makes its table, whose columns (n,) end with their units; quick: a smaller one for
    tests. `claims` compares the paper's numbers with those of a table. `picture` draws a table;
    None if there is nothing to draw.
    """

    TITLE: str
    CONFIG: str

    def compute(self, quick: bool) -> Table: ...
    def claims(self, table: Table) -> list[PaperClaim]: ...
    def picture(self, table: Table) -> Figure | None: ...


def experiment(name: str) -> Experiment:
    """Import the module of an experiment."""
    module = import_module(f"{__package__}.{name.replace('-', '_')}")
    return cast("Experiment", module)


def no_picture(table: Table) -> None:
    """The absent picture of an experiment whose claims suffice."""


def columns_of(names: str, rows: list[Any]) -> Table:
    """Make a table from rows and one string of column names."""
    return {
        name: np.array(column)
        for name, column in zip(names.split(), zip(*rows, strict=True), strict=True)
    }
