"""The uncertainty of a pose: noise, priors, calibration; unseen errors; expanded uncertainties.

The noise of the readings differs between samples, so that a mean over n samples has 1/n of its
variance. The errors of the calibrated parameters are the same in every sample: a mean contains them
unchanged, and a difference of two poses contains them times the difference of the derivatives. The
errors of a prior of beam or power also remain in a mean, except for the laser's pointing jitter and
power noise, which differ between samples.

The largest error that one corrupted number can cause without raising the residual above its limit
is called external reliability in geodesy (W. Baarda, 1968). Of the squared error of a number, in
standard deviations, the pose takes the fraction h and the residual 1 - h. An error whose
residual is the limit L of `Chance` therefore moves the pose by L sqrt(h / (1 - h)), and no
component of the pose by more than this many of its standard uncertainties.

The expanded uncertainty (JCGM 100, GUM, annex G) is U = k u, with k the quantile of Student's t
distribution for the effective degrees of freedom. The noise of a reading is known and has
infinitely many degrees of freedom; the calibration has the degrees of freedom of its residuals. For
a region in m dimensions k follows from the chi-square distribution (JCGM 102, 6.5), or from
Hotelling's distribution with few degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import check_arguments
from ..core.errors import InputError
from ..core.knowledge import BeamKnowledge, Knowledge, PowerKnowledge
from ..core.names import FINE_UNITS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.calibrated import LIGHT_CENTRE, MISFIT, MODEL_ERROR, TEMPERATURE
from ..detectors.correction import NAMES, correction_slopes
from ..detectors.noise import standard_deviations
from ..model.arrays import (
    EFFECTS,
    as_rows,
    derivatives,
    effect_jacobian,
    jacobian,
    parameter_jacobian,
    readings,
)
from ..model.beam_shape import SHAPE, shape_derivatives
from ..optics.forward import PARAMETERS
from .plan import chance_of, jitter_fraction, make_plan
from .problem import Results, unpack_covariances

if TYPE_CHECKING:
    from ..core.sensor import Calibration, Sensor
    from .plan import Plan


#: Number of samples that are propagated together; each takes 5 kB.
PART_SAMPLES = 2000


def slices_of(count: int) -> list[slice]:
    """Slices of `count` samples, each small enough to be propagated at once."""
    return [slice(first, first + PART_SAMPLES) for first in range(0, count, PART_SAMPLES)]


class Propagation(NamedTuple):
    """Propagation of errors to solved states (n, 8), mm and rad; NaN for a non-finite state.

    noise: (n, 8, 8) covariance due to the readings' noise.  statistical: (n, 8, 8) covariance due
    to the noise and the priors of beam and power.  slopes: (n, 8, p) derivatives of the state by
    the calibrated parameters, or None without a calibration.  readings: (n, 9) of the model, mm and
    mW.  priors: (n, 8, 3) change of the state by one standard deviation of the prior errors of bx,
    by and the power that are the same in all samples: statistical is noise + priors priors'.
    """

    noise: Floats
    statistical: Floats
    slopes: Floats | None
    readings: Floats
    priors: Floats


class UncertaintyParts(NamedTuple):
    """Covariances (n, 8, 8) of states, and their parts due to the readings' noise and to the
    calibration; NaN for a state that is not finite.  degrees_of_freedom: of the calibration; NaN
    if unknown."""

    total: Floats
    noise: Floats
    calibration: Floats
    degrees_of_freedom: float


def uncertainty_parts(
    sensor: Sensor, plan: Plan, results: Results, warmer: Floats | None = None
) -> UncertaintyParts | None:
    """Add the calibration's part to the covariances of poses, and return them with their parts.

    Returns None without a calibration (`Sensor.calibration`) or without covariances.  plan, warmer:
    as in `propagate`.
    """
    if sensor.calibration is None or not results.covariances.shape[1]:
        return None
    total = unpack_covariances(results.covariances)
    noise, calibration = np.empty_like(total), np.empty_like(total)
    for part in slices_of(len(total)):
        propagation = propagate(
            sensor, sensor.calibration, results.states[part, :8], results.used[part], plan,
            None if warmer is None else warmer[part],
        )  # fmt: skip
        noise[part] = propagation.noise
        calibration[part] = carry_over(sensor.calibration, propagation.slopes)
    total += calibration
    freedom = sensor.calibration.degrees_of_freedom
    return UncertaintyParts(total, noise, calibration, np.nan if freedom is None else freedom)


def transpose(matrices: Floats) -> Floats:
    """The transposes of matrices (..., m, k)."""
    return np.swapaxes(matrices, -1, -2)


def carry(slopes: Floats, covariance: Floats) -> Floats:
    """Propagate the covariance (..., k, k) of some quantities to others: (..., m, m).

    slopes: (..., m, k) derivatives of the others by the quantities.
    """
    carried: Floats = slopes @ covariance @ transpose(slopes)
    return carried


def carry_over(calibration: Calibration, slopes: Floats | None) -> Floats:
    """Covariance (n, 8, 8) of states due to a calibration.

    slopes: (n, 8, p) derivatives of the states by its parameters.
    """
    assert slopes is not None
    return carry(slopes, np.array(calibration.covariance))


def propagate(
    sensor: Sensor,
    calibration: Calibration | None,
    states: Floats,
    used: NDArray[np.bool_],
    plan: Plan,
    warmer: Floats | None = None,
) -> Propagation:
    """Propagate noise, priors and the errors of a calibration to solved states (n, 8).

    used: (n, 3) whether each detector took part.  plan: the unknowns and priors of the estimate.
    warmer: (n,) temperature above the calibration's reference, K; None if unknown.
    """
    exact, free, weights = readings(sensor, states), plan.free, plan.weights
    row_weights = np.repeat(used, 3, axis=1) / standard_deviations(sensor, exact)
    by_state = np.zeros((len(states), 9, 9))
    by_state[:, :, :8] = jacobian(sensor, states)
    by_state[:, 2::3, 8] = exact[:, 2::3] / sensor.beam.power
    rows = np.nan_to_num(by_state[:, :, free] * row_weights[:, :, None])
    prior_information = np.zeros(9)
    prior_information[6:] = weights**2
    units = np.array([*FINE_UNITS, 1e-3])[free]
    rows *= units
    transposed = np.swapaxes(rows, 1, 2)
    information = transposed @ rows
    inner = information + np.diag(prior_information[free] * units**2)
    is_finite = np.isfinite(states).all(axis=1)
    inner[~is_finite] = np.eye(len(free))
    inverse = np.linalg.inv(inner)
    scale = np.outer(units, units)

    def state_part(part: Any, places: tuple[Any, ...], shape: tuple[int, ...]) -> Floats:
        """Expand rows (and columns) from the unknowns to the state; known components are 0."""
        expanded = np.zeros((len(states), *shape))
        expanded[(slice(None), *places)] = part
        expanded[~is_finite] = np.nan
        return expanded[:, :8]

    square, free_pairs = (9, 9), np.ix_(free, free)
    jitter = np.zeros(9)
    jitter[6:] = jitter_fraction(sensor, prior_information[6:])
    random = information + np.diag((prior_information * jitter)[free] * units**2)
    lasting = inverse * (np.sqrt(prior_information * (1 - jitter))[free] * units) * units[:, None]
    noise = state_part(inverse @ random @ inverse * scale, free_pairs, square)
    statistical = state_part(inverse * scale, free_pairs, square)
    priors = state_part(lasting, free_pairs, square)[:, :, 6:]
    slopes = None
    if calibration is not None:
        shifts = parameter_derivatives(sensor, calibration, states, exact, warmer)
        shifts = shifts * row_weights[:, :, None]
        if not np.isfinite(shifts).all():  # nan_to_num takes longer than all other steps.
            shifts = np.nan_to_num(shifts)
        shifted = inverse @ (transposed @ shifts) * units[:, None]
        slopes = state_part(shifted, (free,), (9, shifts.shape[2]))
    return Propagation(noise[:, :, :8], statistical[:, :, :8], slopes, exact, priors)


def parameter_derivatives(
    sensor: Sensor,
    calibration: Calibration,
    states: Floats,
    exact: Floats,
    warmer: Floats | None = None,
) -> Floats:
    """Derivatives (n, 9, p) of the model minus the reading by the calibrated parameters.

    states: (n, 8).  exact: (n, 9) the model's readings there.  warmer: (n,) temperature above the
    calibration's reference, K.
    """
    by_parameter: Floats = np.empty(0)
    if any(name in PARAMETERS or name in SHAPE for name in calibration.names):
        by_parameter = parameter_jacobian(sensor, states)
    # Each misfit adds to its own reading.
    identity = np.broadcast_to(np.eye(9), (len(states), 9, 9))
    makers: dict[tuple[str, ...], Callable[[], Floats]] = {
        PARAMETERS: lambda: by_parameter,
        NAMES: lambda: -correction_slopes(sensor, exact),
        MISFIT: lambda: identity,
        MODEL_ERROR: lambda: identity,
        SHAPE: lambda: shape_derivatives(sensor, states, by_parameter),
        LIGHT_CENTRE: lambda: jacobian(sensor, states)[:, :, 6:],
        TEMPERATURE: lambda: temperature_derivatives(sensor, states, warmer),
        EFFECTS: lambda: effect_jacobian(sensor, states, names=calibration.names),
    }
    parts: list[Floats] = [np.empty((len(states), 9, 0))]
    order: list[int] = []
    for names, make in makers.items():
        columns = [n for n, name in enumerate(calibration.names) if name in names]
        if columns:
            which = [names.index(calibration.names[n]) for n in columns]
            parts.append(make().take(which, axis=2))
            order += columns
    derivatives: Floats = np.concatenate(parts, axis=2)
    return derivatives if order == sorted(order) else derivatives[:, :, np.argsort(order)]


def temperature_derivatives(sensor: Sensor, states: Floats, warmer: Floats | None) -> Floats:
    """Derivatives (n, 9, 8) of readings by the coefficients `TEMPERATURE`, K; 0 without `warmer`.

    warmer: (n,) temperature above the reference, K.
    """
    slopes = np.zeros((len(states), 9, len(TEMPERATURE)))
    if warmer is not None:
        slopes[:, :, :2] = jacobian(sensor, states)[:, :, 6:]
        slopes[:, [0, 1, 3, 4, 6, 7], np.arange(2, len(TEMPERATURE))] = 1.0
        slopes *= warmer[:, None, None]
    return slopes


#: A number with less redundancy than this has none, apart from rounding errors.
ROUNDED_REDUNDANCY = 1e-12


@check_arguments
def unseen_errors(
    sensor: Sensor,
    state: ArrayLike,
    *,
    beam: BeamKnowledge = "free",
    power: PowerKnowledge = "known",
) -> Floats:
    """Bound the error of a pose that one corrupted number can cause without being detected.

    Parameters
    ----------
    sensor
        The sensor.
    state
        States tx, ty, tz, roll, pitch, yaw, bx, by, (..., 8); mm and rad, world frame.
    beam, power
        Knowledge of them, as for `facets.solve`; the mean of a `Prior` is ignored.

    Returns
    -------
    ndarray
        (..., 9) for each number of the reading, in standard uncertainties of the pose. If only that
        number is wrong and the solution is still `ok`, no component of the pose has a larger error,
        to first order and without the noise of the other numbers. Infinite for a number without
        redundancy; NaN where a detector has no light.

    Examples
    --------
    >>> import numpy as np, facets
    >>> facets.unseen_errors(facets.Sensor(), np.zeros(8), beam="known").round()[:3].tolist()
    [4.0, 12.0, 6.0]
    >>> facets.unseen_errors(facets.Sensor(), np.zeros(8), beam="free").round()[:3].tolist()
    [inf, inf, 6.0]
    """
    states, shape = as_rows(state, 8, "state")
    plan = make_plan(sensor, Knowledge(beam=beam, power=power), shape=shape)
    limit = chance_of(sensor, plan).limit
    return unseen_by_residual(redundancies(sensor, states, plan), limit).reshape(*shape, 9)


def unseen_by_residual(redundancy: Floats, limit: float) -> Floats:
    """Compute `unseen_errors` (n, 9) from `redundancies` (n, 9) and the limit of the residual."""
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = limit * np.sqrt((1 - redundancy) / redundancy)
    return np.where(redundancy <= ROUNDED_REDUNDANCY, np.inf, errors)


def redundancies(sensor: Sensor, states: Floats, plan: Plan) -> Floats:
    """The redundancy (n, 9) of each number of the readings at states (n, 8).

    It is the fraction of the number's squared error, in standard deviations, that appears in the
    residual. The sum over a reading is the expected square of its residual, if beam and power are
    within the priors of the plan. NaN where a detector has no light.
    """
    exact = readings(sensor, states)
    slopes = np.zeros((len(states), 9, 9))
    slopes[:, :, :8] = derivatives(sensor, states) * FINE_UNITS
    slopes[:, 2::3, 8] = exact[:, 2::3]
    slopes /= standard_deviations(sensor, exact)[:, :, None]
    priors = np.diag([*[0.0] * 6, *plan.weights * [*FINE_UNITS[6:], sensor.beam.power]])
    rows = np.concatenate([slopes, np.broadcast_to(priors, slopes.shape)], axis=1)[:, :, plan.free]
    out = np.full((len(states), 9), np.nan)
    lit = np.isfinite(rows).all(axis=(1, 2))
    factor = np.linalg.qr(rows[lit] / column_lengths(rows[lit]))[0]
    out[lit] = 1 - (factor[:, :9] ** 2).sum(axis=2)
    return out


def column_lengths(matrices: Floats) -> Floats:
    """The Euclidean norms (n, 1, k) of the columns of matrices (n, m, k)."""
    lengths: Floats = np.linalg.norm(matrices, axis=1, keepdims=True)
    return lengths


def require_probability(probability: float) -> float:
    """Return the coverage probability.  Raises `InputError` if it is not between 0 and 1."""
    if not 0 < probability < 1:
        raise InputError(
            f"the coverage probability is {probability}; allowed: between 0 and 1, such as 0.95"
        )
    return probability


def describe_coverage(sensor: Sensor, probability: float) -> dict[str, str]:
    """Entries of a table's head on its expanded uncertainties.

    Raises `InputError` for a probability that is not between 0 and 1.
    """
    calibration = sensor.calibration
    if calibration is None:
        source = "infinite, as the configuration has no covariance of a calibration"
    elif calibration.degrees_of_freedom is None:
        source = "unknown; coverage factors are those of the normal distribution"
    else:
        source = f"{calibration.degrees_of_freedom:.6g}"
    return {
        "coverage_probability": f"{require_probability(probability):g}",
        "calibration_degrees_of_freedom": source,
    }


def effective_degrees_of_freedom(
    variance: ArrayLike, part: ArrayLike, degrees_of_freedom: ArrayLike
) -> Floats:
    """Effective degrees of freedom of variances (...) by the formula of Welch and Satterthwaite.

    part: (...) the part of each variance with `degrees_of_freedom` (...), NaN if unknown; the rest
    has infinitely many. The result is infinite where the part is zero.
    """
    total, limited, freedom = np.broadcast_arrays(
        *(np.asarray(numbers, float) for numbers in (variance, part, degrees_of_freedom))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        effective: Floats = np.where(limited > 0, freedom * (total / limited) ** 2, np.inf)
    return effective


def coverage_factor(probability: float, degrees_of_freedom: ArrayLike = np.inf) -> Floats:
    """Coverage factor of an interval that is symmetric about the estimate (GUM, G.3).

    degrees_of_freedom: (...); NaN if unknown, which gives the factor of the normal distribution.
    """
    from scipy.special import ndtri, stdtrit

    require_probability(probability)
    freedom, upper = np.asarray(degrees_of_freedom, float), (1 + probability) / 2
    is_finite = np.isfinite(freedom)
    factor: Floats = np.full(freedom.shape, ndtri(upper))
    factor[is_finite] = stdtrit(freedom[is_finite], upper)
    return factor


def region_factor(probability: float, dimensions: int, degrees_of_freedom: float = np.inf) -> float:
    """Coverage factor of a hyper-ellipsoid about the estimate.

    With the covariance C, the region contains the points whose difference d from the estimate has
    d' C^-1 d up to the square of the factor. The factor is NaN, because there is no such region, if
    the degrees of freedom are fewer than the dimensions; unknown ones (NaN) give the factor of the
    normal distribution.
    """
    from scipy.special import chdtri, fdtri

    require_probability(probability)
    if not np.isfinite(degrees_of_freedom):
        return float(np.sqrt(chdtri(dimensions, 1 - probability)))
    rest = degrees_of_freedom - dimensions + 1
    if rest <= 0:
        return float("nan")
    scale = dimensions * degrees_of_freedom / rest
    return float(np.sqrt(scale * fdtri(dimensions, rest, probability)))
