"""Sums of products and Gaussians of floats, free of the rounding that large numbers bring."""

from __future__ import annotations

from math import pi

from ..scalars.dispatch import exp, round_product

Plane = tuple[float, float]


def product(a: float, b: float) -> tuple[float, float]:
    """The product a b exactly: the rounded product and its error (Dekker)."""
    whole = round_product(a * b)
    # 2^27 + 1 splits a float in two halves.
    big_a, big_b = round_product(134217729.0 * a), round_product(134217729.0 * b)
    high_a, high_b = big_a - (big_a - a), big_b - (big_b - b)
    low_a, low_b = a - high_a, b - high_b
    missing = ((high_a * high_b - whole) + high_a * low_b + low_a * high_b) + low_a * low_b
    return whole, missing


def sum_of_products(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """The sum a b + c d to twice a float's precision: a float and its error."""
    first, first_missing = product(a, b)
    second, second_missing = product(c, d)
    total = first + second
    part = total - first
    missing = (first - (total - part)) + (second - part) + first_missing + second_missing
    whole = total + missing
    return whole, missing - (whole - total)


def normalise(q: Plane, u: Plane) -> tuple[float, float, float]:
    """Return (q . u, q x u, the error of the latter) for u normalised beyond its own rounding."""
    square, missing = sum_of_products(u[0], u[0], u[1], u[1])
    excess = ((square - 1) + missing) / 2
    a, _ = sum_of_products(q[0], u[0], q[1], u[1])
    h, h_missing = sum_of_products(q[0], u[1], -q[1], u[0])
    return a - a * excess, h, h_missing - h * excess


def gauss(x: float, missing: float) -> float:
    """exp(-(x + missing)^2 / 2), however large x."""
    square, square_missing = product(x, x)
    return exp(-square / 2) * (1 - square_missing / 2 - x * missing)  # type: ignore[no-any-return]


def gauss_of_point(q: Plane) -> float:
    """exp(-|q|^2 / 2) / 2 pi, however far the point."""
    square, missing = sum_of_products(q[0], q[0], q[1], q[1])
    return exp(-square / 2) * (1 - missing / 2) / (2 * pi)  # type: ignore[no-any-return]
