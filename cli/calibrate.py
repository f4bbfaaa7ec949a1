"""`facets calibrate`: a rig's own parameters, from readings with reference poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facets import calibration
from facets.core.errors import InputError
from facets.core.plain_numbers import suggest_name

from .console import load_config
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
)
from .parts.calibration_files import CalibrationFiles, write_proposal, write_results
from .parts.calibration_fit import fit_rig

if TYPE_CHECKING:
    from facets.config import Config


DataTable = Annotated[
    Path | None,
    typer.Argument(
        metavar="DATA",
        help="Table of readings, CSV, Parquet, HDF5 or TDMS, with the reference's poses in the "
        "columns ref_tx_mm, ref_yaw_mrad and so on, or in --reference.",
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
        help="Table of the reference instrument's poses, CSV, Parquet, HDF5 or TDMS (LabVIEW), "
        "which is joined to DATA by the column time_s; an unknown offset in time is fitted.",
    ),
]
Effect = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="NAME=on|off|auto",
        help="Include an effect of real light in the fit, exclude it, or let the data "
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
        "gains, detectors, facets. All others are known by the covariance of CONFIG, and remain in "
        "the covariance that is written.",
    ),
]
Dwells = Annotated[
    bool,
    typer.Option(
        "--dwells",
        help="Average the readings over each interval in which the reference is at rest.",
    ),
]
AcceptMisfit = Annotated[
    bool,
    typer.Option("--accept-misfit", help="Write the result even if the checks refuse it."),
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

        facets calibrate rig run/readings.csv -o calibrated.yaml
        facets calibrate rig --propose 60 -o poses.csv

    The parameters are the detectors' positions and angles, the facets' angles, the gains and, if
    the data need them, effects of real light. DATA holds readings of a motion that a reference
    instrument measured, all axes or some; the beam's position must be known. The command prints
    which parameters the motion determines, the fitted values, and the errors of poses on samples
    that were not used in the fit. It writes a configuration with the parameters' covariance, which
    `facets solve` includes in the uncertainties. If the result is not to be trusted, it prints the
    reasons, writes nothing and ends with exit status 1.
    """
    settings, groups = load_config(config), read_groups(only)
    path = output or Path(f"{settings.name}-calibrated.yaml")
    if propose and (data or reference or report or groups):
        raise InputError(
            "--propose takes no DATA, no --only and no --report: it lists poses for a future "
            "calibration of all parameters"
        )
    if propose:
        path = output_folder(output, settings.name, "proposal.csv")
        write_proposal(settings, path, propose, force)
    elif data is None:
        raise InputError(
            "DATA is missing: a table of readings with reference poses, or --propose N"
        )
    else:
        settings = choose_effects(settings, effect or [])
        settings = replace(settings, calibrate=replace(settings.calibrate, dwells=dwells))
        paths = CalibrationFiles(data, reference, path, plot.value, report)
        paths.require(settings, force)
        write_results(*fit_rig(settings, paths, groups, accept_misfit), paths)


def read_groups(only: str | None) -> list[str]:
    """Read the groups of --only; none if all parameters are calibrated."""
    groups, names = [] if only is None else only.split(","), calibration.table.GROUPS
    for group in groups:
        if group not in names:
            near = suggest_name(group, names)
            raise InputError(f"--only has {group!r}; allowed: {', '.join(names)}, by commas{near}")
        if groups.count(group) > 1:
            raise InputError(f"--only has {group} twice; give it once")
    return groups


def choose_effects(settings: Config, decisions: list[str]) -> Config:
    """Set decisions about effects from the command line in the configuration."""
    effects, named = dict(settings.calibrate.effects), set()
    for text in decisions:
        name, _, decision = text.partition("=")
        if name in named:
            raise InputError(f"--effect is given twice for {name}; give it once")
        named.add(name)
        if name not in effects or decision not in ("on", "off", "auto"):
            raise InputError(
                f"--effect has {text!r}; allowed: NAME=on, NAME=off or NAME=auto, of "
                f"{', '.join(effects)}{suggest_name(name, effects)}"
            )
        effects[name] = decision
    return replace(settings, calibrate=replace(settings.calibrate, effects=effects))
