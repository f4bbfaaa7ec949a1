"""The files of `facets rezero`: the provenance of a zero, and the configuration with it."""

from __future__ import annotations

from datetime import UTC, datetime
from os.path import relpath
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import facets
from facets import config as configuration, files, live
from facets.core.errors import InputError

from .calibration_files import calibration_keys, write_covariance

if TYPE_CHECKING:
    from facets.calibration.rezero import NewZero
    from facets.config import Config


def trace_origin(settings: Config, then: Path, now: Path) -> dict[str, str]:
    """Describe the readings from which the new zero follows, for its provenance.

    Raises `InputError` for a zero that was renewed already, which would be corrected twice, and for
    recordings in the wrong order, which would reverse all signs.
    """
    file = settings.resolved["sensor"]["calibration"]["file"]
    older = files.tables.read_head(Path(file)) if file else {}
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
    """Date at which a recording or a table of readings was recorded, if it is stated."""
    is_table = not source.is_dir()
    head = files.tables.read_head(source) if is_table else live.recording.reader.meta_of(source)
    try:
        date = datetime.fromisoformat(str(head.get("recorded") or head.get("made")))
    except ValueError:
        return None
    return date.astimezone(UTC)


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
        files.whole.write_text(trial, files.provenance.extension(settings.path, block, about))
        facets.load(trial)
        parent = Path(relpath(settings.path.resolve(), path.resolve().parent))
        with files.tables.ResultSet():
            with files.tables.Whole(covariance) as temporary:
                copyfile(matrix, temporary)
            files.whole.write_text(path, files.provenance.extension(parent, block, about))
    print(f"{path}, {covariance.name}")


def new_keys(settings: Config, zero: NewZero, covariance: Path) -> dict[str, Any]:
    """The blocks `sensor`, with its changed keys, and `solve`, with the beam's offset, um. The
    covariance's file must exist, because its hash is one of the keys."""
    old = settings.resolved["sensor"]
    new = configuration.sensor_keys.write_sensor(old, zero.sensor)
    new["calibration"] = calibration_keys(zero.sensor, covariance)
    return {
        "sensor": configuration.build.differences(old, new),
        "solve": {"beam_offset_um": (1e3 * zero.beam).tolist()},
    }
