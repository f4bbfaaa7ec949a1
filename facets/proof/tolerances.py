"""Tolerances of the real sensor's parameters about its configuration, for a certificate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..calibration.table import choice
from ..core.settings import Config
from ..optics.forward import PARAMETERS


class Tolerances(NamedTuple):
    """Tolerances of a sensor's parameters.  values: (30,) in the order of `facets.PARAMETERS`; mm,
    rad, mW.  source: their origin.

    exact: names of parameters without a tolerance.  left_out: names of parameters that have an
    uncertainty but are none of the 30: the detectors' corrections, and the beam's shape if it is
    not given by two diameters.
    """

    values: tuple[float, ...]
    source: str
    exact: tuple[str, ...]
    left_out: tuple[str, ...]


def calibration_tolerances(settings: Config, factor: float) -> Tolerances:
    """Return `factor` standard uncertainties of each parameter; `factor` is the coverage factor.

    The uncertainties are those of the sensor's calibration, if it has one, else those of
    `calibrate.before`. A box of that half width contains the ellipsoid of the covariance with the
    same factor.
    """
    calibration = settings.sensor.calibration
    if calibration is None:
        sigmas, source = prior_uncertainties(settings), "calibrate.before"
    else:
        spread = np.sqrt(np.diag(np.array(calibration.covariance)))
        sigmas = dict(zip(calibration.names, spread.tolist(), strict=True))
        source = "the sensor's calibration"
    values = tuple(next_float_or_zero(factor * sigmas.get(name, 0.0)) for name in PARAMETERS)
    exact = tuple(name for name, value in zip(PARAMETERS, values, strict=True) if value == 0)
    of_sensor = [
        name for name in sigmas if name.startswith(("beam.", "facet_", "psd_", "correction_"))
    ]
    left_out = tuple(name for name in of_sensor if name not in PARAMETERS)
    return Tolerances(values, source, exact, left_out)


def prior_uncertainties(settings: Config) -> dict[str, float]:
    """Return standard uncertainties by name, from `calibrate.before`; mm, rad, mW."""
    sensor, before = settings.sensor, settings.calibrate.before
    unknowns = choice(sensor, settings.calibrate)
    sigmas = dict(zip(unknowns.names, unknowns.sigma.tolist(), strict=True))
    for name in [name for name in sigmas if name.startswith("beam.") and name not in PARAMETERS]:
        del sigmas[name]  # the diameters already describe the beam's shape
    wide = before.get("beam_diameter_percent", 0) / 100
    sigmas |= {f"beam.{name}": wide * getattr(sensor.beam, name) for name in DIAMETERS}
    sigmas["beam.power"] = before.get("laser_percent", 0) / 100 * sensor.beam.power
    return sigmas


DIAMETERS = ("diameter_x", "diameter_y")


def next_float_or_zero(value: float) -> float:
    """The next larger float of a positive value; 0 for any other value, also for NaN."""
    return float(np.nextafter(value, np.inf)) if value > 0 else 0.0
