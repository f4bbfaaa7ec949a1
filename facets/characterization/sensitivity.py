"""Sobol indices of a design's measures by its variables, from sampled designs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.units import Floats


class Index(NamedTuple):
    """A first-order Sobol index, and half the width of its 95 % interval."""

    value: float
    half: float


#: Least number of designs for a meaningful index.
MIN_DESIGNS = 100
#: Number of the first harmonics whose power counts as the variable's own.
HARMONICS = 10
#: Number of random halves of the designs whose indices' scatter gives the interval.
RESAMPLES = 100
SIGMAS_OF_95_PERCENT = 1.959963984540054


def sensitivity(
    table: dict[str, NDArray[Any]], names: list[str], objectives: list[str]
) -> dict[str, dict[str, Index]]:
    """First-order Sobol indices of each objective by each variable, by their names; empty if fewer
    than MIN_DESIGNS designs are possible.

    table: columns of completely evaluated designs; impossible designs may be among them. An index
    is an estimate, so that a small one can be below zero, within its interval.
    """
    good = np.isfinite(table["range_tz_mm"])
    if good.sum() < MIN_DESIGNS:
        return {}
    by_objective = {}
    for objective in objectives:
        y = table[objective][good]
        if np.ptp(y) == 0:
            continue
        rng = np.random.default_rng(1)
        by_objective[objective] = {name: index_of(table[name][good], y, rng) for name in names}
    return by_objective


def index_of(x: Floats, y: Floats, rng: np.random.Generator) -> Index:
    """The index of y (designs,) by the variable x (designs,), with its interval from repeated draws
    of half of the designs."""
    halves = [rng.choice(len(x), size=len(x) // 2) for _ in range(RESAMPLES)]
    scatter = np.std([first_order(x[half], y[half]) for half in halves], ddof=1)
    return Index(first_order(x, y), float(SIGMAS_OF_95_PERCENT * scatter))


def first_order(x: Floats, y: Floats) -> float:
    """Fraction of the variance of y that x causes, by RBD-FAST.

    The designs are ordered as a cycle: x rises over every second design and falls over the others.
    The part of y that depends on x is then in the first harmonics of its spectrum (Plischke 2010,
    doi:10.1016/j.ress.2009.11.005). The part that is there by chance is subtracted (Tissot and
    Prieur 2012, doi:10.1016/j.ress.2012.06.010).
    """
    order = np.argsort(x)
    cycle = y[np.concatenate([order[::2], order[1::2][::-1]])]
    power = np.abs(np.fft.rfft(cycle - cycle.mean())[1:]) ** 2
    if len(y) % 2 == 0:
        power[-1] /= 2  # The highest frequency occurs once in a spectrum, the others twice.
    fraction, chance = power[:HARMONICS].sum() / power.sum(), 2 * HARMONICS / len(y)
    return float(fraction - chance / (1 - chance) * (1 - fraction))
