"""Estimate changes since a calibration from readings at one stop of the mirror, then and now.

The mirror rests at the same stop twice. The difference d of the mean readings is

    d = D x + P m + G t + n

x: changes of the beam's position and width, the laser's power, the detectors' gains and the heights
of their posts; Gaussian, with the standard uncertainties of `ChangePriors`. At one stop a wider
beam and higher posts look nearly alike, and only their combination is determined.  m: displacement
of the mirror between the two visits.  t: errors of the calibrated parameters.  n: noise of the
means.  D, P: derivatives of the readings.  G: difference of the readings' derivatives now and then,
so that t counts only where a large change meets a parameter that is not well known.

The estimate of x is the most probable one, found by Gauss-Newton steps, because 20 um of beam
motion are a tenth of the beam's width. The calibrated values stay. The covariance of the present
parameters consists of that of the calibration, that of x, and that between both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError
from ..core.knowledge import Prior
from ..core.names import (
    DETECTORS,
    FINE_UNITS,
    POSE,
    READING_COLUMNS,
    TEMPERATURE_COLUMN,
)
from ..core.sensor import Calibration, Sensor
from ..core.small_matrices import one_thread
from ..core.units import Floats
from ..detectors.calibrated import LIGHT_CENTRE
from ..detectors.correction import correct
from ..detectors.noise import standard_deviations
from ..detectors.temperature import beam_shift, exact_readings, warmer_than_reference
from ..estimation.dwells import mean
from ..estimation.solution import Status
from ..estimation.solver import solve
from ..estimation.uncertainty import parameter_derivatives
from ..model.arrays import jacobian, readings
from ..model.beam_shape import SHAPE, shape_of
from .alternatives.alternative import RIVAL_FACTOR, Alternative, chance_of, log_chance
from .alternatives.entries import BY_KEY, lengths
from .alternatives.score import falls_of
from .fitting.bundle_adjustment import Data
from .fitting.fit import GAINS
from .fitting.samples import add_converter_steps
from .table import REFERENCE, find_reference_dwells, whole_table

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..core.settings import Config

HEIGHTS = tuple(f"psd_{letter}.height" for letter in DETECTORS)
#: The parameters that may have changed; the beam's position is that of the light's centre. The last
#: of the ten changes scales the beam's width and keeps its shape.
CHANGES = (*LIGHT_CENTRE, "beam.power", *GAINS, *HEIGHTS, *SHAPE)
#: Number of blocks in which a stop's rows are compared, and the least number of rows.
BLOCKS, MIN_ROWS = 16, 32
#: Largest ratio of the standard deviation of the blocks' means to the noise of one sample; above it
#: the mirror or the light moved, and averaging is no use.
MAX_WANDER = 2.0
#: Gauss-Newton steps; four settle the largest changes.
STEPS = 6
#: Probability by chance, below which the changes do not explain the readings: of a misfit at least
#: as large, and of as large an apparent motion of the mirror or a detector.
LEAST_CHANCE = 0.01


@dataclass(frozen=True)
class ChangePriors:
    """Standard uncertainties of possible changes since the calibration.

    Parameters
    ----------
    beam
        Position of the beam in x and in y, mm.
    power
        Power of the laser, as a fraction.
    gain
        Gain of each detector, as a fraction.
    post
        Height of each detector's post, mm.
    width
        Diameter of the beam, as a fraction, the same in all directions.
    stop, stop_angle
        Position (mm) and angles (rad) of the mirror at the stop now, relative to those then.
    """

    beam: float = 0.020
    power: float = 0.05
    gain: float = 0.002
    post: float = 0.003
    width: float = 0.005
    stop: float = 1e-4
    stop_angle: float = 5e-7

    def sigmas(self, power: float) -> Floats:
        """The standard uncertainties (10,) of the changes, in mm, mW and fractions.

        power: of the laser, mW.
        """
        sizes = ([self.beam] * 2, [self.power * power], [self.gain] * 3, [self.post] * 3)
        return np.concatenate([*sizes, [self.width]])


@dataclass(frozen=True)
class StopReadings:
    """Mean readings (m, 9) at m stops as the detectors gave them, mm and mW, and the variances of
    these means.

    warmer: (m,) temperatures of the stops relative to the reference temperature of the calibration,
    K; None for a sensor that does not depend on the temperature.
    """

    mean: Floats
    variance: Floats
    warmer: Floats | None = None


@dataclass(frozen=True)
class NewZero:
    """The changes since a calibration, with their uncertainties and the sensor now.

    Attributes
    ----------
    sensor
        The sensor now. Its calibration holds the covariance of the parameters as they are now.
    beam
        Position of the beam (2,) relative to the configured one, mm: see `Solve.beam_offset`.
    change, uncertainty, prior
        The changes (10,), their standard uncertainties, and their prior ones; mm, mW and fractions.
    chi_square, freedom
        Chi-square of the readings' differences with all priors, and its expectation.
    causes
        Alternatives that would explain the readings beyond chance, with their sizes, the likeliest
        first; alternatives that are much less likely than the first are not listed.
    """

    sensor: Sensor
    beam: Floats
    change: Floats
    uncertainty: Floats
    prior: Floats
    chi_square: float
    freedom: int
    causes: list[tuple[Alternative, str]]

    @property
    def chance(self) -> float:
        """Probability of a chi-square at least as large."""
        return chance_of(self.chi_square, self.freedom)

    @property
    def is_explained(self) -> bool:
        """Whether the changes explain the readings and no alternative is likely."""
        return self.chance >= LEAST_CHANCE and not self.causes


def stop_readings(sensor: Sensor, raw: Floats, name: str = "the readings") -> StopReadings:
    """Average the readings of a mirror at rest.

    Parameters
    ----------
    sensor
        The sensor, whose noise is the least noise of the readings.
    raw
        Readings (n, 9) as the detectors gave them, mm and mW; rows that are not finite are
        excluded.
    name
        Name of the readings, for messages.

    Returns
    -------
    StopReadings
        One stop. The variance of a mean follows from the noise of the sensor or, where that is
        larger, from the scatter of the means of 16 blocks, so that slow noise counts. The variance
        by a converter's steps is added.

    Raises
    ------
    InputError
        If fewer than 32 rows are finite, or if the readings wander by more than twice the noise of
        one sample.
    """
    complete = raw[np.isfinite(raw).all(axis=1)]
    count = len(complete)
    if count < MIN_ROWS:
        raise InputError(
            f"{name}: {count} rows with all nine readings; a stop needs {MIN_ROWS} at least, and "
            "two seconds of a detector board are better"
        )
    middle = np.array([mean(column) for column in complete.T])
    noise = standard_deviations(sensor, correct(sensor, middle[None]))[0]
    blocks = np.array([part.mean(axis=0) for part in np.array_split(complete, BLOCKS)])
    scatter = blocks.std(axis=0, ddof=1)
    worst = int(np.argmax(scatter / noise))
    if scatter[worst] > MAX_WANDER * noise[worst]:
        raise InputError(
            f"{name}: {READING_COLUMNS[worst]} wanders by {scatter[worst] / noise[worst]:.3g} "
            f"times the noise of one sample (allowed: {MAX_WANDER:g}): the mirror or the light "
            "moved. Record the mirror at rest at the stop"
        )
    sigma = np.maximum(noise / np.sqrt(count), scatter / np.sqrt(BLOCKS))
    return combine_means(sensor, middle[None], sigma[None], np.array([float(count)]))


def combine_means(sensor: Sensor, means: Floats, sigma: Floats, rows: Floats) -> StopReadings:
    """Stops by mean readings, with the variance of the converter's steps added.

    means, sigma: (m, 9) the means and their standard uncertainties.  rows: (m,) number of rows in
    each.
    """
    count = len(means)
    data = Data(
        means, np.zeros((count, 6)), np.zeros(6), np.zeros((count, 2)), noise=sigma, rows=rows
    )
    stepped = add_converter_steps(sensor, data).noise
    assert stepped is not None
    return StopReadings(means, stepped**2)


def read_stops(path: Path, settings: Config, dwells: bool) -> StopReadings:
    """The single stop of a table of readings, or with `dwells` one stop for each dwell of its
    reference.

    Raises `InputError` where the mirror moved, or where the reference has no dwells.
    """
    sensor, reference = settings.sensor, settings.calibrate.reference
    measured = [n for n in range(6) if np.isfinite(reference[n])]
    needed = (*READING_COLUMNS, *(REFERENCE[n] for n in measured if dwells))
    if sensor.thermal.is_on:
        needed = (*needed, TEMPERATURE_COLUMN)
    columns = whole_table(path, needed, ())
    if not dwells:
        return average_stop(sensor, columns, str(path))
    rests = find_reference_dwells(columns, reference)
    means = np.column_stack([rests.columns[name] for name in READING_COLUMNS])
    if not len(means) or not np.isfinite(means).all():
        raise InputError(
            f"{path}: the reference is at rest {len(means)} times; every stop needs all nine "
            "readings"
        )
    return add_temperature(
        sensor, combine_means(sensor, means, rests.noise, rests.rows), rests.columns, str(path)
    )


def average_stop(sensor: Sensor, columns: Mapping[str, Floats], name: str) -> StopReadings:
    """The one stop of columns of readings; see `stop_readings`. Raises `InputError` if a
    temperature that the sensor needs is missing."""
    raw = np.column_stack([columns[column] for column in READING_COLUMNS])
    if sensor.thermal.is_on and TEMPERATURE_COLUMN not in columns:
        raise InputError(
            f"{name}: there is no temperature_c, which sensor.temperature needs; record it as a "
            "channel (acquire.channels), or give a table of readings that has this column"
        )
    return add_temperature(sensor, stop_readings(sensor, raw, name), columns, name)


def add_temperature(
    sensor: Sensor, stops: StopReadings, columns: Mapping[str, Floats], name: str
) -> StopReadings:
    """The stops of the source `name` with their mean temperatures, for a sensor that follows it.
    Raises `InputError` if a stop has none."""
    if not sensor.thermal.is_on:
        return stops
    each = np.array_split(columns[TEMPERATURE_COLUMN], len(stops.mean))
    if not all(np.isfinite(part).any() for part in each):
        raise InputError(
            f"{name}: {TEMPERATURE_COLUMN} has no value at a stop, which sensor.temperature needs"
        )
    mean_temperatures = np.array([np.nanmean(part) for part in each])
    return replace(stops, warmer=warmer_than_reference(sensor, mean_temperatures))


@one_thread
def renew_zero(
    sensor: Sensor,
    then: StopReadings,
    now: StopReadings,
    priors: ChangePriors | None = None,
    beam: tuple[float, float] = (0.0, 0.0),
) -> NewZero:
    """Estimate changes since a calibration from readings at the same stops, then and now.

    Parameters
    ----------
    sensor
        The calibrated sensor.
    then, now
        Readings at the same stops in the same order; one stop is enough.
    priors
        How much each quantity may have changed, and how well the stop repeats.
    beam
        Position of the beam then, mm.

    Returns
    -------
    NewZero
        The changes with their uncertainties, and the sensor now. Check `is_explained` before use.

    Raises
    ------
    InputError
        If the sensor has no calibration, if the numbers of stops differ, or if the readings then
        cannot be solved.

    Notes
    -----
    At one stop, a motion of the mirror along z is indistinguishable from posts that grew, and 0.1 %
    of one detector's gain is not detectable. The uncertainties include `ChangePriors.stop`.

    Examples
    --------
    >>> import facets
    >>> from facets.calibration import rezero
    >>> settings = facets.load("calibrated.yaml")  # doctest: +SKIP
    >>> then = rezero.stop_readings(settings.sensor, readings_then)  # doctest: +SKIP
    >>> now = rezero.stop_readings(settings.sensor, readings_now)  # doctest: +SKIP
    >>> zero = rezero.renew_zero(settings.sensor, then, now)  # doctest: +SKIP
    >>> zero.is_explained, 1e3 * zero.beam  # um  # doctest: +SKIP
    """
    if sensor.calibration is None:
        raise InputError(
            "the sensor has no calibration; give the configuration that facets calibrate wrote"
        )
    if len(then.mean) != len(now.mean):
        raise InputError(
            f"{len(then.mean)} stops then and {len(now.mean)} now; the mirror has to visit the "
            "same stops in the same order"
        )
    task = StopComparison(sensor, then, now, priors or ChangePriors(), beam)
    change = task.estimate()
    covariance, cross, chi_square, causes = task.conclude(change)
    return NewZero(
        sensor=add_covariance(task.change_sensor(change), sensor.calibration, covariance, cross),
        beam=np.array(beam) + change[:2],
        change=change,
        uncertainty=np.sqrt(np.diag(covariance)),
        prior=task.prior,
        chi_square=chi_square,
        freedom=then.mean.size,
        causes=causes,
    )


class StopComparison:
    """The readings at the stops then and now, and those that the model predicts for changes
    (10,)."""

    def __init__(
        self,
        sensor: Sensor,
        then: StopReadings,
        now: StopReadings,
        priors: ChangePriors,
        beam: tuple[float, float],
    ) -> None:
        assert sensor.calibration is not None
        self.now, self.names = now, sensor.calibration.names
        self.covariance = np.array(sensor.calibration.covariance)
        nothing = np.zeros(len(then.mean))
        #: Temperatures of the stops then and now, relative to the calibration's reference (m,), K.
        self.then_warmer = nothing if then.warmer is None else then.warmer
        self.now_warmer = nothing if now.warmer is None else now.warmer
        exact = exact_readings(sensor, then.mean, self.then_warmer)
        position = Prior(np.array(beam) + beam_shift(sensor, self.then_warmer), 0.0)
        solution = solve(sensor, exact, beam=position, power="unknown", covariance=False)
        if not solution.converged.all():
            label = Status(int(solution.status[~solution.converged][0])).label
            raise InputError(
                f"the readings at the stop then have no pose ({label}); give readings of the "
                "calibrated rig"
            )
        self.states, power = solution.state, float(solution.power.mean())
        self.prior = priors.sigmas(power)
        self.sensor = replace(sensor, beam=replace(sensor.beam, power=power))
        self.offset = exact - readings(self.sensor, self.states)
        stop = np.array([priors.stop] * 3 + [priors.stop_angle] * 3)
        moved = jacobian(sensor, self.states)[:, :, :6] * stop
        self.noise = block_diagonal(moved @ np.swapaxes(moved, 1, 2))
        self.noise += np.diag((then.variance + now.variance).ravel())

    def change_sensor(self, change: Floats) -> Sensor:
        """The sensor with changes (10,), except that of the beam's position."""
        sensor = self.sensor
        psds = [
            replace(psd, height=psd.height + height,
                    correction=replace(psd.correction, power=psd.correction.power + gain))
            for psd, gain, height in zip(sensor.psds, *change[3:9].reshape(2, 3).tolist(),
                                         strict=True)
        ]  # fmt: skip
        beam, power, wider = sensor.beam, float(change[2]), float(change[9])
        beam = replace(beam, power=beam.power + power, diameter_x=beam.diameter_x * (1 + wider),
                       diameter_y=beam.diameter_y * (1 + wider))  # fmt: skip
        return replace(sensor, beam=beam, psds=(psds[0], psds[1], psds[2]))

    def situation(self, change: Floats) -> tuple[Sensor, Floats]:
        """The sensor and the states (m, 8) now, after changes."""
        states = self.states.copy()
        states[:, 6:] += change[:2]
        states[:, 6:] += beam_shift(self.sensor, self.now_warmer - self.then_warmer)
        return self.change_sensor(change), states

    def predict(self, change: Floats) -> Floats:
        """The readings (stops, 9), mm and mW, after changes since the calibration."""
        return readings(*self.situation(change))

    def derivatives(self, change: Floats, names: tuple[str, ...]) -> Floats:
        """The derivatives (9 m, p) of the difference of model and readings now by some
        parameters."""
        return derivatives(*self.situation(change), names, self.now_warmer)

    def slopes(self, change: Floats) -> Floats:
        """The derivatives (9 m, 10) of the difference of model and readings now by the changes."""
        return self.derivatives(change, CHANGES) @ spread_of(self.change_sensor(change))

    def weights(self, change: Floats) -> tuple[Floats, Floats]:
        """The inverse covariance (9 m, 9 m) of the readings' differences without changes, and the
        derivatives (9 m, p) of these differences by the calibrated parameters."""
        by_parameters = self.derivatives(change, self.names)
        by_parameters -= derivatives(self.sensor, self.states, self.names, self.then_warmer)
        covariance = self.noise + by_parameters @ self.covariance @ by_parameters.T
        return np.linalg.inv(covariance), by_parameters

    def estimate(self) -> Floats:
        """The most probable changes (10,)."""
        change, information = np.zeros(len(self.prior)), self.prior**-2
        for _ in range(STEPS):
            weights, _ = self.weights(change)
            slopes, residuals = self.slopes(change), self.residuals(change)
            matrix = slopes.T @ weights @ slopes + np.diag(information)
            change = change + np.linalg.solve(
                matrix, slopes.T @ weights @ residuals - information * change
            )
        return change

    def residuals(self, change: Floats) -> Floats:
        """The readings' differences (9 m,) minus those that the changes explain."""
        exact = exact_readings(self.change_sensor(change), self.now.mean, self.now_warmer)
        return (exact - self.predict(change) - self.offset).ravel()

    def conclude(
        self, change: Floats
    ) -> tuple[Floats, Floats, float, list[tuple[Alternative, str]]]:
        """The covariance (10, 10) of the most probable changes, their covariance (10, p) with the
        calibrated parameters, chi-square, and alternatives that would explain the readings."""
        weights, by_parameters = self.weights(change)
        slopes, residuals = self.slopes(change), self.residuals(change)
        information = self.prior**-2
        matrix = slopes.T @ weights @ slopes + np.diag(information)
        covariance: Floats = np.linalg.inv(matrix).astype(float)
        back = covariance @ slopes.T @ weights
        cost = float(residuals @ weights @ residuals + information @ change**2)
        reduced = weights - weights @ slopes @ back  # in directions that no change absorbs
        pulled = reduced @ residuals + back.T @ (information * change)
        causes = self.explain(weights, reduced, pulled)
        return covariance, -back @ by_parameters @ self.covariance, cost, causes

    def explain(
        self, weights: Floats, reduced: Floats, pulled: Floats
    ) -> list[tuple[Alternative, str]]:
        """Alternatives, the likeliest first, that would explain the residuals, with their sizes: a
        motion of the mirror along one axis, or a detector that moved; see `remainder`."""
        tried = possible_moves(jacobian(self.sensor, self.states))
        scores = []
        for alternative, axes, columns in tried:
            total, square = (columns.T @ part @ columns for part in (weights, reduced))
            side = columns.T @ pulled
            fall, amounts, count = falls_of(total[None], square[None], side[None])
            chance = log_chance(float(fall[0]), float(count[0])) + np.log(len(tried))
            size = np.zeros(6) if alternative is SEAT else np.zeros(2)
            size[axes] = amounts[0]
            scores.append((chance, alternative, describe_size(alternative, size)))
        scores.sort(key=lambda score: score[0])
        limit = min(np.log(LEAST_CHANCE), scores[0][0] + np.log(RIVAL_FACTOR))
        return [(alternative, size) for chance, alternative, size in scores if chance < limit]


def possible_moves(slopes: Floats) -> list[tuple[Alternative, list[int], Floats]]:
    """Possible moves of the mirror and the detectors between stops: each with its axes and the
    columns (9 m, q) that it adds to the readings.

    slopes: the derivatives (m, 9, 8) of the readings by the mirror's states.
    """
    moved = slopes[:, :, :6].reshape(-1, 6)
    tried = [(SEAT, [n], moved[:, [n]]) for n in range(6)]
    for k, letter in enumerate(DETECTORS):
        place = np.tile(np.eye(9)[:, 3 * k : 3 * k + 2], (len(slopes), 1))
        tried.append((BY_KEY[f"detector_{letter}.jumped"], [0, 1], place))
    return tried


#: The alternative that the mirror rests elsewhere at the stop.
SEAT = BY_KEY["seat.jumped"]


def describe_size(alternative: Alternative, amounts: Floats) -> str:
    """The size of a move in words.  amounts: of a pose (6,) or of a place (2,), mm and rad."""
    if alternative is SEAT:
        axis = int(np.argmax(np.abs(amounts) / FINE_UNITS[:6]))
        unit = "um" if axis < 3 else "urad"
        return f"by {amounts[axis] / FINE_UNITS[axis]:.2g} {unit} in {POSE[axis]}"
    return lengths("psi", "zeta")(amounts)


def spread_of(sensor: Sensor) -> Floats:
    """The matrix (12, 10) from the changes to the parameters `CHANGES`."""
    beam, spread = sensor.beam, np.eye(len(CHANGES), len(CHANGES) - 2)
    shape = shape_of(beam.diameter_x, beam.diameter_y, beam.rotation)
    spread[9:, 9] = 2 * np.array(shape)
    return spread


def derivatives(sensor: Sensor, states: Floats, names: tuple[str, ...], warmer: Floats) -> Floats:
    """The derivatives (9 m, p) of the difference of model and readings by some parameters."""
    size = len(names)
    unit = Calibration(names, tuple(map(tuple, np.eye(size).tolist())))
    every = parameter_derivatives(sensor, unit, states, readings(sensor, states), warmer)
    return every.reshape(-1, size)


def block_diagonal(blocks: Floats) -> Floats:
    """A matrix (9 m, 9 m) of blocks (m, 9, 9)."""
    count = len(blocks)
    matrix = np.zeros((count, 9, count, 9))
    matrix[range(count), :, range(count)] = blocks
    return matrix.reshape(9 * count, 9 * count)


def add_covariance(
    sensor: Sensor, calibration: Calibration, covariance: Floats, cross: Floats
) -> Sensor:
    """The sensor with the covariance of its present parameters, the sums of the calibrated ones and
    their changes.

    covariance, cross: of the changes (10, 10), and between changes and calibrated parameters (10,
    p).
    """
    names = (*calibration.names, *(name for name in CHANGES if name not in calibration.names))
    size, count = len(calibration.names), len(covariance)
    joint = np.block([[np.array(calibration.covariance), cross.T], [cross, covariance]])
    sums = np.zeros((len(names), size + count))
    sums[range(size), range(size)] = 1.0
    sums[[names.index(name) for name in CHANGES], size:] = spread_of(sensor)
    matrix = sums @ joint @ sums.T
    matrix = (matrix + matrix.T) / 2
    now = replace(calibration, names=names, covariance=tuple(map(tuple, matrix.tolist())))
    return replace(sensor, calibration=now)
