"""Check that every sub-beam of a configured sensor hits its detector at the nominal pose.

Otherwise some key of the configuration is wrong.
"""

from __future__ import annotations

import math

import numpy as np

from ..core.names import DETECTORS
from ..core.sensor import Apertures, BenchLight, Sensor
from ..core.units import Floats
from ..model.arrays import geometry_of, half_sizes, readings as model_readings
from ..optics.forward import readings


def complaint(sensor: Sensor) -> str:
    """Describe sub-beams that miss their detectors or have no light; "" if there are none."""
    return describe_misses(sensor) or describe_dark_detectors(sensor)


def spots(sensor: Sensor) -> Floats:
    """Positions (3, 2) of the spots at the nominal pose, psi and zeta, mm; NaN for a sub-beam that
    does not reach the plane of its detector."""
    try:
        return np.array(readings(geometry_of(sensor), (0.0,) * 8), dtype=float)[:, :2]
    except ZeroDivisionError:  # A ray may be exactly parallel to a plane.
        return np.full((3, 2), np.nan)


def powers(sensor: Sensor) -> Floats:
    """Powers (3,) on the detectors at the nominal pose, mW; the beam's power if nothing cuts it."""
    if sensor.apertures == Apertures() and sensor.light == BenchLight():
        return np.full(3, sensor.beam.power)
    # A batch of one row, because commands compute batches, by other machine code than single rows.
    measured: Floats = model_readings(sensor, np.zeros((1, 8)))[0, 2::3]
    return measured


def misses(sensor: Sensor) -> Floats:
    """Distance (3,) of each spot from the middle of its detector, in half sizes: 1 or less on the
    detector; infinite for a spot that does not reach its plane."""
    distances: Floats = np.abs(spots(sensor) / half_sizes(sensor)).max(axis=1)
    return np.where(np.isnan(distances), math.inf, distances)


def worst_miss(sensor: Sensor) -> float:
    """The largest of `misses`; infinite if all spots hit their detectors but one has no light."""
    worst = float(misses(sensor).max())
    return worst if worst > 1 or (powers(sensor) > 0).all() else math.inf


def describe_misses(sensor: Sensor) -> str:
    places = []
    for k in np.flatnonzero(misses(sensor) > 1):
        psi, zeta = spots(sensor)[k].round(1) + 0.0  # Adding 0.0 avoids -0.0.
        beyond = (np.abs(spots(sensor)[k]) - half_sizes(sensor)[k]).max()
        place = (
            f"lands at psi {psi:g}, zeta {zeta:g} mm, {beyond:.1f} mm beyond the edge of its PSD"
        )
        where = "never reaches the front of its PSD" if np.isnan(psi) else place
        places.append(f"the sub-beam of facet {DETECTORS[k]} {where}")
    return f"at the nominal pose {'; '.join(places)}" if places else ""


def describe_dark_detectors(sensor: Sensor) -> str:
    letters = ", ".join(DETECTORS[k] for k in np.flatnonzero(~(powers(sensor) > 0)))
    return f"leaves no light on PSD {letters} at the nominal pose" if letters else ""
