"""`facets calibrate`: a rig's own parameters, from readings beside a reference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facets import calibration, characterization, files
from facets import config as configuration
from facets.core.errors import InputError
from facets.core.names import STATE_COLUMNS

from .console import FINDING, free_output, load_config, wrap
from .options import (
    ConfigName,
    Force,
    Look,
    Plot,
    PlotKind,
    Style,
    completion,
    output_folder,
    output_option,
    report_option,
    require_html,
    require_yaml,
)
from .parts.calibration_files import write_results
from .sentences.calibration import show_verdict, show_weak

if TYPE_CHECKING:
    from facets.calibration.bundle_adjustment import Data
    from facets.calibration.unknowns import Choice
    from facets.config import Config
    from facets.core.calibrate import Calibrate


DataTable = Annotated[
    Path | None,
    typer.Argument(
        metavar="DATA",
        help="Table of readings, CSV or Parquet, with the reference's poses in the columns "
        "ref_tx_mm, ref_yaw_mrad and so on, or in --reference.",
    ),
]
Output = Annotated[
    Path | None,
    output_option(
        "calibrated configuration, YAML, or with --propose a table of poses",
        "CONFIG-calibrated.yaml or results/CONFIG-proposal.csv",
    ),
]
Reference = Annotated[
    Path | None,
    typer.Option(
        "--reference",
        metavar="FILE",
        help="Table of the reference instrument's poses, CSV or Parquet, which is joined to "
        "DATA by the column time_s; an unknown offset in time is fitted.",
    ),
]
Effect = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="NAME=on|off|auto",
        help="Include an effect of real light in the fit, leave it out, or let the data "
        "decide; can be repeated.  [default: the configuration's `calibrate.effects`]",
        autocompletion=completion.assignments(completion.effects, ("on", "off", "auto")),
    ),
]
Only = Annotated[
    str | None,
    typer.Option(
        "--only",
        metavar="GROUP,...",
        help="Recalibrate a calibrated CONFIG in which only these parameters have changed: beam, "
        "gains, detectors, facets. All others are known by the covariance of CONFIG, and stay in "
        "the covariance that is written.",
    ),
]
Dwells = Annotated[
    bool,
    typer.Option(
        "--dwells",
        help="Average the readings over each interval in which the reference stands still.",
    ),
]
AcceptMisfit = Annotated[
    bool,
    typer.Option(
        "--accept-misfit", help="Write the result even if the checks say not to trust it."
    ),
]
Propose = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Write a table of the N poses that are best to calibrate with, instead of "
        "calibrating.",
    ),
]
Report = Annotated[
    Path | None,
    report_option(
        "the calibration certificate, with uncertainties, budget, validity and findings; the "
        "block `calibrate.statement` names sensor, reference and conditions"
    ),
]


def calibrate(
    config: ConfigName,
    data: DataTable = None,
    output: Output = None,
    reference: Reference = None,
    effect: Effect = None,
    only: Only = None,
    dwells: Dwells = False,
    accept_misfit: AcceptMisfit = False,
    propose: Propose = None,
    report: Report = None,
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
    path = output or Path(f"{settings.name}-calibrated.yaml")
    if propose and (data or reference or report):
        raise InputError(
            "--propose takes no DATA and no --report: it lists poses for a future motion"
        )
    if propose:
        path = output_folder(output, settings.name, "proposal.csv")
        write_proposal(settings, path, propose, force)
    elif data is None:
        raise InputError(
            "DATA is missing: a table of readings with reference poses, or --propose N"
        )
    else:
        asked = choose_effects(settings, effect or [])
        asked = replace(asked, calibrate=replace(asked.calibrate, dwells=dwells))
        fit_rig(asked, data, reference, path, plot, force, accept_misfit, read_groups(only), report)


def read_groups(only: str | None) -> list[str]:
    """Read the groups of --only; none if all parameters are calibrated."""
    groups, known = [] if only is None else only.split(","), calibration.table.GROUPS
    for group in groups:
        if group not in known or groups.count(group) > 1:
            raise InputError(f"--only {only}: give {', '.join(known)}, each once, by commas")
    return groups


def choose_effects(settings: Config, decisions: list[str]) -> Config:
    """Set decisions about effects from the command line in the configuration."""
    effects, named = dict(settings.calibrate.effects), set()
    for text in decisions:
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
    groups: list[str],
    report: Path | None,
) -> None:
    require_yaml(path)
    paths = result_files(path, plot)
    if report is not None:
        require_html(report)
    sources = [data, *filter(None, [reference])]
    read = [*configuration.source_files(settings), *sources]
    files.tables.refuse_to_overwrite([*paths, *filter(None, [report])], force, read)
    samples, asked = read_samples(settings, data, reference)
    chosen = (
        calibration.table.choose_groups(settings.sensor, asked, groups)
        if groups
        else calibration.table.choice(settings.sensor, asked)
    )
    wanted = calibration.table.add_seats(chosen, samples, asked)
    typer.echo(f"{len(samples.raw)} samples, {len(wanted.names)} unknowns of the rig")
    if wanted.joint:
        typer.echo(
            f"{len(wanted.joint.names)} of them are known before by the covariance of CONFIG; "
            f"changes are looked for in: {', '.join(groups)}."
        )
    else:
        show_weak(
            calibration.identifiability.weak_directions(
                calibration.identifiability.information(settings.sensor, samples, wanted),
                wanted,
                settings.sensor,
            )
        )
        show_lost_uncertainties(settings, wanted)
    found = calibration.verdict.verdict(settings.sensor, samples, wanted, asked)
    show_verdict(settings, found)
    if found.sensor is None or not (found.is_trusted or accept_misfit):
        typer.echo(
            "The calibration failed its checks (lines with !); nothing was written.", err=True
        )
        if found.sensor is not None:
            typer.echo("To write it nevertheless, add --accept-misfit.", err=True)
        raise typer.Exit(FINDING)
    write_results(settings, found, paths, sources, report)


def show_lost_uncertainties(settings: Config, unknowns: Choice) -> None:
    """Warn if a calibration loses the uncertainties of parameters that it does not fit."""
    known = settings.sensor.calibration
    lost = [] if known is None else [
        name for name in known.names
        if name in calibration.unknowns.OF_SENSOR and name not in unknowns.names
        and name != "beam.power"
    ]  # fmt: skip
    if lost:
        typer.echo(
            f"CONFIG has the uncertainties of {len(lost)} parameters that are not fitted here; the "
            "result\nwould take them as exact unless the data call for them. --only keeps them."
        )


def read_samples(settings: Config, data: Path, reference: Path | None) -> tuple[Data, Calibrate]:
    """Read the samples, and add the fitted time offset if a reference is joined."""
    asked = settings.calibrate
    if reference is None:
        return calibration.table.read(data, asked), asked
    joined = calibration.reference_join.join_tables(data, reference, settings.sensor, asked)
    typer.echo(
        f"Joined {reference.name} at an offset of {1e3 * joined.offset:.4g} ms (likeness of the "
        f"motions: {joined.likeness:.3f}; 1 is perfect)."
    )
    if asked.effects["delay"] == "auto" and not asked.dwells:
        asked = replace(asked, effects=asked.effects | {"delay": "on"})
    return joined.data, asked


def result_files(path: Path, plot: PlotKind) -> list[Path]:
    """Paths of the configuration, the table of unknowns, the covariance and the picture."""
    table, covariance = (
        path.with_name(f"{path.stem}-{kind}.csv") for kind in ("found", "covariance")
    )
    return [path, table, covariance, path.with_suffix(f".{plot.value}")]


def write_proposal(settings: Config, path: Path, count: int, force: bool) -> None:
    """Write a table of poses for a calibration; print how well they determine the parameters."""
    files.tables.refuse_to_overwrite([path], force, configuration.source_files(settings))
    files.tables.ending(path)
    poses = characterization.random_poses.poses_to_calibrate_with(settings)
    proposal = calibration.proposal.propose_poses(settings, poses, count)
    files.tables.write_table(path, proposal.columns, files.provenance.provenance_header(settings))
    different = len(set(zip(*(proposal.columns[name] for name in STATE_COLUMNS[:6]), strict=True)))
    again = f" ({different} different ones; what tells most is visited again)"
    text = (
        f"Wrote {count} poses to {path}{again * (different < count)}. A calibration with them "
        f"reduces the parameters' standard uncertainties to {100 * proposal.reduction:.3g} % of "
        f"their prior values (geometric mean); {count} random poses, to "
        f"{100 * proposal.random_reduction:.3g} %. Visiting them in this order shortens the path "
        f"by {100 * proposal.saving:.0f} % and approaches each axis's poses from below in "
        f"{100 * proposal.upward.min():.0f} to {100 * proposal.upward.max():.0f} % of them, so "
        "that backlash of the reference shows."
    )
    with free_output(path):
        typer.echo(wrap(text))
