"""Range maps: time of following the outlines, compared with grids of the same resolution."""

from __future__ import annotations

import time
from itertools import combinations
from typing import Any

import numpy as np

from ..characterization.outlines import trace
from ..characterization.ranges import clearances
from ..core.names import POSE
from ..core.rules import Rules
from . import rivals

Row = dict[str, Any]


def maps(quick: bool, seed: int) -> list[Row]:
    """Time all pairs of axes under a fixed beam, and tx, ty with the beam following.

    The grids' time is extrapolated from a million calls.
    """
    del seed  # nothing is drawn
    pairs = [("tx", "ty"), ("tz", "roll")] if quick else list(combinations(POSE, 2))
    each = seconds_a_call(100_000 if quick else 1_000_000)
    trace(rivals.SENSOR, Rules(), pairs[0])  # compiles, imports
    return [
        *(row(pair, Rules(), "fixed", each) for pair in pairs),
        row(("tx", "ty"), Rules(tracking=True), "following", each),
    ]


def seconds_a_call(count: int) -> float:
    poses = np.zeros((count, 6))
    poses[:, 0] = np.linspace(-0.1, 0.1, count)
    rules = Rules(condition=np.inf)
    clearances(rivals.SENSOR, poses[:1000], rules)
    start = time.perf_counter()
    clearances(rivals.SENSOR, poses, rules)
    return (time.perf_counter() - start) / count


def row(pair: tuple[str, str], rules: Rules, beam: str, each: float) -> Row:
    start = time.perf_counter()
    boundary = trace(rivals.SENSOR, rules, pair)
    seconds = time.perf_counter() - start
    return {
        "axes": " ".join(pair),
        "beam": beam,
        "points": len(boundary.points),
        "calls": boundary.calls,
        "ms": 1e3 * seconds,
        "grid_calls": boundary.grid_calls,
        "grid_hours": boundary.grid_calls * each / 3600,
        "ratio": boundary.grid_calls * each / seconds,
    }
