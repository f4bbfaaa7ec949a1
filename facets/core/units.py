"""Types of arrays, units with their factors to the code's units, and the spelling of units.

The code works in mm, rad, mW and s. Output has positions in mm and mrad, and errors in µm and µrad.
The micro sign is µ in text, and u in names that must be ASCII: columns of tables and keys of a
configuration.
"""

from __future__ import annotations

from collections.abc import Callable
from math import degrees, floor, log10, pi, radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .names import ANGLES, FINE_UNITS, STATE_UNITS

__all__ = ["FINE_UNITS", "STATE_UNITS"]

#: Types of arrays. Docstrings state the shapes; components are last.
Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Rows = NDArray[np.void]
Booleans = NDArray[np.bool_]
Complexes = NDArray[np.complex128]

MICRO = "µ"
#: Factors from the code's units (mm, rad, mW) to µm, mrad, µrad and µW.
UM, MRAD, URAD, UW = 1e3, 1e3, 1e6, 1e3


class AxisUnit(NamedTuple):
    """Output units of an axis: unit of its positions with the factor from the code's unit, and unit
    of its errors with this factor."""

    unit: str
    factor: float
    fine_unit: str
    fine_factor: float


LENGTH = AxisUnit("mm", 1.0, f"{MICRO}m", UM)
ANGLE = AxisUnit("mrad", MRAD, f"{MICRO}rad", URAD)


def unit_of(name: str) -> AxisUnit:
    """Return the output units of a component of the state: `unit_of("yaw").unit` is "mrad"."""
    return ANGLE if name in ANGLES else LENGTH


def write_micro(unit: str) -> str:
    """Write the unit of a column or a key for people: "µm" for "um"."""
    return MICRO + unit[1:] if unit in ("um", "urad", "uw", "uW") else unit


def ascii_unit(text: str) -> str:
    """Write text for a table's column or cell: "um" for "µm"."""
    return text.replace(MICRO, "u")


def round_to(value: float, uncertainty: float) -> str:
    """A value to the place of the second digit of its uncertainty, without decimals if it is 10 or
    more; to six digits if there is none."""
    if not uncertainty > 0:
        return f"{value:.6g}"
    return f"{value:z.{max(0, 1 - floor(log10(uncertainty)))}f}"


class KeyUnit(NamedTuple):
    """A unit at the end of configuration keys' names.

    label: usual spelling.  to_code: converts from this unit to the code's (mm, rad, mW, s, V, A,
    ohm, Hz, K, N).  to_key: converts back.
    """

    label: str
    to_code: Callable[[float], float] = float
    to_key: Callable[[float], float] = float


def _divide(label: str, per: float) -> KeyUnit:
    return KeyUnit(label, lambda value: value / per, lambda value: value * per)


def _multiply(label: str, factor: float, back: float) -> KeyUnit:
    return KeyUnit(label, lambda value: factor * value, lambda value: back * value)


def _invert(label: str) -> str:
    """The inverse of a unit: "1/um", "1/(m/s^2)"."""
    return f"1/({label})" if "/" in label else f"1/{label}"


#: Units of configuration keys, by the endings of names. Whether a factor divides or multiplies
#: affects the last bit; it must not change, so that a file defines the same sensor in all versions.
KEY_UNITS = {
    "mm": KeyUnit("mm"),
    "um": _divide("um", UM),
    "nm": _multiply("nm", 1e-6, 1e6),
    "um2": _multiply("um^2", 1e-6, 1e6),
    "um_per_k": _divide("um/K", UM),
    "c": KeyUnit("degC"),
    "per_m": _divide("1/m", 1e3),
    "deg": _divide("deg", 180 / pi),
    "deg_of_phase": KeyUnit("deg", radians, degrees),  # of motions and of polarised light
    "mrad": _divide("mrad", MRAD),
    "urad": _multiply("urad", 1e-6, URAD),
    "mw": KeyUnit("mW"),
    "uw": _divide("uW", UW),
    "percent": _divide("%", 100.0),
    "ppm": _multiply("ppm", 1e-6, 1e6),
    "s": KeyUnit("s"),
    "ms": _divide("ms", 1e3),
    "us": _multiply("us", 1e-6, 1e6),
    "hz": KeyUnit("Hz"),
    "mm_s": KeyUnit("mm/s"),
    "m_s": _divide("m/s", 1e-3),
    "mm_s2": KeyUnit("mm/s^2"),
    "m_s2": _divide("m/s^2", 1e-3),
    "mrad_s": _divide("mrad/s", MRAD),
    "rad_s": KeyUnit("rad/s"),
    "deg_s": _divide("deg/s", 180 / pi),
    "rad_s2": KeyUnit("rad/s^2"),
    "v": KeyUnit("V"),
    "k": KeyUnit("K"),
    "n": KeyUnit("N"),
    "a_w": KeyUnit("A/W"),
    "na": _multiply("nA", 1e-9, 1e9),
    "kohm": _multiply("kohm", 1e3, 1e-3),
    "nv_rthz": _multiply("", 1e-9, 1e9),
    "pa_rthz": _multiply("", 1e-12, 1e12),
    "nm_rthz": _multiply("", 1e-6, 1e6),
    "mk_rthz": _multiply("", 1e-3, 1e3),
}
KEY_UNITS |= {
    f"per_{name}": _divide(_invert(KEY_UNITS[name].label), KEY_UNITS[name].to_code(1.0))
    for name in ("um", "urad", "mm_s", "mrad_s", "m_s2", "rad_s2")
}

#: Least and largest plausible value of a column or a key, by the ending of its name. Other values
#: have another unit, such as a temperature in kelvin, or come from a broken sensor.
PLAUSIBLE = {
    "temperature_c": (-60.0, 150.0),
    "temperature_k": (60.0, 450.0),
    "_mm": (-1e5, 1e5),
    "_mrad": (-1e4, 1e4),
    "_deg": (-36e3, 36e3),
}


def bounds_of(name: str) -> dict[str, float]:
    """The plausible range of a column or a key, as the bounds of a key; empty if there is none."""
    return next(({"ge": a, "le": b} for end, (a, b) in PLAUSIBLE.items() if name.endswith(end)), {})


def describe_bounds(name: str) -> str:
    """The plausible range of a column or a key with its unit, for a message: "-60 to 150 degC"."""
    low, high = bounds_of(name).values()
    return f"{low:g} to {high:g} {KEY_UNITS[unit_in(name)].label}"


def find_implausible(values: Floats, name: str) -> Booleans:
    """Whether each number of a column is implausible in its unit, for example infinite; NaN counts
    as plausible."""
    low, high = bounds_of(name).values() or (-np.inf, np.inf)
    is_implausible: Booleans = (values < low) | (values > high)
    return is_implausible


def unit_in(key: str) -> str:
    """Return the unit at the end of a key's name, or "": `unit_in("max_speed_mm_s")` is "mm_s"."""
    words = key.split("_")[1:]
    endings = ("_".join(words[n:]) for n in range(len(words)))
    return next((ending for ending in endings if ending in KEY_UNITS), "")
