"""Interval numbers that carry their slopes by roll, pitch and yaw.

The optics' formulas run with them as with any number, and so give their own derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flint import arb

from ..scalars.intervals import Interval

NONE = (arb(0),) * 3


class Sloped:
    """A value and its three slopes. It compares by its value."""

    __slots__ = ("slope", "value")

    def __init__(self, value: Interval, slope: Sequence[Interval] = NONE) -> None:
        self.value, self.slope = value, slope

    def __add__(self, other: Any) -> Sloped:
        if isinstance(other, Sloped):
            a, b = self.slope, other.slope
            return Sloped(self.value + other.value, (a[0] + b[0], a[1] + b[1], a[2] + b[2]))
        return Sloped(self.value + other, self.slope)

    def __mul__(self, other: Any) -> Sloped:
        a, x = self.slope, self.value
        if isinstance(other, Sloped):
            b, y = other.slope, other.value
            slope = (a[0] * y + x * b[0], a[1] * y + x * b[1], a[2] * y + x * b[2])
            return Sloped(x * y, slope)
        return Sloped(x * other, (a[0] * other, a[1] * other, a[2] * other))

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Sloped:
        a = self.slope
        return Sloped(-self.value, (-a[0], -a[1], -a[2]))

    def __sub__(self, other: Any) -> Sloped:
        difference: Sloped = self + -other
        return difference

    def __rsub__(self, other: Any) -> Sloped:
        difference: Sloped = -self + other
        return difference

    def __truediv__(self, other: Any) -> Sloped:
        if not isinstance(other, Sloped):
            return self * (1 / arb(other))
        a, b = self.slope, other.slope
        ratio = self.value / other.value
        return Sloped(
            ratio,
            (
                (a[0] - ratio * b[0]) / other.value,
                (a[1] - ratio * b[1]) / other.value,
                (a[2] - ratio * b[2]) / other.value,
            ),
        )

    def __rtruediv__(self, other: Any) -> Sloped:
        return Sloped(arb(other)) / self

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < other)

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > other)

    def chain(self, value: Interval, rate: Interval) -> Sloped:
        """A function of this number, by its value and its derivative."""
        a = self.slope
        return Sloped(value, (rate * a[0], rate * a[1], rate * a[2]))

    def sin(self) -> Sloped:
        return self.chain(self.value.sin(), self.value.cos())

    def cos(self) -> Sloped:
        return self.chain(self.value.cos(), -self.value.sin())

    def sqrt(self) -> Sloped:
        root = self.value.sqrt()
        return self.chain(root, 1 / (2 * root))
