"""Simulated heads with manufacturing and assembly errors, which check the predictions of
`prediction`.

The block `calibrate.before` states the tolerances. Each head's parameters are drawn from normal
distributions about those of the design, independently, with the standard uncertainties that a
calibration uses as its prior. The mirror's position on the reference belongs to the calibration's
rig, not to a head, and only the calibration estimates it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from ...calibration.fitting.bundle_adjustment import Data
from ...calibration.fitting.fit import Fit, StoppingRule, fit
from ...calibration.fitting.unknowns import MOUNTING, Choice, assign_values, fold_mount, values_of
from ...calibration.table import choice
from ...characterization.ranges import axis_ranges, clearances
from ...core.errors import InputError
from ...core.rules import Rules
from ...core.sensor import Sensor
from ...core.small_matrices import one_thread
from ...core.units import Booleans, Floats
from ...detectors.correction import invert_correction
from ...detectors.noise import add_noise
from ...model.arrays import readings
from ..requirement import (
    Requirement,
    accuracy_margins,
    errors_of,
    margins_of,
    requirement_of,
)

if TYPE_CHECKING:
    from ...core.calibrate import Calibrate
    from ...core.layout import Layout

#: The calibration's motion: least amplitude in x and y, in diameters of the beam; least distance of
#: a spot from a detector's edge, in halves of a detector; and seed. The amplitude matters because
#: only powers that change nonlinearly separate the gains and the beam's size from the apex's
#: position.
REACH_DIAMETERS, EDGE_CLEARANCE, SEED = 0.3, 0.2, 1
#: Condition at which the calibration of a head ends.
ENDING = StoppingRule(steps=25, fall=0.1)
#: 95 % of a normal distribution lie within this many standard deviations.
NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Assembly:
    """A design, the tolerances of its heads, and their calibration.

    choice: the parameters that differ from head to head or that the calibration estimates, with
    their standard uncertainties.  varies: (p,) which of them differ.  poses: (n, 6) of the
    calibration's motion, mm and rad.  reference: (6,) standard uncertainty of the reference, mm and
    rad.
    """

    sensor: Sensor
    requirement: Requirement
    choice: Choice
    varies: Booleans
    poses: Floats
    reference: Floats

    @property
    def nominal(self) -> Floats:
        """The values (ALL,) of the nominal sensor."""
        return values_of(self.sensor)

    def values(self, z: Floats) -> Floats:
        """Return all unknowns of a calibration, where the chosen parameters deviate by `z` (p,)
        standard uncertainties."""
        values = self.nominal.copy()
        values[self.choice.places] += self.choice.sigma * z
        return values

    def head(self, z: Floats) -> Sensor:
        """Return the head at `z`. Raises `InputError` if no sensor has these parameters."""
        return assign_values(self.sensor, fold_mount(self.values(z)))


@dataclass(frozen=True)
class HeadSettings:
    """Requirements on heads, and their calibration.

    layout: the volume and the limits.  rules: of the ranges, within which a calibration moves.
    calibrate: the tolerances of the heads, and the reference of their calibration.
    """

    layout: Layout
    rules: Rules
    calibrate: Calibrate

    def assembly_of(self, sensor: Sensor) -> Assembly:
        """Make the assembly of a design. Raises `InputError` if no parameter has a tolerance."""
        plain, calibrate = replace(sensor, calibration=None), self.calibrate
        unknowns = choice(plain, calibrate)
        varies = np.array([name not in MOUNTING for name in unknowns.names])
        if not varies.any():
            raise InputError(
                "calibrate.before has no tolerance of the head: all heads would be equal"
            )
        reference = np.array(calibrate.reference)
        requirement = requirement_of(plain, self.layout, calibrate.power_per_sample)
        poses = motion(plain, self.rules, self.layout.poses, reference)
        return Assembly(plain, requirement, unknowns, varies, poses, reference)


def motion(sensor: Sensor, rules: Rules, count: int, reference: Floats) -> Floats:
    """Draw poses (count, 6) within half the ranges at which the spots keep their distance from the
    edges, mm and rad."""
    reach = np.array([axis.symmetric / 2 for axis in axis_ranges(sensor, rules, np.zeros(6))])
    beam = min(sensor.beam.diameter_x, sensor.beam.diameter_y)
    reach[:2] = np.maximum(reach[:2], REACH_DIAMETERS * beam)
    fractions = np.random.default_rng(SEED).uniform(-1, 1, (200 * count, 6))
    poses = np.where(np.isfinite(reference), fractions, 0.0) * reach
    centred = replace(rules, whole_spot=False)
    distances = clearances(sensor, poses, centred)
    distances[:, 0] -= EDGE_CLEARANCE
    usable: Floats = poses[distances.min(axis=1) > 0][:count]
    if len(usable) < count:
        raise InputError(
            f"of {200 * count} random poses within the ranges only {len(usable)} keep the spots "
            f"well on the detectors, too few for a calibration of {count} poses"
        )
    return usable


def measure_rig(built: Assembly, head: Sensor, rng: np.random.Generator) -> Data:
    """Simulate a head's calibration data: noisy readings and a reference with its errors."""
    states = np.concatenate([built.poses, np.zeros((len(built.poses), 2))], axis=1)
    raw = invert_correction(head, add_noise(head, readings(head, states), rng))
    is_measured = np.isfinite(built.reference)
    errors = rng.normal(size=built.poses.shape) * np.where(is_measured, built.reference, 0.0)
    return Data(raw, built.poses + errors, built.reference, states[:, 6:])


def calibrate_head(built: Assembly, head: Sensor, rng: np.random.Generator) -> Fit:
    """Simulate the measurement of a head, and fit a sensor to it."""
    data = measure_rig(built, head, rng)
    return fit(built.sensor, data, built.choice, None, rule=ENDING)


@dataclass(frozen=True)
class SimulatedHeads:
    """The results of n simulated heads.

    within_limits: (n,) the least margin of spots, light and uncertainties.  built, calibrated: (n,)
    the least margin of accuracy as built and after a calibration; NaN without an accuracy limit or
    without a calibration.  errors: (n, 2, 6) the largest errors in the volume, likewise; um and
    urad.  unsettled: number of heads whose calibration did not converge; they count as failed.
    """

    within_limits: Floats
    built: Floats
    calibrated: Floats
    errors: Floats
    unsettled: int


@one_thread
def simulate_heads(
    built: Assembly,
    count: int,
    seed: int,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> SimulatedHeads:
    """Simulate `count` heads; the same seed gives the same heads."""
    rng = np.random.default_rng(seed)
    rows, errors, unsettled = np.full((count, 3), np.nan), np.full((count, 2, 6), np.nan), 0
    for n in range(count):
        on_progress(n, count)
        z = rng.normal(size=len(built.choice.names)) * built.varies
        try:
            head = built.head(z)
        except InputError:  # the drawn parameters give no pyramid or no beam
            rows[n] = -1.0
            continue
        rows[n, 0] = margins_of(built.requirement, head).min()
        if not built.requirement.accuracy_axes:
            continue
        errors_of_head = [errors_of(built.requirement, head, built.sensor)]
        if built.requirement.layout.calibrated:
            fitted = calibrate_head(built, head, rng)
            unsettled += not fitted.ended
            errors_of_head.append(errors_of(built.requirement, head, fitted.sensor))
        for which, each in enumerate(errors_of_head):
            rows[n, 1 + which] = accuracy_margins(built.requirement, each).min()
            errors[n, which] = np.abs(each).max(axis=0)
        if built.requirement.layout.calibrated and not fitted.ended:
            rows[n, 2] = -1.0
    return SimulatedHeads(rows[:, 0], rows[:, 1], rows[:, 2], errors, unsettled)


def count_passes(heads: SimulatedHeads) -> dict[str, int]:
    """Count the heads that meet all limits, and those that are also accurate as built, and
    calibrated."""
    within_limits = heads.within_limits >= 0
    return {
        "within_limits": int(within_limits.sum()),
        "built": int((within_limits & (heads.built >= 0)).sum()),
        "calibrated": int((within_limits & (heads.calibrated >= 0)).sum()),
    }


def interval(passed: int, count: int) -> tuple[float, float]:
    """The 95 % interval (Wilson) of a fraction of which `passed` of `count` heads are a sample."""
    fraction, z = passed / count, NORMAL_95
    scale = 2 * (count + z**2)
    middle = (2 * count * fraction + z**2) / scale
    half = z / scale * sqrt(4 * count * fraction * (1 - fraction) + z**2)
    return middle - half if passed else 0.0, middle + half if passed < count else 1.0
