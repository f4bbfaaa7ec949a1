"""Printed bounds of a proof: rounded once, to the side on which the statement stays true."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from math import inf, isfinite, nextafter
from typing import TYPE_CHECKING

from facets import characterization

if TYPE_CHECKING:
    from facets.core.units import Floats
    from facets.proof.pieces import ProvedPiece


def round_down(value: float | Fraction, digits: int = 3, per_unit: int = 1) -> str:
    """Round a lower bound down, in units of which `per_unit` make one unit of the value."""
    return round_bound(value, ROUND_FLOOR, digits, per_unit)


def round_up(value: float | Fraction, digits: int = 3, per_unit: int = 1) -> str:
    """Round an upper bound up, in units of which `per_unit` make one unit of the value."""
    return round_bound(value, ROUND_CEILING, digits, per_unit)


def round_bound(value: float | Fraction, towards: str, digits: int, per_unit: int) -> str:
    """Round a number of a proven statement in one step, so that the statement also holds for the
    printed number."""
    if not isfinite(value):
        return f"{value:g}"
    exact = Fraction(value) * per_unit
    context = Context(prec=digits, rounding=towards)
    number = context.divide(Decimal(exact.numerator), Decimal(exact.denominator))
    return f"{float(number):.{digits}g}"


def light_text(fraction: float, largest_power: float) -> str:
    """Describe the least light of a set of states; largest_power: of the laser, mW.

    The proof is about the fraction of the laser's light. Of a laser that is brighter than
    `largest_power` the same light is a smaller fraction, so the light in µW is stated with this
    power.
    """
    power = nextafter(largest_power, inf)  # as a float 0.3 is a little less than 0.3
    light = Fraction(fraction) * Fraction(power)
    return (
        f"at least {round_up(fraction, 4, 100)} % of the light on each detector"
        f" ({round_up(light, 4, 1000)} µW of a laser of {round_down(power, 4)} mW or less)"
    )


def piece_text(piece: ProvedPiece) -> str:
    """Describe the piece in which nothing is proved, its ends rounded outwards."""
    sides = []
    for name, unit, low, high in zip(
        characterization.state_box.COLUMNS,
        characterization.state_box.UNITS,
        piece.low,
        piece.high,
        strict=False,
    ):
        per_unit = round(1 / unit)
        sides.append(f"{name} {round_down(low, 4, per_unit)} to {round_up(high, 4, per_unit)}")
    return ", ".join(sides)


def box_lines(low: Floats, high: Floats) -> list[str]:
    """Describe the box of poses, its ends rounded inwards."""
    lines = []
    for name, unit, a, b in zip(
        characterization.state_box.COLUMNS,
        characterization.state_box.UNITS,
        low[:6],
        high[:6],
        strict=False,
    ):
        per_unit = round(1 / unit)
        ends = f"{round_up(a, 4, per_unit):>10} to {round_down(b, 4, per_unit)}"
        lines.append(f"  {name:<12} {ends}")
    return lines
