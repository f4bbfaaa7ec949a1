"""Numbers that carry a derivative along: a value, and its slope by whatever is varied.

Over scalars of any kind; a slope that is the plain number 0 costs nothing where a writer of code
leaves out sums and products with zeros. What carries a derivative in compiled loops are complex
numbers instead (`dispatch.carrying`), whose text is the same.
"""

from __future__ import annotations

from typing import Any

from . import dispatch


class Dual:
    """real: the value.  imag: the slope; named as a complex number's parts, for one text."""

    __slots__ = ("imag", "real")

    def __init__(self, value: Any, slope: Any) -> None:
        self.real, self.imag = value, slope

    def __add__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.real + other.real, self.imag + other.imag)
        return Dual(self.real + other, self.imag)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.real, -self.imag)

    def __sub__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.real - other.real, self.imag - other.imag)
        return Dual(self.real - other, self.imag)

    def __rsub__(self, other: Any) -> Dual:
        return Dual(other - self.real, -self.imag)

    def __mul__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            slope = self.real * other.imag + self.imag * other.real
            return Dual(self.real * other.real, slope)
        return Dual(self.real * other, self.imag * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        inverse = 1 / dispatch.real(other)
        value = self.real * inverse
        if isinstance(other, Dual):
            return Dual(value, (self.imag - value * other.imag) * inverse)
        return Dual(value, self.imag * inverse)

    def __rtruediv__(self, other: Any) -> Dual:
        inverse = 1 / self.real
        value = other * inverse
        return Dual(value, -value * self.imag * inverse)


pi = dispatch.math.pi


def sqrt(x: Dual) -> Dual:
    root = dispatch.sqrt(x.real)
    return Dual(root, x.imag / (2 * root))


def log(x: Dual) -> Dual:
    return Dual(dispatch.log(x.real), x.imag / x.real)


def sin(x: Dual) -> Dual:
    return Dual(dispatch.sin(x.real), dispatch.cos(x.real) * x.imag)


def cos(x: Dual) -> Dual:
    return Dual(dispatch.cos(x.real), -dispatch.sin(x.real) * x.imag)


def atan2(y: Any, x: Any) -> Dual:
    of_y, of_x = parts(y), parts(x)
    square = of_x[0] * of_x[0] + of_y[0] * of_y[0]
    slope = (of_x[0] * of_y[1] - of_y[0] * of_x[1]) / square
    return Dual(dispatch.atan2(of_y[0], of_x[0]), slope)


def parts(x: Any) -> tuple[Any, Any]:
    """A number's value and slope, which is 0 where it carries none."""
    return (x.real, x.imag) if isinstance(x, Dual) else (x, 0.0)
