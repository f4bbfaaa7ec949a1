"""The names of everything that a calibration can determine."""

from __future__ import annotations

from ..core.names import DETECTORS
from ..model.arrays import EFFECTS
from ..model.beam_shape import SHAPE
from ..optics.parameters import PARAMETERS
from .correction import NAMES

#: Errors of the model in each reading, mm and mW, which differ from place to place.
MISFIT = tuple(f"misfit_{k}.{kind}" for k in DETECTORS for kind in ("psi", "zeta", "power"))
#: Offset of the light's centre from the beam's position, mm, the same in every sample.
LIGHT_CENTRE = ("light.centre_x", "light.centre_y")
KNOWN = (*PARAMETERS, *SHAPE, *NAMES, *EFFECTS, *MISFIT, *LIGHT_CENTRE)
