"""Model of a sensor for the certificate checker: rays and edges in interval dual numbers.

It uses no code of the package; check_certificate.py lists what is trusted.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from flint import arb

from .certificate_schema import refuse_unless

#: Largest offset of the apex that is tried, in sigmas, and the number of steps that reduce it.
FARTHEST, STEPS = 8, 32


def span(low: Any, high: Any) -> Any:
    """The interval between two exact numbers."""
    return arb(low).union(arb(high))


class IntervalDual:
    """Interval value with its derivatives by tx, ty, tz, roll, pitch and yaw.

    The value may itself be a dual number, as its derivatives then are. Comparisons use the value.
    """

    def __init__(self, value: Any, slope: list[Any] | None = None) -> None:
        self.value, self.slope = value, [arb(0)] * 6 if slope is None else slope

    def __add__(self, other: Any) -> IntervalDual:
        b = other if isinstance(other, IntervalDual) else IntervalDual(other)
        return IntervalDual(
            self.value + b.value, [x + y for x, y in zip(self.slope, b.slope, strict=True)]
        )

    def __mul__(self, other: Any) -> IntervalDual:
        b = other if isinstance(other, IntervalDual) else IntervalDual(other)
        both = zip(self.slope, b.slope, strict=True)
        return IntervalDual(self.value * b.value, [x * b.value + self.value * y for x, y in both])

    def __truediv__(self, other: IntervalDual) -> IntervalDual:
        ratio = self.value / other.value
        both = zip(self.slope, other.slope, strict=True)
        return IntervalDual(ratio, [(x - ratio * y) / other.value for x, y in both])

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> IntervalDual:
        return self * arb(-1)

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
        return IntervalDual(self.value.sin(), [self.value.cos() * d for d in self.slope])

    def cos(self) -> IntervalDual:
        return IntervalDual(self.value.cos(), [-self.value.sin() * d for d in self.slope])

    def __sub__(self, other: Any) -> IntervalDual:
        difference: IntervalDual = self + other * arb(-1)
        return difference


def inner_product(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def matrix_product(a: Any, b: Any) -> Any:
    return [[inner_product(row, [b[0][j], b[1][j], b[2][j]]) for j in range(3)] for row in a]


def rotation(roll: Any, pitch: Any, yaw: Any) -> Any:
    """Rz(yaw) Ry(pitch) Rx(roll), as three rows."""
    none = roll * arb(0)
    one = none + arb(1)
    x = [[one, none, none], [none, roll.cos(), -roll.sin()], [none, roll.sin(), roll.cos()]]
    y = [[pitch.cos(), none, pitch.sin()], [none, one, none], [-pitch.sin(), none, pitch.cos()]]
    z = [[yaw.cos(), -yaw.sin(), none], [yaw.sin(), yaw.cos(), none], [none, none, one]]
    return matrix_product(z, matrix_product(y, x))


def values_within(value: float, off: float) -> Any:
    """Interval of all numbers at most `off` from `value`."""
    return arb(value) if off == 0 else (arb(value) - off).lower().union((arb(value) + off).upper())


class IntervalSensor:
    """All sensors whose 30 `facets.PARAMETERS` lie within their tolerances."""

    def __init__(self, parameters: list[float], tolerances: list[float]) -> None:
        p = [values_within(*pair) for pair in zip(parameters, tolerances, strict=True)]
        self.power = p[0]
        tilt = rotation(p[4], p[5], arb(0))
        x, y, back = ([row[i] for row in tilt] for i in range(3))
        c, s = p[3].cos(), p[3].sin()
        self.down = [-value for value in back]
        self.across = [[c * a + s * b for a, b in zip(x, y, strict=True)],
                       [c * b - s * a for a, b in zip(x, y, strict=True)]]  # fmt: skip
        self.sigma = [p[1] / 4, p[2] / 4]
        self.normals = [
            [p[i].sin() * p[i + 1].cos(), p[i].sin() * p[i + 1].sin(), p[i].cos()]
            for i in (6, 8, 10)
        ]
        self.centres, self.axes = [], []
        for i in (12, 18, 24):
            self.centres.append([p[i] * p[i + 1].cos(), p[i] * p[i + 1].sin(), p[i + 2]])
            rows = rotation(p[i + 3], p[i + 4], p[i + 1] + p[i + 5])
            self.axes.append([[row[j] for row in rows] for j in range(3)])

    def flat(self, v: Any) -> Any:
        """Project a vector along the beam; the result is in sigmas."""
        return [inner_product(v, a) * (1 / s) for a, s in zip(self.across, self.sigma, strict=True)]


def pose_of_box(box: list[Any]) -> list[IntervalDual]:
    """Dual numbers of the pose, whose derivatives by the pose are the identity."""
    return [IntervalDual(x, [arb(i == j) for j in range(6)]) for i, x in enumerate(box)]


def spots(rig: IntervalSensor, box: list[Any], light: Any) -> list[IntervalDual]:
    """Return psi and zeta of the three detectors with derivatives at fixed shares of the light."""
    pose = pose_of_box(box)
    turn = rotation(*pose[3:])
    apex, out = pose[:3], []
    for k in range(3):
        normal = [inner_product(row, rig.normals[k]) for row in turn]
        middle = [
            IntervalDual(span(*light["from_point"][k][i]),
                 [arb(0)] * 3 + [span(*d) for d in light["turns"][k][i]])
            for i in range(2)
        ]  # fmt: skip
        beside = [
            sum(
                (middle[i] * (rig.sigma[i] * rig.across[i][c]) for i in range(2)),
                IntervalDual(arb(0)),
            )
            for c in range(3)
        ]
        down = inner_product(normal, rig.down)
        drop = -inner_product(normal, beside) / down
        start = [apex[c] + beside[c] + drop * rig.down[c] for c in range(3)]
        away = [normal[c] * (down * arb(-2)) + rig.down[c] for c in range(3)]
        x, y, z = rig.axes[k]
        reach = inner_product(
            [IntervalDual(m) - s for m, s in zip(rig.centres[k], start, strict=True)], x
        )
        facing = inner_product(away, x)
        refuse_unless(down.value < 0, f"facet {'abc'[k]} may not face the beam in the box")
        refuse_unless(facing.value > 0, f"detector {'abc'[k]} may not face its sub-beam in the box")
        refuse_unless(reach.value > 0, f"detector {'abc'[k]} may stand behind the mirror")
        place = [start[c] + away[c] * (reach / facing) - rig.centres[k][c] for c in range(3)]
        out += [inner_product(place, y), inner_product(place, z)]
    return out


def edges_of(rig: IntervalSensor, angles: list[Any]) -> list[tuple[Any, list[Any]]]:
    """Angle of each edge seen along the beam, and its derivatives by roll, pitch and yaw."""
    turn = rotation(*pose_of_box([arb(0)] * 3 + angles)[3:])
    edges = []
    for k in range(3):
        a, b = rig.normals[k], rig.normals[k - 1]
        edge = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        x, y = rig.flat([inner_product(row, edge) for row in turn])
        c, s = x.value.mid(), y.value.mid()
        angle = arb.atan2(s, c) + arb.atan2(c * y.value - s * x.value, c * x.value + s * y.value)
        slopes = [
            (x.value * y.slope[j] - y.value * x.slope[j]) / (x.value**2 + y.value**2)
            for j in (3, 4, 5)
        ]
        edges.append((angle, slopes))
    return edges


def openings_between(edges: list[tuple[Any, list[Any]]]) -> list[Any]:
    """Angles from each edge to the next, rad."""
    turn = 2 * arb.pi()
    gaps = [edges[(k + 1) % 3][0] - edges[k][0] for k in range(3)]
    openings = [gap - turn * (gap / turn).mid().floor() for gap in gaps]
    for gap in openings:
        refuse_unless(gap > 0 and gap < arb.pi(), "a facet may be as wide as half a turn")
    return openings


def farthest_offset(openings: list[Any], least: float) -> Fraction:
    """Offset of the apex, in sigmas, beyond which some facet has less than its least share."""
    farthest = None
    for step in range(STEPS, 0, -1):
        distance = Fraction(FARTHEST * step, STEPS)
        far = arb(distance.numerator) / distance.denominator
        shares = [(far * least_sine(gap) / arb(2).sqrt()).erfc() / 2 for gap in openings]
        if not all(share < least for share in shares):
            break
        farthest = distance
    refuse_unless(
        farthest is not None, "a facet may have its least share of light with the apex far"
    )
    return farthest or Fraction(0)


def least_sine(opening: Any) -> Any:
    """Least sine between a right angle and the opening; 1 if the opening is acute."""
    return arb(1) if opening <= arb.pi() / 2 else opening.upper().sin()
