"""The output of `facets axis`: the quantities of an axis, and notes on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facets import core, pictures

from ..console import show_table, wrap

if TYPE_CHECKING:
    from facets.axis_tests.report import AxisReport


def show(report: AxisReport) -> None:
    """Print the quantities of the axis, the range of each error motion, and the notes."""
    motions = report.motions
    unit, scale = report.units(motions.main)
    rows = [
        (
            q.name,
            q.symbol,
            *pictures.axis.value_cells(scale * q.value, scale * q.expanded),
            core.units.write_micro(unit),
        )
        for q in report.quantities[motions.main]
    ]
    title = (
        f"{motions.names[motions.main]}: {len(report.visits.target)} dwells at "
        f"{len(motions.targets)} positions; U: expanded uncertainty by the sensor (k = 2)"
    )
    show_table(title, ("quantity", "", "value", "U", ""), rows, left_columns=(0, 1, 4))
    heads = ("error", "", "range", "U", "reversal", "U")
    show_table("", heads, pictures.axis.other_rows(report), left_columns=(0, 1))
    for note in filter(None, (report.alignment(), *report.notes())):
        print(wrap(f"- {note}"))
