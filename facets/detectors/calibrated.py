"""The names of all that a calibration can say something about."""

from __future__ import annotations

from ..core.names import DETECTORS
from ..model.arrays import EFFECTS
from ..model.beam_shape import SHAPE
from ..optics.parameters import PARAMETERS
from .correction import NAMES

#: What the model is found to miss in each reading, mm and mW, other in every place.
MISFIT = tuple(f"misfit_{k}.{kind}" for k in DETECTORS for kind in ("psi", "zeta", "power"))
#: Where the middle of the light is beside the beam's position, mm, the same in every sample.
LIGHT_CENTRE = ("light.centre_x", "light.centre_y")
KNOWN = (*PARAMETERS, *SHAPE, *NAMES, *EFFECTS, *MISFIT, *LIGHT_CENTRE)
