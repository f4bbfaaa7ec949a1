"""`facets bench`: run time against error."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

import facets
from facets import bench as benchmarks
from facets import core, files, model

from .console import draw_beside, show_table
from .options import Force, Look, Quick, Style, folder_option, seed_option

#: Module and title of each study.
STUDIES = {
    "forward": ("studies", "readings: time a pose against error"),
    "inverse": ("studies", "poses: time against error, eight unknowns from nine readings"),
    "calls": ("calls", "what a call costs, beside a reference loop and the ratio stored for it"),
    "light": ("light", "the light of a bench: time a pose, beside ideal light"),
    "starts": ("starts", "starts and first uses, nothing compiled before, and the next ones"),
    "live": ("live", "a live run at 10 kHz: from a byte to its pose"),
    "apertures": ("apertures", "cut light: time a pose, beside that of uncut light"),
    "stability": ("stability", "errors over apex offset and tilt, against high precision"),
}
PICTURE = "stability.png"


def bench(
    folder: Annotated[Path, folder_option("")] = Path("results/bench"),
    force: Force = False,
    quick: Quick = False,
    seed: Annotated[int, seed_option()] = 1,
    look: Style = Look.screen,
) -> None:
    """Measure run times and errors, and compare with other methods.

    All methods run in turn on the paper's sensor; ratios are relative to this package. Writes a
    table for each study, the facts of the machine (machine.json) and a picture into the
    folder. --quick takes under a minute.
    """
    core.extras.require_extra("mpmath", "facets bench")
    names = [*(f"{name}.csv" for name in STUDIES), "machine.json", PICTURE]
    files.tables.refuse_to_overwrite([folder / name for name in names], force)
    about = facts(seed)
    with files.tables.ResultSet():
        results = {name: run_study(name, quick, seed, folder, about) for name in STUDIES}
        text = json.dumps({"about": about, **results}, indent=1)
        files.whole.write_text(folder / "machine.json", text)
        draw_beside(folder / PICTURE, benchmarks.pictures.heat_map, results["stability"])
    typer.echo(f"{folder}/: {', '.join(names)}")


def run_study(
    name: str, quick: bool, seed: int, output: Path, about: dict[str, str]
) -> list[dict[str, Any]]:
    """Run a study, write its rows as a table, and print them."""
    module, title = STUDIES[name]
    study = getattr(import_module(f"facets.bench.{module}"), name)
    rows: list[dict[str, Any]] = study(quick, seed)
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    files.tables.write_table(output / f"{name}.csv", columns, about)
    show(title, worst_of_tilts(rows) if name == "stability" else rows)
    return rows


def worst_of_tilts(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Shorten a table for printing: one row per offset, with the largest errors over the tilts."""
    offsets = dict.fromkeys(row["offset_sigma"] for row in rows)
    keys = ("place_error_mm", "power_error", "most_steps")
    return [
        {"offset_sigma": x, **{k: max(r[k] for r in rows if r["offset_sigma"] == x) for k in keys}}
        for x in offsets
    ]


def facts(seed: int) -> dict[str, str]:
    """Facts about the machine and its load."""
    import platform
    from importlib.metadata import version

    return {
        "facets": facets.__version__,
        "command": files.provenance.command_line(),
        "seed": str(seed),
        "processor": processor(),
        "cores": str(model.threads.cores()),
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


def show(title: str, rows: list[dict[str, Any]]) -> None:
    keys = list(rows[0])
    words = [n for n, key in enumerate(keys) if isinstance(rows[0][key], str)]
    show_table(title, keys, [[cell(row[key]) for key in keys] for row in rows], left=words)


def cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    if value != value:
        return ""
    return f"{value:.3g}" if isinstance(value, float) else str(value)
