"""The layout in memory of a task of `blocks`, for its code and its callers."""

from __future__ import annotations

from typing import Any, NamedTuple


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

    light, half_sizes, noise, rounding, eight: as there.  weight: (3,) of the priors.  weighed:
    whether the readings have weights of their own.  checks: `count_checks` without a detector.
    accepts: whether poses that nothing checks are estimated.
    """

    noise: Any
    light: Any
    half_sizes: Any
    rounding: Any
    weight: Any
    weighed: Any
    eight: Any
    checks: Any
    accepts: Any
    damped: Any
    most_steps: Any


#: Their arrangement.
SCALES = Scales(
    (0.0,) * 3, ((0.0,) * 3,) * 2, ((0.0,) * 2,) * 3, (0.0,) * 2, (0.0,) * 3, *(0.0,) * 6
)  # fmt: skip


class BlockTask(NamedTuple):
    """What code works on: 64-bit integers, in memory one after the other.

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
