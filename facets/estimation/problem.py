"""The request of an estimate and its results, and their layout in memory for compiled code."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..model.threads import part_of

Array = Any

(
    CONVERGED, MAX_STEPS, SINGULAR, OUT_OF_RANGE, NO_LIGHT, NON_FINITE, STALLED, UNCHECKED,
    AMBIGUOUS,
) = range(9)  # fmt: skip

#: Converged when the next step would move the fit by less than this, in sigmas, squared.
NEGLIGIBLE_GAIN = 1e-12
#: A step to where a detector that reads light would have less than this, in standard deviations of
#: its power, is a step into the dark: there the readings do not tell the way back.
DARK_SIGMAS = 1.0
#: An estimate that starts in the dark has so many steps to find the light.
MAX_DARK_STEPS = 8
#: After each so many steps the sum of squares must have fallen below this share of what it was
#: before them; else the estimate goes round in circles and is stalled.
PROGRESS_INTERVAL_STEPS, MAX_COST_SHARE = 10, 0.9
#: A step that the damping has shortened by this much, and that still does not help: stalled.
MAX_DAMPING = 1e12
#: Rounding of a computed reading, relative to the detector's distance or to the power.
ROUNDING = 4e-15
#: Redundancy of the readings below which nothing checks a pose: an error of one reading then stays
#: below the limit of the residual up to more than 100 of its standard deviations.
MIN_REDUNDANCY = 1e-3
UNKNOWNS = 9

#: Where the numbers of a reading's solution are, which blocks write in one row: the state and the
#: power, then how the estimate has ended, which detectors were used, and what is left, then the
#: checks and the limit, and the covariance if there is one.
STATUS, ITERATIONS, USED = 9, 10, 11
RESIDUAL, CHECKS, LIMIT, COVARIANCE = range(14, 18)

#: The entries of a covariance (8, 8) that are kept: the variances, and what is below the diagonal.
KEPT_ENTRIES = [(i, i) for i in range(8)] + [(i, j) for i in range(8) for j in range(i)]
#: The number of each entry among these.
PLACES = np.empty((8, 8), int)
_rows, _columns = np.transpose(KEPT_ENTRIES)
PLACES[_rows, _columns] = PLACES[_columns, _rows] = range(len(KEPT_ENTRIES))


class FitProblem(NamedTuple):
    """The prior knowledge and the options of an estimate.

    means: (n or 1, 3) of bx, by (mm) and power (mW).  weight: (3,) 1/sigma of these, 0 if unknown.
    free: (m,) numbers of the unknowns, ascending.  starts: (n or 1, 9), including the known values.
    previous: whether to start where the last converged sample ended.  damped: whether a step that
    does not help is shortened (Levenberg-Marquardt), or accepted.  accept_unchecked: whether to
    estimate poses without redundant readings.  limits: by which readings are screened.
    least_redundancy: of the readings of a pose, see `MIN_REDUNDANCY`; below 0 for any.
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

    noise: (3,) a centroid's sigma (mm) at a power (mW), and a power's sigma (mW).
    light: (2, 3) the powers below which a detector's reading is left out, and below which a step
    has lost its light, mW.
    usable: (3, 4) lowest and highest psi and zeta of each detector, mm.
    eight: leave out the last power.
    rounding: (2,) of a computed place, mm, and of a power, mW.
    """

    noise: Array
    light: Array
    usable: Array
    eight: bool
    rounding: Array


class Readings(NamedTuple):
    """values: (n, 9) mm, mW.  sigmas: (n, 9) their standard deviations; empty where those of
    `ScreeningLimits` hold."""

    values: Array
    sigmas: Array


class Results(NamedTuple):
    """states: (n, 9), with the power.  used: (n, 3) the detectors that took part.
    status, steps: (n,).  residuals: (n,) root of the sum of squares left.
    covariances: (n, 36), the `KEPT_ENTRIES`; (n, 0) for none.  Where status is not CONVERGED,
    states, residuals and covariances become NaN."""

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
    """Some of the readings, and the request for them."""
    n = len(readings.values)
    return (
        Readings(*(part_of(array, which, n) for array in readings)),
        request._replace(
            means=part_of(request.means, which, n), starts=part_of(request.starts, which, n)
        ),
    )


def put_rows(results: Results, which: Array, some: Results) -> None:
    """Put the results of some readings in their places."""
    for whole, part in zip(results, some, strict=True):
        whole[which] = part


class Form(NamedTuple):
    """The form of an estimator's code.

    free: numbers of the unknowns, the first six among them.  kind: of the light, see
    `kinds.block_kind`.  exact: whether derivatives under real light are exact.  varied: whether
    each reading has a sensor of its own.
    """

    free: tuple[int, ...]
    kind: str
    exact: bool = False
    varied: bool = False

    @property
    def keeps_equations(self) -> bool:
        """Whether it takes longer to make equations once more than to keep all, for steps that are
        refused: approximate derivatives often need some."""
        return self.kind != "plain"

    @property
    def name(self) -> str:
        details = f"{'exact_' if self.exact else ''}{'varied_' if self.varied else ''}"
        return f"estimate_{''.join(map(str, self.free[5:]))}_{details}of_{self.kind}"


class Scales(NamedTuple):
    """The numbers of `ScreeningLimits` and of a `FitProblem` that all readings share.

    light, usable, noise, rounding, eight: as there.  weight: (3,) of the priors.  weighed:
    whether the readings have weights of their own.  checks: `count_checks` without a detector.
    accepts: whether poses that nothing checks are estimated.  least_redundancy: as there.
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


#: The arrangement of these numbers.
SCALES = Scales(
    (0.0,) * 3, ((0.0,) * 3,) * 2, ((0.0,) * 4,) * 3, (0.0,) * 2, (0.0,) * 3, *(0.0,) * 7
)  # fmt: skip


class BlockTask(NamedTuple):
    """The task of a block's code: 64-bit integers, in memory one after the other.

    The address of a sensor's vectors (of a row of `packing.row_size` numbers for each reading, if
    the form is varied), of `Scales`, and of arrays of `Readings`, `FitProblem` and `Results` (0
    where no covariances are asked for).
    weights: any such rows, if the readings have none of their own.
    ends: of rows of five numbers: the status, the steps, and 1 for each detector used.
    own_rows, own_means, own_starts: whether each lane has rows of its own in the readings, weights
    and results, in the means, and in the starts.  apart: by how many numbers the rows of all
    results are apart; 0 where they follow one another.
    patient: whether a block waits for lanes that need many steps; else some have not ended.
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
    apart: Any
    patient: Any
    blocks: Any
