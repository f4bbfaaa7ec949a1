"""The uncertainty budget of a calibration: how much of each variance comes from which source.

With F the information on all unknowns, those of the samples included, and F_s the part of it that
source s gives, the covariance is the sum of F^-1 F_s F^-1 over the sources. The samples' own
unknowns are eliminated as in the fit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.units import Floats
from ..detectors.calibrated import LIGHT_CENTRE, MISFIT, MODEL_ERROR
from ..estimation.differences import carry, propagate_in_light
from ..estimation.plan import make_plan
from ..estimation.uncertainty import effective_degrees_of_freedom
from .bundle_adjustment import OWN_COUNT, OWN_UNITS, own_information, states_of
from .fit import Fit, Task, add_mean_power, sensor_covariance
from .misfit import covariance_factor
from .small_matrices import one_thread
from .unknowns import PLACE

if TYPE_CHECKING:
    from ..core.knowledge import Knowledge
    from ..core.sensor import Sensor
    from .bundle_adjustment import Data

#: The sources of a fit's uncertainty.
READINGS = "noise of the calibration's readings"
REFERENCE = "reference instrument, as stated"
LASER = "power of the laser, from sample to sample"
BEAM = "position of the beam, from sample to sample"
PRIOR = "values known before the calibration"
#: Sources that the fit does not contain, by the names that they have in the covariance.
UNSEEN = {
    "misfit of the model, of unknown cause": MISFIT,
    "accuracy of the model": MODEL_ERROR,
    "middle of the light": LIGHT_CENTRE,
}
#: The coverage probability of expanded uncertainties.
COVERAGE = 0.95


class Budget(NamedTuple):
    """The covariance of the written parameters by source.

    sensor: (p, p) each, in the order of `Sensor.calibration`.  estimated: the sources whose size
    the residuals estimate.  freedom: degrees of freedom of that estimate.
    """

    sensor: dict[str, Floats]
    estimated: tuple[str, ...]
    freedom: float

    def effective_freedom(self, variances: dict[str, Floats]) -> Floats:
        """Effective degrees of freedom of sums of variances by source (Welch and Satterthwaite)."""
        whole = np.asarray(sum(variances.values()))
        estimated = np.asarray(sum(variances[name] for name in self.estimated))
        return effective_degrees_of_freedom(whole, estimated, self.freedom)


@one_thread
def calibration_budget(
    nominal: Sensor, data: Data, result: Fit, made: Sensor, robust: float | None
) -> Budget:
    """The budget of a fit that began at `nominal`.  made: the calibrated sensor, as it is
    written."""
    assert made.calibration is not None
    parts, names = fitted_parts(Task(nominal, data, result.choice, robust), result)
    factor = covariance_factor(result)
    written = np.diag(np.array(made.calibration.covariance))
    sensor = {}
    for source, part in parts.items():
        covariance = np.array(sensor_covariance(names, result.all_values, factor * part).covariance)
        beside = len(written) - len(covariance)
        sensor[source] = np.pad(covariance, (0, beside))
    for source, kinds in UNSEEN.items():
        is_kind = [name in kinds for name in made.calibration.names]
        if any(is_kind):
            sensor[source] = np.diag(np.where(is_kind, written, 0.0))
    # An earlier calibration of which the values are known was itself estimated by residuals.
    estimated = (READINGS,) if result.choice.joint is None else (READINGS, PRIOR)
    freedom = made.calibration.degrees_of_freedom or result.freedom
    return Budget(sensor, estimated if factor == 1 else tuple(parts), max(freedom, 1.0))


def fitted_parts(task: Task, result: Fit) -> tuple[dict[str, Floats], list[str]]:
    """Covariances (p, p) of the unknowns by source, and the unknowns' names: the unknowns of the
    fit, and the laser's mean power where each sample has its own."""
    at = task.guess(result.all_values, result.own_values)
    _, _, normal = task.linearise(at, task.outlier_limit(at))
    names, size = list(result.choice.names), len(result.covariance)
    back, total = normal.back[:, :, :size], result.covariance
    by_common, by_own = np.eye(size), np.zeros((len(back), 1, OWN_COUNT))
    if np.isinf(result.choice.power):
        names.append("beam.power")
        total = add_mean_power(task, at, normal, total)
        unit = OWN_UNITS[6] * at.values[PLACE["beam.power"]]
        by_common = np.vstack([by_common, -unit * back[:, 6].mean(axis=0)])
        by_own = np.zeros((len(back), size + 1, OWN_COUNT))
        by_own[:, -1] = np.linalg.inv(normal.inner)[:, 6] * unit / len(back)
    # The derivatives of the estimates by what was known before of each sample's own unknowns.
    rows = by_own - by_common @ result.covariance @ np.swapaxes(back, 1, 2)
    known = np.where(task.is_known, 0.0, own_information(task.own_sigma))

    def part_of(unknowns: slice) -> Floats:
        some: Floats = np.einsum(
            "npk,k,nqk->pq", rows[:, :, unknowns], known[unknowns], rows[:, :, unknowns]
        )
        return some

    by_prior = by_common @ result.covariance
    parts = {
        REFERENCE: part_of(slice(0, 6)),
        LASER: part_of(slice(6, 7)),
        BEAM: part_of(slice(7, 9)),
        PRIOR: by_prior @ task.prior @ by_prior.T,
    }
    parts = {source: part for source, part in parts.items() if part.any()}
    return {READINGS: total - sum(parts.values()), **parts}, names


def pose_covariances(
    sensor: Sensor, budget: Budget, states: Floats, knowledge: Knowledge
) -> dict[str, Floats]:
    """Covariances (n, 6, 6) of the poses at states (n, 8) by source of the calibration, mm and
    rad."""
    propagated = propagate_in_light(
        sensor, states, make_plan(sensor, knowledge, shape=states.shape[:1])
    )
    assert propagated.slopes is not None
    slopes = propagated.slopes[:, :6]
    return {source: carry(slopes, part) for source, part in budget.sensor.items()}


def fitted_states(data: Data, result: Fit) -> Floats:
    """The states (n, 8) of the samples of a fit."""
    return states_of(data, result.own_values, result.all_values)
