"""`facets rezero`: what changed since a calibration, from readings at one stop, then and now."""

from __future__ import annotations

from datetime import UTC, datetime
from hashlib import sha256
from os.path import relpath
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

import facets
from facets import calibration, files, live
from facets import config as configuration
from facets.core.errors import InputError
from facets.core.names import DETECTORS, POSE

from .console import FINDING, load_config, wrap
from .options import ConfigName, Force, output_option, require_yaml
from .parts.calibration_files import round_freedom, write_covariance
from .parts.recordings import solve_recording

if TYPE_CHECKING:
    from facets.calibration.rezero import ChangePriors, NewZero, StopReadings
    from facets.config import Config

#: An uncertainty above this share of the one before is named as not determined.
UNDETERMINED_SHARE = 0.5


def readings_argument(name: str, when: str) -> Any:
    return typer.Argument(
        metavar=name,
        help=f"Readings of the mirror at the stop {when}: a folder written by `facets acquire`, "
        "or a table of readings, CSV or Parquet.",
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
        help="Average the readings over each interval in which the reference stands still: each "
        "is a stop; both tables have the same stops in the same order.",
    ),
]
BeamUm = Annotated[float, prior_option("the beam's motion in x and in y since then, um", 1e4)]
PowerPercent = Annotated[float, prior_option("the change of the laser's power since then, %", 100)]
GainPercent = Annotated[
    float, prior_option("the change of each detector's gain since then, %", 100)
]
PostUm = Annotated[
    float, prior_option("the change of the height of each detector's post since then, um", 1e4)
]
WidthPercent = Annotated[float, prior_option("the change of the beam's diameter since then, %", 10)]
StopUm = Annotated[
    float, prior_option("the mirror's position at the stop now relative to then, um", 1e4)
]
StopUrad = Annotated[
    float, prior_option("the mirror's angles at the stop now relative to then, urad", 1e6)
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

    The mirror stands at the same stop as at the time of the calibration; no reference instrument is
    needed. From the change of the mean readings the command estimates by how much the beam moved,
    and by how much its width, the laser's power, the three detectors' gains and the heights of
    their posts changed. It writes a small configuration that extends CONFIG and has the new
    covariance of all parameters. If these changes do not explain the readings, or a motion of the
    mirror explains them better than chance does, the command says so, writes nothing and ends with
    exit status 1. A CONFIG whose zero was renewed already, and a THEN that was recorded after NOW,
    are refused.
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


def trace_origin(settings: Config, then: Path, now: Path) -> dict[str, str]:
    """What the new zero comes from, for its provenance.

    Raises `InputError` for a zero that was renewed already, which would be corrected twice, and for
    recordings in the wrong order, which would turn all signs.
    """
    known = settings.resolved["sensor"]["calibration"]["file"]
    older = files.tables.read_head(Path(known)) if known else {}
    if "zero_now" in older:
        raise InputError(
            f"{settings.path}: its zero was renewed already, from {older['zero_now']}; give the "
            f"configuration that it extends ({older.get('config')})"
        )
    dates = [find_date(source) for source in (then, now)]
    if dates[0] and dates[1] and dates[0] > dates[1]:
        raise InputError(
            f"{then}: was recorded at {dates[0]}, after {now} ({dates[1]}); give the readings at "
            "the time of the calibration first, and those of now second"
        )
    words = [
        f"{source}, recorded at {date or 'an unknown time'}"
        for source, date in zip((then, now), dates, strict=True)
    ]
    return {"zero_then": words[0], "zero_now": words[1]}


def find_date(source: Path) -> datetime | None:
    """When the readings of a recording or of a table were recorded, if they say it."""
    is_table = not source.is_dir()
    head = files.tables.read_head(source) if is_table else live.recording.reader.meta_of(source)
    try:
        date = datetime.fromisoformat(str(head.get("recorded") or head.get("made")))
    except ValueError:
        return None
    return date.astimezone(UTC)


def read_stops(settings: Config, source: Path, dwells: bool) -> StopReadings:
    """The mean readings of a recording, of a table, or of the stands in a table."""
    if not source.is_dir():
        return calibration.rezero.read_stops(source, settings, dwells)
    if dwells:
        raise InputError(f"{source}: a recording has no reference, which --dwells needs")
    columns = solve_recording(live.Playback(source, settings))
    if not columns:
        raise InputError(f"{source}: no samples")
    return calibration.rezero.average_stop(settings.sensor, columns, str(source))


#: The changes, in the order of `ChangePriors.sigmas`: name, unit, and the factor to it from
#: mm or a share.
ROWS = (
    *((f"beam {axis}", "um", 1e3) for axis in "xy"),
    ("laser's power", "%", 100.0),
    *((f"gain of detector {letter.upper()}", "%", 100.0) for letter in DETECTORS),
    *((f"post of detector {letter.upper()}", "um", 1e3) for letter in DETECTORS),
    ("beam's width", "%", 100.0),
)


def show_changes(settings: Config, zero: NewZero, priors: ChangePriors) -> None:
    """Print the changes, and what a stop does not tell."""
    typer.echo("Changes since the calibration, with standard uncertainties:")
    typer.echo(f"  {'':19} {'change':>9} {'u':>8} {'u before':>9}")
    weak = []
    scales = priors.sigmas(1.0) / zero.prior  # of the power, to a share
    numbers = zip(ROWS, scales, zero.change, zero.uncertainty, zero.prior, strict=True)
    for (name, unit, factor), scale, *values in numbers:
        change, u, before = (factor * scale * value for value in values)
        typer.echo(f"  {name:19} {change:+9.3g} {u:8.2g} {before:9.2g} {unit}")
        if u > UNDETERMINED_SHARE * before:
            weak.append(name)
    notes = [f"A stop hardly determines: {', '.join(weak)}."] if weak else []
    notes += [
        f"The mirror is taken to stand at the stop again within {1e3 * priors.stop:g} um and "
        f"{1e6 * priors.stop_angle:g} urad (--stop-um, --stop-urad). If it stands elsewhere, all "
        "poses are off by as much; along z nothing in the readings shows that.",
        f"Chi-square is {zero.chi_square:.3g} where {zero.freedom} is expected (probability of a "
        f"larger one: {zero.chance:.2g}; at least {calibration.rezero.LEAST_CHANCE:g} is needed).",
    ]
    axis, chance = zero.likeliest_motion
    if chance < calibration.rezero.LEAST_CHANCE:
        factor, unit = (1e3, "um") if axis < 3 else (1e6, "urad")
        moved, u = factor * zero.motion[:, axis]
        notes.append(
            f"A motion of the mirror by {moved:.2g} +- {u:.1g} {unit} in {POSE[axis]} "
            f"between the stops would explain the readings better (probability by chance: "
            f"{chance:.2g}; at least {calibration.rezero.LEAST_CHANCE:g} is needed)."
        )
    if settings.solve.beam == "free":
        notes.append(
            "CONFIG solves for the beam (solve.beam: free); the beam's new position counts with "
            "`known` and `prior`."
        )
    for note in notes:
        typer.echo(wrap(f"- {note}"))


#: A change of more than this number of its prior standard uncertainties is named.
LARGE_CHANGE = 4.0


def refuse(zero: NewZero) -> NoReturn:
    """Say that the changes do not explain the readings; exit status 1."""
    ratios = abs(zero.change / zero.prior)
    worst = int(ratios.argmax())
    words = (
        "! These changes do not explain the readings: the mirror moved between the stops, or "
        "something else changed. Nothing was written. Bring the mirror to the stop again; if the "
        "result stays, calibrate."
    )
    if ratios[worst] > LARGE_CHANGE:
        words += (
            f" Or the change is larger than assumed: {ROWS[worst][0]}, {ratios[worst]:.2g} "
            "standard uncertainties before; the options state these."
        )
    typer.echo(wrap(words), err=True)
    raise typer.Exit(FINDING)


def write_zero(
    settings: Config, zero: NewZero, path: Path, covariance: Path, origin: dict[str, str]
) -> None:
    """Write the configuration and the covariance, after loading them from a temporary folder."""
    about = files.provenance.provenance_header(settings) | origin
    with TemporaryDirectory() as folder:
        trial = Path(folder) / path.name
        matrix = trial.with_name(covariance.name)
        write_covariance(matrix, zero.sensor, about)
        block = new_keys(settings, zero, matrix)
        trial.write_text(files.provenance.extension(settings.path, block, about), "utf-8")
        facets.load(trial)
        parent = Path(relpath(settings.path.resolve(), path.resolve().parent))
        with files.tables.ResultSet():
            with files.tables.Whole(covariance) as temporary:
                copyfile(matrix, temporary)
            with files.tables.Whole(path) as temporary:
                temporary.write_text(files.provenance.extension(parent, block, about), "utf-8")
    typer.echo(f"{path}, {covariance.name}")


def new_keys(settings: Config, zero: NewZero, covariance: Path) -> dict[str, Any]:
    """The keys of CONFIG that change."""
    old = settings.resolved["sensor"]
    new = configuration.sensor_keys.write_sensor(old, zero.sensor)
    new["calibration"] = {
        "file": covariance.name,
        "sha256": sha256(covariance.read_bytes()).hexdigest(),
        "degrees_of_freedom": round_freedom(zero.sensor),
    }
    return {
        "sensor": changed_keys(old, new),
        "solve": {"beam_offset_um": (1e3 * zero.beam).tolist()},
    }


def changed_keys(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    """The keys of `new` whose values differ from those of `old`, block by block."""
    return {
        key: changed_keys(old[key], value) if isinstance(value, dict) else value
        for key, value in new.items()
        if value != old[key]
    }
