"""Elementary functions of numbers in lanes by additions, multiplications and divisions only."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from llvmlite import ir

from . import dispatch, polynomials
from .tracing import Condition, Value

LONG = ir.IntType(64)

#: Tangents of pi / 8 and 3 pi / 8: above each, the arc tangent is found from another angle.
TAN_1, TAN_3 = math.sqrt(2) - 1, math.sqrt(2) + 1
#: Number of bits of a double's mantissa, and the smallest double with a full mantissa.
MANTISSA_BITS, SMALLEST = 52, 2.0**-1022
BITS_OF_ROOT_OF_HALF = int.from_bytes(struct.pack("<d", math.sqrt(0.5)), "little")
#: The logarithm of 2, as a number with 21 zero bits at its end, whose products with exponents are
#: exact, and the remainder.
LN2_HIGH, LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10
#: The series of the exponential function, accurate to all digits up to half of ln 2; the exponent
#: below which the function is 0.
EXPONENTIAL_SERIES = tuple(1 / math.factorial(n) for n in range(14))
MIN_EXPONENT = -700.0


#: A quarter turn as the sum of three parts. The first two end in zero bits, so that their products
#: with integers are exact.
QUARTERS = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
#: The sum of this and a number has the nearest integer in its last bits.
ROUNDING = 1.5 * 2.0**52


def sine(x: Value) -> Value:
    """The sine of an angle in rad of any size."""
    return turn(x)[0]  # type: ignore[no-any-return]


def cosine(x: Value) -> Value:
    """The cosine of an angle in rad of any size."""
    return turn(x)[1]  # type: ignore[no-any-return]


def turn(x: Value) -> Any:
    """Sine and cosine of an angle, which are written together by `turns`."""
    x.writer.turn_together(x)
    return x.writer.once(("turn", x), turns, (x,))


def turns(angles: tuple[Value, ...]) -> tuple[Any, ...]:
    """Sine and cosine of each angle; angles of more than a radian call a function."""
    usual = tuple((polynomials.sine(x), polynomials.cosine(x)) for x in angles)
    large = tuple(abs(x) > 1 for x in angles)
    return dispatch.where_each(large, usual, reduced_turn, tuple((x,) for x in angles))


def reduced_turn(x: Value) -> Any:
    """Sine and cosine of a larger angle, from its difference to a multiple of a quarter turn."""
    code = x.writer
    quarters, bits = nearest_whole(x * (2 / math.pi))
    rest = x
    for part in QUARTERS:
        rest = rest - quarters * part
    sine, cosine = polynomials.sine(rest), polynomials.cosine(rest)
    odd = has_bit(code, bits, 1)
    sine, cosine = code.select(odd, cosine, sine), code.select(odd, sine, cosine)
    back, in_left_half = has_bit(code, bits, 2), has_bit(code, bits, 2, 1)
    return code.select(back, -sine, sine), code.select(in_left_half, -cosine, cosine)


def nearest_whole(x: Value) -> tuple[Value, Any]:
    """The nearest integer as a number, and a vector of integers with its last bits."""
    scaled = x + ROUNDING
    bits = x.writer.builder.bitcast(scaled.ir, ir.VectorType(LONG, x.writer.lanes))
    return scaled - ROUNDING, bits


def has_bit(code: Any, bits: Any, bit: int, more: int = 0) -> Condition:
    """Whether, in each lane, an integer plus `more` has a certain bit set."""
    added = code.builder.add(bits, integers(code, more))
    masked = code.builder.and_(added, integers(code, bit))
    return Condition(code, code.builder.icmp_signed("!=", masked, integers(code, 0)))


def integers(code: Any, number: int) -> Any:
    """A constant integer in each lane."""
    return ir.Constant(ir.VectorType(LONG, code.lanes), [number] * code.lanes)


def exponential(x: Value) -> Value:
    """The exponential function to all digits; 0 where x is below -700."""
    code = x.writer
    e, bits = nearest_whole(x * (1 / math.log(2)))
    rest = (x - e * LN2_HIGH) - e * LN2_LOW
    power = code.builder.shl(bits, integers(code, MANTISSA_BITS))
    part = polynomials.polynomial(rest, EXPONENTIAL_SERIES)
    mantissa = code.builder.bitcast(part.ir, power.type)
    result = Value(code, code.builder.bitcast(code.builder.add(mantissa, power), code.kind))
    return code.select(x < MIN_EXPONENT, 0.0, result)  # type: ignore[no-any-return]


def logarithm(x: Value) -> Value:
    """The logarithm of positive numbers to all digits; NaN of others.

    x = m 2^e with m between the roots of 1/2 and 2.
    """
    code, build = x.writer, x.writer.builder
    root, digits = integers(code, BITS_OF_ROOT_OF_HALF), integers(code, (1 << MANTISSA_BITS) - 1)
    bits = build.sub(build.bitcast(x.ir, root.type), root)
    power = build.ashr(bits, integers(code, MANTISSA_BITS))
    part = build.add(build.and_(bits, digits), root)
    m = Value(code, build.bitcast(part, code.kind))
    e = Value(code, build.sitofp(power, code.kind))
    rest = polynomials.logarithm((m - 1) / (m + 1)) + e * LN2_LOW
    valid = (x > SMALLEST) & (x < math.inf)
    return code.select(valid, e * LN2_HIGH + rest, math.nan)  # type: ignore[no-any-return]


def arc_tangent(y: Value, x: Value) -> Value:
    """The angle of the vector (x, y), rad."""
    code, high, wide = x.writer, abs(y), abs(x)
    steep, middle = high > wide * TAN_3, high > wide * TAN_1
    above = code.select(steep, -wide, code.select(middle, high - wide, high))
    below = code.select(steep, high, code.select(middle, high + wide, wide))
    turn = code.select(steep, math.pi / 2, code.select(middle, math.pi / 4, 0.0))
    angle = turn + polynomials.arc_tangent(above / below)
    angle = code.select(x > 0, angle, math.pi - angle)
    return code.select(y < 0, -angle, angle)  # type: ignore[no-any-return]


#: The functions for which processors have no instruction, by their names in `math`.
FUNCTIONS: dict[str, Callable[..., Value]] = {
    "sin": sine,
    "cos": cosine,
    "exp": exponential,
    "log": logarithm,
    "atan2": arc_tangent,
}
