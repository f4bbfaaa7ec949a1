"""`facets rezero`: what changed since a calibration, from readings at one stop, then and now."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from facets import calibration, config as configuration, files, live
from facets.core.errors import InputError

from .console import load_config
from .options import ConfigName, Force, output_option, require_yaml
from .parts.recordings import solve_recording
from .parts.zero_files import trace_origin, write_zero
from .sentences.rezero import refuse, show_changes

if TYPE_CHECKING:
    from facets.calibration.rezero import StopReadings
    from facets.config import Config


def readings_argument(name: str, when: str) -> Any:
    return typer.Argument(
        metavar=name,
        help=f"Readings of the mirror at the stop {when}: a folder written by `facets acquire`, "
        "or a table of readings, CSV, Parquet, HDF5 or TDMS.",
    )


def prior_option(what: str, most: float) -> Any:
    return typer.Option(min=1e-9, max=most, help=f"Standard uncertainty of {what}.")


Then = Annotated[Path, readings_argument("THEN", "at the time of the calibration")]
Now = Annotated[Path, readings_argument("NOW", "now")]
Output = Annotated[
    Path | None, output_option("configuration that extends CONFIG, YAML", "CONFIG-rezeroed.yaml")
]
Dwells = Annotated[
    bool,
    typer.Option(
        "--dwells",
        help="Average the readings over each interval in which the reference is at rest: each "
        "interval is a stop; both tables have the same stops in the same order.",
    ),
]
BeamUm = Annotated[float, prior_option("the beam's motion in x and in y since then, µm", 1e4)]
PowerPercent = Annotated[float, prior_option("the change of the laser's power since then, %", 100)]
GainPercent = Annotated[
    float, prior_option("the change of each detector's gain since then, %", 100)
]
PostUm = Annotated[
    float, prior_option("the change of the height of each detector's post since then, µm", 1e4)
]
WidthPercent = Annotated[float, prior_option("the change of the beam's diameter since then, %", 10)]
StopUm = Annotated[
    float, prior_option("the mirror's position at the stop now relative to then, µm", 1e4)
]
StopUrad = Annotated[
    float, prior_option("the mirror's angles at the stop now relative to then, µrad", 1e6)
]


def rezero(
    config: ConfigName,
    then: Then,
    now: Now,
    output: Output = None,
    dwells: Dwells = False,
    beam_um: BeamUm = 20.0,
    power_percent: PowerPercent = 5.0,
    gain_percent: GainPercent = 0.2,
    post_um: PostUm = 3.0,
    width_percent: WidthPercent = 0.5,
    stop_um: StopUm = 0.1,
    stop_urad: StopUrad = 0.5,
    force: Force = False,
) -> None:
    """Renew the zero of a calibrated rig from two seconds at a stop.

        facets rezero calibrated.yaml stop-then.csv stop-now.csv

    The mirror is at the same stop as at the time of the calibration; no reference instrument is
    needed. From the change of the mean readings the command estimates the motion of the beam and
    the changes of its width, the laser's power, the detectors' gains and the heights of their
    posts. It writes a small configuration that extends CONFIG and has the new
    covariance of all parameters. If these changes do not explain the readings, or a motion of the
    mirror explains them better than chance does, the command reports this, writes nothing and ends
    with exit status 1. A CONFIG whose zero was renewed already, and a THEN that was recorded after
    NOW, are refused.
    """
    settings = load_config(config)
    path = output or Path(f"{settings.name}-rezeroed.yaml")
    require_yaml(path)
    covariance = path.with_name(f"{path.stem}-covariance.csv")
    sources = [*configuration.source_files(settings), then, now]
    files.tables.refuse_to_overwrite([path, covariance], force, sources)
    priors = calibration.rezero.ChangePriors(
        1e-3 * beam_um, power_percent / 100, gain_percent / 100, 1e-3 * post_um,
        width_percent / 100, 1e-3 * stop_um, 1e-6 * stop_urad,
    )  # fmt: skip
    origin = trace_origin(settings, then, now)
    stops = [read_stops(settings, source, dwells) for source in (then, now)]
    zero = calibration.rezero.renew_zero(
        settings.sensor, stops[0], stops[1], priors, settings.solve.beam_offset
    )
    show_changes(settings, zero, priors)
    if not zero.is_explained:
        refuse(zero)
    write_zero(settings, zero, path, covariance, origin)


def read_stops(settings: Config, source: Path, dwells: bool) -> StopReadings:
    """The mean readings of a recording, of a table, or of the dwells in a table."""
    if not source.is_dir():
        return calibration.rezero.read_stops(source, settings, dwells)
    if dwells:
        raise InputError(f"{source}: a recording has no reference, which --dwells needs")
    columns = solve_recording(live.Playback(source, settings))
    if not columns:
        raise InputError(f"{source}: no samples")
    return calibration.rezero.average_stop(settings.sensor, columns, str(source))
