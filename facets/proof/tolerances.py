"""By how much the sensor on the bench may be off its configuration, for a certificate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..calibration.table import choice
from ..core.settings import Config
from ..optics.parameters import PARAMETERS


class Tolerances(NamedTuple):
    """values: (30,) in the order of `facets.PARAMETERS`; mm, rad, mW.  source: where from.

    exact: names of parameters that are taken as they are.
    """

    values: tuple[float, ...]
    source: str
    exact: tuple[str, ...]


def tolerances_of(settings: Config, factor: float) -> Tolerances:
    """`factor` standard uncertainties of each parameter: the coverage factor.

    Those of the sensor's calibration, if it has one, else those of `calibrate.before`. A box of
    that half width holds the ellipsoid of the covariance with the same factor. The detectors' own
    corrections are not among the 30 parameters: where spots lie is taken to be known.
    """
    sigmas, source = standard_uncertainties(settings)
    values = tuple(float(np.nextafter(factor * sigmas.get(name, 0.0), np.inf)) if sigmas.get(name)
                   else 0.0 for name in PARAMETERS)  # fmt: skip
    exact = tuple(name for name, value in zip(PARAMETERS, values, strict=True) if value == 0)
    return Tolerances(values, source, exact)


def standard_uncertainties(settings: Config) -> tuple[dict[str, float], str]:
    """Of parameters by name; mm, rad, mW. And the words for where they come from."""
    known = settings.sensor.calibration
    if known is not None:
        sigmas = np.sqrt(np.diag(np.array(known.covariance)))
        return dict(zip(known.names, sigmas.tolist(), strict=True)), "the sensor's calibration"
    found = choice(settings.sensor, settings.calibrate.before)
    return dict(zip(found.names, found.sigma.tolist(), strict=True)), "calibrate.before"
