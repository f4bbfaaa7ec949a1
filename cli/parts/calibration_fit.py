"""The fit of `facets calibrate`: samples, unknowns, and the verdict on the result."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from facets import calibration

from ..console import FINDING
from ..sentences.calibration import show_lost_uncertainties, show_verdict, show_weak
from .calibration_files import CalibrationFiles

if TYPE_CHECKING:
    from facets.calibration.fitting.bundle_adjustment import Data
    from facets.calibration.verdict import Verdict
    from facets.config import Config
    from facets.core.calibrate import Calibrate


def fit_rig(
    settings: Config, paths: CalibrationFiles, groups: list[str], accept_misfit: bool
) -> tuple[Config, Verdict]:
    """Fit the rig's parameters, and print the result; exit status 1 if it is not to be trusted.

    groups: the only parameters that have changed; none if all are calibrated.
    Returns the configuration, with the settings `solve` for later readings, and the verdict.
    """
    samples, options = read_samples(settings, paths)
    unknowns = (
        calibration.table.choose_groups(settings.sensor, options, groups)
        if groups
        else calibration.table.choice(settings.sensor, options)
    )
    print(f"{len(samples.raw)} samples, {len(unknowns.names)} unknowns of the rig")
    if unknowns.joint:
        print(
            f"{len(unknowns.joint.names)} of them have the covariance of CONFIG as their prior; "
            f"changes are looked for in: {', '.join(groups)}."
        )
    else:
        show_weak(
            calibration.motions.weak_directions(
                calibration.motions.information(settings.sensor, samples, unknowns),
                unknowns,
                settings.sensor,
            )
        )
        show_lost_uncertainties(settings, unknowns)
    verdict = calibration.verdict.verdict(settings.sensor, samples, unknowns, options)
    settings, verdict = choose_power(settings, options, verdict)
    show_verdict(settings, verdict)
    if verdict.sensor is None or not (verdict.is_trusted or accept_misfit):
        print(
            "The calibration failed its checks (lines with !); nothing was written.",
            file=sys.stderr,
        )
        if verdict.sensor is not None:
            print("To write it nevertheless, add --accept-misfit.", file=sys.stderr)
        raise typer.Exit(FINDING)
    return settings, verdict


def choose_power(settings: Config, options: Calibrate, verdict: Verdict) -> tuple[Config, Verdict]:
    """Choose the prior knowledge of the laser's power for later readings; add the finding on it."""
    if verdict.sensor is None or verdict.fit is None:
        return settings, verdict
    solve, findings = calibration.findings.later_power(
        settings.solve, options, verdict.sensor, verdict.fit, verdict.fitted
    )
    later = replace(settings, solve=solve)
    return later, replace(verdict, findings=[*verdict.findings, *findings])


def read_samples(settings: Config, paths: CalibrationFiles) -> tuple[Data, Calibrate]:
    """Read the samples. With a joined reference, print its offset, and fit a delay that is
    `auto`, unless dwells are averaged. Raises `InputError` for unusable tables."""
    options, data, reference = settings.calibrate, paths.data, paths.reference
    if reference is None:
        return calibration.table.read(data, options), options
    joined = calibration.reference_join.join_tables(data, reference, settings.sensor, options)
    print(
        f"Joined {reference.name} at an offset of {1e3 * joined.offset:.4g} ms (likeness of the "
        f"motions: {joined.likeness:.3f}; 1 is perfect)."
    )
    if options.effects["delay"] == "auto" and not options.dwells:
        options = replace(options, effects=options.effects | {"delay": "on"})
    return joined.data, options
