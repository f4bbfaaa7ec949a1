"""Coverage intervals and regions of a pose by propagation of distributions, compared with the
linear result.

JCGM 101 (supplement 1 to the GUM), clauses 7 and 8, for each axis of a pose; JCGM 102 (supplement
2), clause 7, for the pose as a whole. Trials without a pose are counted; the results hold
for measurements that have a pose.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.rigid_body import MeasuredObject
from ..core.sensor import Sensor
from ..core.settings import Solve
from ..core.units import Floats
from ..estimation.object_pose import ObjectPose, transform
from ..estimation.uncertainty import region_factor, require_probability
from .trials import PART, MeasurementTrials, TrialResults

#: Trials that have to lie beyond each end of an interval.
FEWEST_BEYOND = 10
#: Standard errors of an interval's end by which a comparison is safe from chance.
SAFE_ERRORS = 2.0
#: Largest number of significant digits for which the linear result is tested.
MOST_DIGITS = 2
#: A trial further from the estimate than this, in standard uncertainties of all axes together, is
#: another solution, or one to which the linear result does not apply.
FAR_SIGMAS = 10.0


@dataclass(frozen=True)
class MonteCarlo:
    """Settings of a propagation by trials.

    count: number of trials.  probability: coverage probability of intervals and regions.  seed:
    seed of the random numbers, or several numbers that make one.
    """

    count: int
    probability: float = 0.95
    seed: int | Sequence[int] = 1


class CoverageInterval(NamedTuple):
    """Ends (6,) of the coverage intervals of the axes; mm and rad.  errors: (6, 2) standard errors
    of both ends, due to the finite number of trials."""

    low: Floats
    high: Floats
    errors: Floats


@dataclass(frozen=True)
class PropagationResult:
    """The distribution of a pose by trials of a measurement, and the linear result; mm and rad.

    Attributes
    ----------
    state
        (8,) state of the mirror and the beam.
    probability
        Coverage probability of the intervals and regions.
    linear
        The pose with its linear covariance.
    trials
        Poses of the trials, and how many have none.
    mean, covariance
        (6,), (6, 6) mean pose of the trials and its covariance.
    symmetric
        Coverage intervals, with equal probabilities beyond both ends.
    region_factor
        Coverage factor of the hyper-ellipsoid about the mean, from the trials.
    linear_region_factor
        Coverage factor of the hyper-ellipsoid of the linear result, about the estimate.
    linear_region_probability
        Fraction of the trials in the hyper-ellipsoid of the linear result.
    far
        Number of trials far from the estimate, such as on a second solution.
    """

    state: Floats
    probability: float
    linear: ObjectPose
    trials: TrialResults
    mean: Floats
    covariance: Floats
    symmetric: CoverageInterval
    region_factor: float
    linear_region_factor: float
    linear_region_probability: float
    far: int

    @property
    def count(self) -> int:
        """Number of trials, those without a pose included."""
        return len(self.trials.poses) + sum(self.trials.failures.values())

    @property
    def is_stated(self) -> bool:
        """Whether enough trials have a pose to state intervals."""
        return bool(np.isfinite(self.region_factor))

    @property
    def linear_interval(self) -> tuple[Floats, Floats]:
        """Ends (6,), (6,) of the linear coverage intervals."""
        expanded = self.linear.expanded_uncertainty(self.probability)[0]
        return self.linear.pose[0] - expanded, self.linear.pose[0] + expanded

    def validate(self) -> tuple[list[int], list[bool]]:
        """Test the linear result of each axis as JCGM 101, 8.1, does.

        Returns to how many significant digits of the standard uncertainty both ends of the linear
        interval agree with those of the trials (0: not to one), and whether more trials could show
        agreement to more.
        """
        digits, undecided = [], []
        sizes = self.linear.uncertainty[0]
        for axis, size in enumerate(sizes.tolist()):
            results = [self._agrees(axis, tolerance(size, n)) for n in (1, MOST_DIGITS)]
            digits.append(sum(result is True for result in results))
            undecided.append(any(result is None for result in results))
        return digits, undecided

    def _agrees(self, axis: int, largest: float) -> bool | None:
        """Whether both ends differ by no more than this; None where chance decides."""
        ends = np.array([interval[axis] for interval in self.linear_interval])
        off = np.abs([self.symmetric.low[axis], self.symmetric.high[axis]] - ends)
        chance = SAFE_ERRORS * self.symmetric.errors[axis]
        if (off + chance <= largest).all():
            return True
        return None if (off - chance <= largest).all() else False


def tolerance(uncertainty: float, digits: int) -> float:
    """Half a unit of the last of some significant digits of an uncertainty (JCGM 101, 7.9.2)."""
    exponent = int(f"{uncertainty:.{digits - 1}e}".partition("e")[2])
    return 0.5 * 10.0 ** (exponent - digits + 1)


def require_trials(count: int, probability: float) -> None:
    """Raise `InputError` for too few trials to know the ends of an interval."""
    fewest = int(np.ceil(2 * FEWEST_BEYOND / (1 - require_probability(probability)) - 1e-9))
    if count < fewest:
        raise InputError(
            f"{count} trials are too few for a coverage probability of {probability:g}; allowed: "
            f"{fewest} or more; JCGM 101 advises {500 * fewest} or more"
        )


def coverage_interval(poses: Floats, probability: float) -> CoverageInterval:
    """The probabilistically symmetric coverage intervals of poses (m, 6) (JCGM 101, 7.7)."""
    values, count = np.sort(poses, axis=0), len(poses)
    width = int(probability * count + 0.5)
    errors = np.empty((6, 2))
    ends = (count - width) // 2, (count - width) // 2 + width
    for side, place in enumerate(ends):
        fraction = (place + 1) / (count + 1)
        step = max(1, round(np.sqrt(count * fraction * (1 - fraction))))
        below, above = max(place - step, 0), min(place + step, count - 1)
        errors[:, side] = (values[above] - values[below]) / 2
    return CoverageInterval(values[ends[0]], values[ends[1]], errors)


def mahalanobis(offsets: Floats, covariance: Floats) -> Floats:
    """Distances (m,) of offsets (m, 6) in standard uncertainties, all axes together."""
    size = np.sqrt(np.diag(covariance))
    factor = np.linalg.cholesky(covariance / np.outer(size, size))
    distances: Floats = np.linalg.norm(np.linalg.solve(factor, (offsets / size).T), axis=0)
    return distances


def propagate_distributions(
    sensor: Sensor,
    options: Solve,
    state: Floats,
    method: MonteCarlo,
    *,
    object: MeasuredObject | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> PropagationResult:
    """Propagate the distributions of readings, parameters and priors to the pose, by trials.

    Parameters
    ----------
    sensor
        The sensor. Its noise, quantisation and calibrated parameters are drawn.
    options
        How readings are solved (`Config.solve`), and with which priors.
    state
        (8,) mm and rad, where the measurement is made.
    method
        Number of trials, coverage probability and seed, such as `MonteCarlo(1_000_000)`.
    object
        The object whose displacement from its pose at the mirror's zero is meant; None: the
        mirror's pose.
    advance
        Called with the number of trials that were just solved.

    Returns
    -------
    PropagationResult
        Its intervals are NaN if too many trials have no pose for the coverage probability.

    Raises
    ------
    InputError
        If there are too few trials, or readings without noise at the state have no pose.
    """
    require_trials(method.count, method.probability)
    trials = MeasurementTrials(sensor, options, state)
    zero = None if object is None else np.zeros(6)
    linear = transform(trials.linear_solution(), object, zero)
    results = trials.solve(method.count, method.seed, advance)
    if object is not None:
        parts = (results.poses[n : n + PART] for n in range(0, len(results.poses), PART))
        carried = [transform(part, object, zero).pose for part in parts]
        results = results._replace(poses=np.concatenate([np.empty((0, 6)), *carried]))
    return summarise(state, method, linear, results)


def summarise(
    state: Floats, method: MonteCarlo, linear: ObjectPose, trials: TrialResults
) -> PropagationResult:
    """Summarise the trials of a measurement at a state (8,), together with the linear result."""
    assert linear.covariance is not None
    poses, probability = trials.poses, method.probability
    freedom = float(np.nanmin(linear.degrees_of_freedom[0]))
    factor = region_factor(probability, 6, freedom)
    if len(poses) < probability * method.count:
        unknown, square = np.full(6, np.nan), np.full((6, 6), np.nan)
        none = CoverageInterval(unknown, unknown, np.full((6, 2), np.nan))
        return PropagationResult(state, probability, linear, trials, unknown, square, none,
                                 np.nan, factor, np.nan, 0)  # fmt: skip
    mean, covariance = poses.mean(axis=0), np.cov(poses.T)
    distances = mahalanobis(poses - linear.pose[0], linear.covariance[0])
    return PropagationResult(
        state=state,
        probability=probability,
        linear=linear,
        trials=trials,
        mean=mean,
        covariance=covariance,
        symmetric=coverage_interval(poses, probability),
        region_factor=float(np.quantile(mahalanobis(poses - mean, covariance), probability)),
        linear_region_factor=factor,
        linear_region_probability=float((distances <= factor).mean()),
        far=int((distances > FAR_SIGMAS).sum()),
    )
