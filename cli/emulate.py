"""`facets emulate`: a virtual bench on two serial ports."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import facets
from facets import files, firmware, live, model
from facets.core.errors import InputError

from .options import (
    ConfigName,
    Seconds,
    WithReference,
    folder_option,
    motion_option,
    seed_option,
)

if TYPE_CHECKING:
    from facets.config import Config


def emulate(
    config: ConfigName,
    motion: Annotated[str, motion_option("the mirror repeats it until the end")],
    rate: Annotated[float, typer.Option(min=1, max=200_000, help="Samples per second.")] = 10_000,
    folder: Annotated[Path, folder_option("")] = Path("bench"),
    seconds: Seconds = None,
    truth: Annotated[
        bool,
        typer.Option(
            "--truth",
            help="Also write the true state of every sample to FOLDER/truth.bin: 77 bytes per "
            "sample, 46 MB per minute at 10,000 samples per second.",
        ),
    ] = False,
    faults: Annotated[
        str,
        typer.Option(
            metavar="NAME=NUMBER,...",
            help="Faults to simulate, such as flip=1e-4,stall=0.1: the probability per sample of "
            "flip, lose, double and drop; the probability per second of stall, block, saturate, "
            "unplug, restart, refuse and jam; and jitter_ms, drift_ppm and uptime_s of the "
            "board's clock.  [default: no faults]",
        ),
    ] = "",
    seed: Annotated[int, seed_option()] = 1,
    firmware: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Shared library compiled from the code of `facets export-c`, with which the board "
            "also computes poses.  [default: the board sends readings only]",
        ),
    ] = None,
    with_reference: WithReference = False,
) -> None:
    """Run a virtual bench: mirror, detectors and stage.

    `facets acquire` connects to its ports FOLDER/board and FOLDER/stage. At the end the command
    prints the numbers of samples and faults and writes them to FOLDER/counts.json, and with
    --with-reference FOLDER/reference.csv. Ctrl-C, SIGTERM and closing the terminal end it.
    """
    import sys
    from contextlib import suppress

    if sys.platform == "win32":
        raise InputError("facets emulate needs ptys, which this system has not")
    if seconds == 0:
        raise InputError(
            "--seconds 0 would end before it begins; give more, or leave it out to run until ^C"
        )

    settings = facets.load(config)
    code = library_of(firmware, settings) if firmware else None
    warm_up(settings)  # before there are ports: who opens them waits for answers
    bench = live.virtual.Bench(
        settings,
        motion,
        rate,
        live.virtual.Faults.from_text(faults),
        seed,
        folder,
        code,
        with_reference,
        truth,
    )
    typer.echo(
        f"board: {bench.board.port.link}   stage: {bench.stage.link} ({settings.stage.driver})"
    )
    if truth:
        typer.echo(f"The true states are written to {folder / 'truth.bin'}, {size_of(rate)}.")
    typer.echo("running; ^C ends it")
    try:
        bench.run(seconds or float("inf"))
    finally:
        if bench.reference:
            columns, about = (
                bench.reference.columns(),
                files.provenance.provenance_header(settings, seed),
            )
            files.tables.write_table(folder / "reference.csv", columns, about)
    with suppress(OSError):  # the terminal may be gone
        for text in bench.summary():
            typer.echo(text)
        if bench.reference:
            typer.echo(f"The reference's readings were written to {folder / 'reference.csv'}.")


def size_of(rate: float) -> str:
    """How fast the file of the true states grows, in words."""
    return f"{60e-6 * rate * live.virtual.TRUTH.itemsize:.3g} MB a minute"


def library_of(path: Path, settings: Config) -> firmware.library.FirmwareLibrary:
    """The sensor's exported solver; its poses need frames, which lines of text have not."""
    if settings.acquire.format == "text":
        raise InputError("--firmware sends poses as frames; acquire.format is text: have it frames")
    library = firmware.library.FirmwareLibrary(path)
    if not library.is_of(settings.sensor):
        raise InputError(
            f"{path}: was exported for another sensor than that of {settings.name}; export and "
            f"compile it again: facets export-c {settings.name}"
        )
    return library


def warm_up(settings: Config) -> None:
    import numpy as np

    model.rare.prepare()
    model.arrays.readings(settings.sensor, np.zeros(8))
