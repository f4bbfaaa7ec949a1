"""Measures of many plain sensors at once, equal to those of `space.measure_design`.

A design is a row with its sensor's 30 parameters and its detectors' sizes; the model evaluates all
designs in one call (`model.many`). The ranges follow from the same search as those of one sensor in
`characterization.ranges`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...characterization.ranges import (
    AXIS_RAYS,
    CAUSES,
    COARSE,
    FARTHEST_MM_RAD,
    LIGHT,
    PSD,
    SATURATED,
    SINGULAR,
    fine_slopes,
    first_exits,
    least_of_rows,
    light_clearances,
    spot_clearances,
    standard_uncertainties,
    states_of as states_of_poses,
)
from ...characterization.singularity import extremes
from ...core.names import FINE_UNITS, STATE_UNITS
from ...core.rules import Rules
from ...core.sensor import Sensor
from ...core.units import Booleans, Floats, Integers
from ...detectors.noise import standard_deviations
from ...model.arrays import edge_distances, edge_limits
from ...model.kinds import kind_of
from ...model.many import evaluate, vectors_of
from ..variables import FACETS, PSDS, layout_parameters

#: Reasons to skip a design; "" for a design that is measured.
SKIPPED = (
    "",
    "spot beside the PSD at rest",
    "too little light at rest",
    "no sensor",
    "not what is required over the volume",
    "Jacobian near singular at rest",
    "too coarse at rest",
    "amplifier past its full scale at rest",
)
OFF_DETECTOR, DIM, INVALID, UNFIT, NEAR_SINGULAR, TOO_COARSE, OVERLOADED = range(1, 8)
#: Reason to skip a design that is outside its own range at rest, by the limit that it violates.
OUTSIDE = {PSD: OFF_DETECTOR, LIGHT: DIM, SATURATED: OVERLOADED, SINGULAR: NEAR_SINGULAR,
           COARSE: TOO_COARSE}  # fmt: skip
#: Factors from mm and rad to mm and mrad, by axis of the pose.
FAR = 1 / np.array(STATE_UNITS[:6])
#: Number of designs that are measured at a time, so that their states fit into the processor's
#: cache.
CHUNK = 50
#: Once glibc has freed a block of this size, it keeps smaller freed blocks for the next use. If it
#: returned them to the system, mapping each chunk's memory again would take a third of the time.
KEPT_BYTES = 3 * 2**23


class Designs(NamedTuple):
    """n plain sensors.

    vectors: (n, m) from `many.vectors_of`.  limits: (n, 3, 5) from `arrays.edge_limits`, mm.
    sensor, rules: the noise and the least light, which are common to all designs.
    """

    vectors: Floats
    limits: Floats
    sensor: Sensor
    rules: Rules

    def subset(self, which: Any) -> Designs:
        """Some of the designs."""
        return self._replace(vectors=self.vectors[which], limits=self.limits[which])

    def evaluate_rest(self, name: str) -> Floats:
        """Compute each design's readings, derivatives or footprints at rest, (designs, ...)."""
        owner = np.arange(len(self.vectors))
        return evaluate(name, self.vectors, owner, np.zeros((len(owner), 8)))

    def margins(self, owner: Integers, poses: Floats) -> Floats:
        """The margins (k, 5) of `ranges.clearances` of the designs `owner` (k,), ascending, at
        poses (k, 6).

        Limits that need electronics or derivatives are infinite, see `is_plain`.
        """
        states = states_of_poses(poses, self.rules)
        reading = evaluate("readings", self.vectors, owner, states)
        ends = evaluate("footprints", self.vectors, owner, states)
        out = np.full((len(poses), len(CAUSES)), np.inf)
        out[:, PSD] = spot_clearances(ends, reading, self.limits[owner], self.rules)
        out[:, LIGHT] = light_clearances(self.sensor, reading, self.rules)
        return out


def is_plain(sensor: Sensor, rules: Rules) -> bool:
    """Whether a sensor's ranges and uncertainties depend only on the data in `Designs`."""
    return (
        kind_of(sensor) == "plain"
        and sensor.electronics is None
        and sensor.calibration is None
        and rules.whole_spot
        and not np.isfinite(rules.coarsest).any()
    )


def designs_of(
    sensor: Sensor, rules: Rules, names: Sequence[str], rows: Floats
) -> tuple[Designs, Floats, Booleans]:
    """Make designs from the valid rows of the named variables' values (n, variables); also return
    the heads' diameters (n,), mm, and whether each row is valid (n,)."""
    count = len(rows)
    p, sizes = layout_parameters(sensor, names, list(rows.T))
    values = np.stack([np.broadcast_to(np.asarray(v, dtype=float), count) for v in p], axis=1)
    halves = np.tile(np.array([[psd.size_y, psd.size_z] for psd in sensor.psds]) / 2, (count, 1, 1))
    if "size_mm" in names:
        halves[:] = np.stack([np.asarray(size) / 2 for size in sizes], axis=1)[:, :, None]
    possible = is_sensor(values) & (halves > 0).all(axis=(1, 2))
    designs = Designs(
        vectors_of(values[possible]), edge_limits(halves[possible], np.inf), sensor, rules
    )
    return designs, 2 * values[:, list(PSDS)].max(axis=1), possible


def is_sensor(p: Floats) -> Booleans:
    """Whether each row of 30 parameters (n, 30) makes a valid sensor, by the rules of
    `core.sensor`."""
    tilts = p[:, list(FACETS)]
    turns = p[:, [k + 1 for k in FACETS]]
    gaps = (np.roll(turns, -1, axis=1) - turns) % (2 * np.pi)
    fine = np.isfinite(p).all(axis=1) & (p[:, :3] > 0).all(axis=1)
    fine &= ((tilts > 0) & (tilts < np.pi / 2) & (gaps > 0) & (gaps < np.pi)).all(axis=1)
    is_valid: Booleans = np.asarray(fine & (p[:, list(PSDS)] > 0).all(axis=1))
    return is_valid


def rest_reasons(distances: Floats, reading: Floats, least_power: float) -> Integers:
    """Numbers (n,) in SKIPPED for designs at rest: 1 if a spot is not completely on its detector, 2
    if a power does not exceed `least_power`, else 0.

    distances: (n, 3, 5) of the spots from their limits, see `margins`.  reading: (n, 9).
    """
    is_off_detector = ~(least_of_rows(distances) > 0)
    is_dim = ~(least_of_rows(reading[:, 2::3]) > least_power)
    return np.where(is_off_detector, OFF_DETECTOR, np.where(is_dim, DIM, 0))


def spectra(some: Designs, reading: Floats) -> tuple[Floats, Floats]:
    """Standard uncertainties of the pose (n, 6), um and urad, and the Jacobian's condition number
    (n,), at rest."""
    sigma = standard_deviations(some.sensor, reading)
    matrices = some.evaluate_rest("derivatives") * FINE_UNITS / sigma[:, :, None]
    slopes = fine_slopes(np.zeros((1, 8)), some.rules.object)
    return standard_uncertainties(matrices, slopes), extremes(matrices)[:, 1]


def symmetric_ranges(some: Designs, tolerance: float) -> Floats:
    """The symmetric range of each axis (n, 6), mm and mrad: twice the distance of the nearer end.

    tolerance: in units of `FARTHEST_MM_RAD`.
    """

    def margins_at(distance: Floats, ray: Integers) -> Floats:
        """The margins (n, ...) at distances (n,) along the rays of these numbers."""
        owner, way = np.divmod(ray, len(AXIS_RAYS))
        return some.margins(owner, distance[:, None] * AXIS_RAYS[way])

    exits = first_exits(margins_at, len(some.vectors) * len(AXIS_RAYS), tolerance)
    ends = exits.distance.reshape(-1, 2, 6).min(axis=1)
    ranges: Floats = 2 * ends * FARTHEST_MM_RAD * FAR
    return ranges


def measure_plain(
    sensor: Sensor, rules: Rules, names: Sequence[str], rows: Floats, least_power: float,
    tolerance: float,
) -> tuple[Booleans, Integers, Floats]:  # fmt: skip
    """Measure designs (n, variables) of a plain sensor; return whether each is a valid sensor (n,),
    its number in SKIPPED (n,), and its measures (n, 14), the head's diameter first."""
    np.empty(KEPT_BYTES, dtype=np.uint8)
    some, heads, possible = designs_of(sensor, rules, names, rows)
    reasons, values = np.zeros(len(rows), dtype=np.int64), np.full((len(rows), 14), np.nan)
    values[possible, 0] = heads[possible]
    numbers = np.flatnonzero(possible)
    for first in range(0, len(numbers), CHUNK):
        part = slice(first, first + CHUNK)
        measured = measure(some.subset(part), least_power, tolerance)
        reasons[numbers[part]], values[numbers[part], 1:] = measured
    return possible, reasons, values


def measure(some: Designs, least_power: float, tolerance: float) -> tuple[Integers, Floats]:
    """Measure designs; return their numbers in SKIPPED (n,) and their measures (n, 13): ranges, mm
    and mrad, uncertainties, um and urad, and the condition number.

    Measures of a skipped design that were not computed are NaN.
    """
    reading = some.evaluate_rest("readings")
    distances = edge_distances(some.evaluate_rest("footprints"), some.limits)
    reasons = rest_reasons(distances, reading, least_power)
    values = np.full((len(reasons), 13), np.nan)
    passing = np.flatnonzero(reasons == 0)
    if not len(passing):
        return reasons, values
    part = some.subset(passing)
    values[passing, 6:12], values[passing, 12] = spectra(part, reading[passing])
    clear = part.margins(np.arange(len(passing)), np.zeros((len(passing), 6)))
    outside = ~(clear.min(axis=1) > 0)
    reasons[passing[outside]] = np.array([OUTSIDE[cause] for cause in range(len(CAUSES))])[
        clear[outside].argmin(axis=1)
    ]
    if not outside.all():
        values[passing[~outside], :6] = symmetric_ranges(part.subset(~outside), tolerance)
    return reasons, values
