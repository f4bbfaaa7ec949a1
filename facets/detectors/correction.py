"""What detectors read, corrected: unequal gains, and places that are not linear.

The model's readings are those of perfect detectors. What real ones read comes to it by way of
`correct`; a simulation goes the other way. Corrections are linear in their coefficients; a grid
that the maker or the user has measured comes on top.
"""

from __future__ import annotations

import numpy as np

from ..core.names import DETECTORS
from ..core.sensor import MONOMIALS, Correction, Grid, Sensor
from ..core.units import Floats
from ..model.arrays import half_sizes

#: Of one detector: what is added to the power, then the coefficients of psi and of zeta.
NAMES_OF_ONE = ("power", "dark", *(f"{axis}{a}{b}" for axis in "yz" for a, b in MONOMIALS))
#: Of all: "correction_a.power", "correction_a.y10", ...
NAMES = tuple(f"correction_{letter}.{name}" for letter in DETECTORS for name in NAMES_OF_ONE)


def is_corrected(sensor: Sensor) -> bool:
    known: bool | None = sensor.__dict__.get("_corrected")
    if known is None:
        known = any(psd.correction != Correction() for psd in sensor.psds)
        sensor.__dict__["_corrected"] = known
    return known


def coefficients(sensor: Sensor) -> Floats:
    """(60,) in the order of `NAMES`: shares, mW and mm."""
    parts = [
        (p.correction.power, p.correction.dark, *p.correction.y, *p.correction.z)
        for p in sensor.psds
    ]
    return np.array(parts).ravel()


def correction_slopes(sensor: Sensor, raw: Floats) -> Floats:
    """What each coefficient adds to raw readings (n, 9), per unit: (n, 9, 60)."""
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
    """Readings (n, 9) as perfect detectors would give them."""
    if not is_corrected(sensor):
        return raw
    with np.errstate(over="ignore", invalid="ignore"):  # a spoilt reading can be anything
        fixed: Floats = raw + correction_slopes(sensor, raw) @ coefficients(sensor)
    for k, psd in enumerate(sensor.psds):
        if psd.correction.grid is not None:
            fixed[:, 3 * k : 3 * k + 2] += interpolate_grid(
                psd.correction.grid, raw[:, 3 * k : 3 * k + 2]
            )
    return fixed


def interpolate_grid(grid: Grid, places: Floats) -> Floats:
    """What a grid adds at places (n, 2), mm; past its edge what it adds there.

    Anything finite where a place is NaN, which stays NaN when that is added to it.
    """
    from scipy.interpolate import RegularGridInterpolator

    added = np.stack([grid.add_y, grid.add_z], axis=-1)
    nearest = np.clip(np.nan_to_num(places), (grid.y[0], grid.z[0]), (grid.y[-1], grid.z[-1]))
    found: Floats = RegularGridInterpolator((grid.y, grid.z), added)(nearest)
    return found


def invert_correction(sensor: Sensor, exact: Floats) -> Floats:
    """What the detectors read (n, 9) where perfect ones would give `exact`."""
    if not is_corrected(sensor):
        return exact
    raw = exact.copy()
    for _ in range(30):  # corrections of some per cent: two digits a step
        raw -= correct(sensor, raw) - exact
    return raw
