"""The names of everything that a calibration can determine."""

from __future__ import annotations

from ..core.names import DETECTORS
from ..model.arrays import EFFECTS
from ..model.beam_shape import SHAPE
from ..optics.forward import PARAMETERS
from .correction import NAMES

_READINGS = tuple(f"{k}.{kind}" for k in DETECTORS for kind in ("psi", "zeta", "power"))
#: Errors of the model that the residuals show in each reading, mm and mW: their cause is unknown.
MISFIT = tuple(f"misfit_{name}" for name in _READINGS)
#: How exact the model itself is in each reading, mm and mW: its errors differ from place to place,
#: but hardly between places that are near each other.
MODEL_ERROR = tuple(f"model_{name}" for name in _READINGS)
#: Offset of the light's centre from the beam's position, mm, the same in every sample.
LIGHT_CENTRE = ("light.centre_x", "light.centre_y")
#: What the temperature adds, mm/K: to the beam's position, and to each place.
TEMPERATURE = (
    "temperature.bx",
    "temperature.by",
    *(f"temperature.{kind}_{k}" for k in DETECTORS for kind in ("psi", "zeta")),
)
KNOWN = (*PARAMETERS, *SHAPE, *NAMES, *EFFECTS, *MISFIT, *MODEL_ERROR, *LIGHT_CENTRE, *TEMPERATURE)
