"""A box of states for surveys and proofs."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..core.axis_keys import MAX_LENGTH_MM
from ..core.errors import InputError
from ..core.names import ANGLES, POSE
from ..core.plain_numbers import assignments, plain_number
from ..core.rules import Rules
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import power_floor
from .ranges import axis_ranges

#: Axes of a box: the pose, and the apex's offset from the beam's centre, Eq. (12).
AXES = (*POSE, "offset_x", "offset_y")
COLUMNS = tuple(f"{name}_mrad" if name in ANGLES else f"{name}_mm" for name in AXES)
UNITS = tuple(1e-3 if name in ANGLES else 1.0 for name in AXES)


@dataclass(frozen=True)
class StateBox:
    """A box: low, high (8,) along `AXES`, mm and rad."""

    low: Floats
    high: Floats

    def __post_init__(self) -> None:
        for name, low, high in zip(AXES, self.low, self.high, strict=True):
            if not (np.isfinite(low) and np.isfinite(high) and low <= high):
                raise InputError(f"the box runs from {low} to {high} in {name}")

    def states(self, shares: Floats) -> Floats:
        """States (n, 8) of Eq. (3) at relative places (n, 8) in the box, 0 to 1."""
        state: Floats = self.low + shares * (self.high - self.low)
        state[:, 6:] = state[:, :2] - state[:, 6:]
        return state


def box_of_poses(low: Floats, high: Floats) -> StateBox:
    """The box of poses (6,), the apex in the beam's centre."""
    none = np.zeros(2)
    return StateBox(np.concatenate([low, none]), np.concatenate([high, none]))


def apex_offset(states: Floats) -> Floats:
    """The apex's offset from the beam's centre, Eq. (12), mm: (n, 8) -> (n,)."""
    distance: Floats = np.hypot(states[:, 0] - states[:, 6], states[:, 1] - states[:, 7])
    return distance


def range_box(sensor: Sensor, rules: Rules) -> StateBox:
    """The box of the ranges of the axes: x and y with the beam following, the offset without.

    Each range is that of one axis with the others at rest. Not all axes can reach their ends
    together, and a combined motion can be longer than one axis alone: the box does not contain
    every pose that keeps the rules.
    """
    from dataclasses import replace

    rest = np.zeros(6)
    following = axis_ranges(sensor, replace(rules, tracking=True), rest)[:2]
    fixed = axis_ranges(sensor, replace(rules, tracking=False), rest)
    ranges = [*following, *fixed[2:], *fixed[:2]]
    low = np.array([axis.low for axis in ranges])
    return StateBox(low, np.array([axis.high for axis in ranges]))


#: Format of a box's side on the command line.
BOX_FORM = "NAME=HALF or NAME=LOW:HIGH"
#: Largest relative rounding error of the quotient in a least share.
ROUNDING_FRACTION = 1e-12


def least_share(sensor: Sensor, rules: Rules, power_off: float = 0.0) -> float:
    """Least fraction of the light on a detector within the rules, rounded down.

    power_off: largest deviation of the laser's power, mW.
    """
    fraction = rules.snr * power_floor(sensor) / (sensor.beam.power + power_off)
    return fraction * (1 - ROUNDING_FRACTION)


def parse_box(text: str) -> StateBox:
    """Parse 'tx_mm=1,yaw_mrad=-2:5': half widths about zero or both ends; other axes have no width.
    Raises `InputError` for a malformed text."""
    low, high = np.zeros(8), np.zeros(8)
    for name, value in assignments(text, "--box", COLUMNS, BOX_FORM).items():
        number = COLUMNS.index(name)
        try:
            low[number], high[number] = parse_ends(value.split(":"), UNITS[number])
        except InputError as error:
            raise InputError(f"--box has '{name}={value}'; allowed: {error}") from None
    return StateBox(low, high)


def parse_ends(texts: list[str], unit: float) -> tuple[float, float]:
    """A half width or both ends in a unit, rounded outwards; `InputError` says what is allowed."""
    try:
        ends = [plain_number(text) for text in texts]
    except ValueError:
        raise InputError(f"{BOX_FORM}, of {', '.join(COLUMNS)}") from None
    if len(ends) > 2 or (len(ends) == 1 and ends[0] < 0):
        raise InputError("a half width, or LOW:HIGH")
    most = np.pi if unit < 1 else MAX_LENGTH_MM
    if not all(abs(end) * unit <= most for end in ends):
        raise InputError(f"up to {most / unit:.5g} either way")
    exact = [Fraction(text.strip()) / round(1 / unit) for text in texts]
    first, last = (-exact[0], exact[0]) if len(exact) == 1 else exact
    return 0.0 - float_above(-first), float_above(last)


def float_above(exact: Fraction) -> float:
    """The least float that is not below a number, so that a box contains the requested one."""
    nearest = float(exact)
    return nearest if nearest >= exact else float(np.nextafter(nearest, np.inf))
