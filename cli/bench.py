"""`facets bench`: run time against error."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import facets
from facets import bench as benchmarks, core, files

from .console import show_table
from .options import Force, Quick, folder_option, seed_option

TABLE = "bench.csv"
#: Headings of the printed columns.
HEADINGS = {
    "us": "µs a pose",
    "spread": "+- %",
    "to_c": "over C",
    "to_numpy": "over NumPy",
    "error_mm": "error, mm",
    "error_rad": "error, rad",
}


def bench(
    folder: Annotated[Path, folder_option("")] = Path("results/bench"),
    force: Force = False,
    quick: Quick = False,
    seed: Annotated[int, seed_option()] = 1,
) -> None:
    """Measure run times and errors, and compare with other methods.

        facets bench --quick

    All methods run in turn on the paper's sensor: this package, the C that it exports (if gcc
    is installed), a quadrature in NumPy, SciPy's fsolve and the paper's way. Tables and a
    recording are solved, too. Ratios are relative to the exported C and to NumPy; rows of a full
    run that are slower than stored, beyond their error bars, are named. Writes one table with the
    facts of the machine into the folder. --quick takes under half a minute.
    """
    core.extras.require_extra("mpmath", "facets bench")
    files.tables.refuse_to_overwrite([folder / TABLE], force)
    rows = benchmarks.table.measure(quick, seed)
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    files.tables.write_table(folder / TABLE, columns, facts(seed))
    for task in dict.fromkeys(columns["task"]):
        cells = [cells_of(row) for row in rows if row["task"] == task]
        show_table(task, ["way", *HEADINGS.values()], cells, left_columns=[0])
    if not benchmarks.rivals.has_compiler():
        print("The exported C was left out: gcc is not installed.")
    if not quick:  # its short batches take longer
        for sentence in benchmarks.table.slower_rows(rows):
            print(sentence)
    print(f"{folder / TABLE}: processor times")


def cells_of(row: dict[str, Any]) -> list[str]:
    """The printed cells of a row of the table."""
    numbers = (100 * row[name] if name == "spread" else row[name] for name in HEADINGS)
    return [row["way"], *("" if math.isnan(number) else f"{number:.3g}" for number in numbers)]


def facts(seed: int) -> dict[str, str]:
    """Facts about the run and the machine."""
    import platform
    from importlib.metadata import version

    from llvmlite.binding import get_host_cpu_name

    return {
        "facets": facets.__version__,
        "command": files.provenance.command_line(),
        "seed": str(seed),
        "processor": get_host_cpu_name(),
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "scipy", "llvmlite", "mpmath")},
    }
