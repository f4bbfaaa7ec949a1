"""`facets export-c`: a sensor's solver as C, for the board that reads the detectors."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from .console import load_config
from .options import ConfigName, Force


def export_c(
    config: ConfigName,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder for the C.  [default: results/CONFIG-c]"),
    ] = None,
    force: Force = False,
) -> None:
    """Write a sensor's readings and solver as C99, with tests, for a board or another program.

    The calibration that the configuration holds is in it, its uncertainty is not. In the folder,
    `make test` compiles it and checks it against poses that facets has solved. Exit status 2 for a
    sensor whose readings the C would not give, with the reason.
    """
    from facets.core.errors import InputError
    from facets.files.provenance import command_line
    from facets.files.whole import ResultSet, Whole, refuse_to_overwrite
    from facets.firmware.export import export
    from facets.firmware.source import Provenance

    from .options import output_folder

    settings = load_config(config)
    folder = output_folder(output, settings.name, "c")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; name a folder with -o")
    about = Provenance(settings.name, settings.sha256, command_line())
    files = export(settings.sensor, about)
    refuse_to_overwrite([folder / path for path in files], force)
    with ResultSet():
        for path, text in files.items():
            with Whole(folder / path) as temporary:
                temporary.write_text(text, "utf-8")
    shown = ", ".join(str(path) for path in files if path.parent == Path())
    typer.echo(f"{folder}/: {shown}, and what is in teensy41/ and callers/")
    typer.echo(f"next: make -C {shlex.quote(str(folder))} test")
