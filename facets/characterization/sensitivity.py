"""Sobol indices of a design's measures by its variables, from sampled designs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.extras import require_extra


class Index(NamedTuple):
    """A first-order Sobol index, and half the width of its 95 % interval."""

    value: float
    half: float


#: Least number of designs for a meaningful index.
MIN_DESIGNS = 100


def sensitivity(
    table: dict[str, NDArray[Any]], names: list[str], objectives: list[str]
) -> dict[str, dict[str, Index]]:
    """First-order Sobol indices of each objective by each variable, by SALib's RBD-FAST.

    table: columns of completely evaluated designs; impossible designs may be among them. An index
    is an estimate, so that a small one can be below zero, within its interval.
    """
    rbd_fast = require_extra("SALib.analyze.rbd_fast", "the sensitivity")
    good = np.isfinite(table["range_tz_mm"])
    if good.sum() < MIN_DESIGNS:
        return {}
    x = np.stack([table[name][good] for name in names], axis=1)
    bounds = [[float(low), float(high)] for low, high in zip(x.min(0), x.max(0), strict=True)]
    problem = {"num_vars": len(names), "names": names, "bounds": bounds}
    by_objective = {}
    for objective in objectives:
        if np.ptp(table[objective][good]) == 0:
            continue
        result = rbd_fast.analyze(problem, x, table[objective][good], seed=1)
        pairs = zip(result["S1"], result["S1_conf"], strict=True)
        indices = [Index(float(value), float(half)) for value, half in pairs]
        by_objective[objective] = dict(zip(names, indices, strict=True))
    return by_objective
