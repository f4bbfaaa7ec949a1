"""The margins of one pose inside its range, for `range.js`; `characterization.ranges` has them for
arrays of poses."""

from __future__ import annotations

from math import inf
from typing import Any

from ...core.sensor import Sensor
from ...scalars.dispatch import log

#: The sense in which each end of a spot counts against its limit, as in `arrays.edge_distances`.
SENSES = (1.0, -1.0, 1.0, -1.0, -1.0)
#: Lowest light over its limit that has a logarithm.
LEAST_RATIO = 1e-300


def spot_clearance(sensor: Sensor, ends: Any, reading: Any, whole: bool) -> float:
    """The least margin of a spot, as of `ranges.spot_clearances`.

    ends: of `footprints`.  reading: (3, 3), mm and mW.  whole: whether the whole spot counts.
    """
    least = inf
    for k in range(3):
        psi, zeta, sides = reading[k][0], reading[k][1], ends[k]
        psd = sensor.psds[k]
        bare = sides[0] != sides[0] and psi == psi
        if bare or not whole:
            sides = (psi, psi, zeta, zeta, -inf if bare and whole else sides[4])
        y, z = psd.size_y / 2, psd.size_z / 2
        limits = (y, y, z, z, sensor.apertures.rim)
        for i in range(5):
            distance = limits[i] + SENSES[i] * sides[i]
            distance = distance / limits[i] if i < 4 else distance
            if distance != distance:
                return -1.0
            least = min(least, distance)
    return max(least, -1.0)


def light_clearance(reading: Any, needed: Any, other: Any) -> float:
    """The margin of light, as of `ranges.light_clearances`.

    needed: least power of each detector, background included.  other: the background's; mW.
    """
    least: float = inf
    for k in range(3):
        share = (reading[k][2] - other[k]) / (needed[k] - other[k])
        if share != share:
            least = LEAST_RATIO
            break
        least = min(least, share)
    clearance: float = log(max(least, LEAST_RATIO))
    return clearance


def fullness(sensor: Sensor, reading: Any, full: float) -> Any:
    """The largest currents of duo-lateral detectors over the end of their range, as of
    `noise.fullness`: (3,).

    reading: (3, 3), mm and mW.  full: the light whose current, all into one electrode, is at the
    end of its range; mW.
    """
    shares = [0.0, 0.0, 0.0]
    for k in range(3):
        psd = sensor.psds[k]
        y = min(abs(reading[k][0]) / (psd.size_y / 2), 1.0)
        z = min(abs(reading[k][1]) / (psd.size_z / 2), 1.0)
        shares[k] = reading[k][2] * (0.5 + max(y, z) / 2) / full
    return shares


def saturation_clearance(sensor: Sensor, reading: Any, full: float) -> float:
    """The margin of the amplifiers, as of `ranges.saturation_clearances`; as of `fullness`."""
    most: float = LEAST_RATIO
    for share in fullness(sensor, reading, full):
        if share > most:
            most = share
    clearance: float = -log(most)
    return clearance
