"""The trials of `facets resolution`: propagation of distributions, to test the linear result."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from facets import characterization, core, files, pictures
from facets.core.errors import InputError
from facets.core.names import POSE, STATE_COLUMNS, STATE_UNITS

from ..console import draw_extra, report_lines, show_progress, show_table
from ..options import PlotKind

if TYPE_CHECKING:
    from facets.characterization.propagation import PropagationResult
    from facets.config import Config
    from facets.core.rules import Rules
    from facets.core.sensor import Sensor
    from facets.core.units import Floats

#: The coverage probability of trials where none is given.
DEFAULT_COVERAGE = 0.95

TrialCount = Annotated[
    int,
    typer.Option(
        "--trials",
        min=0,
        max=10**8,
        help="Number of trials at each pose, such as 1000000, that test the linear result; 0: no "
        "trials.",
    ),
]
PosesTable = Annotated[
    Path | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="Table of poses for --trials, CSV, Parquet or HDF5, with the columns tx_mm, ty_mm, "
        "tz_mm, roll_mrad, pitch_mrad, yaw_mrad and, for the beam, bx_mm, by_mm.  [default: at "
        "rest, and where the axes are worst]",
    ),
]


class TrialRequest(NamedTuple):
    """The trials that --trials requests; none for 0."""

    settings: Config
    rules: Rules
    trials: int
    probability: float
    seed: int
    table: Path | None

    def names(self, plot: PlotKind) -> list[str]:
        """Names of the table and the picture."""
        return ["trials.csv", f"trials.{plot.value}"] if self.trials else []

    def states(self) -> dict[str, Floats]:
        """The states (8,) of the trials by name, for valid requests."""
        if not self.trials:
            if self.table is not None:
                raise InputError(
                    f"--poses {self.table} gives the poses of trials, of which there are none; "
                    "add --trials 1000000, or leave --poses out"
                )
            return {}
        characterization.propagation.require_trials(self.trials, self.probability)
        if self.table is None:
            sensor, trials = self.settings.sensor, characterization.trials
            how = trials.estimator_of(self.settings.solve, sensor)
            return trials.default_states(sensor, self.rules, how)
        import numpy as np

        states: dict[str, Floats] = {}
        optional = STATE_COLUMNS[6:]
        for chunk in files.tables.read_chunks(self.table, STATE_COLUMNS[:6], optional):
            rows = np.zeros((len(chunk.lines), 8))
            for n, name in enumerate(STATE_COLUMNS):
                rows[:, n] = chunk.columns.get(name, 0.0) * STATE_UNITS[n]
            if self.rules.tracking and optional[0] not in chunk.columns:
                rows[:, 6:] = rows[:, :2]
            bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
            if len(bad):
                raise InputError(
                    f"{self.table}:{chunk.lines[bad[0]]}: this row is no pose; needed: a number in "
                    "each column"
                )
            for row in rows:
                states[f"at row {len(states) + 1} of {self.table.name}"] = row
        if not states:
            raise InputError(f"{self.table}: no rows")
        return states

    def run(self, states: dict[str, Floats]) -> dict[str, PropagationResult]:
        """Trials at each state; prints the results."""
        results: dict[str, PropagationResult] = {}
        with show_progress("trials") as on_progress:
            solved = 0

            def advance(more: int) -> None:
                nonlocal solved
                solved += more
                on_progress(solved, self.trials * len(states))

            method = characterization.propagation.MonteCarlo
            for number, (where, state) in enumerate(states.items()):
                results[where] = characterization.propagation.propagate_distributions(
                    self.settings.sensor,
                    self.settings.solve,
                    state,
                    method(self.trials, self.probability, (self.seed, number)),
                    object=self.settings.object,
                    advance=advance,
                )
        for where, result in results.items():
            show(where, result)
            if not result.is_stated:
                explain_failures(self.settings.sensor, result.state, result.trials.failures)
            print()
        if any(result.is_stated and any(result.validate()[1]) for result in results.values()):
            report_lines("A ? marks results that may agree to one digit more: more trials decide.")
        return results

    def record(self, results: dict[str, PropagationResult]) -> dict[str, Any]:
        """Entries of the record of the run."""
        if not results:
            return {}
        return {
            "trials": self.trials,
            "coverage_probability": self.probability,
            "agrees_to_digits": {
                where: dict(zip(POSE, result.validate()[0], strict=True))
                for where, result in results.items()
            },
        }

    def write(self, paths: list[Path], results: dict[str, PropagationResult]) -> None:
        """Write the table of the trials, and the picture of the pose where the linear result is
        farthest off."""
        if not results:
            return
        about = files.provenance.provenance_header(self.settings, self.seed)
        about |= {"coverage_probability": f"{self.probability:g}", "trials": str(self.trials)}
        files.tables.write_table(paths[0], characterization.tables.trial_columns(results), about)
        draw_extra(paths[1], pictures.trials.trials_picture, results)


def show(where: str, result: PropagationResult) -> None:
    rows, linear = [], result.linear
    expanded = linear.expanded_uncertainty(result.probability)[0]
    digits, undecided = result.validate()
    for i, name in enumerate(POSE):
        unit, place = core.units.unit_of(name), linear.pose[0, i]
        low, high = (unit.fine_factor * (end[i] - place) for end in result.symmetric[:2])
        ends, agreement = f"{low:.4g} {high:+.4g}", describe(digits[i], undecided[i])
        cells = [ends, agreement] if result.is_stated else ["-"] * 2
        linear_end = f"±{unit.fine_factor * expanded[i]:.4g}"
        rows.append([f"{name} {unit.fine_unit}", linear_end, *cells])
    percent = f"{100 * result.probability:g} %"
    headings = ["", "linear", "trials", "linear agrees to"]
    whose = "of the object's displacement " if linear.is_displacement else ""
    title = f"{percent} coverage intervals {whose}{where}, {result.count:,} trials"
    show_table(title, headings, rows)
    if result.is_stated:
        report_lines(
            f"Region of all six axes: coverage factor {result.region_factor:.3f} by the trials, "
            f"{result.linear_region_factor:.3f} by the linear result, whose region holds "
            f"{100 * result.linear_region_probability:.2f} % of the trials."
        )
    if failures := result.trials.failures:
        reasons = ", ".join(f"{number:,} {reason}" for reason, number in failures.items())
        report_lines(
            f"Trials without a pose: {reasons}. The intervals hold for measurements with a pose."
            if result.is_stated
            else f"Trials without a pose: {reasons}. These are more than the coverage probability "
            "allows, so that no interval is stated."
        )
    if result.far:
        report_lines(
            f"Trials more than {characterization.propagation.FAR_SIGMAS:g} standard uncertainties "
            f"from the estimate, such as those on a second solution: {result.far:,}."
        )


def explain_failures(sensor: Sensor, state: Floats, statuses: Collection[str]) -> None:
    """Explain why most trials at a state have no pose, unless the statuses do."""
    full = characterization.trials.saturated_detectors(sensor, state)
    for letter in full:
        report_lines(
            f"Detector {letter} has no reading there: its light drives a converter past the end of "
            "its range (sensor.electronics.adc_range_v), which the linear result does not count. "
            "The pose is outside the range; a smaller transimpedance_kohm avoids it."
        )
    if not full and not {"out of range", "no light"}.issuperset(statuses):
        report_lines("The cause is unknown; `facets render` shows the spots at such a pose.")


def describe(digits: int, undecided: bool) -> str:
    """The number of digits to which the linear result agrees, with ? where it may be one more."""
    words = ("not to one digit", "1 digit", "2 digits")[digits]
    return f"{words}?" if undecided else words
