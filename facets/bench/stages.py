"""Time of a pose by stage: the chain compiled up to each stage, and its innermost integral.

Importing this imports Numba.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from math import erf, erfc, exp, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from ..model import blocks, kernels
from ..model.block_code import LaneWrite, each_block
from ..model.jit import compiler
from ..model.packing import vectors_of
from ..optics.central import side_central
from ..optics.forward import Geometry, dark_scene, illuminate, readings
from ..optics.gradient import linearise
from ..optics.wedge import swept_series
from ..scalars.lanes import LaneWriter
from ..scalars.nesting import leaves

Array = Any

compiled = compiler(__file__, calls=(kernels,))


def stage_code(formula: Callable[[LaneWriter, Any, tuple[Any, ...]], Iterable[Any]]) -> LaneWrite:
    """Make block code that writes one sum of numbers per pose."""

    def write(code: LaneWriter, vectors: Geometry, states: Any, found: Any) -> None:
        state = tuple(code.load_rows(states, 8, 8))
        total: Any = 0.0
        for number in formula(code, vectors, state):
            total = total + number
        code.store_lanes(total, found, 0)

    return each_block(write, lambda code, pointer: vectors_of(code, pointer, "plain"), 1)


def special(code: LaneWriter, vectors: Geometry, state: tuple[Any, ...]) -> Iterator[Any]:
    """Evaluate only the functions of three edges, which all readings need: a Gaussian of the point;
    of each edge a Gaussian, two error functions, a triangle's mass, a root and an arc tangent; of
    each angle its sine and cosine."""
    q = state[:2]
    for k in range(3):
        a, h, angle = state[k], state[k + 1], state[3 + k]
        yield from side_central(q, a, h)
        yield code.function("sqrt", a * a + angle)
        yield code.function("atan2", a, h)
        yield code.function("sin", angle) + code.function("cos", angle)


#: The functions alone, of inputs that need no computation: the least time of the stages below.
FLOOR = "functions of three edges alone"
#: Stages in the order of the chain; each includes the one before.
CHAIN: dict[str, Callable[[LaneWriter, Any, tuple[Any, ...]], Iterable[Any]]] = {
    "mirror turned; its edges seen along the beam": lambda code, vectors, state: leaves(
        (dark_scene(vectors, state).q, dark_scene(vectors, state).sides)
    ),
    "special functions of three edges": lambda code, vectors, state: leaves(
        illuminate(dark_scene(vectors, state)).integrals
    ),
    "mass; centroid and covariance on three facets": lambda code, vectors, state: leaves(
        illuminate(dark_scene(vectors, state)).moments
    ),
    "three rays to the detectors": lambda code, vectors, state: leaves(readings(vectors, state)),
    "their 72 derivatives": lambda code, vectors, state: leaves(linearise(vectors, state)),
}


@cache
def stage(name: str) -> Callable[[Array, Array, Array], None]:
    """The floor, or a part of the chain, as a function of arrays: a sensor's vectors, (n, 8)
    states, (n,) results; n in blocks."""
    formula = special if name == FLOOR else CHAIN[name]
    number = [FLOOR, *CHAIN].index(name)
    code = blocks.lane_code(
        f"stage_{number}", blocks.lanes(), 5, lambda: stage_code(formula), Path(__file__)
    )

    def work(vectors: Array, states: Array, out: Array) -> None:
        count = len(states) // blocks.lanes()
        left = np.empty(count, np.int64)
        code(*map(blocks.address_of, (vectors, states, out, left)), count)

    return work


@compiled
def evaluate_series(points: Array, out: Array) -> None:
    """Integrate over a side's sweep by the optics' series; points (n, 2): a, h."""
    for n in range(len(points)):
        a, h = points[n, 0], points[n, 1]
        along, across = exp(-a * a / 2), exp(-h * h / 2)
        out[n] = swept_series(a, h, along, across, erfc(a / sqrt(2.0)), erf(h / sqrt(2.0)))


@compiled
def evaluate_quadrature(points: Array, nodes: Array, weights: Array, out: Array) -> None:
    """Integrate the same by Gauss-Legendre; nodes on 0..1."""
    for n in range(len(points)):
        a, h = points[n, 0], points[n, 1]
        wide = abs(a) >= abs(h)
        larger, smaller = (a, h) if wide else (h, a)
        x, t = larger * larger / 2, smaller / larger
        total = 0.0
        for i in range(len(nodes)):
            around = 1 + (t * nodes[i]) ** 2
            total += weights[i] * (1 - exp(-x * around)) / around
        total *= t / (2 * pi)
        within = erf(h / sqrt(2.0))
        out[n] = erfc(a / sqrt(2.0)) * within / 4 + total if wide else within / 4 - total


def evaluate_library(points: Array, out: Array) -> None:
    """Compute the same by SciPy's Owen's T (Patefield and Tandy)."""
    from scipy import special

    a, h = points.T
    wide = np.abs(a) >= np.abs(h)
    larger, t = np.where(wide, a, h), np.where(wide, h / a, a / h)
    total = np.arctan(t) / (2 * pi) - special.owens_t(larger, t)
    within = special.erf(h / sqrt(2.0))
    out[:] = np.where(wide, special.erfc(a / sqrt(2.0)) * within / 4 + total, within / 4 - total)
