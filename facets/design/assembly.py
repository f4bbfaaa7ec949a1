"""Heads with manufacturing and assembly errors, whose tolerances `calibrate.before` states.

Each head's parameters are drawn about those of the design, normally and independently, with the
standard uncertainties that a calibration takes as its prior: one statement of the tolerances serves
both. Where the mirror sits on the reference belongs to the calibration's rig, not to a head, and
only the calibration estimates it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..calibration.fitting.bundle_adjustment import Data
from ..calibration.fitting.fit import Fit, StoppingRule, fit
from ..calibration.fitting.unknowns import MOUNTING, Choice, assign_values, fold_mount, values_of
from ..calibration.table import choice
from ..characterization.ranges import axis_ranges, clearances
from ..core.errors import InputError
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Booleans, Floats
from ..detectors.correction import invert_correction
from ..detectors.noise import add_noise
from ..model.arrays import readings
from .requirement import Requirement, requirement_of

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate
    from ..core.layout import Layout

#: The motion's amplitude in x and y over the beam's diameter, since only powers that change
#: nonlinearly separate the gains and the beam's size from the apex's place; its clearance from a
#: detector's edge over half a detector; and its seed.
REACH_DIAMETERS, EDGE_CLEARANCE, SEED = 0.3, 0.2, 1
#: When the calibration of a head ends.
ENDING = StoppingRule(steps=25, fall=0.1)


@dataclass(frozen=True)
class Assembly:
    """A design, the tolerances of its heads, and their calibration.

    choice: the parameters that differ from head to head or that the calibration estimates, with
    their standard uncertainties.  loose: which of them differ.  poses: (n, 6) of the calibration's
    motion.  reference: (6,) its standard uncertainty, mm and rad.
    """

    sensor: Sensor
    asked: Requirement
    choice: Choice
    loose: Booleans
    poses: Floats
    reference: Floats

    @property
    def nominal(self) -> Floats:
        return values_of(self.sensor)

    def values(self, z: Floats) -> Floats:
        """Return all unknowns of a calibration, at `z` (p,) standard uncertainties of the
        choice."""
        values = self.nominal.copy()
        values[self.choice.places] += self.choice.sigma * z
        return values

    def head(self, z: Floats) -> Sensor:
        """Return the head at `z`. Raises `InputError` if no sensor has these parameters."""
        return assign_values(self.sensor, fold_mount(self.values(z)))


def assembly_of(sensor: Sensor, layout: Layout, rules: Rules, known: Calibrate) -> Assembly:
    """Make the assembly of a design. Raises `InputError` if no parameter has a tolerance."""
    plain = replace(sensor, calibration=None)
    unknowns = choice(plain, known)
    loose = np.array([name not in MOUNTING for name in unknowns.names])
    if not loose.any():
        raise InputError(
            "calibrate.before states no tolerance of the head: every head would be the same"
        )
    reference = np.array(known.reference)
    asked = requirement_of(plain, layout, known.power_per_sample)
    return Assembly(
        plain, asked, unknowns, loose, motion(plain, rules, layout.poses, reference), reference
    )


def motion(sensor: Sensor, rules: Rules, count: int, reference: Floats) -> Floats:
    """Draw poses (count, 6) within half the ranges, with spots clear of the edges, mm and rad."""
    reach = np.array([axis.symmetric / 2 for axis in axis_ranges(sensor, rules, np.zeros(6))])
    beam = min(sensor.beam.diameter_x, sensor.beam.diameter_y)
    reach[:2] = np.maximum(reach[:2], REACH_DIAMETERS * beam)
    shares = np.random.default_rng(SEED).uniform(-1, 1, (200 * count, 6))
    poses = np.where(np.isfinite(reference), shares, 0.0) * reach
    centred = replace(rules, whole_spot=False)
    room = clearances(sensor, poses, centred)
    room[:, 0] -= EDGE_CLEARANCE
    possible: Floats = poses[room.min(axis=1) > 0][:count]
    if len(possible) < count:
        raise InputError(
            f"of {200 * count} random poses within the ranges only {len(possible)} keep the spots "
            f"well on the detectors, too few for a calibration of {count} poses"
        )
    return possible


def measure_rig(built: Assembly, head: Sensor, rng: np.random.Generator) -> Data:
    """Simulate a head's calibration data: noisy readings and a reference with its errors."""
    states = np.concatenate([built.poses, np.zeros((len(built.poses), 2))], axis=1)
    raw = invert_correction(head, add_noise(head, readings(head, states), rng))
    told = np.isfinite(built.reference)
    errors = rng.normal(size=built.poses.shape) * np.where(told, built.reference, 0.0)
    return Data(raw, built.poses + errors, built.reference, states[:, 6:])


def calibrate_head(built: Assembly, head: Sensor, rng: np.random.Generator) -> Fit:
    data = measure_rig(built, head, rng)
    return fit(built.sensor, data, built.choice, None, rule=ENDING)
