"""`facets resolution`: how fine the sensor measures, and what limits it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .simulate import PlotKind

if TYPE_CHECKING:
    from facets.characterization.resolution import Resolution


def resolution(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    tracking: Annotated[
        bool, typer.Option("--tracking/--fixed", help="Whether the beam follows in x and y.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Folder for the results.  [default: results/CONFIG-resolution]"
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace older results.")] = False,
    plot: Annotated[PlotKind, typer.Option(help="Kind of the picture.")] = PlotKind.png,
) -> None:
    """Tell standard uncertainties of the six axes, at rest and at worst.

    At worst: along each axis's symmetric range, the others at rest, as the paper takes it. For the
    paper's inversion and for ours with the beam's place free, known within the config's
    `beam_sigma_um`, and known. Also which source each uncertainty at rest comes from.
    """
    import time

    from facets import load
    from facets.characterization.resolution import estimators, resolve
    from facets.files import provenance, tables
    from facets.pictures import ranges, style

    settings = load(config)
    rules = replace(settings.range, tracking=tracking)
    folder = output or Path("results") / f"{settings.name}-resolution"
    table, picture = folder / "resolution.csv", folder / f"budget.{plot.value}"
    story = folder / "run.yaml"
    tables.refuse_to_overwrite([table, picture, story], force)
    start = time.perf_counter()
    found = resolve(settings.sensor, rules, estimators(settings.solve.beam_sigma))
    show(found)
    tables.write_table(table, columns(found), provenance.about(settings))
    style.save(ranges.budget_picture(found), picture)
    results = {"tracking": tracking, "estimators": [row.how.name for row in found]}
    provenance.write_record(story, settings, None, time.perf_counter() - start, results)
    typer.echo(f"{folder}/: {table.name}, {picture.name}, {story.name}")


def show(found: list[Resolution]) -> None:
    from rich.console import Console
    from rich.table import Table

    from facets.core.names import POSE
    from facets.pictures.style import unit_of

    console = Console(highlight=False)
    for title, field in (("at rest", "nominal"), ("at worst in the range of each axis", "worst")):
        table = Table(title=f"standard uncertainty, 1 sigma, {title}", box=None)
        table.title_justify, table.title_style = "left", "bold"
        table.add_column("")
        for name in POSE:
            table.add_column(f"{name} {unit_of(name)[2]}", justify="right", no_wrap=True)
        for row in found:
            values = getattr(row, field)
            cells = [f"{unit_of(n)[3] * v:.3g}" for n, v in zip(POSE, values, strict=True)]
            table.add_row(row.how.name, *cells)
        console.print(table, "")
    finer = found[0].worst / found[-1].worst
    gains = ", ".join(f"{name} {gain:.3g}" for name, gain in zip(POSE, finer, strict=True))
    console.print(f"with the beam known, finer than the paper's inversion by: {gains}\n")


def columns(found: list[Resolution]) -> dict[str, Any]:
    """A row an estimator and axis; um and urad."""
    import numpy as np

    from facets.core.names import POSE, STATE_COLUMNS, STATE_UNITS
    from facets.pictures.style import unit_of

    rows: list[dict[str, Any]] = []
    for row in found:
        for i, name in enumerate(POSE):
            factor, unit = unit_of(name)[3], unit_of(name)[2].replace("µ", "u")
            worst_at = row.worst_state[i] / STATE_UNITS
            rows.append(
                {
                    "estimator": row.how.name.replace("µ", "u"),
                    "axis": name,
                    "unit": unit,
                    "u_at_rest": factor * row.nominal[i],
                    "u_worst": factor * row.worst[i],
                    "u_expanded_worst": 2 * factor * row.worst[i],
                    **{
                        f"share_of_{source.replace(' ', '_')}": row.shares[i, s]
                        for s, source in enumerate(row.sources)
                    },
                    **{f"worst_at_{c}": worst_at[k] for k, c in enumerate(STATE_COLUMNS)},
                }
            )
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}
