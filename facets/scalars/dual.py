"""Numbers with a value and a derivative, for forward differentiation.

The two parts are scalars of any kind: floats, of which the derivative may be an array by several
variables, or numbers that write machine code. A slope that is the float 0 remains 0 without any
computation.
"""

from __future__ import annotations

import math
import sys
from typing import Any

from . import dispatch


def is_zero(slope: Any) -> bool:
    """Whether a slope is the float 0, which marks a constant."""
    return isinstance(slope, float) and slope == 0.0


def scale_slope(slope: Any, factor: Any) -> Any:
    """A slope times a factor, without computation for a constant."""
    return 0.0 if is_zero(slope) else slope * factor


def add_slopes(a: Any, b: Any) -> Any:
    """The sum of two slopes, without computation for a constant."""
    return b if is_zero(a) else a if is_zero(b) else a + b


def subtract_slopes(a: Any, b: Any) -> Any:
    """The difference of two slopes, without computation for a constant."""
    return a if is_zero(b) else -b if is_zero(a) else a - b


class Dual:
    """A number with its derivative.

    real: the value.  imag: the slope; named as in complex numbers, so that formulas serve both.
    """

    __slots__ = ("imag", "real")
    #: The module with the elementary functions of such numbers, see `dispatch.library`.
    library = sys.modules[__name__]
    #: NumPy's arrays leave mixed operations to this class.
    __array_ufunc__ = None

    def __init__(self, value: Any, slope: Any) -> None:
        self.real, self.imag = value, slope

    def __add__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.real + other.real, add_slopes(self.imag, other.imag))
        return Dual(self.real + other, self.imag)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.real, 0.0 if is_zero(self.imag) else -self.imag)

    def __sub__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.real - other.real, subtract_slopes(self.imag, other.imag))
        return Dual(self.real - other, self.imag)

    def __rsub__(self, other: Any) -> Dual:
        return Dual(other - self.real, subtract_slopes(0.0, self.imag))

    def __mul__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            slope = add_slopes(
                scale_slope(other.imag, self.real), scale_slope(self.imag, other.real)
            )
            return Dual(self.real * other.real, slope)
        return Dual(self.real * other, scale_slope(self.imag, other))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        inverse = 1 / dispatch.real(other)
        value = self.real * inverse
        if isinstance(other, Dual):
            return Dual(
                value,
                scale_slope(subtract_slopes(self.imag, scale_slope(other.imag, value)), inverse),
            )
        return Dual(value, scale_slope(self.imag, inverse))

    def __rtruediv__(self, other: Any) -> Dual:
        inverse = 1 / self.real
        value = other * inverse
        return Dual(value, scale_slope(scale_slope(self.imag, -value), inverse))


pi = math.pi


def sqrt(x: Dual) -> Dual:
    root = dispatch.sqrt(x.real)
    return Dual(root, scale_slope(x.imag, 1 / (2 * root)))


def exp(x: Dual) -> Dual:
    power = dispatch.exp(x.real)
    return Dual(power, scale_slope(x.imag, power))


def log(x: Dual) -> Dual:
    return Dual(dispatch.log(x.real), scale_slope(x.imag, 1 / x.real))


def sin(x: Dual) -> Dual:
    return Dual(dispatch.sin(x.real), scale_slope(x.imag, dispatch.cos(x.real)))


def cos(x: Dual) -> Dual:
    return Dual(dispatch.cos(x.real), scale_slope(x.imag, -dispatch.sin(x.real)))


def atan2(y: Any, x: Any) -> Dual:
    (up, of_up), (right, of_right) = value_and_slope(y), value_and_slope(x)
    inverse = 1 / (right * right + up * up)
    slope = scale_slope(
        subtract_slopes(scale_slope(of_up, right), scale_slope(of_right, up)), inverse
    )
    return Dual(dispatch.atan2(up, right), slope)


def value_and_slope(x: Any) -> tuple[Any, Any]:
    """A number's value and slope; the slope is 0 if the number carries none."""
    return (x.real, x.imag) if isinstance(x, Dual) else (x, 0.0)
