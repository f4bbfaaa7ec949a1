"""`facets bench`: run time against error."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

import facets
from facets import bench as benchmarks
from facets import core, files

from .console import show_table
from .options import Force, Quick, folder_option, seed_option

TABLE = "bench.csv"


def bench(
    folder: Annotated[Path, folder_option("")] = Path("results/bench"),
    force: Force = False,
    quick: Quick = False,
    seed: Annotated[int, seed_option()] = 1,
) -> None:
    """Measure run times and errors, and compare with other methods.

    All methods run in turn on the paper's sensor: this package, the C that it exports (if gcc
    is installed), a quadrature in NumPy, SciPy's solvers and the paper's way. Ratios are
    relative to this package. Writes one table with the facts of the machine into the folder.
    --quick takes under a minute.
    """
    core.extras.require_extra("mpmath", "facets bench")
    files.tables.refuse_to_overwrite([folder / TABLE], force)
    rows = benchmarks.table.measure(quick, seed)
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    files.tables.write_table(folder / TABLE, columns, facts(seed))
    for task in dict.fromkeys(columns["task"]):
        cells = [
            [row["way"], *("" if math.isnan(x) else f"{x:.3g}" for x in list(row.values())[2:])]
            for row in rows
            if row["task"] == task
        ]
        show_table(task, ["way", "µs a pose", "ratio", "error, mm", "error, rad"], cells, left=[0])
    if not benchmarks.rivals.has_compiler():
        typer.echo("The exported C was left out: gcc is not installed.")
    typer.echo(f"{folder / TABLE}: processor times; ratios are to the first row of each task")


def facts(seed: int) -> dict[str, str]:
    """Facts about the run and the machine."""
    import platform
    from importlib.metadata import version

    return {
        "facets": facets.__version__,
        "command": files.provenance.command_line(),
        "seed": str(seed),
        "processor": processor(),
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "scipy", "llvmlite", "mpmath")},
    }


def processor() -> str:
    """The processor's name, if the system states it."""
    import platform

    listing = Path("/proc/cpuinfo")
    if listing.is_file():
        for line in listing.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
