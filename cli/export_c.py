"""`facets export-c`: a sensor's solver as C, for the board that reads the detectors."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from facets import files, firmware
from facets.core.errors import InputError

from .console import load_config
from .options import ConfigName, Force, folder_option, output_folder


def export_c(
    config: ConfigName,
    folder: Annotated[Path | None, folder_option("results/CONFIG-c")] = None,
    force: Force = False,
) -> None:
    """Write a sensor's model and solver as C99 code.

        facets export-c calibrated.yaml -d firmware

    The code computes readings and solves them for poses on a microcontroller board or in
    another program. It contains the calibrated parameters but not their uncertainty. The code
    comes with tests: `make test` in the folder compiles the code and compares its poses with
    those of facets. Exit status 2 if the sensor has effects that the C code cannot compute.
    """
    settings = load_config(config)
    place = output_folder(folder, settings.name, "c")
    if place.exists() and not place.is_dir():
        raise InputError(f"{place} is a file; name another one with --folder")
    about = firmware.source.Provenance(
        settings.name, settings.sha256, files.provenance.command_line()
    )
    paths = firmware.export.export(settings.sensor, about)
    files.whole.refuse_to_overwrite([place / path for path in paths], force)
    with files.whole.ResultSet():
        for path, text in paths.items():
            files.whole.write_text(place / path, text)
    shown = ", ".join(str(path) for path in paths if path.parent == Path())
    print(f"{place}/: {shown}, and the files in teensy41/ and callers/")
    if settings.sensor.thermal.is_on:
        print(
            "The C code does not follow the temperature: its poses hold at sensor.temperature's "
            f"reference, {settings.sensor.thermal.reference:.4g} degrees Celsius."
        )
    print(f"next: make -C {shlex.quote(str(place))} test")
