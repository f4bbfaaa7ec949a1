"""Simulate a stage that follows a simulated mirror, with the controller of a real stage."""

from __future__ import annotations

import numpy as np

from ..core.sensor import Sensor
from ..core.settings import Stage as Settings
from ..core.units import Floats
from ..model.arrays import readings
from .control import ControlInput, Law
from .stage import StageModel


def simulate_following(sensor: Sensor, settings: Settings, time: Floats, truth: Floats) -> Floats:
    """True states (n, 8) at times (n,), s, with the beam carried by the stage.

    The beam begins at the apex. The stage stops while a facet has no light.
    """
    states = truth.copy()
    law, model = Law.from_sensor(sensor, settings), StageModel(settings)
    model.place = truth[0, :2].copy()
    model.target = model.place.copy()
    due = 0.0
    for n, now in enumerate((time - time[0]).tolist()):
        model.advance(now)
        states[n, 6:] = model.place
        if now >= due:
            due += 1 / settings.rate
            powers = readings(sensor, states[n])[2::3]
            if np.isfinite(powers).all() and (powers > 0).all():
                measured = ControlInput(now, now, powers, states[n, :2], model.place)
                model.command(law.command(measured))
            else:
                model.halt()
                law.forget()
    return states
