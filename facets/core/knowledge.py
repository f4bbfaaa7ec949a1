"""What is known of the beam before a reading is solved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .arguments import as_floats, checked
from .errors import InputError


@checked
@dataclass(frozen=True)
class Prior:
    """What is known before the reading: a Gaussian of the given mean and standard deviation.

    For the beam, mean (..., 2) and sigma (a number or one each) of bx, by in mm; for the power,
    mean and sigma in mW. sigma 0: known exactly; infinite: not known at all.
    """

    mean: ArrayLike
    sigma: ArrayLike

    def __post_init__(self) -> None:
        if not (as_floats(self.sigma, "a prior's sigma") >= 0).all():
            raise InputError(f"a prior's sigma is {self.sigma!r}; allowed: 0 or more")
        if not np.isfinite(as_floats(self.mean, "a prior's mean")).all():
            raise InputError(f"a prior's mean is {self.mean!r}; allowed: finite numbers")
