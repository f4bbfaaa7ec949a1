"""What an experiment is: it computes a table, from which come a picture and claims.

Each module of this folder named in `EXPERIMENTS` has

    TITLE                what it shows
    CONFIG               the shipped configuration that it runs
    compute(quick)       the table, column by column; `quick` may take fewer rows
    claims(table)        what the paper says beside what the table says
    picture(table)       a figure, or None where the claims say all

The table goes to a file first, and what follows is made from the file.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table = dict[str, NDArray[Any]]

#: In the paper's order, then what it does not say.
EXPERIMENTS = (
    "table1", "fig4", "eq8", "fig6", "fig7", "fig8", "fig9", "eq13", "fig10", "fig11", "table2",
    "section4", "known-beam", "power-drift", "uniqueness",
)  # fmt: skip
NONE = float("nan")
#: A number agrees with the paper's when it is this near, over the paper's: the paper prints two
#: or three digits of what was measured on a rig whose own errors it does not state.
NEAR = 0.1


class PaperClaim(NamedTuple):
    """One number. paper: NaN where it gives none.  why: what the ratio comes from."""

    what: str
    unit: str
    paper: float
    ours: float
    why: str

    @property
    def ratio(self) -> float:
        return self.ours / self.paper if self.paper else NONE

    @property
    def agrees(self) -> bool | None:
        """Whether the paper's number is met within `NEAR`; None where the paper gives none."""
        if self.paper != self.paper:
            return None
        return bool(abs(self.ours - self.paper) <= NEAR * abs(self.paper))


class Experiment(Protocol):
    TITLE: str
    CONFIG: str

    def compute(self, quick: bool) -> Table: ...
    def claims(self, table: Table) -> list[PaperClaim]: ...
    def picture(self, table: Table) -> Figure | None: ...


def experiment(name: str) -> Experiment:
    """The module of that name."""
    module = import_module(f"{__package__}.{name.replace('-', '_')}")
    return cast("Experiment", module)


def columns_of(names: str, rows: list[Any]) -> Table:
    """A table from rows, its columns named in one string."""
    return {
        name: np.array(column)
        for name, column in zip(names.split(), zip(*rows, strict=True), strict=True)
    }
