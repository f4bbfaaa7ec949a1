"""`facets optimize`: the best layout for a volume, as a configuration."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from facets import config as configuration, core, design, files

from .console import FINDING, draw_extra, load_config
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
from .options.places import choose_point
from .parts.layout_search import layout_for_yield, rounded_layout, search, write_layout
from .sentences.certificate import prove_design
from .sentences.design_pages import NewLayout, show_layout, write_report

REPORT = "the layout and its drawing, with a 3D scene in FILE.gltf"


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
    report: Annotated[Path | None, report_option(REPORT)] = None,
    heads: Annotated[int, heads_option("0 skips the simulation")] = 0,
    point: Point = None,
) -> None:
    """Find the layout that meets a requirement best.

        facets optimize layout
        facets optimize parts --heads 200 --report layout.html

    The requirement is the block `optimize` of the configuration. The command varies the parameters
    in `optimize.variables` within their bounds, from several starting layouts, and with every
    combination of parts from the catalogue, if there is one. It prints which requirements limit the
    optimum; if no layout meets all of them, it prints which exclude each other and ends with exit
    status 1. It writes a configuration that extends CONFIG by the new values, rounded to values
    that can be manufactured, and a table and a picture that compare it with CONFIG. With
    `optimize.production.yield_percent` the layout has margins, so that this percentage of the
    manufactured heads meets the requirements. With an object in the configuration or --point, the
    volume, the ranges and the uncertainties are those of the object's displacement from its pose at
    the mirror's zero.
    """
    core.extras.require_extra("casadi", "the search for a layout")
    if certify:
        core.extras.require_extra("flint", "--certify")
    settings = choose_point(load_config(config), point)
    design.variables.require_variables(settings.layout, settings.name)
    path = output or Path(f"{settings.name}-optimum.yaml")
    require_yaml(path)
    paths = [path.with_suffix(ending) for ending in (".csv", f".{plot.value}")]
    pages = []
    if report:
        require_html(report)
        pages += [report, report.with_suffix(".gltf")]
    sources = configuration.source_files(settings)
    files.tables.refuse_to_overwrite([path, *paths, *pages], force, sources)
    optimum = layout_for_yield(settings, search(settings))
    rounded = rounded_layout(optimum)
    with files.tables.ResultSet():
        better = write_layout(settings, optimum, rounded, path)
        if not isinstance(better, str):
            proved = prove_design(better, certify)
            layout = NewLayout(settings, optimum, rounded, better)
            table, sections = show_layout(layout, paths, proved, heads)
            if report:
                draw_extra(report, write_report, layout, table, sections, *pages)
    if isinstance(better, str):
        print(f"{path} is written, but does not load:\n{better}", file=sys.stderr)
        raise typer.Exit(FINDING)
    print(", ".join([str(path), *(file.name for file in (*paths, *pages) if file.exists())]))
