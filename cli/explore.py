"""`facets explore`: a design space, on all cores or a cluster, and its Pareto front."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from facets import design, files, pictures
from facets.core.errors import InputError

from .console import load_config
from .options import (
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Style,
    Table,
    TableKind,
    completion,
    folder_option,
    output_folder,
    output_option,
    report_option,
    require_html,
    seed_option,
)
from .parts.design_space import Exploration, follow_front, sample, write, write_pick

GOALS = ("head_mm", "u_roll_urad", "range_roll_mrad")


Objectives = Annotated[
    list[str] | None,
    typer.Option(
        metavar="MEASURE",
        help="Quantity to optimise, such as head_mm, u_tx_um or range_tx_mm; can be repeated.  "
        f"[default: {', '.join(GOALS)}]",
        autocompletion=completion.words(completion.measures),
    ),
]
Required = Annotated[
    bool,
    typer.Option(
        "--required", help="Use only designs that meet all requirements of the block `optimize`."
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Address of the scheduler of a Dask cluster.  [default: all cores of this machine]",
    ),
]
Front = Annotated[
    bool,
    typer.Option(
        "--front",
        help="Follow the Pareto front by continuation instead of sampling designs, with the "
        "exchange rate between the objectives; the picture has the folder's sampled designs, too.",
    ),
]
Report = Annotated[
    Path | None,
    report_option(
        "interactive plots, and each design's drawing and YAML; it needs the extra `pages`"
    ),
]
Pick = Annotated[
    int | None,
    typer.Option(
        min=0,
        metavar="N",
        help="Write a configuration (-o) of design N in the folder of an earlier run, instead of "
        "exploring: column `design` of front.csv, or with --front column `point` of pareto.csv.",
    ),
]
Picked = Annotated[
    Path | None, output_option("configuration of the design of --pick, YAML", "CONFIG-N.yaml")
]
Points = Annotated[
    int,
    typer.Option(
        min=3, max=10_000, help="Approximate number of points on the front, with --front."
    ),
]
Number = Annotated[
    int, typer.Option(min=2, max=10**9, help="Number of designs to sample, by a Sobol' sequence.")
]


def explore(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG-explore")] = None,
    designs: Number = 1000,
    seed: Annotated[int, seed_option()] = 1,
    objective: Objectives = None,
    required: Required = False,
    scheduler: Scheduler = None,
    force: Force = False,
    table: Table = TableKind.parquet,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
    front: Front = False,
    points: Points = 100,
    report: Report = None,
    pick: Pick = None,
    output: Picked = None,
) -> None:
    """Sample a design space and find its Pareto front.

        facets explore layout --designs 5000
        facets explore layout --pick 17 -o chosen.yaml

    Varies the parameters in `optimize.variables`, and computes the ranges and uncertainties of each
    design and which designs no other one beats in all objectives. The results are written part by
    part: the same command continues an interrupted run, and --force starts again. Exit status 1 if
    no design has all objectives.
    """
    settings = load_config(config)
    goals = objective or GOALS
    space = design.exploration.space.space_of(settings, goals, designs, seed, required)
    place = output_folder(folder, settings.name, "explore")
    if pick is not None:
        source = place / ("pareto.csv" if front else "front.csv")
        write_pick(settings, space, source, pick, output, force)
        return
    if output is not None:
        raise InputError(f"-o {output}: -o is the file that --pick writes; the folder is --folder")
    require_page(report, force)
    design.exploration.runs.require_same(settings, place, force)
    job = Exploration(settings, space, place, plot.value, report)
    if front:
        follow_front(job, points)
        return
    begin = time.perf_counter()
    names = (f"designs.{table.value}", "front.csv", f"front.{plot.value}")
    paths = [place / name for name in names]
    sample(job, paths, scheduler, force)
    write(job, paths, time.perf_counter() - begin)


def require_page(report: Path | None, force: bool) -> None:
    """Refuse a page that cannot be written, before any computation."""
    if report is not None:
        require_html(report)
        files.tables.refuse_to_overwrite([report], force)
        pictures.exploration_page.plotly_text()
