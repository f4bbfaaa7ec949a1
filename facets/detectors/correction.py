"""Corrections of detectors' readings: unequal gains and non-linear positions.

The model describes perfect detectors. `correct` converts raw readings to readings of perfect
detectors; a simulation applies the inverse. A correction is a polynomial, linear in its
coefficients, plus an optional measured grid.
"""

from __future__ import annotations

import numpy as np

from ..core.names import DETECTORS
from ..core.sensor import MONOMIALS, Correction, Grid, Sensor
from ..core.units import Floats
from ..model.arrays import half_sizes

#: Names for one detector: the power's gain and offset, then the coefficients of psi and of zeta.
NAMES_OF_ONE = ("power", "dark", *(f"{axis}{a}{b}" for axis in "yz" for a, b in MONOMIALS))
#: Names for all detectors: "correction_a.power", "correction_a.y10", ...
NAMES = tuple(f"correction_{letter}.{name}" for letter in DETECTORS for name in NAMES_OF_ONE)


def is_corrected(sensor: Sensor) -> bool:
    """Whether any detector has a correction; cached per sensor."""
    corrected: bool | None = sensor.__dict__.get("_corrected")
    if corrected is None:
        corrected = any(psd.correction != Correction() for psd in sensor.psds)
        sensor.__dict__["_corrected"] = corrected
    return corrected


def coefficients(sensor: Sensor) -> Floats:
    """Coefficients of all corrections (60,) in the order of `NAMES`; gains are fractions, offsets
    in mW, terms of the positions in mm."""
    parts = [
        (p.correction.power, p.correction.dark, *p.correction.y, *p.correction.z)
        for p in sensor.psds
    ]
    return np.array(parts).ravel()


def correction_slopes(sensor: Sensor, raw: Floats) -> Floats:
    """Derivatives (n, 9, 60) of the corrections of raw readings (n, 9) by each coefficient."""
    out = np.zeros((len(raw), 9, len(NAMES)))
    count = len(MONOMIALS)
    for k, half in enumerate(half_sizes(sensor)):
        y, z = raw[:, 3 * k] / half[0], raw[:, 3 * k + 1] / half[1]
        powers = np.stack([y**a * z**b for a, b in MONOMIALS], axis=1)
        first = k * len(NAMES_OF_ONE)
        out[:, 3 * k + 2, first] = raw[:, 3 * k + 2]
        out[:, 3 * k + 2, first + 1] = 1.0
        out[:, 3 * k, first + 2 : first + 2 + count] = powers
        out[:, 3 * k + 1, first + 2 + count : first + 2 + 2 * count] = powers
    return out


def correct(sensor: Sensor, raw: Floats) -> Floats:
    """Convert raw readings (n, 9) to readings of perfect detectors."""
    if not is_corrected(sensor):
        return raw
    with np.errstate(over="ignore", invalid="ignore"):  # A corrupted reading can be any number.
        fixed: Floats = raw + correction_slopes(sensor, raw) @ coefficients(sensor)
    for k, psd in enumerate(sensor.psds):
        if psd.correction.grid is not None:
            fixed[:, 3 * k : 3 * k + 2] += interpolate_grid(
                psd.correction.grid, raw[:, 3 * k : 3 * k + 2]
            )
    return fixed


def interpolate_grid(grid: Grid, places: Floats) -> Floats:
    """Interpolate a grid's corrections (n, 2) at positions (n, 2), mm.

    Beyond the grid, the correction at its nearest edge holds. At a position with NaN the correction
    is finite, so that the sum of both remains NaN.
    """
    from scipy.interpolate import RegularGridInterpolator

    grid_values = np.stack([grid.add_y, grid.add_z], axis=-1)
    nearest = np.clip(np.nan_to_num(places), (grid.y[0], grid.z[0]), (grid.y[-1], grid.z[-1]))
    corrections: Floats = RegularGridInterpolator((grid.y, grid.z), grid_values)(nearest)
    return corrections


def invert_correction(sensor: Sensor, exact: Floats) -> Floats:
    """Raw readings (n, 9) that `correct` converts to the readings `exact`."""
    if not is_corrected(sensor):
        return exact
    raw = exact.copy()
    for _ in range(30):  # Corrections are a few per cent: each iteration gains two digits.
        raw -= correct(sensor, raw) - exact
    return raw
