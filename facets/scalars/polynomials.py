"""Elementary functions as polynomials without branches, for several poses at once.

Each is accurate to a few units in the last digit on the stated interval, and invalid outside it.
The coefficients are those of `mpmath.chebyfit(function, [1e-50, end], count)` in 60 digits, the
lowest power first. The comment on each has the function of z, the end of its interval, and its
error.
"""

from __future__ import annotations

from collections.abc import Sequence

from .dispatch import Number

#: exp(-z) to 1; error 3.0e-18
EXPONENTIAL = (
    1.0,
    -0.999999999999999,
    0.4999999999999427,
    -0.16666666666540417,
    0.041666666652193346,
    -0.008333333234481316,
    0.0013888884549085943,
    -0.00019841141919339013,
    2.4798998659720724e-05,
    -2.7521178006932173e-06,
    2.721363367981267e-07,
    -2.2905624278899246e-08,
    1.2719039650810423e-09,
)
#: erf(sqrt(z / 2)) / sqrt(z) to 4; error 1.6e-17
ERROR_FUNCTION = (
    0.7978845608028653,
    -0.1329807601338093,
    0.019947114020045544,
    -0.0023746564307934167,
    0.00023086937467037234,
    -1.8889311387695144e-05,
    1.3319372244950559e-06,
    -8.245203244481295e-08,
    4.5462402939697775e-09,
    -2.2566177779059331e-10,
    1.0111722984492556e-11,
    -3.9960921741385613e-13,
    1.260254961294898e-14,
    -2.3213558622716866e-16,
)
#: (1 - exp(-z)) / z to 2; error 3.9e-17
DECAY = (
    1.0,
    -0.49999999999999223,
    0.16666666666641428,
    -0.04166666666342607,
    0.00833333331158856,
    -0.0013888888013329,
    0.00019841246951401908,
    -2.4801179927390758e-05,
    2.7552245740163468e-06,
    -2.751252893253912e-07,
    2.477182510301927e-08,
    -1.9650743818350247e-09,
    1.2426976499965376e-10,
    -4.585677284736203e-12,
)
#: sin(sqrt(z)) / sqrt(z) to 1; error 8.5e-20
SINE = (
    1.0,
    -0.16666666666666666,
    0.008333333333333106,
    -0.0001984126984108742,
    2.7557319152292533e-06,
    -2.5052093081256153e-08,
    1.605723315933452e-10,
    -7.535482987408254e-13,
)
#: cos(sqrt(z)) to 1; error 1.4e-18
COSINE = (
    1.0,
    -0.49999999999999983,
    0.0416666666666628,
    -0.0013888888888579183,
    2.4801587179865645e-05,
    -2.7557293238470703e-07,
    2.087368217362566e-09,
    -1.128104316059591e-11,
)
#: arctan(sqrt(z)) / sqrt(z) to (sqrt(2) - 1)^2; error 1.3e-18
ARC_TANGENT = (
    1.0,
    -0.3333333333333312,
    0.19999999999940893,
    -0.14285714279250245,
    0.11111110744919658,
    -0.09090896809064027,
    0.07692045330902225,
    -0.06662951813629191,
    0.05846878297330872,
    -0.05035102456601552,
    0.03796525745386593,
    -0.017805397205419446,
)


def polynomial(x: Number, coefficients: Sequence[float]) -> Number:
    """Evaluate a polynomial, lowest power first; even and odd powers are summed independently."""
    square = x * x
    return horner(square, coefficients[::2]) + x * horner(square, coefficients[1::2])


def horner(x: Number, coefficients: Sequence[float]) -> Number:
    """The value at x of a polynomial with coefficients from order 0 upwards."""
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total


def exponential(x: Number) -> Number:
    """exp(-x) for 0 <= x <= 2."""
    root = polynomial(x * 0.5, EXPONENTIAL)
    return root * root


def error_function(x: Number, square: Number) -> Number:
    """erf(x / sqrt 2) for -2 <= x <= 2; `square` is x^2."""
    return x * polynomial(square, ERROR_FUNCTION)


def sine(x: Number) -> Number:
    """sin(x) for -1 <= x <= 1."""
    return x * polynomial(x * x, SINE)


def cosine(x: Number) -> Number:
    """cos(x) for -1 <= x <= 1."""
    return polynomial(x * x, COSINE)


def arc_tangent(x: Number) -> Number:
    """arctan(x) for x between the tangents of -pi/8 and pi/8."""
    return x * polynomial(x * x, ARC_TANGENT)


#: Coefficients of 2 artanh(x) / x in powers of x^2; error 2e-18
LOGARITHM = tuple(2 / (2 * n + 1) for n in range(12))


def logarithm(x: Number) -> Number:
    """ln((1 + x) / (1 - x)) for |x| <= 0.172: numbers between the roots of 1/2 and 2."""
    return x * polynomial(x * x, LOGARITHM)
