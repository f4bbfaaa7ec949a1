"""`facets calibrate`: a rig's own parameters, from readings beside a reference."""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any

import typer

import facets
from facets import calibration, characterization, files, pictures
from facets import config as configuration
from facets.core.errors import FacetsError, InputError
from facets.core.names import DETECTORS, STATE_COLUMNS, STATE_UNITS

from . import completion
from .console import FINDING, load_config
from .options import ConfigName, Force, Look, Plot, PlotKind, Style, output_option

if TYPE_CHECKING:
    from facets.calibration.bundle_adjustment import Data
    from facets.calibration.effect_search import Search
    from facets.calibration.fit import Fit
    from facets.calibration.identifiability import Direction
    from facets.calibration.verdict import Verdict
    from facets.config import Config
    from facets.core.calibrate import Calibrate
    from facets.core.units import Floats


def calibrate(
    config: ConfigName,
    data: Annotated[
        Path | None,
        typer.Argument(
            help="Table of readings, CSV or Parquet, with the reference's poses in the columns "
            "ref_tx_mm, ref_yaw_mrad and so on, or in --reference."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option(
            "calibrated configuration, YAML, or with --propose a table of poses",
            "CONFIG-calibrated.yaml or CONFIG-poses.csv",
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help="Table of the reference instrument's poses, CSV or Parquet, which is joined to "
            "DATA by the column time_s; an unknown offset in time is fitted.",
        ),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            "--effect",
            metavar="NAME=on|off|auto",
            help="Include an effect of real light in the fit, leave it out, or let the data "
            "decide; can be repeated.  [default: the configuration's `calibrate.effects`]",
            autocompletion=completion.assignments(completion.effects, ("on", "off", "auto")),
        ),
    ] = None,
    dwells: Annotated[
        bool,
        typer.Option(
            "--dwells",
            help="Average the readings over each interval in which the reference stands still.",
        ),
    ] = False,
    accept_misfit: Annotated[
        bool,
        typer.Option(
            "--accept-misfit", help="Write the result even if the checks say not to trust it."
        ),
    ] = False,
    propose: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="Write a table of the N poses that are best to calibrate with, instead of "
            "calibrating; 0 calibrates.",
        ),
    ] = 0,
    force: Force = False,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
) -> None:
    """Fit the parameters of a rig to readings with reference poses.

    The parameters are the detectors' positions and angles, the facets' angles, the gains and, if
    the data need them, effects of real light. DATA holds readings of a motion that a reference
    instrument measured, all axes or some; the beam's position must be known. The command prints
    which parameters the motion determines, the fitted values, and the errors of poses on samples
    that were not used in the fit. It writes a configuration with the parameters' covariance, which
    `facets solve` includes in the uncertainties. If the result is not to be trusted, it prints the
    reasons, writes nothing and ends with exit status 1.
    """

    settings = load_config(config)
    path = output or Path(f"{settings.name}-{'poses.csv' if propose else 'calibrated.yaml'}")
    if propose and (data or reference):
        raise InputError("--propose takes no DATA: it lists poses for a motion that is still to be")
    if propose:
        propose_poses(settings, path, propose, force)
    elif data is None:
        raise InputError("DATA is missing: a table of readings beside a reference, or --propose N")
    else:
        asked = with_effects(settings, effect or [])
        asked = replace(asked, calibrate=replace(asked.calibrate, dwells=dwells))
        fit_rig(asked, data, reference, path, plot, force, accept_misfit)


def with_effects(settings: Config, asked: list[str]) -> Config:
    """The configuration with decisions about effects from the command line."""

    effects, named = dict(settings.calibrate.effects), set()
    for text in asked:
        name, _, decision = text.partition("=")
        if name in named:
            raise InputError(f"--effect has {name} twice; give it once")
        named.add(name)
        if name not in effects or decision not in ("on", "off", "auto"):
            raise InputError(
                f"--effect {text}: not NAME=on, NAME=off or NAME=auto; the names are "
                f"{', '.join(effects)}"
            )
        effects[name] = decision
    return replace(settings, calibrate=replace(settings.calibrate, effects=effects))


def fit_rig(
    settings: Config,
    data: Path,
    reference: Path | None,
    path: Path,
    plot: PlotKind,
    force: bool,
    accept_misfit: bool,
) -> None:

    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path}: a configuration's name ends in .yaml")
    paths = result_files(path, plot)
    files.tables.refuse_to_overwrite(paths, force)
    samples, asked = read_samples(settings, data, reference)
    wanted = calibration.table.and_seats(
        calibration.table.choice(settings.sensor, asked), samples, asked
    )
    typer.echo(f"{len(samples.raw)} samples, {len(wanted.names)} unknowns of the rig")
    show_weak(
        calibration.identifiability.weak(
            calibration.identifiability.information(settings.sensor, samples, wanted),
            wanted,
            settings.sensor,
        )
    )
    found = calibration.verdict.verdict(settings.sensor, samples, wanted, asked)
    show_verdict(settings, found)
    if found.sensor is None or not (found.trusted or accept_misfit):
        typer.echo("The calibration is not to be trusted; nothing is written.", err=True)
        if found.sensor is not None:
            typer.echo("--accept-misfit writes it all the same.", err=True)
        raise typer.Exit(FINDING)
    write_results(settings, found, paths)


def read_samples(settings: Config, data: Path, reference: Path | None) -> tuple[Data, Calibrate]:
    """The samples, and what is asked of them: a joined reference has an offset that is fitted."""

    asked = settings.calibrate
    if reference is None:
        return calibration.table.read(data, asked), asked
    joined = calibration.reference_join.read_joined(data, reference, settings.sensor, asked)
    typer.echo(
        f"{reference.name} joined at an offset of {1e3 * joined.offset:.4g} ms "
        f"(likeness of the motions {joined.likeness:.3f})"
    )
    if asked.effects["delay"] == "auto" and not asked.dwells:
        asked = replace(asked, effects=asked.effects | {"delay": "on"})
    return joined.data, asked


def result_files(path: Path, plot: PlotKind) -> list[Path]:
    """The configuration, the table of unknowns, the covariance, the picture."""
    table, covariance = (
        path.with_name(f"{path.stem}-{kind}.csv") for kind in ("found", "covariance")
    )
    return [path, table, covariance, path.with_suffix(f".{plot.value}")]


def write_results(settings: Config, found: Verdict, paths: list[Path]) -> None:
    """Written beside first and loaded from there, so that no file is left that can not be."""

    path, table, covariance, picture = paths
    assert found.found is not None
    assert found.errors is not None
    assert found.search is not None
    about = files.provenance.about(settings)
    with TemporaryDirectory() as folder:
        trial = Path(folder) / path.name
        matrix = trial.with_name(covariance.name)
        write_covariance(matrix, found.found, about)
        bent = write_grids(settings, trial, found.found, about)
        trial.write_text(as_yaml(settings, found.found, matrix, bent, about), "utf-8")
        try:
            facets.load(trial)
        except FacetsError as error:
            typer.echo(
                f"What was found makes no configuration that can be loaded ({error}); nothing is "
                "written. Look for a swapped sign or unit in the columns.",
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
    typer.echo(", ".join(str(file) if file == path else file.name for file in paths))


def show_weak(directions: list[Direction]) -> None:
    """What the data cannot tell, before anything is fitted."""
    if not directions:
        typer.echo("The motion tells every one of them better than it was known.")
        return
    typer.echo(
        "The motion says less about these than was known before; they keep their prior values\n"
        "(how much it says, over what was known):"
    )
    for direction in directions:
        typer.echo(f"  {direction.information:8.2g}  {direction.words}")


def show_verdict(settings: Config, found: Verdict) -> None:
    if found.search is not None:
        show_candidates(found.search)
    if found.errors is not None and found.found is not None and found.search is not None:
        show_found(calibration.table.found_table(found.search.sensor, found.found), found.found)
        show_errors(found.errors)
    for one in found.findings:
        typer.echo(wrapped(("! " if one.bad else "- ") + one.words))
    if found.found is not None and found.trusted:
        typer.echo(
            f"Settled in {found.found.steps} steps; chi-square is {found.found.reduced:.3f} for "
            "each degree of freedom (1 within chance is right)."
        )


def wrapped(words: str) -> str:

    return fill(words, 100, subsequent_indent="  ")


def show_candidates(done: Search) -> None:
    """Which effects the data call for."""
    from rich.console import Console
    from rich.table import Table

    shown = Table(box=None)
    columns = ("effect", "unknowns", "fall of chi-square", "error left out", "", "why")
    for name in columns:
        left = name in ("effect", "", "why")
        shown.add_column(name, justify="left" if left else "right", no_wrap=True)
    shown.add_row(
        "the plain fit", str(len(done.plain.choice.names)), "", f"{done.error:.4f}", "", ""
    )
    for row in done.rows:
        error = f"{row.error:.4f}" if row.error == row.error else ""
        fall = f"{row.fall:.5g}" if row.fall == row.fall else ""
        decision = "taken" if row.taken else "left"
        shown.add_row(row.words, str(row.unknowns), fall, error, decision, row.why)
    typer.echo("\nEffects that the data call for; error left out: of readings that the fit did not "
               "see, over their noise")  # fmt: skip
    Console(highlight=False, width=130).print(shown, "")


def show_found(table: dict[str, Any], found: Fit) -> None:
    from rich.console import Console
    from rich.table import Table

    shown = Table(box=None)
    for name in ("parameter", "known before", "change", "u (1 sigma)", "unit"):
        left = name in ("parameter", "unit")
        shown.add_column(name, justify="left" if left else "right", no_wrap=True)
    for name, unit, before, change, u in zip(*table.values(), strict=True):
        shown.add_row(name, f"± {before:.3g}", f"{change:+.4g}", f"{u:.2g}", unit)
    Console(highlight=False, width=120).print(shown, "")


def show_errors(table: dict[str, Any]) -> None:
    typer.echo(
        "Errors of poses on samples held back, beam known: r.m.s. before and after, robust (from "
        "the median),\nas stated by the uncertainties; and how many 95 % intervals held"
    )
    typer.echo(f"  {'':6} {'before':>9} {'after':>9} {'robust':>9} {'stated':>9}       {'held':>6}")
    for axis, unit, before, after, robust, stated, inside in zip(*table.values(), strict=True):
        if after == after:
            typer.echo(
                f"  {axis:6} {before:9.3g} {after:9.3g} {robust:9.3g} {stated:9.3g} {unit:4} "
                f"{inside:6.1f} %"
            )
    typer.echo("")


def write_covariance(path: Path, found: Fit, about: dict[str, str]) -> None:

    assert found.sensor.calibration is not None
    files.tables.write_table(
        path, configuration.covariance.columns(found.sensor.calibration), about
    )


def write_grids(
    settings: Config, beside: Path, found: Fit, about: dict[str, str]
) -> dict[str, Path]:
    """Tables of detectors that were found to be bent beyond third order, by letter."""

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
    }
    for letter, table in bent.items():
        keys["psd"][letter]["correction"] |= {
            "table": table.name,
            "table_sha256": sha256(table.read_bytes()).hexdigest(),
        }
    return files.provenance.configuration(with_power(settings), keys, about)


def with_power(settings: Config) -> Config:
    """A calibration tells the laser's power on its day; a pose solved later holds it to a prior."""

    solve = settings.resolved["solve"]
    if solve["power"] != "known" or solve["method"] == "paper":
        return settings
    if settings.calibrate.power_per_sample:
        solve = solve | {"power": "prior"}
    return replace(settings, resolved=settings.resolved | {"solve": solve})


def propose_poses(settings: Config, path: Path, count: int, force: bool) -> None:
    """Out of random poses, those that together tell most, in an order that is short to travel."""
    import numpy as np

    files.tables.refuse_to_overwrite([path], force)
    files.tables.ending(path)
    sensor, asked = settings.sensor, settings.calibrate
    poses = possible_poses(settings)
    if not len(poses):
        raise InputError(
            f"{settings.name}: no pose of a motion to calibrate with has light on all detectors "
            f"and its spots {EDGE} mm from their edges"
        )
    wanted = calibration.table.choice(sensor, asked)
    sigma = np.array(asked.reference)
    chosen, left = calibration.identifiability.proposed(sensor, wanted, sigma, poses, count)
    rows = calibration.identifiability.told_by(sensor, wanted, sigma, poses[:count]).reshape(
        -1, len(wanted.names)
    )
    any_ones = calibration.identifiability.mean_left(np.eye(rows.shape[1]) + rows.T @ rows)
    shares = poses[chosen] / np.maximum(np.abs(poses).max(axis=0), 1e-12)
    rest = np.zeros((1, 6))
    order = calibration.tour.short_order(shares, rest[0])
    columns: dict[str, Any] = {
        name: poses[chosen[order], n] / STATE_UNITS[n] for n, name in enumerate(STATE_COLUMNS[:6])
    }
    columns["rank"], columns["mean_left"] = order + 1, left[order]
    files.tables.write_table(path, columns, files.provenance.about(settings))
    long, short = (
        calibration.tour.travel(np.vstack([rest, rows])) for rows in (shares, shares[order])
    )
    typer.echo(
        f"{path}: {count} poses; uncertainties are {left[-1]:.3g} of those before, in the "
        f"geometric mean; by as many at random {any_ones:.3g}. In this order the way is "
        f"{100 * (1 - short / long):.0f} % shorter than by rank"
    )


#: Of a motion to calibrate with: how far it goes in x and y, in diameters of the beam; how near to
#: a detector's edge the spots come, mm; the least power over its noise.
REACH, EDGE, LEAST = 0.3, 1.2, 100.0


def possible_poses(settings: Config) -> Floats:
    """Random poses (n, 6) within half the range of z and the angles, mm and rad.

    Further in x and y, where only powers that bend part gains, lost strips and the beam's size
    from the apex's place.
    """

    import numpy as np

    sensor, beam = settings.sensor, settings.sensor.beam
    reach = np.array(
        [
            a.symmetric / 2
            for a in characterization.ranges.axis_ranges(sensor, settings.range, np.zeros(6))
        ]
    )
    reach[:2] = np.maximum(reach[:2], REACH * min(beam.diameter_x, beam.diameter_y))
    shares = np.random.default_rng(1).uniform(-1, 1, (4000, 6))
    measured = np.isfinite(settings.calibrate.reference)
    poses = np.where(measured, shares, 0.0) * reach
    rules = replace(settings.range, whole_spot=False, snr=min(settings.range.snr, LEAST))
    margin = characterization.ranges.clearances(sensor, poses, rules)
    margin[:, 0] -= max(
        EDGE / (size / 2) for psd in sensor.psds for size in (psd.size_y, psd.size_z)
    )
    found: Floats = poses[margin.min(axis=1) > 0]
    return found
