"""Prior knowledge of the beam's position and power."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .arguments import as_floats, check_arguments, labels_of
from .errors import InputError


@check_arguments
@dataclass(frozen=True)
class Prior:
    """Gaussian prior of a quantity: its mean and standard uncertainty.

    For the beam's position: mean (..., 2) and sigma, a number or (2,), of bx and by, mm; for its
    power: mean and sigma, mW. A sigma of 0 means known exactly, infinite means unknown.

    >>> import facets
    >>> facets.Prior(mean=(0.0, 0.1), sigma=0.005)  # the beam at y = 0.1 mm, within 5 um
    Prior(mean=(0, 0.1), sigma=0.005)
    """

    mean: ArrayLike
    sigma: ArrayLike

    def __post_init__(self) -> None:
        for name in ("mean", "sigma"):
            value = getattr(self, name)
            numbers = as_floats(value, f"a prior's {name}", 2)
            if labels_of(value):
                object.__setattr__(self, name, numbers)
            if name == "sigma" and not (numbers >= 0).all():
                raise InputError(f"a prior's sigma is {value!r}; allowed: 0 or more")
            if name == "mean" and not np.isfinite(numbers).all():
                raise InputError(f"a prior's mean is {value!r}; allowed: finite numbers")


#: The forms of the arguments `beam` and `power` of public functions.
BeamKnowledge = Literal["free", "known"] | Prior
PowerKnowledge = Literal["known", "unknown"] | Prior
#: Standard uncertainties that the words represent.
SIGMAS = {"known": 0.0, "free": np.inf, "unknown": np.inf}


@check_arguments
@dataclass(frozen=True)
class Knowledge:
    """Prior knowledge of the beam, in the words of `facets.solve`.

    beam: its position is "free" (solved for), "known" to be (0, 0), or has a `Prior` in mm.
    power: "known" as the sensor's, "unknown" (solved for), or a `Prior` in mW.

    >>> import facets
    >>> facets.Knowledge(beam="known").beam_prior
    Prior(mean=(0, 0), sigma=0)
    """

    beam: BeamKnowledge = "free"
    power: PowerKnowledge = "known"

    @property
    def beam_sigma(self) -> ArrayLike:
        """The standard uncertainty of the position, mm; 0 if known exactly, infinite if free."""
        return self.beam.sigma if isinstance(self.beam, Prior) else SIGMAS[self.beam]

    @property
    def power_sigma(self) -> ArrayLike:
        """The standard uncertainty of the power, mW; 0 if known exactly, infinite if unknown."""
        return self.power.sigma if isinstance(self.power, Prior) else SIGMAS[self.power]

    @property
    def beam_prior(self) -> Prior:
        """The beam's position as a prior, mm; a word is a prior with sigma 0 or infinite."""
        return self.beam if isinstance(self.beam, Prior) else Prior((0.0, 0.0), self.beam_sigma)

    def power_prior(self, power: float) -> Prior:
        """The beam's power as a prior, mW.  power: of the sensor's beam, mW."""
        return self.power if isinstance(self.power, Prior) else Prior(power, self.power_sigma)


class Question(NamedTuple):
    """Settings of one solve: prior knowledge of beam and power, and the method; see
    `facets.solve`."""

    beam: BeamKnowledge = "free"
    power: PowerKnowledge = "known"
    method: Literal["least-squares", "paper"] = "least-squares"
    max_steps: int = 50
    covariance: bool = True
    accept_unchecked: bool = False

    @property
    def knowledge(self) -> Knowledge:
        """Prior knowledge of the beam."""
        return Knowledge(self.beam, self.power)

    def rows(self, which: Any) -> Question:
        """Return the settings for some of the readings, with their rows of the priors' means."""
        beam, power = self.beam, self.power
        if isinstance(beam, Prior) and np.ndim(beam.mean) > 1:
            beam = Prior(np.asarray(beam.mean)[which], beam.sigma)
        if isinstance(power, Prior) and np.ndim(power.mean) > 0:
            power = Prior(np.asarray(power.mean)[which], power.sigma)
        return self._replace(beam=beam, power=power)
