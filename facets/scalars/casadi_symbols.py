"""Elementary functions of casadi's symbols, for differentiating the optics' formulas.

They hold for apices within a few sigmas of the beam's centre, as in any layout: erfc is 1 - erf,
and an integral over 0..1 a Gauss-Legendre rule, exact there to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

pi = math.pi
NODES = 20


def exp(x: Any) -> Any:
    return library().exp(x)


def library() -> Any:
    import casadi

    return casadi


def sqrt(x: Any) -> Any:
    return library().sqrt(x)


def sin(x: Any) -> Any:
    return library().sin(x)


def cos(x: Any) -> Any:
    return library().cos(x)


def erf(x: Any) -> Any:
    return library().erf(x)


def erfc(x: Any) -> Any:
    return 1 - erf(x)


def atan2(y: Any, x: Any) -> Any:
    return library().atan2(y, x)


def quad(integrand: Callable[[Any], Any], _: Sequence[float]) -> Any:
    import numpy as np

    places, weights = np.polynomial.legendre.leggauss(NODES)
    parts = [
        float(weight) / 2 * integrand((float(place) + 1) / 2)
        for place, weight in zip(places, weights, strict=True)
    ]
    return sum(parts[1:], parts[0])
