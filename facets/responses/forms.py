"""The forms of a frequency response, by the names of ISO 7626-1.

The receptance H is the displacement over the force. The mobility and the accelerance are the
velocity and the acceleration over the force,

    (2 pi i f)^k H,   k = 1, 2.

The inverses of these three are the dynamic stiffness, the mechanical impedance and the apparent
mass of a point that is free to move in all directions in which no force acts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core import ANGLES, KEY_UNITS, Complexes, Floats, write_micro

#: Units of a displacement, a velocity and an acceleration, each for translations and rotations.
MOTION_UNITS = (("um", "urad"), ("mm_s", "mrad_s"), ("m_s2", "rad_s2"))


class ResponseForm(NamedTuple):
    """A form of a response.  order: of the displacement's time derivative, 0 to 2.  is_inverse:
    whether it is the input over the motion."""

    order: int = 0
    is_inverse: bool = False

    def convert(self, frequency: Floats, receptance: Complexes) -> Complexes:
        """Convert receptances (m, d) at frequencies (m,), Hz, to this form; NaN for the inverse of
        zero."""
        motion = (2j * np.pi * frequency[:, None]) ** self.order * receptance
        if not self.is_inverse:
            return motion
        return np.asarray(1 / np.where(motion == 0, np.nan, motion))

    def unit_of(self, axis: str) -> str:
        """The unit of an axis's motion, or "per_" and that unit, as in the name of a column."""
        unit = MOTION_UNITS[self.order][axis in ANGLES]
        return f"per_{unit}" if self.is_inverse else unit

    def factor(self, axis: str) -> float:
        """Factor from mm or rad (per s, s^2), or from their inverses, to `unit_of` the axis."""
        return KEY_UNITS[self.unit_of(axis)].to_key(1.0)

    def unit_text(self, axis: str, unit: str) -> str:
        """The unit of an axis's response to an input in `unit`, for people: "µm per N"."""
        motion = write_micro(MOTION_UNITS[self.order][axis in ANGLES])
        motion = motion.replace("_s2", "/s²").replace("_s", "/s")
        if self.is_inverse:
            return f"{unit} per {motion}".strip()
        return f"{motion} per {unit}" if unit else motion


FORMS = {
    "receptance": ResponseForm(),
    "mobility": ResponseForm(1),
    "accelerance": ResponseForm(2),
    "dynamic-stiffness": ResponseForm(0, True),
    "mechanical-impedance": ResponseForm(1, True),
    "apparent-mass": ResponseForm(2, True),
}
RECEPTANCE = FORMS["receptance"]
