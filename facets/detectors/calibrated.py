"""The names of everything that a calibration can determine."""

from __future__ import annotations

from ..core.names import DETECTORS
from ..model.arrays import EFFECTS
from ..model.beam_shape import SHAPE
from ..optics.forward import PARAMETERS
from .correction import NAMES

_READINGS = tuple(f"{k}.{kind}" for k in DETECTORS for kind in ("psi", "zeta", "power"))
#: Errors of the model in each reading, mm and mW, of unknown cause, whose size the residuals show.
MISFIT = tuple(f"misfit_{name}" for name in _READINGS)
#: Errors of the model itself in each reading, mm and mW, which vary slowly with the pose, so that
#: neighbouring poses share them.
MODEL_ERROR = tuple(f"model_{name}" for name in _READINGS)
#: Offset of the light's centre from the beam's position, mm, the same in every sample.
LIGHT_CENTRE = ("light.centre_x", "light.centre_y")
#: Temperature coefficients of the beam's position and of each spot's position, mm/K.
TEMPERATURE = (
    "temperature.bx",
    "temperature.by",
    *(f"temperature.{kind}_{k}" for k in DETECTORS for kind in ("psi", "zeta")),
)
KNOWN = (*PARAMETERS, *SHAPE, *NAMES, *EFFECTS, *MISFIT, *MODEL_ERROR, *LIGHT_CENTRE, *TEMPERATURE)
