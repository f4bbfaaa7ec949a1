"""`facets emulate`: a virtual bench on two serial ports."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from facets.config import Config
    from facets.firmware.library import FirmwareLibrary
    from facets.live.virtual import Bench


def emulate(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    motion: Annotated[str, typer.Option(help="Which the mirror goes through, again and again.")],
    rate: Annotated[float, typer.Option(min=1, max=200_000, help="Samples per second.")] = 10_000,
    folder: Annotated[
        Path, typer.Option(help="For the ports `board` and `stage`, and the truth.")
    ] = Path("bench"),
    seconds: Annotated[float | None, typer.Option(min=0, help="Then it ends.")] = None,
    faults: Annotated[
        str,
        typer.Option(
            help="Chances a sample of flip, lose, double, drop, and a second of stall, block, "
            "saturate, unplug, restart, refuse, jam: flip=1e-4,stall=0.1. Of the board's time: "
            "jitter_ms, drift_ppm, uptime_s."
        ),
    ] = "",
    seed: Annotated[int, typer.Option(min=0, help="Of noise and faults.")] = 1,
    firmware: Annotated[
        Path | None,
        typer.Option(help="A library of `facets export-c`: the board solves with it, too."),
    ] = None,
    reference: Annotated[
        bool,
        typer.Option(
            "--reference",
            help="At the end, write what a reference instrument says of the mirror's poses to "
            "FOLDER/reference.csv, for `facets calibrate --reference`.",
        ),
    ] = False,
) -> None:
    """Run a virtual bench: moving mirror, detectors, and a stage that carries the beam.

    Its ports are named FOLDER/board and FOLDER/stage. It writes where the mirror and the beam
    truly were to FOLDER/truth.bin, and at its end what it did to FOLDER/counts.json. Ctrl-C ends
    it, as do SIGTERM and the end of the terminal.
    """
    import json
    import sys
    from contextlib import suppress

    from facets import load
    from facets.core.errors import InputError

    if sys.platform == "win32":
        raise InputError("facets emulate needs ptys, which this system has not")
    if seconds == 0:
        raise InputError(
            "--seconds 0 would end before it begins; give more, or leave it out to run until ^C"
        )
    from facets.files import provenance, tables
    from facets.live.virtual import Bench, Faults

    settings = load(config)
    code = library_of(firmware, settings) if firmware else None
    bench = Bench(settings, motion, rate, Faults.of(faults), seed, folder, code, reference)
    warm_up(bench)
    typer.echo(
        f"board: {bench.board.port.link}   stage: {bench.stage.link} ({settings.stage.driver})"
    )
    typer.echo("running; ^C ends it")
    try:
        bench.run(seconds or float("inf"))
    finally:
        if bench.reference:
            columns, about = bench.reference.columns(), provenance.about(settings, seed)
            tables.write_table(folder / "reference.csv", columns, about)
    with suppress(OSError):  # the terminal may be gone
        if bench.reference:
            typer.echo(f"The reference's readings were written to {folder / 'reference.csv'}.")
        typer.echo(json.dumps(bench.count.__dict__))


def library_of(path: Path, settings: Config) -> FirmwareLibrary:
    """The sensor's exported solver; its poses need frames, which lines of text have not."""
    from facets.core.errors import InputError
    from facets.firmware.library import FirmwareLibrary

    if settings.acquire.format == "text":
        raise InputError("--firmware sends poses as frames; acquire.format is text: have it frames")
    library = FirmwareLibrary(path)
    if not library.is_of(settings.sensor):
        raise InputError(
            f"{path}: was exported for another sensor than that of {settings.name}; export and "
            f"compile it again: facets export-c {settings.name}"
        )
    return library


def warm_up(bench: Bench) -> None:
    import numpy as np

    from facets.model import rare
    from facets.model.arrays import readings

    rare.prepare()
    readings(bench.config.sensor, np.zeros(8))
