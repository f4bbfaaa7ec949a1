"""The input and the results of an estimate, and their layout in memory for compiled code."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..model.threads import part_of

Array = Any

(
    CONVERGED, MAX_STEPS, SINGULAR, OUT_OF_RANGE, NO_LIGHT, NON_FINITE, STALLED, UNCHECKED,
    AMBIGUOUS,
) = range(9)  # fmt: skip

#: The estimate has converged when the next step would change the sum of squares by less than this.
NEGLIGIBLE_GAIN = 1e-12
#: A step is refused if a detector that reads light would have less than this power, in standard
#: deviations of a power: without light, readings have no derivatives that lead back.
DARK_SIGMAS = 1.0
#: An estimate that starts without light on a detector ends if it has not found light after this
#: many steps.
MAX_DARK_STEPS = 8
#: An estimate is stalled if the sum of squares, over an interval of this many steps, has not fallen
#: below this fraction of its earlier value.
PROGRESS_INTERVAL_STEPS, MAX_COST_FRACTION = 10, 0.9
#: An estimate is stalled if a step with this much damping is still refused.
MAX_DAMPING = 1e12
#: Rounding error of a computed reading, relative to the detector's distance or to the power.
ROUNDING = 4e-15
#: Poses with less redundancy than this are unchecked: an error of one reading by 100 of its
#: standard deviations can then leave the residual below its limit.
MIN_REDUNDANCY = 1e-3
UNKNOWNS = 9

#: Indices in the row of numbers that blocks write for each reading: first the state and the power,
#: then these numbers, and at the end the covariance, if requested.
STATUS, ITERATIONS, USED = 9, 10, 11
RESIDUAL, CHECKS, LIMIT, COVARIANCE = range(14, 18)

#: Stored entries of a covariance (8, 8): the variances, then the entries below the diagonal.
KEPT_ENTRIES = [(i, i) for i in range(8)] + [(i, j) for i in range(8) for j in range(i)]
#: Index of each entry of a covariance among the stored ones.
PLACES = np.empty((8, 8), int)
_rows, _columns = np.transpose(KEPT_ENTRIES)
PLACES[_rows, _columns] = PLACES[_columns, _rows] = range(len(KEPT_ENTRIES))


class FitProblem(NamedTuple):
    """The prior knowledge and the options of an estimate.

    means: (n or 1, 3) prior means of bx, by (mm) and power (mW).  weight: (3,) 1/sigma of these
    priors, 0 if unknown.  free: (m,) indices of the estimated unknowns, ascending.  starts: (n or
    1, 9) initial states and powers, with the known values.  previous: whether each sample starts
    from the solution of the last converged one.  damped: whether a step that raises the sum of
    squares is shortened (Levenberg-Marquardt) instead of accepted.  accept_unchecked: whether to
    estimate poses without redundant readings.  limits: limits for screening readings.
    least_redundancy: required redundancy, see `MIN_REDUNDANCY`; negative for any.
    """

    means: Array
    weight: Array
    free: Array
    starts: Array
    previous: bool
    max_steps: int
    damped: bool
    accept_unchecked: bool
    limits: ScreeningLimits
    least_redundancy: float


class ScreeningLimits(NamedTuple):
    """The limits by which readings are screened.

    noise: (3,) standard deviation of a centroid, mm, the power at which it holds, mW, and standard
    deviation of a power, mW.  light: (2, 3) power below which a detector is excluded, and power
    below which a step has lost the detector's light, mW.
    usable: (3, 4) lowest and highest psi and zeta of each detector, mm.
    eight: whether the power of detector C is excluded.
    rounding: (2,) rounding error of a computed position, mm, and of a power, mW.
    """

    noise: Array
    light: Array
    usable: Array
    eight: bool
    rounding: Array


class Readings(NamedTuple):
    """Readings and their noise.

    values: (n, 9) mm and mW.  sigmas: (n, 9) standard deviations; empty if `ScreeningLimits.noise`
    applies.
    """

    values: Array
    sigmas: Array


class Results(NamedTuple):
    """The results of n estimates.

    states: (n, 9) with the power.  used: (n, 3) whether each detector took part.  status: (n,).
    steps: (n,) number of steps.  residuals: (n,) root of the remaining sum of squares.
    covariances: (n, 36) the `KEPT_ENTRIES`; (n, 0) if not requested.  States, residuals and
    covariances are NaN unless the status is CONVERGED.
    """

    states: Array
    used: Array
    status: Array
    steps: Array
    residuals: Array
    covariances: Array


def empty_results(count: int, covariance: bool) -> Results:
    return Results(
        states=np.empty((count, 9)),
        used=np.empty((count, 3), bool),
        status=np.empty(count, np.int8),
        steps=np.empty(count, np.int32),
        residuals=np.empty(count),
        covariances=np.empty((count, len(KEPT_ENTRIES) if covariance else 0)),
    )


def unpack_covariances(entries: Array) -> Array:
    """Expand covariances from their `KEPT_ENTRIES` (..., 36) to (..., 8, 8)."""
    return entries.take(PLACES, axis=-1)


def some_rows(which: Any, readings: Readings, request: FitProblem) -> tuple[Readings, FitProblem]:
    """Select some of the readings, and the request for them."""
    n = len(readings.values)
    return (
        Readings(*(part_of(array, which, n) for array in readings)),
        request._replace(
            means=part_of(request.means, which, n), starts=part_of(request.starts, which, n)
        ),
    )


def put_rows(results: Results, which: Array, replacements: Results) -> None:
    """Replace the results of the readings `which`, in place."""
    for array, part in zip(results, replacements, strict=True):
        array[which] = part


class Form(NamedTuple):
    """The form of an estimator's code.

    free: indices of the estimated unknowns, always with the first six.  kind: kind of light, see
    `kinds.block_kind`.  exact: whether derivatives under real light are exact.  varied: whether
    each reading has its own sensor.
    """

    free: tuple[int, ...]
    kind: str
    exact: bool = False
    varied: bool = False

    @property
    def keeps_equations(self) -> bool:
        """Whether the equations at the best state are stored for refused steps.

        With approximate derivatives steps are refused often, and storing is faster than evaluating
        the equations once more.
        """
        return self.kind != "plain"

    @property
    def name(self) -> str:
        details = f"{'exact_' if self.exact else ''}{'varied_' if self.varied else ''}"
        return f"estimate_{''.join(map(str, self.free[5:]))}_{details}of_{self.kind}"


class Scales(NamedTuple):
    """The numbers of `ScreeningLimits` and of a `FitProblem` that all readings have in common.

    noise, light, usable, rounding, eight: as in `ScreeningLimits`.  weight, damped,
    least_redundancy: as in `FitProblem`.  weighed: whether the readings have their own weights.
    checks: `count_checks` without a detector.  accepts: whether unchecked poses are estimated.
    most_steps: largest number of steps.
    """

    noise: Any
    light: Any
    usable: Any
    rounding: Any
    weight: Any
    weighed: Any
    eight: Any
    checks: Any
    accepts: Any
    damped: Any
    most_steps: Any
    least_redundancy: Any


#: The structure of these numbers, with zeros.
SCALES = Scales(
    (0.0,) * 3, ((0.0,) * 3,) * 2, ((0.0,) * 4,) * 3, (0.0,) * 2, (0.0,) * 3, *(0.0,) * 7
)  # fmt: skip


class BlockTask(NamedTuple):
    """The arguments of a block's code: consecutive 64-bit integers in memory.

    packed: address of the sensor's vectors; in a varied form, of a row of `packing.row_size`
    numbers for each reading.  scales: address of `Scales`.  values to covariances: addresses of the
    arrays of `Readings`, `FitProblem` and `Results`.
    weights: any rows of this size, if the readings have no weights of their own.
    ends: rows of five numbers: the status, the number of steps, and 1 for each detector used.
    covariances: 0 if none are requested.
    own_rows, own_means, own_starts: whether each lane has its own row in the readings, weights and
    results, in the means, and in the starts.  result_stride: distance between the rows of each
    result, in numbers; 0 for consecutive rows.
    patient: whether a block waits for lanes that need many steps; else some may not have ended.
    blocks: number of blocks.
    """

    packed: Any
    scales: Any
    values: Any
    weights: Any
    means: Any
    starts: Any
    states: Any
    ends: Any
    residuals: Any
    covariances: Any
    own_rows: Any
    own_means: Any
    own_starts: Any
    result_stride: Any
    patient: Any
    blocks: Any
