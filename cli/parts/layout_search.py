"""The search of `facets optimize` for a layout, and the configuration with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from facets import design, files
from facets.core.plain_numbers import count_text, short_number

from ..console import FINDING, show_progress, show_table
from ..options.places import report_object

if TYPE_CHECKING:
    from facets.config import Config
    from facets.design.optimisation.problem import StartResult
    from facets.design.optimisation.rounding import Rounded
    from facets.design.optimisation.search import Optimum

#: Maximum number of choices of parts in a table.
SHOWN = 24


def search(settings: Config) -> Optimum:
    """Find the best layout and print all choices of parts and all starts; exit status 1 if no
    layout meets all requirements."""
    with show_progress("searching") as on_progress:
        optimum = design.optimisation.search.optimize(settings.sensor, settings.layout, on_progress)
    if optimum.tried:
        headings, rows = design.results.tables.part_rows(optimum, settings.layout.aim)
        left_columns = (0, 1, 2, len(headings) - 1)
        show_table("parts, the best first", headings, rows[:SHOWN], left_columns=left_columns)
        if len(rows) < optimum.choices or len(rows) > SHOWN:
            print(
                f"{len(rows)} of {optimum.choices} choices were tried; the others cannot be "
                "better, or do not meet all requirements\n"
            )
    headings, rows = design.results.tables.start_rows(optimum, settings.layout.aim)
    report_object(settings)
    show_table("starts, the best first", headings, rows, left_columns=(len(headings) - 1,))
    if not optimum.best.found:
        words = "No layout meets all requirements; these exclude each other:"
        refuse(words, optimum.best)
    return optimum


def refuse(words: str, result: StartResult) -> NoReturn:
    """Print the conflicting requirements and end."""
    print(words)
    for group, gap in result.shortfalls.items():
        print(f"  {group}: would have to be relaxed by {short_number(100 * gap)} % of its limit")
    raise typer.Exit(FINDING)


def rounded_layout(optimum: Optimum) -> Rounded | None:
    """Round the layout to manufacturable values; None if only the exact layout meets all."""
    rounded = design.optimisation.rounding.round_design(optimum.problem, optimum.best.x)
    if rounded is None:
        print(
            "The layout was not rounded to manufacturable values, because no rounded layout nearby "
            "meets all requirements."
        )
    return rounded


def layout_for_yield(settings: Config, optimum: Optimum) -> Optimum:
    """Find the layout with margins for `production.yield_percent`, if this is set; exit status 1 if
    there is none."""
    layout = settings.layout
    if not layout.production:
        return optimum
    heads = design.tolerances.heads.HeadSettings(layout, settings.range, settings.calibrate)
    robust = design.tolerances.robust.robust_layout(optimum.problem, heads, optimum.best)
    percent = f"{100 * layout.production:g} %"
    if not robust.result.found:
        refuse(f"No layout was found of whose heads {percent} meet all requirements; with margins "
               f"of {robust.factor:.3g} of their spreads these exclude each other:",
               robust.result)  # fmt: skip
    was = design.results.tables.objective_text(layout.aim, optimum.best.objective)
    print(
        f"Spots, light and limits have margins of {robust.factor:.3g} of the spreads that the "
        f"tolerances give them, for {percent} of the heads (predicted "
        f"{100 * robust.within_limits:.1f} %, {count_text(robust.rounds, 'round')}).\n"
        f"For perfect heads alone the objective would be: {was}\n"
    )
    return replace(optimum, results=[robust.result, *optimum.results], problem=robust.problem)


def write_layout(
    settings: Config, optimum: Optimum, rounded: Rounded | None, path: Path
) -> Config | str:
    """Write the configuration of the layout; return the reason if it does not load."""
    x = optimum.best.x if rounded is None else rounded.x
    about = files.provenance.provenance_header(settings, settings.layout.seed)
    if optimum.tried:
        about["parts"] = " ".join(filter(None, optimum.tried[0][0].names))
    sensor = design.variables.sensor_of(optimum.sensor, optimum.names, x)
    remarks = design.results.tables.roundings(rounded, optimum.names)
    return design.results.changes.write_design(settings, sensor, path, about, remarks)
