"""Time of the best layout and of many layouts, compared with SciPy on the float model."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from ..characterization.resolution import uncertainties
from ..config import load
from ..core.knowledge import Knowledge
from ..core.names import FINE_UNITS
from ..core.units import Floats
from ..design.exploration import Space, designs, measure_design
from ..design.problem import problem_of
from ..design.search import solve_from, starts_of
from ..design.variables import sensor_of
from ..design.volume import states_of
from ..model.arrays import half_sizes, margins

Row = dict[str, Any]


def layouts(quick: bool, seed: int) -> list[Row]:
    """Time one start of the shipped `layout`, and designs of the same space with their ranges."""
    config = load("layout")
    names = ["radius_mm", "diameter_mm"] if quick else list(config.layout.variables)
    bounds = {name: config.layout.variables[name] for name in names}
    layout = replace(config.layout, variables=bounds, starts=1)
    seconds, best = optimise_with_facets(config.sensor, layout)
    slow, value = optimise_with_scipy(config.sensor, layout, names)
    space = Space(config.sensor, config.range, config.layout, "sobol", 16 if quick else 64, seed)
    drawn = designs(space)
    measure_design(space, drawn[0])
    each = mean_call_time(lambda x: measure_design(space, x), drawn)
    return [
        row("a start of the best layout by IPOPT", seconds, seconds, best),
        row("the same by SciPy SLSQP with differences", slow, seconds, value),
        row("ranges and resolution of a design", each, each, np.nan),
    ]


def row(what: str, seconds: float, ours: float, value: float) -> Row:
    return {"what": what, "ms": 1e3 * seconds, "ratio": seconds / ours, "objective": float(value)}


def optimise_with_facets(sensor: Any, layout: Any) -> tuple[float, float]:
    """Processor seconds of a start, and the worst uncertainty over its unit, at the same states as
    for the other method."""
    first = problem_of(sensor, layout)
    solve_from(first, starts_of(first, layout)[0])  # compiles
    problem = replace(problem_of(sensor, layout), span=None)
    begin = time.process_time()
    best = solve_from(problem, starts_of(problem, layout)[0])
    return time.process_time() - begin, float(np.sqrt(best.objective))


def mean_call_time(function: Any, drawn: Floats) -> float:
    start = time.perf_counter()
    for x in drawn:
        function(x)
    return (time.perf_counter() - start) / len(drawn)


def optimise_with_scipy(sensor: Any, layout: Any, names: list[str]) -> tuple[float, float]:
    """Processor seconds, and the worst uncertainty over its unit, by SciPy's minimax."""
    from scipy.optimize import minimize

    states = np.array(states_of(layout, 1.0), dtype=float)
    low, high = np.array([layout.variables[name] for name in names]).T

    def make_sensor(shares: Floats) -> Any:
        return sensor_of(sensor, names, low + shares * (high - low))

    def fine(unknown: Floats) -> Floats:
        units = np.array(FINE_UNITS[:6]) * np.array(layout.unit)
        sigma = uncertainties(make_sensor(unknown[:-1]), states, Knowledge()) / units
        below: Floats = np.nan_to_num(unknown[-1] - sigma.max(axis=0), nan=-1e3)
        return below

    def clearance(unknown: Floats) -> Floats:
        here = make_sensor(unknown[:-1])
        edges = margins(here, states)[:, :, :4].reshape(len(states), -1).min(axis=0)
        share: Floats = np.nan_to_num(edges / half_sizes(here)[0, 0], nan=-1.0)
        return share

    begin = np.append(np.full(len(names), 0.5), 5.0)
    fine(begin), clearance(begin)  # compiles
    start = time.process_time()
    optimum = minimize(
        lambda unknown: unknown[-1],
        begin,
        method="SLSQP",
        bounds=[(0, 1)] * len(names) + [(0, None)],
        constraints=[{"type": "ineq", "fun": fine}, {"type": "ineq", "fun": clearance}],
    )
    return time.process_time() - start, float(optimum.x[-1])
