"""`facets resolution`: how fine the sensor measures, and what limits it."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import load_config, name_files, show_table
from .options import (
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Style,
    Track,
    folder_option,
    output_folder,
)

if TYPE_CHECKING:
    from facets.characterization.resolution import Resolution


def resolution(
    config: ConfigName,
    track: Track = False,
    folder: Annotated[Path | None, folder_option("results/CONFIG-resolution")] = None,
    force: Force = False,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
) -> None:
    """Compute the standard uncertainty of each axis, at rest and at the worst pose.

    The worst pose is searched along the symmetric range of each axis, with the other axes at rest.
    They are computed for the paper's inversion and for the least-squares solver with the
    beam's position free, known within `solve.beam_sigma_um`, and known exactly. Writes a table, a
    picture of the noise budget at rest and a record of the run into the folder.
    """
    from facets.characterization.resolution import estimators, resolve
    from facets.characterization.tables import resolution_columns
    from facets.files import provenance, tables
    from facets.pictures import resolution as drawing
    from facets.pictures import style

    start = time.perf_counter()
    settings = load_config(config)
    rules = replace(settings.range, tracking=track)
    place = output_folder(folder, settings.name, "resolution")
    files = [place / "resolution.csv", place / f"budget.{plot.value}", place / "run.yaml"]
    tables.refuse_to_overwrite(files, force)
    found = resolve(settings.sensor, rules, estimators(settings.solve.beam_sigma))
    show(found)
    table, picture, record = files
    with tables.ResultSet():
        tables.write_table(table, resolution_columns(found), provenance.about(settings))
        style.save(drawing.budget_picture(found), picture)
        results = {"tracking": track, "estimators": [row.how.name for row in found]}
        seconds = time.perf_counter() - start
        provenance.write_record(record, settings, None, seconds, results, files)
    name_files(place, files)


def show(found: list[Resolution]) -> None:
    from facets.core.names import POSE
    from facets.core.units import unit_of

    headings = ["", *(f"{name} {unit_of(name).fine_unit}" for name in POSE)]
    for title, field in (("at rest", "nominal"), ("at worst in the range of each axis", "worst")):
        rows = []
        for row in found:
            values = zip(POSE, getattr(row, field), strict=True)
            cells = [f"{unit_of(name).fine_factor * value:.3g}" for name, value in values]
            rows.append([row.how.name, *cells])
        show_table(f"standard uncertainty, 1 sigma, {title}", headings, rows)
    finer = found[0].worst / found[-1].worst
    gains = ", ".join(f"{name} {gain:.3g}" for name, gain in zip(POSE, finer, strict=True))
    typer.echo(f"with the beam known, finer than the paper's inversion by: {gains}\n")
