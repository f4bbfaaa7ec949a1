"""`facets resolution`: how fine the sensor measures, and what limits it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import characterization, core, estimation, files, pictures
from facets.core.names import POSE

from .console import FINDING, load_config, name_files, report_coverage, report_lines, show_table
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
    seed_option,
)
from .options.places import choose_point, object_rules, report_object
from .parts.trials import DEFAULT_COVERAGE, PosesTable, TrialCount, TrialRequest

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
    trials: TrialCount = 0,
    poses: PosesTable = None,
    seed: Annotated[int, seed_option()] = 1,
) -> None:
    """Compute each axis's uncertainty, at rest and at worst.

    Prints standard uncertainties (1 sigma): at rest; at the worst pose of each axis's own symmetric
    range, with the other axes at rest; and at the worst pose anywhere in the box that `range-map`
    prints, all axes at once. Both are searched. They are computed for the paper's inversion
    and for the least-squares solver with the beam's position free, known within
    `solve.beam_sigma_um`, and known exactly. Writes a table, a picture of the noise budget at
    rest and a record of the run into the folder. --coverage adds expanded uncertainties. With an
    object in the configuration or --point, the axes are those of the object's displacement from its
    pose at the mirror's zero.

    --trials tests these linear results by propagation of distributions: it draws readings, priors
    and calibrated parameters, solves each trial by the full model as `solve` in CONFIG says, and
    writes coverage intervals and a picture. Exit status 1 if more trials have no pose than the
    coverage probability leaves.
    """
    start = time.perf_counter()
    settings = choose_point(load_config(config), point)
    about = files.provenance.provenance_header(settings)
    if coverage is not None:
        about |= estimation.coverage.describe_coverage(settings.sensor, coverage)
    rules = object_rules(settings, track)
    place = output_folder(folder, settings.name, "resolution")
    paths = [place / "resolution.csv", place / f"budget.{plot.value}", place / "run.yaml"]
    request = TrialRequest(settings, rules, trials, coverage or DEFAULT_COVERAGE, seed, poses)
    pictured = request.paths(place, plot)
    files.tables.refuse_to_overwrite([*paths, *pictured], force, [poses])
    states = request.states()
    found = characterization.resolution.resolve(
        settings.sensor, rules, characterization.resolution.estimators(settings.solve.beam_sigma)
    )
    report_object(settings)
    show(found, coverage)
    if coverage is not None:
        report_coverage(about)
    propagated = request.run(states)
    table, picture, record = paths
    with files.tables.ResultSet():
        files.tables.write_table(
            table,
            characterization.tables.resolution_columns(found, coverage),
            about,
        )
        pictures.style.save(pictures.resolution.budget_picture(found), picture)
        results: dict[str, Any] = {
            "tracking": track,
            "estimators": [row.how.name for row in found],
        }
        request.write(pictured, propagated)
        results |= request.record(propagated)
        seconds = time.perf_counter() - start
        files.provenance.write_record(
            record, settings, seed if trials else None, seconds, results, [*paths, *pictured]
        )
    name_files(place, [*paths, *pictured])
    if not all(one.is_stated for one in propagated.values()):
        raise typer.Exit(FINDING)


def show(found: list[Resolution], coverage: float | None = None) -> None:
    headings = ["", *(f"{name} {core.units.unit_of(name).fine_unit}" for name in POSE)]
    kind = "standard uncertainty, 1 sigma"
    if coverage is not None:
        kind = f"expanded uncertainty, {100 * coverage:g} %"
    places = (
        ("at rest", "nominal"),
        ("at worst over each axis's own range", "worst"),
        ("at worst anywhere in the box", "worst_in_box"),
    )
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
    box = [
        f"{name} {core.units.unit_of(name).factor * half:.4g} {core.units.unit_of(name).unit}"
        for name, half in zip(POSE, found[0].box, strict=True)
    ]
    report_lines(f"The box, +-, all six axes at once: {', '.join(box)}.")
    finer = found[0].worst / found[-1].worst
    gains = ", ".join(f"{name} {gain:.3g}" for name, gain in zip(POSE, finer, strict=True))
    typer.echo(f"with the beam known, finer than the paper's inversion by: {gains}\n")
