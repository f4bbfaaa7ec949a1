"""The largest error of a pose by one wrong number that its residual does not show.

Geodesy calls it external reliability (W. Baarda, 1968). A number takes the share h of its own error
into the pose and leaves 1 - h in the residual, both squared and in standard deviations. So an error
that leaves the limit L of `Chance` as its residual moves the pose by L sqrt(h / (1 - h)), and no
component of the pose by more of its standard uncertainties.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import check_arguments
from ..core.knowledge import BeamKnowledge, Knowledge, PowerKnowledge
from ..core.names import FINE_UNITS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import standard_deviations
from ..model.arrays import as_rows, derivatives, readings
from .plan import chance_of, make_plan

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
    asked = make_plan(sensor, Knowledge(beam=beam, power=power), shape=shape)
    exact = readings(sensor, states)
    slopes = np.zeros((len(states), 9, 9))
    slopes[:, :, :8] = derivatives(sensor, states) * FINE_UNITS
    slopes[:, 2::3, 8] = exact[:, 2::3]
    slopes /= standard_deviations(sensor, exact)[:, :, None]
    known = np.diag([*[0.0] * 6, *asked.weights * [*FINE_UNITS[6:], sensor.beam.power]])
    rows = np.concatenate([slopes, np.broadcast_to(known, slopes.shape)], axis=1)[:, :, asked.free]
    out = np.full((len(states), 9), np.nan)
    lit = np.isfinite(rows).all(axis=(1, 2))
    into_pose = (np.linalg.qr(rows[lit] / column_lengths(rows[lit]))[0][:, :9] ** 2).sum(axis=2)
    left = 1 - into_pose
    limit = chance_of(sensor, asked).limit
    with np.errstate(divide="ignore", invalid="ignore"):
        out[lit] = np.where(left > NOTHING, limit * np.sqrt(into_pose / left), np.inf)
    return out.reshape(*shape, 9)


def column_lengths(matrices: Floats) -> Floats:
    found: Floats = np.linalg.norm(matrices, axis=1, keepdims=True)
    return found
