"""Model of a sensor for the certificate checker: rays and edges in interval dual numbers.

It uses no code of the package; check_certificate.py lists what the checker relies on.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from flint import arb
from numpy.typing import NDArray

from .certificate_schema import refuse_unless

#: Arrays of intervals or of dual numbers: NumPy only calls the operators of their elements.
Array = NDArray[Any]

#: Largest offset of the apex that is tried, in sigmas, and the number of steps that reduce it.
FARTHEST, STEPS = 8, 32


def span(low: Any, high: Any) -> Any:
    """The interval between two exact numbers."""
    return arb(low).union(arb(high))


class IntervalDual:
    """Interval value with its derivatives (6,) by tx, ty, tz, roll, pitch and yaw.

    The value may itself be a dual number, as its derivatives then are. Comparisons use the value.
    """

    def __init__(self, value: Any, slope: Array | None = None) -> None:
        self.value, self.slope = value, np.full(6, arb(0)) if slope is None else slope

    def __add__(self, other: Any) -> IntervalDual:
        if not isinstance(other, IntervalDual):
            return IntervalDual(self.value + other, self.slope)
        return IntervalDual(self.value + other.value, self.slope + other.slope)

    def __mul__(self, other: Any) -> IntervalDual:
        if not isinstance(other, IntervalDual):
            return IntervalDual(self.value * other, self.slope * other)
        slope = self.slope * other.value + other.slope * self.value
        return IntervalDual(self.value * other.value, slope)

    def __truediv__(self, other: IntervalDual) -> IntervalDual:
        ratio = self.value / other.value
        return IntervalDual(ratio, (self.slope - other.slope * ratio) / other.value)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> IntervalDual:
        return self * arb(-1)

    def __sub__(self, other: Any) -> IntervalDual:
        difference: IntervalDual = self + other * arb(-1)
        return difference

    def __rsub__(self, other: Any) -> IntervalDual:
        difference: IntervalDual = -self + other
        return difference

    def __rtruediv__(self, other: Any) -> IntervalDual:
        return IntervalDual(other) / self

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < other)

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > other)

    def sin(self) -> IntervalDual:
        return IntervalDual(self.value.sin(), self.slope * self.value.cos())

    def cos(self) -> IntervalDual:
        return IntervalDual(self.value.cos(), self.slope * -self.value.sin())


def rotation(roll: Any, pitch: Any, yaw: Any) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll), (3, 3)."""
    zero = roll * arb(0)
    unit = zero + arb(1)
    x = [[unit, zero, zero], [zero, roll.cos(), -roll.sin()], [zero, roll.sin(), roll.cos()]]
    y = [[pitch.cos(), zero, pitch.sin()], [zero, unit, zero], [-pitch.sin(), zero, pitch.cos()]]
    z = [[yaw.cos(), -yaw.sin(), zero], [yaw.sin(), yaw.cos(), zero], [zero, zero, unit]]
    product: Array = np.array(z) @ np.array(y) @ np.array(x)
    return product


def values_within(value: float, off: float) -> Any:
    """Interval of all numbers at most `off` from `value`."""
    return arb(value) if off == 0 else (arb(value) - off).lower().union((arb(value) + off).upper())


class IntervalSensor:
    """All sensors whose 30 `facets.PARAMETERS` lie within their tolerances."""

    def __init__(self, parameters: list[float], tolerances: list[float]) -> None:
        p = [values_within(*pair) for pair in zip(parameters, tolerances, strict=True)]
        self.power = p[0]
        x, y, back = rotation(p[4], p[5], arb(0)).T
        c, s = p[3].cos(), p[3].sin()
        self.down = -back
        self.across = np.array([c * x + s * y, c * y - s * x])
        self.sigma = np.array(p[1:3]) / 4
        self.normals = np.array([
            [p[i].sin() * p[i + 1].cos(), p[i].sin() * p[i + 1].sin(), p[i].cos()]
            for i in (6, 8, 10)
        ])  # fmt: skip
        of_psd = [p[i : i + 6] for i in (12, 18, 24)]
        self.centres = np.array([
            [radius * azimuth.cos(), radius * azimuth.sin(), height]
            for radius, azimuth, height, *_ in of_psd
        ])  # fmt: skip
        self.axes = [
            rotation(roll, pitch, azimuth + yaw).T for _, azimuth, _, roll, pitch, yaw in of_psd
        ]

    def project(self, v: Array) -> Any:
        """Project a vector (3,) along the beam: (2,) in sigmas."""
        return (self.across @ v) * (1 / self.sigma)


def pose_of_box(box: Any) -> Array:
    """Dual numbers (6,) of the pose, whose derivatives by the pose are the identity."""
    return np.array([
        IntervalDual(x, np.array([arb(i == j) for j in range(6)])) for i, x in enumerate(box)
    ])  # fmt: skip


def spots(rig: IntervalSensor, box: Any, light: Any) -> list[IntervalDual]:
    """Return psi and zeta of the three detectors, with derivatives while the facets' shares in the
    light are fixed."""
    pose = pose_of_box(box)
    apex, turn, out = pose[:3], rotation(*pose[3:]), []
    for k in range(3):
        normal = turn @ rig.normals[k]
        from_point = np.array([
            IntervalDual(span(*light["from_point"][k][i]),
                         np.array([arb(0)] * 3 + [span(*d) for d in light["turns"][k][i]]))
            for i in range(2)
        ])  # fmt: skip
        offset = from_point @ (rig.across * rig.sigma[:, None])
        down = normal @ rig.down
        start = apex + offset + rig.down * (-(normal @ offset) / down)
        leaving = normal * (down * arb(-2)) + rig.down
        x, y, z = rig.axes[k]
        reach, facing = (rig.centres[k] - start) @ x, leaving @ x
        refuse_unless(down.value < 0, f"facet {'abc'[k]} may not face the beam in the box")
        refuse_unless(facing.value > 0, f"detector {'abc'[k]} may not face its sub-beam in the box")
        refuse_unless(reach.value > 0, f"detector {'abc'[k]} may stand behind the mirror")
        place = start + leaving * (reach / facing) - rig.centres[k]
        out += [place @ y, place @ z]
    return out


def edges_of(rig: IntervalSensor, angles: list[Any]) -> list[tuple[Any, Array]]:
    """Angle of each edge seen along the beam, and its derivatives (3,) by roll, pitch and yaw."""
    turn = rotation(*pose_of_box([arb(0)] * 3 + angles)[3:])
    edges = []
    for k in range(3):
        x, y = rig.project(turn @ np.cross(rig.normals[k], rig.normals[k - 1]))
        c, s = x.value.mid(), y.value.mid()
        angle = arb.atan2(s, c) + arb.atan2(c * y.value - s * x.value, c * x.value + s * y.value)
        slopes = (y.slope * x.value - x.slope * y.value) / (x.value**2 + y.value**2)
        edges.append((angle, slopes[3:]))
    return edges


def openings_between(edges: list[tuple[Any, Array]]) -> list[Any]:
    """Angles from each edge to the next, rad. Raises `Refused` if one may reach half a turn."""
    turn = 2 * arb.pi()
    gaps = [edges[(k + 1) % 3][0] - edges[k][0] for k in range(3)]
    openings = [gap - turn * (gap / turn).mid().floor() for gap in gaps]
    for gap in openings:
        refuse_unless(gap > 0 and gap < arb.pi(), "a facet may be as wide as half a turn")
    return openings


def farthest_offset(openings: list[Any], least_share: float) -> Fraction:
    """Offset of the apex, in sigmas, beyond which some facet has less than the least share."""
    farthest = None
    for step in range(STEPS, 0, -1):
        distance = Fraction(FARTHEST * step, STEPS)
        far = arb(distance.numerator) / distance.denominator
        bounds = [(far * least_sine(gap) / arb(2).sqrt()).erfc() / 2 for gap in openings]
        if not all(bound < least_share for bound in bounds):
            break
        farthest = distance
    refuse_unless(
        farthest is not None, "a facet may have its least share of light with the apex far"
    )
    return farthest or Fraction(0)


def least_sine(opening: Any) -> Any:
    """Least sine between a right angle and the opening; 1 if the opening is acute."""
    return arb(1) if opening <= arb.pi() / 2 else opening.upper().sin()
