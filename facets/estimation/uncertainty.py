"""The uncertainty of a pose: noise, and what noise is not; unseen errors; expanded uncertainties.

The noise of the readings differs from sample to sample, so that a mean over n samples has 1 / n of
its variance. The calibrated parameters are off by the same amount in every sample: a mean keeps
their part, and a difference of two poses has that of the difference between their derivatives. What
is known of beam and power beforehand (a prior) stays in a mean, too, but for the laser's pointing
jitter and power noise, which differ from sample to sample as the readings' noise does.

The largest error by one wrong number that the residual does not show is called external reliability
in geodesy (W. Baarda, 1968). A number takes the share h of its own error into the pose and leaves
1 - h in the residual, both squared and in standard deviations. So an error that leaves the limit L
of `Chance` as its residual moves the pose by L sqrt(h / (1 - h)), and no component of the pose by
more of its standard uncertainties.

JCGM 100 (GUM), annex G: the expanded uncertainty is U = k u, with k the quantile of Student's t
distribution for the effective degrees of freedom. The noise of a reading is known and has
infinitely many; the calibration has those of its residuals. For a region in m dimensions k follows
from the chi-square distribution (JCGM 102, 6.5), or from Hotelling's with few degrees of freedom.
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
from .plan import chance_of, jitter_share, make_plan
from .problem import Results, unpack_covariances

if TYPE_CHECKING:
    from ..core.sensor import Calibration, Sensor
    from .plan import Plan


#: How many samples at once: 5 kB each.
PART_SAMPLES = 2000


def slices_of(count: int) -> list[slice]:
    """Slices of some samples, each few enough to be propagated at once."""
    return [slice(first, first + PART_SAMPLES) for first in range(0, count, PART_SAMPLES)]


class Propagation(NamedTuple):
    """How solved states (n, 8) follow what is not known; NaN where a state is not finite.

    noise: (n, 8, 8) covariance by the readings' noise.  statistical: that by the priors of beam
    and power included.  slopes: (n, 8, p) derivatives by the calibrated parameters, or None without
    a calibration.  readings: (n, 9) of the model.  priors: (n, 8, 3) what one standard deviation of
    the lasting error of the priors of bx, by and the power does to the state, so that statistical
    is noise + priors priors'.
    """

    noise: Floats
    statistical: Floats
    slopes: Floats | None
    readings: Floats
    priors: Floats


class UncertaintyParts(NamedTuple):
    """Covariances (n, 8, 8) of states, and their parts by the readings' noise and by the
    calibration; NaN where a state is not finite.  degrees_of_freedom: of the calibration; NaN:
    unknown."""

    whole: Floats
    noise: Floats
    calibration: Floats
    degrees_of_freedom: float


def uncertainty_parts(
    sensor: Sensor, plan: Plan, results: Results, warmer: Floats | None = None
) -> UncertaintyParts | None:
    """The covariances of poses with those of the calibrated parameters (`Sensor.calibration`), and
    their parts; None without a calibration or covariances.

    The other arguments are those of `propagate`.
    """
    if sensor.calibration is None or not results.covariances.shape[1]:
        return None
    whole = unpack_covariances(results.covariances)
    noise, calibration = np.empty_like(whole), np.empty_like(whole)
    for part in slices_of(len(whole)):
        propagation = propagate(
            sensor, sensor.calibration, results.states[part, :8], results.used[part], plan,
            None if warmer is None else warmer[part],
        )  # fmt: skip
        noise[part] = propagation.noise
        calibration[part] = carry_over(sensor.calibration, propagation.slopes)
    whole += calibration
    known = sensor.calibration.degrees_of_freedom
    return UncertaintyParts(whole, noise, calibration, np.nan if known is None else known)


def transpose(matrices: Floats) -> Floats:
    """The transposes of matrices (..., m, k)."""
    return np.swapaxes(matrices, -1, -2)


def carry(slopes: Floats, covariance: Floats) -> Floats:
    """The covariance (..., m, m) of quantities with derivatives (..., m, k) by others, whose
    covariance (..., k, k) is known."""
    carried: Floats = slopes @ covariance @ transpose(slopes)
    return carried


def carry_over(known: Calibration, slopes: Floats | None) -> Floats:
    """The covariance (n, 8, 8) of states whose derivatives by the parameters are (n, 8, p)."""
    assert slopes is not None
    return carry(slopes, np.array(known.covariance))


def propagate(
    sensor: Sensor,
    known: Calibration | None,
    states: Floats,
    used: NDArray[np.bool_],
    plan: Plan,
    warmer: Floats | None = None,
) -> Propagation:
    """How solved states (n, 8) follow noise, priors and the parameters that are `known`.

    used: (n, 3) detectors.  plan: the unknowns that were solved for, and what was known of bx, by
    and the power.
    warmer: (n,) than the reference temperature of the calibration, K; None where it is not known.
    """
    seen, free, weights = readings(sensor, states), plan.free, plan.weights
    weigh = np.repeat(used, 3, axis=1) / standard_deviations(sensor, seen)
    by_state = np.zeros((len(states), 9, 9))
    by_state[:, :, :8] = jacobian(sensor, states)
    by_state[:, 2::3, 8] = seen[:, 2::3] / sensor.beam.power
    rows = np.nan_to_num(by_state[:, :, free] * weigh[:, :, None])
    before = np.zeros(9)
    before[6:] = weights**2
    units = np.array([*FINE_UNITS, 1e-3])[free]
    rows *= units
    across = np.swapaxes(rows, 1, 2)
    information = across @ rows
    inner = information + np.diag(before[free] * units**2)
    good = np.isfinite(states).all(axis=1)
    inner[~good] = np.eye(len(free))
    inverse = np.linalg.inv(inner)
    scale = np.outer(units, units)

    def state_part(part: Any, places: tuple[Any, ...], shape: tuple[int, ...]) -> Floats:
        """Rows or rows and columns of the unknowns as those of the state; 0 of what is known."""
        whole = np.zeros((len(states), *shape))
        whole[(slice(None), *places)] = part
        whole[~good] = np.nan
        return whole[:, :8]

    square, both = (9, 9), np.ix_(free, free)
    share = np.zeros(9)
    share[6:] = jitter_share(sensor, before[6:])
    random = information + np.diag((before * share)[free] * units**2)
    lasting = inverse * (np.sqrt(before * (1 - share))[free] * units) * units[:, None]
    noise = state_part(inverse @ random @ inverse * scale, both, square)
    statistical = state_part(inverse * scale, both, square)
    priors = state_part(lasting, both, square)[:, :, 6:]
    slopes = None
    if known is not None:
        off = parameter_derivatives(sensor, known, states, seen, warmer) * weigh[:, :, None]
        if not np.isfinite(off).all():  # replacing takes longer than all else
            off = np.nan_to_num(off)
        moved = inverse @ (across @ off) * units[:, None]
        slopes = state_part(moved, (free,), (9, off.shape[2]))
    return Propagation(noise[:, :, :8], statistical[:, :, :8], slopes, seen, priors)


def parameter_derivatives(
    sensor: Sensor,
    known: Calibration,
    states: Floats,
    seen: Floats,
    warmer: Floats | None = None,
) -> Floats:
    """How far model and reading part for each unit of what was calibrated: (n, 9, p).

    warmer: (n,) than the reference temperature of the calibration, K.
    """
    whole: Floats = np.empty(0)
    if any(name in PARAMETERS or name in SHAPE for name in known.names):
        whole = parameter_jacobian(sensor, states)
    identity = np.broadcast_to(np.eye(9), (len(states), 9, 9))  # each adds to its own reading
    makers: dict[tuple[str, ...], Callable[[], Floats]] = {
        PARAMETERS: lambda: whole,
        NAMES: lambda: -correction_slopes(sensor, seen),
        MISFIT: lambda: identity,
        MODEL_ERROR: lambda: identity,
        SHAPE: lambda: shape_derivatives(sensor, states, whole),
        LIGHT_CENTRE: lambda: jacobian(sensor, states)[:, :, 6:],
        TEMPERATURE: lambda: temperature_derivatives(sensor, states, warmer),
        EFFECTS: lambda: effect_jacobian(sensor, states, names=known.names),
    }
    parts: list[Floats] = [np.empty((len(states), 9, 0))]
    order: list[int] = []
    for names, make in makers.items():
        columns = [n for n, name in enumerate(known.names) if name in names]
        if columns:
            which = [names.index(known.names[n]) for n in columns]
            parts.append(make().take(which, axis=2))
            order += columns
    derivatives: Floats = np.concatenate(parts, axis=2)
    return derivatives if order == sorted(order) else derivatives[:, :, np.argsort(order)]


def temperature_derivatives(sensor: Sensor, states: Floats, warmer: Floats | None) -> Floats:
    """The derivatives by `TEMPERATURE` (n, 9, 8), of readings at temperatures (n,) K above the
    reference."""
    slopes = np.zeros((len(states), 9, len(TEMPERATURE)))
    if warmer is not None:
        slopes[:, :, :2] = jacobian(sensor, states)[:, :, 6:]
        slopes[:, [0, 1, 3, 4, 6, 7], np.arange(2, len(TEMPERATURE))] = 1.0
        slopes *= warmer[:, None, None]
    return slopes


#: Shares of an error that a residual has of it, squared, below this are rounding.
NOTHING = 1e-12


@check_arguments
def unseen_errors(
    sensor: Sensor,
    state: ArrayLike,
    *,
    beam: BeamKnowledge = "free",
    power: PowerKnowledge = "known",
) -> Floats:
    """Bound the error of a pose by one wrong number that the residual does not show.

    Parameters
    ----------
    sensor
        The sensor.
    state
        States tx, ty, tz, roll, pitch, yaw, bx, by, (..., 8); mm and rad, world frame.
    beam, power
        What is known of them, as for `facets.solve`; of a `Prior` its sigma alone counts.

    Returns
    -------
    ndarray
        (..., 9): for each number of the reading, in standard uncertainties of the pose. Where only
        that number is wrong and the solution is `ok` all the same, no component of the pose is off
        by more, to first order and but for the noise of the others. Infinite where nothing checks
        the number; NaN where a detector has no light.

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
    """The errors of `unseen_errors`, from `redundancies` and the limit of the residual."""
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = limit * np.sqrt((1 - redundancy) / redundancy)
    return np.where(redundancy <= NOTHING, np.inf, errors)


def redundancies(sensor: Sensor, states: Floats, plan: Plan) -> Floats:
    """The redundancy (n, 9) of each number of the readings at states (n, 8): the fraction of its
    error that stays in the residual, squared and in standard deviations.

    Their sum over a reading is the expected square of its residual where beam and power are as the
    priors of the plan say. NaN where a detector has no light.
    """
    exact = readings(sensor, states)
    slopes = np.zeros((len(states), 9, 9))
    slopes[:, :, :8] = derivatives(sensor, states) * FINE_UNITS
    slopes[:, 2::3, 8] = exact[:, 2::3]
    slopes /= standard_deviations(sensor, exact)[:, :, None]
    known = np.diag([*[0.0] * 6, *plan.weights * [*FINE_UNITS[6:], sensor.beam.power]])
    rows = np.concatenate([slopes, np.broadcast_to(known, slopes.shape)], axis=1)[:, :, plan.free]
    out = np.full((len(states), 9), np.nan)
    lit = np.isfinite(rows).all(axis=(1, 2))
    factor = np.linalg.qr(rows[lit] / column_lengths(rows[lit]))[0]
    out[lit] = 1 - (factor[:, :9] ** 2).sum(axis=2)
    return out


def column_lengths(matrices: Floats) -> Floats:
    lengths: Floats = np.linalg.norm(matrices, axis=1, keepdims=True)
    return lengths


def require_probability(probability: float) -> float:
    """The coverage probability.  Raises `InputError` if it is not between 0 and 1."""
    if not 0 < probability < 1:
        raise InputError(
            f"the coverage probability is {probability}; allowed: between 0 and 1, such as 0.95"
        )
    return probability


def describe_coverage(sensor: Sensor, probability: float) -> dict[str, str]:
    """The lines of a table's header on its expanded uncertainties."""
    known = sensor.calibration
    if known is None:
        source = "infinite, as the configuration has no covariance of a calibration"
    elif known.degrees_of_freedom is None:
        source = "unknown; coverage factors are those of the normal distribution"
    else:
        source = f"{known.degrees_of_freedom:.6g}"
    return {
        "coverage_probability": f"{require_probability(probability):g}",
        "calibration_degrees_of_freedom": source,
    }


def effective_degrees_of_freedom(
    variance: ArrayLike, part: ArrayLike, degrees_of_freedom: ArrayLike
) -> Floats:
    """Degrees of freedom of combined variances (...) by the formula of Welch and Satterthwaite.

    part: (...) of these variances, with `degrees_of_freedom` (...) of its own, NaN for unknown;
    the rest has infinitely many. Unknown ones matter only where the part is above zero.
    """
    whole, share, known = np.broadcast_arrays(
        *(np.asarray(numbers, float) for numbers in (variance, part, degrees_of_freedom))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        effective: Floats = np.where(share > 0, known * (whole / share) ** 2, np.inf)
    return effective


def coverage_factor(probability: float, degrees_of_freedom: ArrayLike = np.inf) -> Floats:
    """Coverage factor of an interval that is symmetric about the estimate (GUM, G.3).

    degrees_of_freedom: (...); NaN for unknown, which gives the factor of the normal distribution.
    """
    from scipy.special import ndtri, stdtrit

    require_probability(probability)
    freedom, upper = np.asarray(degrees_of_freedom, float), (1 + probability) / 2
    is_finite = np.isfinite(freedom)
    factor: Floats = np.full(freedom.shape, ndtri(upper))
    factor[is_finite] = stdtrit(freedom[is_finite], upper)
    return factor


def region_factor(probability: float, dimensions: int, degrees_of_freedom: float = np.inf) -> float:
    """Coverage factor of a hyper-ellipsoid in some dimensions, about the estimate.

    The region has the points whose difference d from the estimate has d' C^-1 d up to the factor's
    square, C the covariance. NaN, as no region can be stated, with fewer degrees of freedom than
    dimensions; NaN for the degrees of freedom (unknown) gives the factor of the normal
    distribution.
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
