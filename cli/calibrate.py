"""`facets calibrate`: a rig's own parameters, from readings beside a reference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .simulate import PlotKind

if TYPE_CHECKING:
    from facets.calibration.fit import Fit
    from facets.calibration.identifiability import Direction
    from facets.config import Config


def calibrate(
    config: Annotated[str, typer.Argument(help="Name of a shipped config, or a YAML file.")],
    data: Annotated[
        Path | None, typer.Argument(help="CSV or Parquet: readings, and ref_tx_mm ... beside them.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="YAML file.  [default: CONFIG-calibrated.yaml]"),
    ] = None,
    propose: Annotated[
        int, typer.Option(min=0, help="Instead: so many poses that would tell most, as a table.")
    ] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace older files.")] = False,
    plot: Annotated[PlotKind, typer.Option(help="Kind of the picture.")] = PlotKind.png,
) -> None:
    """Calibrate a rig: where its detectors are, how its facets lean, what its gains are.

    Takes readings of a motion that a reference knows, wholly or in part, the beam's place known.
    Says first what the motion can tell; then fits, tries the result on samples held back, and
    writes a configuration whose uncertainty goes into every pose that is solved with it.
    """
    from facets import load
    from facets.core.errors import InputError

    settings = load(config)
    path = output or Path(f"{settings.name}-{'poses.csv' if propose else 'calibrated.yaml'}")
    if propose:
        propose_poses(settings, path, propose, force)
    elif data is None:
        raise InputError("DATA is missing: a table of readings beside a reference, or --propose N")
    else:
        fit_rig(settings, data, path, plot, force)


def fit_rig(settings: Config, data: Path, path: Path, plot: PlotKind, force: bool) -> None:
    from facets import load
    from facets.calibration.fit import fit
    from facets.calibration.identifiability import information, weak
    from facets.calibration.table import choice, found_table, read, split, validation
    from facets.core.errors import InputError
    from facets.files import provenance, tables
    from facets.pictures import style
    from facets.pictures.calibration import residual_picture

    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path}: a configuration's name ends in .yaml")
    table, covariance = (
        path.with_name(f"{path.stem}-{kind}.csv") for kind in ("found", "covariance")
    )
    picture = path.with_suffix(f".{plot.value}")
    tables.refuse_to_overwrite([path, table, covariance, picture], force)
    asked = settings.calibrate
    wanted = choice(settings.sensor, asked.before)
    fitted, held = split(read(data, asked), asked.held_back)
    typer.echo(f"{len(fitted.raw)} samples fitted, {len(held.raw)} held back; "
               f"{len(wanted.names)} unknowns of the rig")  # fmt: skip
    show_weak(weak(information(settings.sensor, fitted, wanted), wanted, settings.sensor))
    found = fit(settings.sensor, fitted, wanted, asked.outliers)
    if not found.ended:
        typer.echo(f"not settled after {found.steps} steps: nothing is written", err=True)
        raise typer.Exit(1)
    changes = found_table(settings.sensor, found)
    show_found(changes, found)
    errors = validation(settings.sensor, found, held if len(held.raw) else fitted)
    show_errors(errors)
    about = provenance.about(settings)
    write_covariance(covariance, found, about)
    with tables.Whole(path) as temporary:
        temporary.write_text(as_yaml(settings, found, covariance, about), "utf-8")
    tables.write_table(table, changes, about)
    style.save(residual_picture(fitted, found, errors), picture)
    load(path)
    typer.echo(f"{path}, {covariance.name}, {table.name}, {picture.name}")


def show_weak(directions: list[Direction]) -> None:
    """What the data cannot tell, before anything is fitted."""
    if not directions:
        typer.echo("the motion tells every one of them better than it was known")
        return
    typer.echo("left to what was known before, since the motion tells less (how much, over that):")
    for direction in directions:
        typer.echo(f"  {direction.information:8.2g}  {direction.words}")


def show_found(table: dict[str, Any], found: Fit) -> None:
    from rich.console import Console
    from rich.table import Table

    shown = Table(box=None)
    for name in ("parameter", "known before", "change", "u (1 sigma)", "unit"):
        left = name in ("parameter", "unit")
        shown.add_column(name, justify="left" if left else "right", no_wrap=True)
    for name, unit, before, change, u in zip(*table.values(), strict=True):
        shown.add_row(name, f"± {before:.3g}", f"{change:+.4g}", f"{u:.2g}", unit)
    typer.echo("")
    Console(highlight=False, width=120).print(shown, "")
    outliers = int((found.weights < 1).any(axis=1).sum())
    typer.echo(f"settled in {found.steps} steps; {outliers} samples hold an outlier")


def show_errors(table: dict[str, Any]) -> None:
    typer.echo("\nr.m.s. error on what was held back, beam known; stated: by the uncertainties")
    typer.echo(f"  {'':6} {'before':>9} {'after':>9} {'stated':>9}")
    for axis, unit, before, after, stated in zip(*table.values(), strict=True):
        if after == after:
            typer.echo(f"  {axis:6} {before:9.3g} {after:9.3g} {stated:9.3g} {unit}")
    typer.echo("")


def write_covariance(path: Path, found: Fit, about: dict[str, str]) -> None:
    from facets.config.covariance import columns
    from facets.files.tables import write_table

    assert found.sensor.calibration is not None
    write_table(path, columns(found.sensor.calibration), about)


def as_yaml(settings: Config, found: Fit, covariance: Path, about: dict[str, str]) -> str:
    from hashlib import sha256

    from facets.config.geometry import written
    from facets.files.provenance import configuration

    keys = written(settings.resolved["sensor"], found.sensor)
    keys["calibration"] = {
        "file": covariance.name,
        "sha256": sha256(covariance.read_bytes()).hexdigest(),
    }
    return configuration(settings, keys, about)


def propose_poses(settings: Config, path: Path, count: int, force: bool) -> None:
    """Out of random poses and corners of half the range, those that together tell most."""
    import numpy as np

    from facets.calibration.identifiability import mean_left, proposed, told_by
    from facets.calibration.table import REFERENCE, choice
    from facets.characterization.ranges import axis_ranges, clearances
    from facets.core.names import STATE_UNITS
    from facets.files import provenance, tables

    tables.refuse_to_overwrite([path], force)
    tables.ending(path)
    sensor, asked = settings.sensor, settings.calibrate
    reach = np.array([a.symmetric / 2 for a in axis_ranges(sensor, settings.range, np.zeros(6))])
    rng = np.random.default_rng(1)
    shares = rng.uniform(-1, 1, (4000, 6))
    poses = np.where(np.isfinite(asked.reference), shares, 0.0) * reach
    poses = poses[clearances(sensor, poses, settings.range).min(axis=1) > 0]
    wanted = choice(sensor, asked.before)
    sigma = np.array(asked.reference)
    chosen, left = proposed(sensor, wanted, sigma, poses, count)
    rows = told_by(sensor, wanted, sigma, poses[:count]).reshape(-1, len(wanted.names))
    any_ones = mean_left(np.eye(rows.shape[1]) + rows.T @ rows)
    columns: dict[str, Any] = {
        name: poses[chosen, n] / STATE_UNITS[n] for n, name in enumerate(REFERENCE)
    }
    columns["mean_left"] = left
    tables.write_table(path, columns, provenance.about(settings))
    typer.echo(
        f"{path}: {count} poses; uncertainties are {left[-1]:.3g} of those before, in the "
        f"geometric mean; by as many at random {any_ones:.3g}"
    )
