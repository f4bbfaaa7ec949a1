"""The files that `facets calibrate` writes: configuration, parameters, covariance, picture."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import typer

import facets
from facets import calibration, characterization, config as configuration, files, pictures
from facets.core.errors import FacetsError
from facets.core.names import DETECTORS, STATE_COLUMNS

from ..console import FINDING, draw_extra, free_output, wrap
from ..options import require_html, require_yaml

if TYPE_CHECKING:
    from facets.calibration.fitting.fit import Fit
    from facets.calibration.verdict import Verdict
    from facets.config import Config
    from facets.core.sensor import Sensor


@dataclass(frozen=True)
class CalibrationFiles:
    """Files of a calibration: tables that are read; the configuration and the report to write."""

    data: Path
    reference: Path | None
    configuration: Path
    plot: str
    report: Path | None

    @property
    def sources(self) -> list[Path]:
        return [self.data] if self.reference is None else [self.data, self.reference]

    @property
    def results(self) -> list[Path]:
        """Paths of the configuration, the table of unknowns, the covariance and the picture."""
        path = self.configuration
        table, covariance = (
            path.with_name(f"{path.stem}-{kind}.csv") for kind in ("found", "covariance")
        )
        return [path, table, covariance, path.with_suffix(f".{self.plot}")]

    def require(self, settings: Config, force: bool) -> None:
        """Refuse files that cannot be written, before any work."""
        require_yaml(self.configuration)
        pages = [] if self.report is None else [self.report]
        for page in pages:
            require_html(page)
        read = [*configuration.source_files(settings), *self.sources]
        files.whole.refuse_to_overwrite([*self.results, *pages], force, read)


def write_results(settings: Config, verdict: Verdict, paths: CalibrationFiles) -> None:
    """Write the results to a temporary place and load them, so that no unreadable file is left.

    settings: with `solve` for later readings.
    """
    path, table, covariance, picture = paths.results
    assert verdict.fit is not None
    assert verdict.errors is not None
    assert verdict.search is not None
    about = files.provenance.provenance_header(settings)
    with TemporaryDirectory() as folder:
        trial = Path(folder) / path.name
        matrix = trial.with_name(covariance.name)
        write_covariance(matrix, verdict.fit.sensor, about)
        bent = write_grids(settings, trial, verdict.fit, about)
        files.whole.write_text(trial, as_yaml(settings, verdict.fit, matrix, bent, about))
        try:
            calibrated = facets.load(trial)
        except FacetsError as error:
            print(
                f"The fitted values make no configuration that can be loaded ({error}); nothing "
                "was written. Check the signs and units of the columns.",
                file=sys.stderr,
            )
            raise typer.Exit(FINDING) from None
        grids = [(source, path.with_name(source.name)) for source in bent.values()]
        with files.tables.ResultSet():
            for source, target in ((matrix, covariance), *grids, (trial, path)):
                with files.tables.Whole(target) as temporary:
                    copyfile(source, temporary)
            files.tables.write_table(
                table, calibration.table.unknowns_table(verdict.search.sensor, verdict.fit), about
            )
            make = pictures.calibration.residual_picture
            draw_extra(picture, make, verdict.fitted, verdict.fit, verdict.errors)
            if (page := paths.report) is not None:
                files_of_page = (page, paths.sources, [trial, matrix])
                draw_extra(page, write_page, settings, calibrated, verdict, files_of_page)
    written = [*paths.results[1:], *filter(None, [paths.report])]
    print(", ".join([str(path), *(file.name for file in written if file.exists())]))


def write_page(
    settings: Config,
    calibrated: Config,
    verdict: Verdict,
    page: tuple[Path, list[Path], list[Path]],
) -> None:
    """Write the certificate.  page: its path, and the files that were read and written."""
    assert verdict.fit is not None
    assert verdict.errors is not None
    drawing = pictures.calibration.residual_drawing(verdict.fitted, verdict.fit, verdict.errors)
    certificate = pictures.calibration_certificate
    certificate.write_report(settings, calibrated, verdict, drawing, certificate.ReportFiles(*page))


def calibration_keys(sensor: Sensor, covariance: Path) -> dict[str, Any]:
    """The block `sensor.calibration` of a configuration, with the file of the covariance."""
    assert sensor.calibration is not None
    freedom = sensor.calibration.degrees_of_freedom
    return {
        "file": covariance.name,
        "sha256": sha256(covariance.read_bytes()).hexdigest(),
        "degrees_of_freedom": None if freedom is None else round(freedom, 3),
    }


def write_covariance(path: Path, sensor: Sensor, about: dict[str, str]) -> None:
    assert sensor.calibration is not None
    files.tables.write_table(path, configuration.covariance.columns(sensor.calibration), about)


def write_grids(settings: Config, path: Path, fit: Fit, about: dict[str, str]) -> dict[str, Path]:
    """Write tables of detectors with corrections beyond third order, next to the configuration;
    return their paths by letter."""
    written = {}
    for letter, old, new in zip(DETECTORS, settings.sensor.psds, fit.sensor.psds, strict=True):
        if new.correction.grid is not None and new.correction.grid != old.correction.grid:
            written[letter] = path.with_name(f"{path.stem}-detector-{letter}.csv")
            files.tables.write_table(
                written[letter], configuration.grid.columns(new.correction.grid), about
            )
    return written


def as_yaml(
    settings: Config, fit: Fit, covariance: Path, bent: dict[str, Path], about: dict[str, str]
) -> str:
    keys = configuration.sensor_keys.write_sensor(settings.resolved["sensor"], fit.sensor)
    keys["calibration"] = calibration_keys(fit.sensor, covariance)
    for letter, table in bent.items():
        keys["psd"][letter]["correction"] |= {
            "table": table.name,
            "table_sha256": sha256(table.read_bytes()).hexdigest(),
        }
    solve = settings.resolved["solve"] | {
        "beam_offset_um": [0.0, 0.0],  # the beam's place in the calibration
        "power": settings.solve.power,
        "power_sigma_percent": float(f"{100 * settings.solve.power_sigma:.3g}"),
    }
    settings = replace(settings, resolved=settings.resolved | {"solve": solve})
    return files.provenance.configuration(settings, keys, about)


def write_proposal(settings: Config, path: Path, count: int, force: bool) -> None:
    """Write a table of poses for a calibration; print how well they determine the parameters."""
    files.tables.refuse_to_overwrite([path], force, configuration.source_files(settings))
    files.tables.ending(path)
    poses = characterization.random_poses.poses_to_calibrate_with(settings)
    proposal = calibration.motions.propose_poses(settings, poses, count)
    files.tables.write_table(path, proposal.columns, files.provenance.provenance_header(settings))
    different = len(set(zip(*(proposal.columns[name] for name in STATE_COLUMNS[:6]), strict=True)))
    repeated = f" ({different} different ones; the most informative are visited again)"
    text = (
        f"Wrote {count} poses to {path}{repeated * (different < count)}. A calibration with them "
        f"reduces the parameters' standard uncertainties to {100 * proposal.reduction:.3g} % of "
        f"their prior values (geometric mean); {count} random poses, to "
        f"{100 * proposal.random_reduction:.3g} %. Visiting them in this order shortens the path "
        f"by {100 * proposal.saving:.0f} % and approaches each axis's poses from below in "
        f"{100 * proposal.upward.min():.0f} to {100 * proposal.upward.max():.0f} % of them, so "
        "that backlash of the reference shows."
    )
    with free_output(path):
        print(wrap(text))
