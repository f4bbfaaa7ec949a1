"""Elementary functions for every number type that the optics is run with.

The formulas in `facets.optics` are written once, over scalars, with `+ - * /` and these functions.
They run with floats, with numbers that write code (`tracing`), and in high precision (mpmath).
Formulas of pure geometry also run with arrays and with rigorous intervals (`intervals`). A formula
contains no decimal literal, because a rounded constant would limit the accuracy of a 40-digit run.

`dual.Dual` adds a derivative to a number of any of these kinds.

Angles are in rad. Outside its domain a function of floats raises the error of `math`; functions of
arrays, intervals and code give NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy

from .nesting import leaves, nest

Number = Any


def is_float(x: Number) -> bool:
    """Whether a number is a plain float or integer."""
    return isinstance(x, float | int)


def has_more_digits(x: Number) -> bool:
    """Whether numbers of this type have more digits than floats, for which polynomials are made."""
    return hasattr(x, "context")


def is_dual(x: Number) -> bool:
    """Whether a number carries a derivative."""
    return type(x).__name__ == "Dual"


def library(x: Number) -> Any:
    """Return the module that has the elementary functions for a number of this type."""
    if type(x).__module__ == "numpy":
        return numpy
    if is_float(x):
        return math
    if hasattr(x, "context"):
        return x.context
    if hasattr(x, "library"):  # `dual.Dual` and `tracing.Value` name their modules
        return x.library
    from . import intervals

    return intervals


def exp(x: Number) -> Number:
    """The exponential function for any number type."""
    return library(x).exp(x)


def sqrt(x: Number) -> Number:
    """The square root for any number type."""
    return library(x).sqrt(x)


def log(x: Number) -> Number:
    """The natural logarithm for any number type."""
    return library(x).log(x)


def sin(x: Number) -> Number:
    """The sine of an angle in rad, for any number type."""
    return library(x).sin(x)


def cos(x: Number) -> Number:
    """The cosine of an angle in rad, for any number type."""
    return library(x).cos(x)


def turn_together(*angles: Number) -> None:
    """Announce angles whose sines and cosines are needed next, so that code tests once whether any
    angle is large."""
    for angle in angles:
        if hasattr(angle, "writer"):
            angle.writer.turn_together(*angles)
            return


def erf(x: Number) -> Number:
    """The error function for any number type."""
    return library(x).erf(x)


def erfc(x: Number) -> Number:
    """The complementary error function for any number type."""
    return library(x).erfc(x)


def atan2(y: Number, x: Number) -> Number:
    """The angle of the vector (x, y), rad, for any number type."""
    return library(y if is_dual(y) or is_float(x) else x).atan2(y, x)


def real(x: Number) -> Number:
    """The value of a number, without its derivative."""
    return x.real if is_dual(x) else x


def maximum(a: Number, b: Number) -> Number:
    """The larger of two numbers, with its derivative."""
    first, second = real(a), real(b)
    code = first if hasattr(first, "writer") else second
    if hasattr(code, "writer"):
        return code.library.maximum(a, b)
    return a if first > second else b


def select(condition: Any, a: Number, b: Number) -> Number:
    """Return `a` where the condition holds, else `b`."""
    if hasattr(condition, "writer"):
        return condition.writer.select(condition, a, b)
    if isinstance(condition, numpy.ndarray):
        return numpy.where(condition, a, b)
    return a if condition else b


def select_each(condition: Any, a: Any, b: Any) -> Any:
    """Apply `select` to each of the numbers in two tuples of equal nesting."""
    pairs = zip(leaves(a), leaves(b), strict=True)
    return nest(a, (select(condition, *pair) for pair in pairs))


def round_product(x: Number) -> Number:
    """Round a product before it is added to anything, so that no sum fuses it (decision 13)."""
    return x.writer.round_product(x) if hasattr(x, "writer") else x


def where_any(condition: Any, other: Any, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return `function(*arguments)` where the condition holds, else `other`.

    Both have the same nesting. Code for several poses calls the function only if one of them needs
    it.
    """
    if hasattr(condition, "writer"):
        return condition.writer.where_any(condition, other, function, *arguments)
    return function(*arguments) if condition else other


def where_each(
    conditions: tuple[Any, ...],
    others: tuple[Any, ...],
    function: Callable[..., Any],
    arguments: tuple[tuple[Any, ...], ...],
) -> tuple[Any, ...]:
    """Apply `where_any` to each condition, with its other numbers and its arguments.

    Code for several poses tests once whether any of the conditions holds for any pose.
    """

    def compute() -> tuple[Any, ...]:
        each = zip(conditions, others, arguments, strict=True)
        return tuple(where_any(when, other, function, *inputs) for when, other, inputs in each)

    if hasattr(conditions[0], "writer"):
        return conditions[0].writer.branch_once(conditions, others, compute)  # type: ignore[no-any-return]
    return compute()


def sum_over(
    function: Callable[..., Any], table: Sequence[tuple[float, float]], *arguments: Any
) -> Any:
    """The sums, over the rows of a table, of a function's results for a row and the arguments."""
    for number in leaves(arguments):
        if hasattr(number, "writer"):
            return number.writer.sum_over(function, table, *arguments)
    rows = [function(*row, *arguments) for row in table]
    return tuple(map(sum, zip(*rows, strict=True)))


def holds_anywhere(condition: Any) -> bool:
    """Whether a condition holds: in an array for any of its elements; in code always."""
    if hasattr(condition, "writer"):
        return True
    return bool(condition.any() if isinstance(condition, numpy.ndarray) else condition)


def pi(like: Number) -> Number:
    """The number pi in the type and precision of `like`."""
    return math.pi if is_float(like) else +library(like).pi


def integral(integrand: Callable[[Number], Number], like: Number) -> Number:
    """The integral over 0..1 in the precision of `like`, which is not for floats, where the optics
    has faster ways."""
    return library(like).quad(integrand, [0, 1])


def nan_unless_positive(value: Number, a: Number, b: Number, c: Number) -> Number:
    """Return `value` where a, b and c are above zero, else NaN."""
    first = real(a)
    if hasattr(first, "writer"):
        return first.library.nan_unless_positive(value, first, real(b), real(c))
    return value if real(a) > 0 and real(b) > 0 and real(c) > 0 else value * math.nan
