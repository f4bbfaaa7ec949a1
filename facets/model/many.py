"""Many sensors that differ in their parameters, for compiled code in one call.

The optics makes the sensors' vectors from arrays of parameters, by the formulas for one sensor.
`evaluate` computes the model of each sensor at its own states, for ideal, uncut light, with the
same bits as `arrays`. The solver takes `VariedSensors`, one for each reading.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats, Integers
from ..optics.effects import LightEffects
from ..optics.forward import build_geometry
from . import packing
from .arrays import effects, group_by_field, openings, options, replace_effects, sensor_with
from .blocks import SHAPES, address_of, kernel, lanes
from .kinds import block_kind, lit_kind


def vectors_of(parameters: Floats) -> Floats:
    """`packing.pack` of each row of 30 parameters: (n, m)."""
    return packing.pack_rows(build_geometry(tuple(parameters.T)), len(parameters))


def evaluate(name: str, vectors: Floats, owner: Integers, states: Floats) -> Floats:
    """Compute readings, derivatives or footprints (k, ...) of sensors at states (k, 8).

    name: of `blocks.SHAPES`.  vectors (n, m): from `vectors_of`.  owner (k,): the row of the sensor
    that a state belongs to, in ascending order.
    """
    width, code = lanes(), kernel(name)
    counts = np.bincount(owner, minlength=len(vectors))
    some = np.flatnonzero(counts)
    begins, blocks = (np.cumsum(counts) - counts)[some], -(-counts[some] // width)
    # The last block of a sensor reaches into the next one's states, whose own block overwrites
    # them.
    rows = np.concatenate([states, np.zeros((width, 8))])
    results = np.empty((len(rows), *SHAPES[name]))
    for arguments in zip(
        (address_of(vectors) + vectors.strides[0] * some).tolist(),
        (address_of(rows) + rows.strides[0] * begins).tolist(),
        (address_of(results) + results.strides[0] * begins).tolist(),
        blocks.tolist(),
        strict=True,
    ):
        code(*arguments)
    return results[: len(states)]


class VariedSensors(NamedTuple):
    """Sensors that differ in their parameters.

    sensor: its other properties are those of all sensors.  parameters: (n, 30) in the order of
    `facets.PARAMETERS`.  effects: (n, 81) numbers of the light in the order of `EFFECTS`; None if
    all have the light of `sensor`.
    """

    sensor: Sensor
    parameters: Floats
    effects: Floats | None

    @property
    def kind(self) -> str | None:
        """The kind of light of the formulas for blocks; None where blocks do not support it."""
        if self.effects is None or self.sensor.apertures.cut:
            return block_kind(self.sensor)
        return lit_kind(self.sensor)

    def rows(self, which: slice | Floats) -> VariedSensors:
        """The sensors of some rows, which a slice or an index selects."""
        some = None if self.effects is None else self.effects[which]
        return VariedSensors(self.sensor, self.parameters[which], some)

    def pack(self, kind: str) -> Floats:
        """The vectors of each sensor, (sensors, numbers), as compiled code for this kind of light
        takes them."""
        light, numbers = None, self.effects
        if kind != "plain":
            if numbers is None:
                numbers = effects(self.sensor)[None]
            columns = [row[0] if (row == row[0]).all() else row for row in numbers.T]
            light = LightEffects(group_by_field(columns), options(self.sensor))
        with np.errstate(invalid="ignore", divide="ignore"):  # an impossible sensor gives no pose
            vectors = build_geometry(tuple(self.parameters.T), openings(self.sensor), light)
        return packing.pack_rows(vectors, len(self.parameters), packing.row_size(kind))

    def one(self, row: int) -> Sensor:
        """The sensor of a row.  Raises `InputError` if it is impossible."""
        made = sensor_with(self.sensor, self.parameters[row].tolist())
        return made if self.effects is None else replace_effects(made, self.effects[row])
