"""`facets explore`: a design space, on all cores or a cluster, and its Pareto front."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .simulate import PlotKind

if TYPE_CHECKING:
    from facets.design.exploration import Space


class Draw(StrEnum):
    sobol = "sobol"
    lhs = "lhs"
    grid = "grid"


def explore(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder.  [default: results/CONFIG-explore]"),
    ] = None,
    designs: Annotated[int, typer.Option(min=1, help="How many, at least.")] = 1000,
    sampling: Annotated[Draw, typer.Option(help="How they are drawn.")] = Draw.sobol,
    seed: Annotated[int, typer.Option(min=0, help="Of the draw.")] = 1,
    objective: Annotated[
        list[str] | None,
        typer.Option(help="May be given again.  [default: head_mm, u_roll_urad, range_roll_mrad]"),
    ] = None,
    every: Annotated[
        bool, typer.Option("--every", help="Look also at designs that cannot be on the front.")
    ] = False,
    required: Annotated[
        bool, typer.Option("--required", help="Only what keeps all that `optimize` asks for.")
    ] = False,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask cluster, else all cores here.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Begin anew in an old folder.")] = False,
    plot: Annotated[PlotKind, typer.Option(help="Kind of the picture.")] = PlotKind.png,
) -> None:
    """Explore a design space: ranges and resolutions of many layouts, and the best of them.

    Varies what the config's `optimize.variables` names. Results are written part by part: the same
    command goes on where a run was cut off. A design that cannot be on the front any more is not
    asked for its ranges, which take most of the time.
    """
    import time

    from facets import load
    from facets.design.exploration import Space, collected, front, require_measures, sensitivity
    from facets.design.exploration import explore as run
    from facets.files import provenance, tables
    from facets.pictures import style
    from facets.pictures.exploration import front_picture

    settings = load(config)
    goals = objective or ["head_mm", "u_roll_urad", "range_roll_mrad"]
    require_measures(goals)
    space = Space(
        settings.sensor, settings.range, settings.layout, sampling.value, designs, seed,
        tuple(goals), every, required,
    )  # fmt: skip
    folder = output or Path("results") / f"{settings.name}-explore"
    about = provenance.about(settings, seed)
    prepare(folder, identity(about, space), force)
    start = time.perf_counter()
    with_progress(lambda tell: run(space, folder, about, scheduler, tell))
    seconds = time.perf_counter() - start
    table = collected(folder)
    best = front(table, goals)
    pilot = {name: column[: space.pilot] for name, column in table.items()}
    indices = sensitivity(pilot, space.names, goals)
    tables.write_table(folder / "designs.parquet", table, about)
    tables.write_table(folder / "front.csv", {n: c[best] for n, c in table.items()}, about)
    style.save(front_picture(table, best, goals, indices), folder / f"front.{plot.value}")
    report(table, best, goals, indices, seconds)
    typer.echo(f"{folder}/: designs.parquet, front.csv, front.{plot.value}")


def identity(about: dict[str, str], space: Space) -> str:
    """What must be the same for a run to go on in a folder."""
    asked = f"{space.sampling} {space.count} {space.seed} {space.every} {space.required}"
    return f"{about['config_sha256']} {asked} {' '.join(space.objectives)}\n"


def prepare(folder: Path, mine: str, force: bool) -> None:
    """A new folder, or an old one of the same search."""
    import shutil

    from facets.core.errors import OutputError

    mark = folder / "search.txt"
    if force and mark.exists():
        shutil.rmtree(folder / "parts", ignore_errors=True)
        mark.unlink()
    if mark.exists() and mark.read_text() != mine:
        raise OutputError(
            f"{folder}: holds another search; --force begins anew, -o names another folder"
        )
    folder.mkdir(parents=True, exist_ok=True)
    mark.write_text(mine)


def with_progress(run: Any) -> None:
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("exploring", total=None)
        run(lambda done, whole: progress.update(task, completed=done, total=whole))


def report(
    table: dict[str, Any], best: Any, goals: list[str], indices: dict[str, Any], seconds: float
) -> None:
    import numpy as np

    skipped, spent = table["skipped"], table["seconds"]
    typer.echo(f"{len(skipped)} designs, {seconds:.1f} s in this run")
    full = np.median(spent[skipped == ""]) if (skipped == "").any() else np.nan
    for reason in np.unique(skipped):
        each = spent[skipped == reason]
        saved = f", {full * len(each) - each.sum():.0f} core seconds saved" if reason else ""
        told = f"{1e3 * np.median(each):.2f} ms each{saved}"
        typer.echo(f"  {len(each):7} {reason or 'looked at'} ({told})")
    typer.echo(f"{int(best.sum())} are beaten by none in {', '.join(goals)}")
    for name, found in indices.items():
        shown = ", ".join(f"{key} {value:.2f}" for key, value in found.items())
        typer.echo(f"  {name} follows: {shown}")
