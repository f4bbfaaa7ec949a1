"""Many sensors that differ in their parameters, for compiled code that gives each reading its own.

The optics makes the sensors' vectors from arrays of parameters, as it makes one sensor's from
numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from ..optics.effects import LightEffects
from ..optics.forward import build_geometry
from . import packing
from .arrays import effects, group_by_field, openings, options, replace_effects, sensor_with
from .kinds import block_kind, lit_kind


class VariedSensors(NamedTuple):
    """Sensors that differ in their parameters.

    sensor: its other properties are those of all sensors.  parameters: (n, 30) in the order of
    `facets.PARAMETERS`.  effects: (n, 36) numbers of the light in the order of `EFFECTS`; None if
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
        some = None if self.effects is None else self.effects[which]
        return VariedSensors(self.sensor, self.parameters[which], some)

    def pack(self, kind: str) -> Floats:
        """The vectors of each sensor, as compiled code for this kind of light takes them."""
        light, numbers = None, self.effects
        if kind != "plain":
            if numbers is None:
                numbers = effects(self.sensor)[None]
            columns = [row[0] if (row == row[0]).all() else row for row in numbers.T]
            light = LightEffects(group_by_field(columns), options(self.sensor))
        with np.errstate(invalid="ignore", divide="ignore"):  # an impossible sensor gives no pose
            vectors = build_geometry(tuple(self.parameters.T), openings(self.sensor), light)
        return packing.pack_rows(vectors, kind, len(self.parameters))

    def one(self, row: int) -> Sensor:
        """The sensor of a row.  Raises `InputError` if it is impossible."""
        made = sensor_with(self.sensor, self.parameters[row].tolist())
        return made if self.effects is None else replace_effects(made, self.effects[row])
