"""From standard to expanded uncertainties: coverage factors and effective degrees of freedom.

JCGM 100 (GUM), annex G: the expanded uncertainty is U = k u, with k the quantile of Student's t
distribution for the effective degrees of freedom. The noise of a reading is known and has
infinitely many; the calibration has those of its residuals. For a region in m dimensions k follows
from the chi-square distribution (JCGM 102, 6.5), or from Hotelling's with few degrees of freedom.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.units import Floats

if TYPE_CHECKING:
    from ..core.sensor import Sensor


def require_probability(probability: float) -> float:
    """The coverage probability.  Raises `InputError` if it is not between 0 and 1."""
    if not 0 < probability < 1:
        raise InputError(
            f"the coverage probability is {probability}; allowed: between 0 and 1, such as 0.95"
        )
    return probability


def describe_coverage(sensor: Sensor, probability: float) -> dict[str, str]:
    """What the header of a table says of its expanded uncertainties."""
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
        found: Floats = np.where(share > 0, known * (whole / share) ** 2, np.inf)
    return found


def coverage_factor(probability: float, degrees_of_freedom: ArrayLike = np.inf) -> Floats:
    """Coverage factor of an interval that is symmetric about the estimate (GUM, G.3).

    degrees_of_freedom: (...); NaN for unknown, which gives the factor of the normal distribution.
    """
    from scipy.special import ndtri, stdtrit

    require_probability(probability)
    freedom, upper = np.asarray(degrees_of_freedom, float), (1 + probability) / 2
    is_finite = np.isfinite(freedom)
    found: Floats = np.full(freedom.shape, ndtri(upper))
    found[is_finite] = stdtrit(freedom[is_finite], upper)
    return found


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
