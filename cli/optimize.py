"""`facets optimize`: the best layout for a volume, as a configuration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from facets import config as configuration
from facets import design, files

from .console import FINDING, load_config, show_progress, show_table
from .options import (
    Certify,
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Point,
    Style,
    heads_option,
    output_option,
    report_option,
    require_html,
    require_yaml,
)
from .options.places import choose_point, report_object
from .sentences.certificate import prove_design
from .sentences.design_pages import NewLayout, show_layout, write_report, write_tables

if TYPE_CHECKING:
    from facets.config import Config
    from facets.design.problem import StartResult
    from facets.design.rounding import Rounded
    from facets.design.search import Optimum


#: Maximum number of choices of parts in a table.
SHOWN = 24

SHEETS = "File for all tables of the result: LaTeX (.tex) or a workbook (.xlsx, extra `sheets`)."
EXACT = "Write the optimum without rounding its numbers to values that can be manufactured."
REPORT = "the layout and its drawing, with a 3D scene beside it (FILE.gltf)"


def optimize(
    config: ConfigName,
    output: Annotated[
        Path | None,
        output_option("configuration with the optimal layout, YAML", "CONFIG-optimum.yaml"),
    ] = None,
    force: Force = False,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
    certify: Certify = 400,
    exact: Annotated[bool, typer.Option("--exact", help=EXACT)] = False,
    report: Annotated[Path | None, report_option(REPORT)] = None,
    heads: Annotated[int, heads_option("0 skips the simulation")] = 0,
    sheets: Annotated[Path | None, typer.Option("--sheets", metavar="FILE", help=SHEETS)] = None,
    point: Point = None,
) -> None:
    """Find the layout that meets a requirement best.

    The requirement is the block `optimize` of the configuration.

    Varies the parameters named there within their bounds, from several starting layouts, and with
    every combination of parts from the catalogue, if there is one. Prints which requirements limit
    the optimum; if no layout meets all of them, prints which exclude each other and ends with exit
    status 1. Writes a configuration that extends CONFIG by the new values, rounded to values that
    can be manufactured, and beside it a table and a picture that compare it with CONFIG. With
    `optimize.production.yield_percent` the layout has margins, so that this share of the
    manufactured heads meets the requirements. With an object in the configuration or --point, the
    volume, the ranges and the uncertainties are those of the object's displacement from its pose at
    the mirror's zero.
    """
    settings = choose_point(load_config(config), point)
    path = output or Path(f"{settings.name}-optimum.yaml")
    require_yaml(path)
    paths = [path.with_suffix(ending) for ending in (".csv", f".{plot.value}")]
    pages = []
    if report:
        require_html(report)
        pages += [report, report.with_suffix(".gltf")]
    if sheets:
        design.sheets.require_writable(sheets)
        pages.append(sheets)
    sources = configuration.source_files(settings)
    files.tables.refuse_to_overwrite([path, *paths, *pages], force, sources)
    optimum = layout_for_yield(settings, search(settings))
    rounded = None if exact else rounded_layout(optimum)
    with files.tables.ResultSet():
        better = write_layout(settings, optimum, rounded, path)
        if not isinstance(better, str):
            proved = prove_design(better, certify)
            layout = NewLayout(settings, optimum, rounded, better)
            table, sections = show_layout(layout, paths, proved, heads)
            if report:
                write_report(layout, table, sections, *pages[:2])
            if sheets:
                write_tables(settings, sections, sheets)
    if isinstance(better, str):
        typer.echo(f"{path} is written, but does not load:\n{better}", err=True)
        raise typer.Exit(FINDING)
    typer.echo(", ".join([str(path), *(file.name for file in (*paths, *pages))]))


def search(settings: Config) -> Optimum:
    """Find the best layout; print all choices of parts and all starts; exit status 1 if no layout
    meets all requirements."""
    with show_progress("searching") as tell:
        optimum = design.search.optimize(settings.sensor, settings.layout, tell)
    if optimum.tried:
        headings, rows = design.tables.part_rows(optimum)
        left = (0, 1, 2, len(headings) - 1)
        show_table("parts, the best first", headings, rows[:SHOWN], left=left)
        if len(rows) < optimum.choices or len(rows) > SHOWN:
            typer.echo(
                f"{len(rows)} of {optimum.choices} choices were tried; the others cannot be "
                "better, or do not meet all requirements\n"
            )
    headings, rows = design.tables.start_rows(optimum)
    report_object(settings)
    show_table("starts, the best first", headings, rows, left=(len(headings) - 1,))
    if not optimum.best.found:
        words = "no layout meets all that is asked for; these stand against each other:"
        refuse(words, optimum.best)
    return optimum


def refuse(words: str, result: StartResult) -> NoReturn:
    """Print the conflicting requirements and end."""
    typer.echo(words)
    for group, gap in result.shortfalls.items():
        typer.echo(f"  {group}: would have to give way by {100 * gap:.3g} % of its limit")
    raise typer.Exit(FINDING)


def rounded_layout(optimum: Optimum) -> Rounded | None:
    """Round the layout to manufacturable values; None if only the exact layout meets all."""
    rounded = design.rounding.round_design(optimum.problem, optimum.best.x)
    if rounded is None:
        typer.echo(
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
    known = (layout, settings.range, settings.calibrate)
    robust = design.robust.robust_layout(optimum.problem, *known, optimum.best)
    share = f"{100 * layout.production:g} %"
    if not robust.result.found:
        refuse(f"no layout was found of whose heads {share} keep all that is asked for; with "
               f"margins of {robust.factor:.3g} of their spreads these stand against each other:",
               robust.result)  # fmt: skip
    was = design.report.objective_text(layout.aim, optimum.best.objective)
    typer.echo(
        f"for {share} of the heads spots, light and limits are kept with {robust.factor:.3g} of "
        f"the spreads that the tolerances give them (predicted {100 * robust.kept:.1f} %, "
        f"{robust.rounds} rounds);\nfor perfect heads alone it would be: {was}\n"
    )
    return replace(optimum, results=[robust.result, *optimum.results], problem=robust.problem)


def write_layout(
    settings: Config, optimum: Optimum, rounded: Rounded | None, path: Path
) -> Config | str:
    """Write the configuration of the layout; return the reason if it does not load."""
    x = optimum.best.x if rounded is None else rounded.x
    about = files.provenance.provenance_header(settings, settings.layout.seed)
    if optimum.tried:
        about["parts"] = optimum.tried[0][0].names
    sensor = design.variables.sensor_of(optimum.sensor, optimum.names, x)
    remarks = design.tables.roundings(rounded, optimum.names)
    return design.changes.write_design(settings, sensor, path, about, remarks)
