"""The layout in memory of a task of `blocks`, for its code and its callers."""

from __future__ import annotations

from typing import Any, NamedTuple

#: Which unknowns can be asked for: the beam free or known, its power known or not.
QUESTIONS = ((0, 1, 2, 3, 4, 5, 6, 7), (0, 1, 2, 3, 4, 5), tuple(range(9)), (0, 1, 2, 3, 4, 5, 8))


class Form(NamedTuple):
    """The form of an estimator's code.

    free: one of QUESTIONS.  kind: of the light, see `kinds.block_kind`.  exact: whether derivatives
    under real light are exact.  varied: whether each reading has a sensor of its own.
    """

    free: tuple[int, ...]
    kind: str
    exact: bool = False
    varied: bool = False

    @property
    def can_damp_steps(self) -> bool:
        """Whether steps can be damped, which approximate derivatives often need."""
        return self.kind != "plain"

    @property
    def name(self) -> str:
        details = f"{'exact_' if self.exact else ''}{'varied_' if self.varied else ''}"
        return f"estimate_{len(self.free)}_{details}of_{self.kind}"


class Scales(NamedTuple):
    """The numbers of `ScreeningLimits` and of a `FitProblem` that all readings share."""

    noise: Any
    light: Any
    half_sizes: Any
    rounding: Any
    weight: Any


#: Their arrangement.
SCALES = Scales((0.0,) * 3, ((0.0,) * 3,) * 2, ((0.0,) * 2,) * 3, (0.0,) * 2, (0.0,) * 3)


class BlockTask(NamedTuple):
    """What code works on: 64-bit integers, in memory one after the other.

    The address of a sensor's vectors (of a row of `packing.row_size` numbers for each reading, if
    the form is varied), of `Scales`, and of arrays of `Readings`, `FitProblem` and
    `Results` (0 where no covariances are asked for).
    left, stalled: addresses of an integer for each block, which tells by its bits in which lanes
    that is so.
    weighed: whether the readings have weights of their own; else `weights` is any of such rows.
    own_rows, own_means, own_starts: whether each lane has rows of its own in the readings, weights
    and results, in the means, and in the starts.
    patient: whether steps that do not help are damped, see `Form.can_damp_steps`; else their lane
    is left.
    """

    packed: Any
    scales: Any
    values: Any
    weights: Any
    means: Any
    starts: Any
    states: Any
    steps: Any
    residuals: Any
    covariances: Any
    left: Any
    stalled: Any
    weighed: Any
    own_rows: Any
    own_means: Any
    own_starts: Any
    patient: Any
    most_steps: Any
    blocks: Any
