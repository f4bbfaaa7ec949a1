"""The standard uncertainties of the pose, and their sources.

Uncertainties are propagated through the estimator of `facets.solve`. With J the Jacobian at the
true state and W the inverse variances of the readings and priors, the gain is G = (J'WJ)^-1 J'W.
Each source i with variance s_i^2 contributes (G_ki s_i)^2 to unknown k. The sum of these
contributions is the diagonal of (J'WJ)^-1, the Cramer-Rao bound. Terms follow the GUM: a standard
uncertainty is one standard deviation, an expanded one twice that (coverage factor 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import as_floats, check_arguments
from ..core.errors import InputError
from ..core.knowledge import Knowledge, Prior
from ..core.rigid_body import MeasuredObject, displacement_slopes
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import sources as noise_sources, variances
from ..estimation.uncertainty import (
    coverage_factor,
    effective_degrees_of_freedom,
    parameter_derivatives,
)
from ..model.arrays import as_rows, jacobian, readings
from .ranges import axis_ranges, largest_box, states_of

#: Name of the source for the uncertainty of calibrated parameters; it is the last source.
CALIBRATION = "calibration"


class Estimator(NamedTuple):
    """The knowledge of the beam and the readings for a solution, with a name for tables.

    eight: omits the last power, as the paper's inversion does.
    """

    name: str
    knowledge: Knowledge
    eight: bool = False


def estimators(beam_sigma: float) -> list[Estimator]:
    """The paper's estimator, and ours with increasing knowledge of the beam."""
    within = Knowledge(Prior((0.0, 0.0), beam_sigma))
    return [
        Estimator("paper: 8 readings", Knowledge(), eight=True),
        Estimator("beam free", Knowledge()),
        Estimator(f"beam within {1000 * beam_sigma:g} µm", within),
        Estimator("beam known", Knowledge("known")),
    ]


def sources(sensor: Sensor, knowledge: Knowledge) -> tuple[str, ...]:
    """Sources of the uncertainty: the columns of a budget."""
    power = ("beam power",) if isinstance(knowledge.power, Prior) else ()
    calibration = (CALIBRATION,) if sensor.calibration else ()
    return (*noise_sources(sensor), "beam position", *power, *calibration)


@check_arguments
def budgets(
    sensor: Sensor,
    states: ArrayLike,
    how: Estimator | Knowledge,
    object: MeasuredObject | None = None,
) -> Floats:
    """Split the variance of each axis of the pose by its sources.

    Parameters
    ----------
    sensor
        The sensor.
    states
        States, (..., 8); mm and rad, world frame.
    how
        Knowledge of the beam (`facets.Knowledge`), or an estimator that also selects the readings
        (`facets.Estimator`).
    object
        The object whose displacement from its pose at the mirror's zero has these axes. None:
        the axes are those of the mirror's pose.

    Returns
    -------
    ndarray
        Variances (..., 6, s); mm^2 and rad^2. `sources` names the s columns. NaN where a detector
        has no reading or the readings do not determine the pose.

    Examples
    --------
    >>> import numpy as np, facets
    >>> known = facets.Knowledge(beam="known")
    >>> parts = facets.budgets(facets.Sensor(), np.zeros((1, 8)), known)[0]
    >>> [f"{share:.0%}" for share in parts[0] / parts[0].sum()]  # of x: places, powers, beam
    ['0%', '100%', '0%']
    """
    knowledge, eight = (how, False) if isinstance(how, Knowledge) else (how.knowledge, how.eight)
    if not isinstance(knowledge, Knowledge):
        raise InputError(f"the estimator's knowledge is {knowledge!r}; allowed: a facets.Knowledge")
    rows, shape = as_rows(states, 8, "states")
    parts = budgets_of_rows(sensor, rows, knowledge, eight, object)
    return parts.reshape(*shape, *parts.shape[1:])


def budgets_of_rows(
    sensor: Sensor,
    states: Floats,
    knowledge: Knowledge,
    eight: bool,
    body: MeasuredObject | None,
) -> Floats:
    """The budgets (n, 6, s) of states (n, 8), see `budgets`.  eight: omits the last power."""
    reading = readings(sensor, states)
    parts = variances(sensor, reading)
    sigma = np.sqrt(parts.sum(axis=-1))
    matrix = jacobian(sensor, states)
    finite = np.isfinite(matrix).all(axis=(1, 2))
    beam, _ = prior_sigmas(knowledge)
    rows = matrix[finite] / sigma[finite][:, :, None]
    gain = estimator_gains(sensor, rows, reading[finite] / sigma[finite], knowledge, eight)
    if body is not None:
        gain = displacement_slopes(states[finite, :6], body) @ gain
    out = np.full((len(states), 6, len(sources(sensor, knowledge))), np.nan)
    square, read = gain**2, 9 - eight
    fraction = parts[finite][:, :read] / sigma[finite][:, :read, None] ** 2
    count = parts.shape[-1]
    out[finite, :, :count] = square[:, :, :read] @ fraction
    beams = 2 if 0 < beam < np.inf else 0
    out[finite, :, count] = square[:, :, read : read + beams].sum(axis=2)
    if isinstance(knowledge.power, Prior):
        out[finite, :, count + 1] = square[:, :, read + beams :].sum(axis=2)
    if sensor.calibration is not None:
        off = parameter_derivatives(sensor, sensor.calibration, states[finite], reading[finite])
        moved = gain[:, :, :read] @ (off[:, :read] / sigma[finite][:, :read, None])
        cross = moved @ np.array(sensor.calibration.covariance)
        out[finite, :, -1] = (cross * moved).sum(axis=2)
    return out


def estimator_gains(
    sensor: Sensor, rows: Floats, weighted: Floats, knowledge: Knowledge, eight: bool
) -> Floats:
    """Gains (n, 6, r) from weighted readings, and after these the priors, to the pose.

    rows: (n, 9, 8) Jacobians over the readings' standard deviations.  weighted: (n, 9) the readings
    over these.
    """
    beam, power = prior_sigmas(knowledge)
    if power > 0:
        rows = add_power_column(sensor, rows, weighted)
    if eight:
        rows = rows[:, :8]
    rows = apply_priors(rows, [beam, beam, power][: rows.shape[2] - 6])
    units = np.array([1e-3] * 3 + [1e-6] * 3 + [1e-3] * (rows.shape[2] - 6))
    gain: Floats = (np.linalg.pinv(rows * units, rcond=1e-15) * units[None, :, None])[:, :6]
    return gain


def add_power_column(sensor: Sensor, rows: Floats, weighted: Floats) -> Floats:
    """Append the beam's power as an unknown: a column (n, 9, 1) of the powers' derivatives."""
    column = weighted / sensor.beam.power
    column[:, [0, 1, 3, 4, 6, 7]] = 0.0
    wider: Floats = np.concatenate([rows, column[:, :, None]], axis=2)
    return wider


def prior_sigmas(knowledge: Knowledge) -> tuple[float, float]:
    """Prior standard uncertainties of the position, mm, and of the power, mW. Raises `InputError`
    if they differ along x and y."""
    beam, power = as_floats(knowledge.beam_sigma, "sigma"), knowledge.power_sigma
    if beam.size > 1 and (beam != beam.flat[0]).any():
        raise InputError(
            f"the beam's prior has the sigmas {beam.tolist()}; allowed: the same along x and y"
        )
    return float(beam.flat[0]), float(as_floats(power, "sigma"))


def apply_priors(rows: Floats, sigmas: Sequence[float]) -> Floats:
    """Remove exactly known unknowns from weighted Jacobians, and append a row for each prior.

    rows: (n, r, 6 + m).  sigmas: m standard uncertainties of the unknowns after the pose, 0 known,
    infinite free.
    """
    priors = [6 + n for n, sigma in enumerate(sigmas) if 0 < sigma < np.inf]
    if priors:
        more = np.zeros((len(rows), len(priors), rows.shape[2]))
        more[:, range(len(priors)), priors] = [1 / sigmas[c - 6] for c in priors]
        rows = np.concatenate([rows, more], axis=1)
    if 0 in sigmas:
        rows = rows[:, :, [*range(6), *(6 + n for n, sigma in enumerate(sigmas) if sigma > 0)]]
    return rows


@check_arguments
def uncertainties(
    sensor: Sensor,
    states: ArrayLike,
    how: Estimator | Knowledge,
    object: MeasuredObject | None = None,
) -> Floats:
    """Compute the least possible standard uncertainties of a pose.

    Parameters
    ----------
    sensor
        The sensor.
    states
        States, (..., 8); mm and rad, world frame.
    how
        Knowledge of the beam (`facets.Knowledge`), or an estimator that also selects the readings
        (`facets.Estimator`).
    object
        The object whose axes are meant, as for `facets.budgets`.

    Returns
    -------
    ndarray
        (..., 6), mm and rad: one standard deviation, by the Cramer-Rao bound. NaN where the
        readings do not determine the pose.

    Examples
    --------
    >>> import numpy as np, facets
    >>> free = facets.Knowledge(beam="free")
    >>> u = facets.uncertainties(facets.Sensor(), np.zeros((1, 8)), free)[0]
    >>> f"z {1e3 * u[2]:.1f} um, yaw {1e6 * u[5]:.0f} urad"
    'z 1.5 um, yaw 6 urad'
    """
    root: Floats = np.sqrt(budgets(sensor, states, how, object).sum(axis=-1))
    return root


#: Largest distance from rest that is searched, places where a search begins, and its first and last
#: steps, all as fractions of a box's half sides.
INSIDE = 1 - 1e-6
STARTS = np.concatenate(
    [
        np.zeros((1, 6)),
        np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T,
        np.random.default_rng(0).uniform(-1, 1, (100, 6)),
    ]
)
FIRST_STEP, LAST_STEP = 0.25, 1e-4


def worst_states(sensor: Sensor, rules: Rules, how: Estimator, halves: Floats) -> Floats:
    """States (6, 8) in which each axis has its largest uncertainty, by a search from many places.
    Raises `InputError` if no pose can be solved.

    halves: (6, 6) for each axis half the sides of the box about rest that is searched.
    """
    axes = np.arange(6)

    def states(shares: Floats) -> Floats:
        """States of shares (6, n, 6): 6 n."""
        return states_of((INSIDE * shares * halves[:, None]).reshape(-1, 6), rules)

    def look(shares: Floats) -> Floats:
        """The standard uncertainty of each axis at its states; -1 where there is none."""
        sigma = uncertainties(sensor, states(shares), how, rules.object).reshape(
            *shares.shape[:2], 6
        )
        sigma_of_axis: Floats = np.nan_to_num(sigma[axes, :, axes], nan=-1.0)
        return sigma_of_axis

    tried = np.repeat(STARTS[None], 6, axis=0)
    sides = np.concatenate([np.eye(6), -np.eye(6)])
    place, best, step = np.zeros((6, 6)), np.full(6, -1.0), np.full(6, FIRST_STEP)
    while (step > LAST_STEP).any():
        uncertainty = look(tried)
        most = uncertainty.argmax(axis=1)
        better = uncertainty[axes, most] > best
        place = np.where(better[:, None], tried[axes, most], place)
        best = np.maximum(best, uncertainty[axes, most])
        step = np.where(better, step, step / 2)
        tried = np.clip(place[:, None] + step[:, None, None] * sides, -1.0, 1.0)
    if (best < 0).any():
        raise InputError(f"{how.name}: no pose in the range can be solved")
    return states(place[:, None])


@dataclass(frozen=True)
class Resolution:
    """One estimator's standard uncertainties, mm and rad: (6,) at rest; at worst over each axis's
    own symmetric range, the others at rest; and at worst anywhere in a box of all six axes.

    worst_state, box_state: (6, 8) states of each axis's maximum.  budget: (6, s) variances at rest,
    by source.  worst_budget, box_budget: (6, s) variances of each axis at its maximum.  box: (6,)
    half the sides of `largest_box`.  degrees_of_freedom: those of the calibration, NaN if unknown.
    object: the object whose displacement has these axes; None: the mirror.
    """

    how: Estimator
    sources: tuple[str, ...]
    worst_state: Floats
    box_state: Floats
    budget: Floats
    worst_budget: Floats
    box_budget: Floats
    box: Floats
    degrees_of_freedom: float
    object: MeasuredObject | None = None

    @property
    def nominal(self) -> Floats:
        """Standard uncertainties (6,) at rest, mm and rad."""
        return total(self.budget)

    @property
    def worst(self) -> Floats:
        """Standard uncertainties (6,) at the worst pose on the axes, mm and rad."""
        return total(self.worst_budget)

    @property
    def worst_in_box(self) -> Floats:
        """Standard uncertainties (6,) at the worst state of the box, mm and rad."""
        return total(self.box_budget)

    def coverage(self, probability: float) -> tuple[tuple[Floats, Floats], ...]:
        """Effective degrees of freedom and coverage factors (6,) at rest, and at both maxima."""
        numbers = []
        for budget in (self.budget, self.worst_budget, self.box_budget):
            part = budget[:, -1] if self.sources[-1] == CALIBRATION else np.zeros(len(budget))
            freedom = effective_degrees_of_freedom(
                budget.sum(axis=1), part, self.degrees_of_freedom
            )
            numbers.append((freedom, coverage_factor(probability, freedom)))
        return tuple(numbers)

    @property
    def shares(self) -> Floats:
        """Fraction of each variance at rest that is due to each source: (6, s)."""
        part: Floats = self.budget / self.budget.sum(axis=1, keepdims=True)
        return part


def total(budget: Floats) -> Floats:
    """Standard uncertainties (6,) of variances (6, s) by source."""
    root: Floats = np.sqrt(budget.sum(axis=1))
    return root


def resolve(sensor: Sensor, rules: Rules, hows: Sequence[Estimator]) -> list[Resolution]:
    """Compute the resolutions of estimators at rest, over the range of each axis, and in the
    largest box with the proportions of these ranges."""
    rest, calibration, body, resolutions = np.zeros((1, 8)), sensor.calibration, rules.object, []
    half = np.array([axis.symmetric / 2 for axis in axis_ranges(sensor, rules, np.zeros(6))])
    box, _ = largest_box(sensor, rules, np.zeros(6), half)
    freedom = (
        np.nan
        if calibration is None or calibration.degrees_of_freedom is None
        else calibration.degrees_of_freedom
    )
    for how in hows:
        along_axes = worst_states(sensor, rules, how, np.diag(half))
        in_box = worst_states(sensor, rules, how, np.tile(box, (6, 1)))
        at_axes, at_box = (
            budgets(sensor, states, how, body)[np.arange(6), np.arange(6)]
            for states in (along_axes, in_box)
        )
        at_rest = budgets(sensor, rest, how, body)[0]
        parts = sources(sensor, how.knowledge)
        resolutions.append(
            Resolution(how, parts, along_axes, in_box, at_rest, at_axes, at_box, box, freedom, body)
        )
    return resolutions
