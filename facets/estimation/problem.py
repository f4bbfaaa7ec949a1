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
#: A step is refused if it leaves a detector that reads light with less than this power, in standard
#: deviations of a power: without light, the readings do not show the way back.
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

#: Places in the row of numbers that blocks write for each reading. First come the state and the
#: power, then the numbers named here; the covariance, if there is one, is at the end.
STATUS, ITERATIONS, USED = 9, 10, 11
RESIDUAL, CHECKS, LIMIT, COVARIANCE = range(14, 18)

#: The entries of a covariance (8, 8) that are stored: the variances, then those below the diagonal.
KEPT_ENTRIES = [(i, i) for i in range(8)] + [(i, j) for i in range(8) for j in range(i)]
#: The place of each entry of a covariance among the stored ones.
PLACES = np.empty((8, 8), int)
_rows, _columns = np.transpose(KEPT_ENTRIES)
PLACES[_rows, _columns] = PLACES[_columns, _rows] = range(len(KEPT_ENTRIES))


class FitProblem(NamedTuple):
    """The prior knowledge and the options of an estimate.

    means: (n or 1, 3) prior means of bx, by (mm) and power (mW).  weight: (3,) 1/sigma of these
    priors, 0 if unknown.  free: (m,) numbers of the estimated unknowns, ascending.  starts: (n or
    1, 9) with the known values.  previous: whether each sample starts where the last converged one
    ended.  damped: whether a step that raises the sum of squares is shortened
    (Levenberg-Marquardt) instead of accepted.  accept_unchecked: whether to estimate poses without
    redundant readings.  limits: limits for screening readings.  least_redundancy: required
    redundancy, see `MIN_REDUNDANCY`; negative for any.
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

    noise: (3,) standard deviation of a centroid (mm) at a power (mW), and that of a power (mW).
    light: (2, 3) the powers below which a detector is excluded, and below which a step has lost the
    detector's light, mW.
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

    values: (n, 9) mm, mW.  sigmas: (n, 9) standard deviations; empty if those of `ScreeningLimits`
    apply.
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
    """Covariances (..., 8, 8) of their `KEPT_ENTRIES` (..., 36)."""
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


def put_rows(results: Results, which: Array, some: Results) -> None:
    """Put the results of some readings in their places."""
    for array, part in zip(results, some, strict=True):
        array[which] = part


class Form(NamedTuple):
    """The form of an estimator's code.

    free: numbers of the estimated unknowns, the first six included.  kind: kind of light, see
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


#: The arrangement of these numbers, as zeros.
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
