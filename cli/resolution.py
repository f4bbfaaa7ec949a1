"""`facets resolution`: how fine the sensor measures, and what limits it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from facets import characterization, core, estimation, pictures
from facets.core.names import POSE

from .console import (
    FINDING,
    draw_extra,
    load_config,
    report_coverage,
    report_lines,
    show_table,
)
from .options import (
    ConfigName,
    Coverage,
    Force,
    Look,
    Plot,
    PlotKind,
    Point,
    Style,
    Track,
    folder_option,
    output_folder,
    seed_option,
)
from .options.places import choose_point, object_rules, report_object
from .parts.trials import DEFAULT_COVERAGE, PosesTable, TrialCount, TrialRequest
from .results import ResultFolder

if TYPE_CHECKING:
    from facets.characterization.pose_density import PoseDensity
    from facets.characterization.resolution import Resolution
    from facets.config import Config


def resolution(
    config: ConfigName,
    track: Track = False,
    folder: Annotated[Path | None, folder_option("results/CONFIG-resolution")] = None,
    force: Force = False,
    plot: Plot = PlotKind.png,
    look: Style = Look.screen,
    coverage: Coverage = None,
    point: Point = None,
    trials: TrialCount = 0,
    poses: PosesTable = None,
    seed: Annotated[int, seed_option()] = 1,
) -> None:
    """Compute each axis's uncertainty, at rest and at worst.

        facets resolution paper
        facets resolution paper --coverage 0.95 --trials 100000

    Prints standard uncertainties (1 sigma) at rest and at two worst poses, which are searched. One
    lies in each axis's own symmetric range, with the other axes at rest; the other, in the box that
    `range-map` prints, all axes at once. They are computed for the paper's inversion
    and for the least-squares solver with the beam's position free, known within
    `solve.beam_sigma_um`, and known exactly. Writes a table, a picture of the noise budget at
    rest and a record of the run into the folder. --coverage adds expanded uncertainties. With an
    object in the configuration or --point, the axes are those of the object's displacement from its
    pose at the mirror's zero.

    --trials tests these linear results by propagation of distributions: it draws readings, priors
    and calibrated parameters, solves each trial by the full model as `solve` in CONFIG says, and
    writes coverage intervals and a picture. Exit status 1 if more trials have no pose than the
    coverage probability leaves.
    """
    settings = choose_point(load_config(config), point)
    rules = object_rules(settings, track)
    request = TrialRequest(settings, rules, trials, coverage or DEFAULT_COVERAGE, seed, poses)
    names = ["resolution.csv", f"budget.{plot.value}", "run.yaml", *request.names(plot)]
    results = ResultFolder(
        output_folder(folder, settings.name, "resolution"), names, force, [poses]
    )
    states = request.states()
    resolutions = characterization.resolution.resolve(
        settings.sensor, rules, characterization.resolution.estimators(settings.solve.beam_sigma)
    )
    densities = [
        characterization.pose_density.density_at_rest(
            settings.sensor, row.how, settings.electronics.bandwidth, settings.object
        )
        for row in resolutions
    ]
    report_object(settings)
    show(resolutions, coverage)
    show_densities(resolutions, densities, settings)
    stated = {}
    if coverage is not None:
        stated = estimation.uncertainty.describe_coverage(settings.sensor, coverage)
        report_coverage(stated)
    propagated = request.run(states)
    with results.publish(settings, more=stated) as (table, picture, _, *trial_paths):
        columns = characterization.tables.resolution_columns(resolutions, densities, coverage)
        results.write_table(table, columns)
        draw_extra(picture, pictures.resolution.budget_picture, resolutions)
        request.write(trial_paths, propagated)
        entries = {"tracking": track, "estimators": [row.how.name for row in resolutions]}
        results.write_record(entries | request.record(propagated), seed if trials else None)
    results.name()
    if not all(result.is_stated for result in propagated.values()):
        raise typer.Exit(FINDING)


def show(resolutions: list[Resolution], coverage: float | None = None) -> None:
    headings = ["", *(f"{name} {core.units.unit_of(name).fine_unit}" for name in POSE)]
    kind = "standard uncertainty, 1 sigma"
    if coverage is not None:
        kind = f"expanded uncertainty, {100 * coverage:g} %"
    places = (
        ("at rest", "nominal"),
        ("at worst over each axis's own range", "worst"),
        ("at worst anywhere in the box", "worst_in_box"),
    )
    for number, (title, field) in enumerate(places):
        rows = []
        for row in resolutions:
            factor = 1.0 if coverage is None else row.coverage(coverage)[number][1]
            values = zip(POSE, factor * getattr(row, field), strict=True)
            cells = [
                f"{core.units.unit_of(name).fine_factor * value:.3g}" for name, value in values
            ]
            rows.append([row.how.name, *cells])
        show_table(f"{kind}, {title}", headings, rows)
    box = [
        f"{name} {core.units.unit_of(name).factor * half:.4g} {core.units.unit_of(name).unit}"
        for name, half in zip(POSE, resolutions[0].box, strict=True)
    ]
    report_lines(
        f"The box, +-, all six axes at once: {', '.join(box)}. It is narrower than each axis's own "
        "range, so its worst uncertainty can be the smaller one."
    )
    finer = resolutions[0].worst / resolutions[-1].worst
    gains = ", ".join(f"{name} {gain:.3g}" for name, gain in zip(POSE, finer, strict=True))
    print(f"with the beam known, finer than the paper's inversion by: {gains}\n")


def show_densities(
    resolutions: list[Resolution], densities: list[PoseDensity], settings: Config
) -> None:
    """Print the noise at rest by frequency and by averaging time, the beam free and known."""
    import numpy as np

    stated = characterization.pose_density
    units = [core.units.unit_of(name) for name in POSE]
    headings = [
        "",
        *(f"{name} n{unit.fine_unit[1:]}" for name, unit in zip(POSE, units, strict=True)),
    ]
    nano = np.array([1e3 * unit.fine_factor for unit in units])
    density, deviation = [], []
    for row, noise in zip(resolutions, densities, strict=True):
        if row.how.name in ("beam free", "beam known"):
            for frequency in stated.FREQUENCIES.values():
                cells = [f"{value:.3g}" for value in nano * noise.amplitude(frequency)]
                density.append([f"{row.how.name}, {frequency:g} Hz", *cells])
            for tau in stated.AVERAGING_TIMES.values():
                cells = [f"{value:.3g}" for value in nano * noise.allan_deviation(tau)]
                deviation.append([f"{row.how.name}, {tau:g} s", *cells])
    show_table("noise at rest per sqrt(Hz), by frequency", headings, density)
    show_table("Allan deviation at rest, by averaging time", headings, deviation)
    report_slow_noise(densities, settings)


def report_slow_noise(densities: list[PoseDensity], settings: Config) -> None:
    """Print whether slow noise is in the densities; some of sensor.drift may have no effect."""
    readings = f"of readings of {settings.electronics.bandwidth:g} Hz bandwidth"
    if any(noise.flicker.any() or noise.walk.any() for noise in densities):
        report_lines(f"This is the white noise {readings}, and the slow noise of sensor.drift.")
        return
    reason = "the configuration has no sensor.drift"
    if settings.sensor.drift != core.sensor.Drift():
        reason = (
            "sensor.drift has no effect, since flicker_corner_hz needs sensor.electronics, and "
            "temperature_mk_rthz the coefficients of sensor.temperature"
        )
    report_lines(
        f"This is a white floor alone, {readings}: {reason}. Do not compare it with a measured "
        "density or drift, which has slow noise in it; the configuration bench-drift has some."
    )
