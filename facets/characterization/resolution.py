"""How fine the sensor measures: standard uncertainties, and which source they come from.

Uncertainties are propagated through the estimator that `facets.solve` is: with J the Jacobian at
the true state and W the inverse variances of the readings and priors, the gain is G = (J'WJ)^-1 J'W
and each source i with variance s_i^2 contributes (G_ki s_i)^2 to unknown k. Their sum is the
diagonal of (J'WJ)^-1, the Cramer-Rao bound. Terms follow the GUM: a standard uncertainty is one
standard deviation, an expanded one twice that (coverage factor 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import as_floats, checked
from ..core.errors import InputError
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import sources as noise_sources
from ..detectors.noise import variances
from ..estimation.calibration_uncertainty import by_parameters
from ..estimation.compiling import compile_for
from ..model.arrays import as_rows, jacobian, readings
from .ranges import axis_ranges, states_of


class Estimator(NamedTuple):
    """What a solution uses. beam: 1 sigma of what is known of bx, by, mm; 0 known, inf free.

    eight: leaves out the last power, as the paper's inversion. power: known, else solved for.
    """

    name: str
    beam: float
    eight: bool = False
    power: bool = True


def estimators(beam_sigma: float) -> list[Estimator]:
    """The paper's, and ours with more and more known of the beam."""
    return [
        Estimator("paper: 8 readings", np.inf, eight=True),
        Estimator("beam free", np.inf),
        Estimator(f"beam within {1000 * beam_sigma:g} µm", beam_sigma),
        Estimator("beam known", 0.0),
    ]


def sources(sensor: Sensor) -> tuple[str, ...]:
    """What an uncertainty comes from: the columns of a budget."""
    return (*noise_sources(sensor), "beam position", *["calibration"] * bool(sensor.calibration))


@checked
def budgets(sensor: Sensor, states: ArrayLike, how: Estimator) -> Floats:
    """What the variance of each axis of the pose is made of.

    states: (..., 8), mm and rad.  how: what a solution uses and knows (`facets.Estimator`).

    Returns variances (..., 6, s) by source (`sources` names the s columns), mm^2 and rad^2; NaN
    where a detector has no reading or the readings do not determine the pose.

    >>> import numpy as np, facets
    >>> known = facets.Estimator("beam known", beam=0.0)
    >>> parts = facets.budgets(facets.Sensor(), np.zeros((1, 8)), known)[0]
    >>> [f"{share:.0%}" for share in parts[0] / parts[0].sum()]  # of x: places, powers, beam
    ['0%', '100%', '0%']
    """
    if not as_floats(how.beam, "the estimator's beam") >= 0:
        raise InputError(f"the estimator's beam is {how.beam}; allowed: 0 mm or more, or infinite")
    rows, shape = as_rows(states, 8, "states")
    return budgets_of_rows(sensor, rows, how).reshape(*shape, 6, len(sources(sensor)))


def budgets_of_rows(sensor: Sensor, states: Floats, how: Estimator) -> Floats:
    """`budgets` of states (n, 8)."""
    reading = readings(sensor, states)
    parts = variances(sensor, reading)
    sigma = np.sqrt(parts.sum(axis=-1))
    matrix = jacobian(sensor, states)
    known = np.isfinite(matrix).all(axis=(1, 2))
    rows = matrix[known] / sigma[known][:, :, None]
    if not how.power:
        rows = with_power(sensor, rows, reading[known] / sigma[known])
    if how.eight:
        rows = rows[:, :8]
    rows = with_beam(rows, how.beam)
    units = np.array([1e-3] * 3 + [1e-6] * 3 + [1e-3] * (rows.shape[2] - 6))
    gain = np.linalg.pinv(rows * units, rcond=1e-15) * units[None, :, None]
    out = np.full((len(states), 6, len(sources(sensor))), np.nan)
    square, read = gain[:, :6] ** 2, 9 - how.eight
    share = parts[known][:, :read] / sigma[known][:, :read, None] ** 2
    count = parts.shape[-1]
    out[known, :, :count] = square[:, :, :read] @ share
    out[known, :, count] = square[:, :, read:].sum(axis=2)
    if sensor.calibration is not None:
        off = by_parameters(sensor, sensor.calibration, states[known], reading[known])
        moved = gain[:, :6, :read] @ (off[:, :read] / sigma[known][:, :read, None])
        cross = moved @ np.array(sensor.calibration.covariance)
        out[known, :, -1] = (cross * moved).sum(axis=2)
    return out


def with_power(sensor: Sensor, rows: Floats, weighted: Floats) -> Floats:
    """Another unknown, the beam's power: a column (n, 9, 1) with the powers' derivatives by it."""
    column = weighted / sensor.beam.power
    column[:, [0, 1, 3, 4, 6, 7]] = 0.0
    wider: Floats = np.concatenate([rows, column[:, :, None]], axis=2)
    return wider


def with_beam(rows: Floats, sigma: float) -> Floats:
    """Two more rows for what is known of bx and by, unless they are free; known: very well."""
    if np.isinf(sigma):
        return rows
    if sigma == 0:
        return rows[:, :, [*range(6), *range(8, rows.shape[2])]]
    more = np.zeros((len(rows), 2, rows.shape[2]))
    more[:, 0, 6] = more[:, 1, 7] = 1 / sigma
    wider: Floats = np.concatenate([rows, more], axis=1)
    return wider


@checked
def uncertainties(sensor: Sensor, states: ArrayLike, how: Estimator) -> Floats:
    """Standard uncertainties of the pose: what a solution can know at best.

    states: (..., 8), mm and rad.  how: what it uses and knows (`facets.Estimator`).

    Returns (..., 6), mm and rad: one standard deviation, by the Cramer-Rao bound; NaN where the
    readings do not determine the pose.

    >>> import numpy as np, facets
    >>> free = facets.Estimator("beam free", beam=np.inf)
    >>> u = facets.uncertainties(facets.Sensor(), np.zeros((1, 8)), free)[0]
    >>> f"z {1e3 * u[2]:.1f} um, yaw {1e6 * u[5]:.0f} urad"
    'z 1.5 um, yaw 6 urad'
    """
    root: Floats = np.sqrt(budgets(sensor, states, how).sum(axis=-1))
    return root


def sweep_states(sensor: Sensor, rules: Rules, count: int = 101) -> Floats:
    """Poses along each axis's symmetric range, the others at rest, as states (6 count, 8).

    The poses over which the paper takes the worst standard deviation.
    """
    poses = []
    for number, found in enumerate(axis_ranges(sensor, rules, np.zeros(6))):
        along = np.zeros((count, 6))
        along[:, number] = np.linspace(-found.symmetric / 2, found.symmetric / 2, count)
        poses.append(0.999 * along)
    return states_of(np.concatenate(poses), rules)


@dataclass(frozen=True)
class Resolution:
    """One estimator's standard uncertainties, mm and rad: (6,) at rest and at worst.

    worst_state: (6, 8) where each axis is worst.  budget: (6, s) variances at rest, by source.
    """

    how: Estimator
    sources: tuple[str, ...]
    nominal: Floats
    worst: Floats
    worst_state: Floats
    budget: Floats

    @property
    def shares(self) -> Floats:
        """What part of each variance at rest comes from each source: (6, s)."""
        part: Floats = self.budget / self.budget.sum(axis=1, keepdims=True)
        return part


def resolve(sensor: Sensor, rules: Rules, hows: Sequence[Estimator]) -> list[Resolution]:
    """Resolutions over the range of each axis."""
    compile_for(sensor, "readings", "footprints", "derivatives")
    states = sweep_states(sensor, rules)
    rest = np.zeros((1, 8))
    found = []
    for how in hows:
        sigma = uncertainties(sensor, states, how)
        if np.isnan(sigma).all(axis=0).any():
            raise InputError(f"{how.name}: no pose in the range can be solved")
        worst = np.nanargmax(sigma, axis=0)
        budget = budgets(sensor, rest, how)[0]
        nominal = np.sqrt(budget.sum(axis=1))
        largest = sigma[worst, np.arange(6)]
        found.append(Resolution(how, sources(sensor), nominal, largest, states[worst], budget))
    return found
