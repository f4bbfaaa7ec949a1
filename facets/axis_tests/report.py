"""The result of a test of an axis: quantities, tables and notes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..core import (
    MIRROR,
    Config,
    Floats,
    InputError,
    Knowledge,
    Sensor,
    check_arguments,
    show_shortly,
    write_micro,
)
from ..estimation import finite_means, make_plan
from ..files import FrameTable, make_frame
from .disturbances import Disturbances, find_disturbances
from .error_motions import AxisTest, ErrorMotions, ReferenceLine, Visits, measure_error_motions
from .positioning import (
    COVERAGE,
    STANDARD_RUNS,
    Quantity,
    bidirectional_means,
    evaluate_positioning,
    reversals,
    standard_deviations_of_runs,
    unidirectional_means,
)
from .visits import PoseSeries, VisitCounts, find_visits, read_commands, read_series

if TYPE_CHECKING:
    from pandas import DataFrame

#: A beam whose position varies by more than this between dwells was moved by a stage.
STILL_BEAM_MM = 0.02
#: Largest angle between an axis under test and the object's axis, degrees.
LARGEST_LEAN_DEG = 10.0
#: Scatter within dwells, over the sensor's noise, that is reported.
LARGE_EXCESS = 2.0
#: The expanded uncertainty of the accuracy is reported as large above this fraction of it.
LARGE_FRACTION = 1 / 3


@show_shortly
@dataclass(frozen=True)
class AxisReport:
    """A test of an axis.

    Attributes
    ----------
    motions
        The error motions at all dwells.
    visits
        The dwells.
    counts
        Numbers of excluded dwells, commands and rows.
    line
        The reference of straightness or tilt.
    has_commands
        Whether commanded positions were given; without them the scale is unknown.
    is_calibrated
        Whether the sensor has a calibration with its covariance.
    disturbances
        Outlying dwells, and drift.
    undisturbed
        The report without outliers and drift; None if there are none.
    """

    motions: ErrorMotions
    visits: Visits
    counts: VisitCounts
    line: ReferenceLine
    has_commands: bool
    is_calibrated: bool
    disturbances: Disturbances
    undisturbed: AxisReport | None = None

    def units(self, component: int) -> tuple[str, float]:
        """The unit of a component's errors, and the factor to it."""
        return ("um", 1e3) if component < 3 else ("urad", 1e6)

    @property
    def position_unit(self) -> tuple[str, float]:
        """The unit of positions along the axis, and the factor to it from mm or rad."""
        return ("deg", 180 / np.pi) if self.motions.is_rotary else ("mm", 1.0)

    @cached_property
    def quantities(self) -> list[list[Quantity]]:
        """The quantities of each component, in mm and rad; those of the main component are those
        of ISO 230-2."""
        pairs = zip(self.motions.values, self.motions.draws, strict=True)
        return [evaluate_positioning(x, errors) for x, errors in pairs]

    @cached_property
    def means(self) -> Floats:
        """The error motions (6, m): bidirectional means, or the means of the only direction."""
        return self.mean_of_directions(self.motions.values)

    @cached_property
    def uncertainties(self) -> Floats:
        """The standard uncertainties (6, m) of `means`."""
        sigma: Floats = self.mean_of_directions(self.motions.draws).std(axis=1)
        return sigma

    def mean_of_directions(self, x: Floats) -> Floats:
        """Means (..., m) over both directions, or over the only one that a target has."""
        means, middle = unidirectional_means(x), bidirectional_means(x)
        return np.where(np.isfinite(middle), middle, finite_means(means))

    @property
    def runs(self) -> tuple[int, int]:
        """The least number of runs at a target, in the positive and the negative direction."""
        there = np.isfinite(self.motions.values[self.motions.main]).sum(axis=2)
        return int(there[:, 0].min()), int(there[:, 1].min())

    @property
    def drifts(self) -> Floats:
        """The range (6,) of the drift of each error motion, mm and rad; negative if the highest
        value came first."""
        trend = self.disturbances.trend
        sizes: Floats = np.ptp(trend, axis=0) * np.sign(trend.argmax(axis=0) - trend.argmin(axis=0))
        return sizes

    def table(self) -> dict[str, Any]:
        """The error motions by position as columns, in um and urad."""
        unit, factor = self.position_unit
        columns: dict[str, Any] = {f"position_{unit}": factor * self.motions.targets}
        there = np.isfinite(self.motions.values[self.motions.main]).sum(axis=2)
        columns |= {"runs_up": there[:, 0], "runs_down": there[:, 1]}
        for n, name in enumerate(self.motions.names):
            x = self.motions.values[n]
            fine, scale = self.units(n)
            up, down = unidirectional_means(x).T
            spread = standard_deviations_of_runs(x).T
            values = {
                name: self.means[n], f"u_{name}": self.uncertainties[n], f"{name}_up": up,
                f"{name}_down": down, f"{name}_reversal": reversals(x),
                f"{name}_s_up": spread[0], f"{name}_s_down": spread[1],
            }  # fmt: skip
            columns |= {f"{key}_{fine}": scale * value for key, value in values.items()}
        return columns

    def to_frame(self) -> DataFrame:
        """The error motions by position, the columns of `table`, as a data frame of pandas."""
        return make_frame(self.table())

    def summary(self) -> dict[str, Any]:
        """All quantities of all error motions as columns."""
        rows = [
            (name, q.symbol, scale * q.value, scale * q.expanded, unit, q.name)
            for n, name in enumerate(self.motions.names)
            for unit, scale in [self.units(n)]
            for q in self.quantities[n]
        ]
        heads = ("error", "symbol", "value", "expanded_uncertainty", "unit", "name")
        return {head: np.array(column) for head, column in zip(heads, zip(*rows, strict=True),
                                                               strict=True)}  # fmt: skip

    def compensation(self) -> str:
        """The error motions as plain CSV without comments, for controllers.

        Outliers and drift are removed. The values are errors, actual less commanded: a correction
        has the opposite sign.
        """
        _, factor = self.position_unit
        rows = [",".join([self.motions.axis, *self.motions.names])]
        means = (self.undisturbed or self).means
        for target, errors in zip(self.motions.targets, means.T, strict=True):
            if np.isfinite(errors).all():
                scaled = [value * self.units(n)[1] for n, value in enumerate(errors)]
                rows.append(",".join(f"{value:.6g}" for value in (factor * target, *scaled)))
        return "\n".join(rows) + "\n"

    def alignment(self) -> str:
        """A sentence on the direction of the axis, and on the position of a rotary one."""
        main = self.motions.main % 3
        across = [n for n in range(3) if n != main]
        names = " and ".join("XYZ"[n] for n in across)
        tilts = " and ".join(f"{1e3 * self.motions.frame[main, n]:+.3g}" for n in across)
        words = f"Its direction leans by {tilts} mrad towards {names} of the object. "
        if self.motions.is_rotary:
            places = " and ".join(f"{self.motions.offset[n]:+.3g}" for n in across)
            words += f"It lies {places} mm from the point of interest in {names}. "
        if self.line == "nominal":
            kind = "tilt" if self.motions.is_rotary else "straightness"
            return f"{words}The lean is part of the {kind}, and not of the positioning."
        return f"{words}Neither is part of the errors."

    def record(self) -> dict[str, Any]:
        """The entries of the record of the run."""
        unit, _ = self.position_unit
        return {
            "axis": self.motions.axis,
            "straightness_line": self.line,
            "coverage_probability": COVERAGE,
            "stands": len(self.visits.target),
            "runs": {"up": self.runs[0], "down": self.runs[1]},
            "left_out": {
                "stray_stands": self.counts.stray_dwells,
                "commands_without_stand": len(self.counts.missing),
                "rows_without_pose": self.counts.unsolved,
                "misfits": self.counts.misfits,
            },
            "compensation": f"errors (actual less commanded) in um and urad at positions in {unit},"
            " without drift and outlying dwells; a correction has the opposite sign",
            "notes": self.notes(),
        }

    def notes(self) -> list[str]:
        """Sentences on what needs attention, with a likely cause."""
        return [*self.omission_notes(), *self.run_notes(), *self.trust_notes()]

    def omission_notes(self) -> list[str]:
        """Notes on excluded dwells, commands and rows."""
        counts, sentences = self.counts, []
        unit, factor = self.position_unit
        if counts.stray_dwells:
            sentences.append(
                f"Dwells that belong to no command, excluded: {counts.stray_dwells}. Likely cause: "
                "the axis paused on its way, before the test or after it, or repeated the test."
            )
        if counts.missing:
            sentences.append(
                f"Commanded positions without a dwell: {len(counts.missing)}, the first at "
                f"{factor * counts.missing[0]:.6g} {unit}. Likely cause: the recording ended "
                "earlier, the axis was at rest for less than --dwell, the pose was lost there, or "
                "the object's axis points against that of the commands, so that runs are swapped. "
                "No compensation is written."
            )
        if counts.misfits:
            sentences.append(
                f"Poses with a residual beyond chance, excluded: {counts.misfits}; one in 10,000 "
                "is expected."
            )
        if counts.unsolved:
            sentences.append(
                f"Rows without a pose, excluded: {counts.unsolved}. Likely cause: a spot left "
                "its detector or the mirror left the beam; see the statuses of `facets "
                "replay`."
            )
        if counts.doubtful:
            sentences.append(
                f"Dwells where most rows have no pose: {len(counts.doubtful)}, the first at "
                f"{factor * counts.doubtful[0]:.6g} {unit}. Likely cause: this position is at the "
                "end of the sensor's range; see `facets range-map`."
            )
        return sentences

    def run_notes(self) -> list[str]:
        """Notes on too few positions or runs, and on missing commands."""
        sentences, (up, down) = [], self.runs
        if min(up, down) < STANDARD_RUNS:
            sentences.append(
                f"The fewest runs at a position are {up} in the positive and {down} in the "
                f"negative direction; ISO 230-2 takes {STANDARD_RUNS} of each. "
                + (
                    "Quantities that need two runs or both directions exclude positions without."
                    if min(up, down) < 2
                    else "Repeatabilities of few runs vary much from test to test."
                )
            )
        if len(self.motions.targets) < 5:
            sentences.append(
                f"There are {len(self.motions.targets)} positions; ISO 230-2 takes at least 5 for "
                "a linear axis, 3 for up to 90 degrees of a rotary one."
            )
        if not self.has_commands:
            sentences.append(
                "No commanded positions were given: the positions are taken as equally spaced by "
                "the measured step. An error of scale cannot be seen."
            )
        return sentences

    def trust_notes(self) -> list[str]:
        """Notes on the limits and the sources of the stated uncertainties."""
        sentences = []
        if not self.is_calibrated:
            sentences.append(
                "The configuration has no calibration of the sensor: U holds the noise and the "
                "converters' steps alone, as if the sensor were exactly as it is configured."
            )
        sentences += self.disturbance_notes()
        excess = self.visits.excess
        for kind, part in (("shifts", excess[:3]), ("angles", excess[3:])):
            if part.max() > LARGE_EXCESS:
                sentences.append(
                    f"Within dwells the {kind} scatter {part.max():.2g} times as much as the "
                    "sensor's noise, which the uncertainties include. Likely cause: vibration, or "
                    "an axis that still settles."
                )
        accuracy = self.quantities[self.motions.main][-1]
        if accuracy.expanded > LARGE_FRACTION * accuracy.value:
            sentences.append(
                "The expanded uncertainty of the accuracy A is more than a third of it: much of "
                "what is seen is the sensor's. Longer dwells and more runs reduce the noise's part."
            )
        return sentences

    def disturbance_notes(self) -> list[str]:
        """Notes on outlying dwells and on drift, with the quantities without them."""
        sentences, (unit, factor) = [], self.position_unit
        far, names = self.disturbances.is_far, self.motions.names
        if far.any():
            dwells = "; ".join(
                f"at {factor * self.motions.targets[self.visits.target[k]]:.6g} {unit} "
                f"({self.visits.time[k]:.4g} s), {self.write_sizes(distances)}"
                for k, distances in enumerate(self.disturbances.distances)
                if far[k]
            )
            sentences.append(
                f"Dwells far from the others of their position and direction: {dwells}. Likely "
                "cause: a knock, dirt, or a dwell that was not reached."
            )
        if self.drifts.any():
            sentences.append(
                f"Equal positions drifted during the test: {self.write_sizes(self.drifts)}. "
                "Possible causes: the axis or its encoder, the laser's beam or the detectors' "
                "posts warmed up."
            )
        if self.undisturbed is not None:
            unit, scale = self.units(self.motions.main)
            sizes = ", ".join(
                f"{q.symbol} {scale * q.value:.4g} ± {scale * q.expanded:.2g}"
                for q in self.undisturbed.quantities[self.motions.main]
                if q.symbol in ("B", "B_mean", "R", "E", "A") and np.isfinite(q.value)
            )
            sentences.append(
                f"Without this, {names[self.motions.main]} has {sizes} {write_micro(unit)}. The "
                "compensation is without it; all other results hold it."
            )
        return sentences

    def write_sizes(self, sizes: Floats) -> str:
        """Format the sizes (6,) of error motions, mm and rad, that are not 0."""
        return ", ".join(
            f"{name} by {scale * size:+.3g} {write_micro(unit)}"
            for n, (name, size) in enumerate(zip(self.motions.names, sizes, strict=True))
            for unit, scale in [self.units(n)]
            if size
        )


def evaluate_axis(
    sensor: Sensor,
    knowledge: Knowledge,
    series: PoseSeries,
    test: AxisTest,
) -> AxisReport:
    """Evaluate a test of an axis: find its dwells, and compute its error motions.

    Parameters
    ----------
    sensor, knowledge
        The sensor and the knowledge of its beam, such as `config.sensor` and
        `config.solve.knowledge(config.sensor)`.
    series
        The solved poses in time.
    test
        The setting: the axis and its commands, the point of interest, the reference of
        straightness, and the shortest dwell, such as `AxisTest("X", commands)`.

    Returns
    -------
    AxisReport
        Error motions, the quantities of ISO 230-2, tables and notes.

    Raises
    ------
    InputError
        If no row has a pose, fewer than two dwells are found, or they fit neither the commands nor
        this axis. Also if all commands are equal, dwells without commands are unevenly spaced, or
        the axis leans by more than 10 degrees from the object's.
    """
    plan = make_plan(sensor, knowledge)
    visits, counts = find_visits(series, test, sensor, plan)
    place = visits.states[:, 6:]
    is_tracked = knowledge.beam != "free" and bool((np.ptp(place, axis=0) > STILL_BEAM_MM).any())
    motions = measure_error_motions(sensor, knowledge, visits, test, is_tracked)
    main = motions.main % 3
    lean = np.degrees(np.arccos(min(1.0, motions.frame[main, main])))
    if lean > LARGEST_LEAN_DEG:
        raise InputError(
            f"the axis leans by {lean:.3g} degrees from the object's {'XYZ'[main]}; allowed: "
            f"{LARGEST_LEAN_DEG:g}. Turn the object's axes with `object:` in the configuration"
        )
    disturbances = find_disturbances(visits, motions)
    report = AxisReport(
        motions, visits, counts, test.line, test.commands is not None,
        sensor.calibration is not None, disturbances,
    )  # fmt: skip
    if not (disturbances.is_far.any() or disturbances.trend.any()):
        return report
    rest = visits.select(~disturbances.is_far, disturbances.trend)
    motions = measure_error_motions(sensor, knowledge, rest, test, is_tracked)
    draws = motions.draws + rest.grid(disturbances.errors[..., ~disturbances.is_far])
    without = replace(report, visits=rest, motions=replace(motions, draws=draws))
    return replace(report, undisturbed=without)


@check_arguments
def measure_axis(
    config: Config,
    poses: DataFrame,
    axis: Literal["X", "Y", "Z", "A", "B", "C"],
    commands: DataFrame | None = None,
    dwell: float = 0.2,
) -> AxisReport:
    """Measure the error motions of a linear or rotary axis, as `facets axis` does.

    Parameters
    ----------
    config
        The configuration of the sensor, with the point of interest (`object`).
    poses
        Poses in time: the columns time_s (or host_s) and tx_mm, ..., yaw_mrad, such as
        `facets.read_table` or `Solution.to_frame` gives.
    axis
        X, Y or Z: it moves along this axis of the object; A, B or C: it rotates about X, Y or Z.
    commands
        The commanded positions in their order, one row for each dwell: position_mm (or another unit
        of length or angle) and, optionally, direction. None: equally spaced positions are found.
    dwell
        Duration of the shortest dwell, s.

    Returns
    -------
    AxisReport
        The quantities of ISO 230-2; `to_frame()` gives the error motions by position.

    Raises
    ------
    InputError
        If a column is missing, or the axis has dwells at fewer than two positions.

    Examples
    --------
    >>> import numpy as np, pandas as pd, facets
    >>> places = np.repeat([0.0, 0.1, 0.2, 0.1, 0.0], 100)  # mm, 100 samples at each
    >>> poses = pd.DataFrame({f"{name}_mrad": 0 * places for name in ("roll", "pitch", "yaw")})
    >>> poses = poses.assign(time_s=0.01 * poses.index, tx_mm=1.001 * places, ty_mm=0, tz_mm=0)
    >>> commands = pd.DataFrame({"position_mm": [0.0, 0.1, 0.2, 0.1, 0.0]})
    >>> report = facets.measure_axis(facets.load("paper"), poses, "X", commands)
    >>> report.to_frame().EXX_um.diff().round(2).tolist()
    [nan, 0.1, 0.1]
    """
    table = None if commands is None else FrameTable(commands)
    test = AxisTest(
        axis,
        None if table is None else read_commands(table, axis),
        config.object or MIRROR,
        shortest_s=dwell,
    )
    series = read_series(FrameTable(poses))
    return evaluate_axis(config.sensor, config.solve.knowledge(config.sensor), series, test)
