"""`facets resolution`: how fine the sensor measures, and what limits it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facets import characterization, core, estimation, files, pictures
from facets.core.names import POSE

from .console import load_config, name_files, report_coverage, show_table
from .options import (
    ConfigName,
    Coverage,
    Force,
    Look,
    Plot,
    PlotKind,
    Point,
    Style,
    Track,
    folder_option,
    output_folder,
)
from .places import choose_point, object_rules, report_object

if TYPE_CHECKING:
    from facets.characterization.resolution import Resolution


def resolution(
    config: ConfigName,
    track: Track = False,
    folder: Annotated[Path | None, folder_option("results/CONFIG-resolution")] = None,
    force: Force = False,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
    coverage: Coverage = None,
    point: Point = None,
) -> None:
    """Compute each axis's uncertainty, at rest and at worst.

    Prints standard uncertainties (1 sigma). The worst pose is searched along the symmetric
    range of each axis, with the other axes at rest. They are computed for the paper's inversion
    and for the least-squares solver with the beam's position free, known within
    `solve.beam_sigma_um`, and known exactly. Writes a table, a picture of the noise budget at
    rest and a record of the run into the folder. --coverage adds expanded uncertainties. With an
    object in the configuration or --point, the axes are those of the object's displacement from its
    pose at the mirror's zero.
    """
    start = time.perf_counter()
    settings = choose_point(load_config(config), point)
    about = files.provenance.provenance_header(settings)
    if coverage is not None:
        about |= estimation.coverage.describe_coverage(settings.sensor, coverage)
    rules = object_rules(settings, track)
    place = output_folder(folder, settings.name, "resolution")
    paths = [place / "resolution.csv", place / f"budget.{plot.value}", place / "run.yaml"]
    files.tables.refuse_to_overwrite(paths, force)
    found = characterization.resolution.resolve(
        settings.sensor, rules, characterization.resolution.estimators(settings.solve.beam_sigma)
    )
    report_object(settings)
    show(found, coverage)
    if coverage is not None:
        report_coverage(about)
    table, picture, record = paths
    with files.tables.ResultSet():
        files.tables.write_table(
            table,
            characterization.tables.resolution_columns(found, coverage),
            about,
        )
        pictures.style.save(pictures.resolution.budget_picture(found), picture)
        results = {"tracking": track, "estimators": [row.how.name for row in found]}
        seconds = time.perf_counter() - start
        files.provenance.write_record(record, settings, None, seconds, results, paths)
    name_files(place, paths)


def show(found: list[Resolution], coverage: float | None = None) -> None:
    headings = ["", *(f"{name} {core.units.unit_of(name).fine_unit}" for name in POSE)]
    kind = "standard uncertainty, 1 sigma"
    if coverage is not None:
        kind = f"expanded uncertainty, {100 * coverage:g} %"
    places = (("at rest", "nominal"), ("at worst in the range of each axis", "worst"))
    for number, (title, field) in enumerate(places):
        rows = []
        for row in found:
            factor = 1.0 if coverage is None else row.coverage(coverage)[number][1]
            values = zip(POSE, factor * getattr(row, field), strict=True)
            cells = [
                f"{core.units.unit_of(name).fine_factor * value:.3g}" for name, value in values
            ]
            rows.append([row.how.name, *cells])
        show_table(f"{kind}, {title}", headings, rows)
    finer = found[0].worst / found[-1].worst
    gains = ", ".join(f"{name} {gain:.3g}" for name, gain in zip(POSE, finer, strict=True))
    typer.echo(f"with the beam known, finer than the paper's inversion by: {gains}\n")
