"""The files that `facets calibrate` writes: configuration, parameters, covariance, picture."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import typer

import facets
from facets import calibration, files, pictures
from facets import config as configuration
from facets.core.errors import FacetsError
from facets.core.names import DETECTORS

from ..console import FINDING

if TYPE_CHECKING:
    from facets.calibration.fit import Fit
    from facets.calibration.verdict import Verdict
    from facets.config import Config
    from facets.core.sensor import Sensor


def write_results(
    settings: Config, found: Verdict, paths: list[Path], sources: list[Path], report: Path | None
) -> None:
    """Write the results to a temporary place and load them, so that no unreadable file is left.

    sources: the tables that were read.  report: where the calibration certificate goes, if at all.
    """
    path, table, covariance, picture = paths
    assert found.found is not None
    assert found.errors is not None
    assert found.search is not None
    about = files.provenance.provenance_header(settings)
    with TemporaryDirectory() as folder:
        trial = Path(folder) / path.name
        matrix = trial.with_name(covariance.name)
        write_covariance(matrix, found.found.sensor, about)
        bent = write_grids(settings, trial, found.found, about)
        trial.write_text(as_yaml(settings, found.found, matrix, bent, about), "utf-8")
        try:
            calibrated = facets.load(trial)
        except FacetsError as error:
            typer.echo(
                f"The fitted values make no configuration that can be loaded ({error}); nothing "
                "was written. Check the signs and units of the columns.",
                err=True,
            )
            raise typer.Exit(FINDING) from None
        beside = [(source, path.with_name(source.name)) for source in bent.values()]
        with files.tables.ResultSet():
            for source, target in ((matrix, covariance), *beside, (trial, path)):
                with files.tables.Whole(target) as temporary:
                    copyfile(source, temporary)
            files.tables.write_table(
                table, calibration.table.found_table(found.search.sensor, found.found), about
            )
            pictures.style.save(
                pictures.calibration.residual_picture(found.fitted, found.found, found.errors),
                picture,
            )
            if report is not None:
                pictures.calibration_certificate.write_report(
                    settings, calibrated, found, report, sources, [trial, matrix]
                )
    paths = paths if report is None else [*paths, report]
    typer.echo(", ".join(str(file) if file == path else file.name for file in paths))


def round_freedom(sensor: Sensor) -> float | None:
    """The degrees of freedom of a calibration, to three digits after the point."""
    assert sensor.calibration is not None
    known = sensor.calibration.degrees_of_freedom
    return None if known is None else round(known, 3)


def write_covariance(path: Path, sensor: Sensor, about: dict[str, str]) -> None:
    assert sensor.calibration is not None
    files.tables.write_table(path, configuration.covariance.columns(sensor.calibration), about)


def write_grids(
    settings: Config, beside: Path, found: Fit, about: dict[str, str]
) -> dict[str, Path]:
    """Write tables of detectors with corrections beyond third order, by letter."""
    written = {}
    for letter, old, new in zip(DETECTORS, settings.sensor.psds, found.sensor.psds, strict=True):
        if new.correction.grid is not None and new.correction.grid != old.correction.grid:
            written[letter] = beside.with_name(f"{beside.stem}-detector-{letter}.csv")
            files.tables.write_table(
                written[letter], configuration.grid.columns(new.correction.grid), about
            )
    return written


def as_yaml(
    settings: Config, found: Fit, covariance: Path, bent: dict[str, Path], about: dict[str, str]
) -> str:
    keys = configuration.sensor_keys.write_sensor(settings.resolved["sensor"], found.sensor)
    keys["calibration"] = {
        "file": covariance.name,
        "sha256": sha256(covariance.read_bytes()).hexdigest(),
        "degrees_of_freedom": round_freedom(found.sensor),
    }
    for letter, table in bent.items():
        keys["psd"][letter]["correction"] |= {
            "table": table.name,
            "table_sha256": sha256(table.read_bytes()).hexdigest(),
        }
    return files.provenance.configuration(choose_power(settings), keys, about)


def choose_power(settings: Config) -> Config:
    """A calibration determines the laser's power on its day; later solutions use it as a prior.
    The beam's position in the calibration is known."""
    solve = settings.resolved["solve"] | {"beam_offset_um": [0.0, 0.0]}
    is_known = solve["power"] == "known" and solve["method"] != "paper"
    if is_known and settings.calibrate.power_per_sample:
        solve = solve | {"power": "prior"}
    return replace(settings, resolved=settings.resolved | {"solve": solve})
