"""`facets emulate`: a virtual bench on two serial ports."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import facets
from facets import files, firmware, live, model, simulation
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


Motion = Annotated[str, motion_option("the mirror repeats it until the end")]
Rate = Annotated[float, typer.Option(min=1, max=200_000, help="Samples per second.")]
Truth = Annotated[
    bool,
    typer.Option(
        "--truth",
        help="Also write the true state of every sample to FOLDER/truth.bin: 77 bytes per "
        "sample, 46 MB per minute at 10,000 samples per second.",
    ),
]
FaultRates = Annotated[
    str,
    typer.Option(
        metavar="NAME=NUMBER,...",
        help="Faults to simulate, such as flip=1e-4,stall=0.1: the probability per sample of "
        "flip, lose, double and drop; the probability per second of stall, block, saturate, "
        "unplug, restart, refuse and jam; and jitter_ms, drift_ppm and uptime_s of the "
        "board's clock.  [default: no faults]",
    ),
]
Firmware = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Shared library compiled from the code of `facets export-c`, with which the board "
        "also computes poses.  [default: the board sends readings only]",
    ),
]


def emulate(
    config: ConfigName,
    motion: Motion,
    rate: Rate = 10_000,
    folder: Annotated[Path, folder_option("")] = Path("bench"),
    seconds: Seconds = None,
    truth: Truth = False,
    faults: FaultRates = "",
    seed: Annotated[int, seed_option()] = 1,
    firmware: Firmware = None,
    with_reference: WithReference = False,
) -> None:
    """Run a virtual bench: mirror, detectors and stage.

        facets emulate bench --motion circle

    `facets acquire` connects to its ports FOLDER/board and FOLDER/stage. At the end the command
    prints the numbers of samples and faults and writes them to FOLDER/counts.json. With
    --with-reference it also writes FOLDER/reference.csv, and of a motion of the kind `runs` the
    positions that `facets axis` needs, FOLDER/commands.csv. Ctrl-C, SIGTERM and closing the
    terminal end the run.
    """
    if sys.platform == "win32":
        raise InputError("facets emulate needs pseudo-terminals, which this system does not have")
    if seconds == 0:
        raise InputError(
            "--seconds 0 would end at once; give more, or leave the option out to run until Ctrl-C"
        )
    settings = facets.load(config)
    code = library_of(firmware, settings) if firmware else None
    # compiled before the ports exist, because programs that open them wait for answers
    model.arrays.readings(settings.sensor, [0.0] * 8)
    setup = live.virtual.BenchSetup(
        settings,
        motion,
        rate,
        live.virtual.Faults.from_text(faults),
        seed,
        firmware=code,
        reference=with_reference,
        truth=truth,
    )
    bench = live.virtual.Bench(setup, folder)
    announce(bench, settings)
    commands = write_commands(folder / "commands.csv", settings, motion, seed)
    try:
        bench.run(seconds or float("inf"))
    finally:
        reference = write_reference(bench)
    with suppress(OSError):  # the terminal may be gone
        print("\n".join([*bench.summary(), *reference, *commands]))


def announce(bench: live.virtual.Bench, settings: Config) -> None:
    """Print the ports of the bench and the files that it writes."""
    print(f"board: {bench.folder / 'board'}   stage: {bench.stage.link} ({settings.stage.driver})")
    if bench.truth:
        path = bench.folder / "truth.bin"
        print(f"The true states are written to {path}, {size_of(bench.rate)}.")
    print("running; ^C ends it")


def write_reference(bench: live.virtual.Bench) -> list[str]:
    """Write the readings of the reference, if there is one; return a sentence about them."""
    if bench.reference is None:
        return []
    path = bench.folder / "reference.csv"
    bench.reference.write(path)
    return [f"The reference's readings were written to {path}."]


def write_commands(path: Path, settings: Config, motion: str, seed: int) -> list[str]:
    """Write where an axis is sent, if the motion is one; return a sentence about the file."""
    about = files.provenance.provenance_header(settings, seed)
    if not simulation.axis_runs.write_commands(path, settings.motions[motion], about):
        return []
    return [f"The commanded positions were written to {path}."]


def size_of(rate: float) -> str:
    """Describe how fast the file of the true states grows."""
    return f"{60e-6 * rate * live.virtual.TRUTH.itemsize:.3g} MB a minute"


def library_of(path: Path, settings: Config) -> firmware.library.FirmwareLibrary:
    """Load the sensor's exported solver; its poses need frames, which text lines do not have."""
    if settings.acquire.format == "text":
        raise InputError(
            "--firmware sends poses as frames, but acquire.format is text; set it to frames"
        )
    library = firmware.library.FirmwareLibrary(path)
    if not library.is_of(settings.sensor):
        raise InputError(
            f"{path}: was exported for another sensor than that of {settings.name}; export and "
            f"compile it again: facets export-c {settings.name}"
        )
    return library
