"""The model at single states as interpreted Python, where compiling would take longer.

The first state takes most of a second, each further one a millisecond. The bits are those of
`row_code`, which has the same operations and the same C library.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import nan
from typing import Any

import numpy as np

from ..core.units import Floats
from ..optics import bench_gradient, bench_light, forward, gradient, parameters
from ..optics.footprint import collimated_slopes, footprint
from ..optics.forward import Geometry, dark_scene, power_derivative, replace_power
from ..scalars.dual import value_and_slope
from ..scalars.nesting import leaves, nest
from . import evaluators
from .blocks import task_of
from .packing import carry_slopes

State = tuple[float, ...]

#: Time for which a process interprets the text before it compiles code; the text of a slow state
#: takes a hundredth of a second.
MAX_TEXT_S = 1.0
#: Most states, and most slow states, that are computed by text in one call.
MAX_TEXT_STATES, MAX_SLOW_STATES = 300, 30
_spent = 0.0


def readings(geometry: Geometry, state: State) -> list[float]:
    text = bench_light if geometry.light.options.on else forward
    return list(leaves(text.readings(geometry, state)))


def derivatives(geometry: Geometry, state: State) -> list[Sequence[float]]:
    """Return the Jacobian at a state; NaN where there is no reading."""
    text = bench_gradient if geometry.light.options.on else gradient
    return rows_of(text.linearise(geometry, state))


def approximate_derivatives(geometry: Geometry, state: State) -> list[Sequence[float]]:
    """Under real light, return what `bench_gradient.linearise_nearly` gives."""
    return rows_of(bench_gradient.linearise_nearly(geometry, state))


def rows_of(detectors: Any) -> list[Sequence[float]]:
    return [
        row if value == value else [nan] * len(row)
        for values, rows in detectors
        for value, row in zip(values, rows, strict=True)
    ]


def footprints(geometry: Geometry, state: State) -> list[Sequence[float]]:
    at = dark_scene(geometry, state)
    return [footprint(geometry, at, k, collimated_slopes(geometry, at, k)) for k in range(3)]


FORMULAS: dict[str, Callable[[Geometry, State], Any]] = {
    function.__name__: function
    for function in (readings, derivatives, approximate_derivatives, footprints)
}


def has_time() -> bool:
    """Whether this process has interpreted text for less time than compiling would take."""
    return _spent < MAX_TEXT_S


def is_text_faster(model: str, count: int, few: int = MAX_TEXT_STATES) -> bool:
    """Whether interpreting these states takes less time than compiling one of `evaluators`."""
    return count <= few and has_time() and not evaluators.is_ready(model)


@contextmanager
def count_text_time() -> Iterator[None]:
    """Count the time of a context that interprets text; raise where compiled code would give
    NaN."""
    global _spent
    begin = time.thread_time()
    try:
        # The first call builds the tables of the text.
        with np.errstate(all="raise", under="ignore"):
            yield
    finally:
        _spent += time.thread_time() - begin


def fill_each(formula: Callable[[State], Any], states: Floats, found: Floats, which: Any) -> Any:
    """Fill some rows of `found` for states (n, 8) and return the numbers of the rows that remain:
    those at which the text divides by zero or a C function has no result."""
    left = []
    for n in which.tolist():
        try:
            with count_text_time():
                found[n] = formula(tuple(states[n].tolist()))
        except (ArithmeticError, ValueError):
            left.append(n)
    return np.array(left, int)


def fill(
    name: str, model: str, geometry: Geometry, states: Floats, found: Floats, which: Any
) -> Any:
    """Run `fill_each` for a kernel of blocks; all rows remain where `evaluators` is faster."""
    if not is_text_faster(model, len(which)):
        return which
    formula = FORMULAS[task_of(name)]
    return fill_each(lambda state: formula(geometry, state), states, found, which)


def fill_slopes(
    name: str, vectors: Geometry, moved: Any, states: Floats, found: Floats, which: Any
) -> Any:
    """Run `fill_each` for the kernels of `blocks.slopes`.

    moved: the vectors with their derivatives; for "slopes_by_parameters", `parameters.Axes`.
    """
    if not is_text_faster(name, len(which), MAX_SLOW_STATES):
        return which
    if isinstance(moved, parameters.Axes):
        own = partial(parameters.linearise, vectors, moved)
        return fill_each(lambda state: rows_of(own(state)), states, found, which)
    carrying = carry_slopes(
        vectors, nest(moved, (value_and_slope(number)[1] for number in leaves(moved)))
    )

    def slopes(state: State) -> list[Any]:
        found = bench_gradient.reading_slopes(carrying, state, bench_light.scene(vectors, state))
        return [row for rows in found for row in rows]

    return fill_each(slopes, states, found, which)


def fill_linearisation(geometry: Geometry, exact: bool, x: Floats, found: Floats) -> None:
    """Fill found (10, 10) as `row_code.write_linearisation` or `write_exact_linearisation` does."""
    *state, power = x[:9].tolist()
    powered, lit = replace_power(geometry, power), geometry.light.options.on
    text = bench_gradient if lit else gradient
    formula = text.linearise if exact or not lit else bench_gradient.linearise_nearly
    put_linearisation(powered, formula(powered, tuple(state)), found)


def put_linearisation(geometry: Geometry, detectors: Any, found: Any) -> None:
    """Put the values in the first row of found (10, 10), then each one's derivatives by the eight
    components of the state and the beam's power."""
    lit = geometry.light.options.on
    for k in range(3):
        values, rows = detectors[k]
        for i in range(3):
            n = 3 * k + i
            found[0, n] = values[i]
            for c in range(8):
                found[1 + n, c] = rows[i][c]
            found[1 + n, 8] = 0.0 if i < 2 else values[i] / geometry.power
            if lit:
                found[1 + n, 8] = power_derivative(geometry, values, k, i)
