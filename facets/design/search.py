"""The best layout over a volume, by casadi's IPOPT from several starts, and why it is no better."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from .catalogue import Choice, choices
from .interruption import run_solver
from .problem import Problem, problem_of
from .variables import present_values

if TYPE_CHECKING:
    from ..core.settings import Layout


#: A multiplier smaller than this, over the largest, holds nothing back.
ACTIVE = 1e-4
#: How far below zero a constraint may be: IPOPT's tolerance, with a margin for its scaling.
SLACK = 1e-6


@dataclass
class StartResult:
    """Where a start ended.

    x: the variables, in the units of their names.  objective: see `report.in_words`.
    active_constraints: the multiplier of each group that holds the result back, over the largest.
    shortfalls: by what share of its limit a group can not be met, where the requirement is
    infeasible.
    """

    start: Floats
    x: Floats
    objective: float
    found: bool
    status: str
    seconds: float
    active_constraints: dict[str, float] = field(default_factory=dict)
    shortfalls: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Optimum:
    """The results of all starts, the best first.

    names: of the variables.  before: the objective as it was, or NaN where the sensor did not keep
    the constraints.  sensor: with the best of the parts.  tried: each choice of parts and where it
    ended, the best first; empty without a catalogue.
    """

    names: list[str]
    results: list[StartResult]
    before: float
    sensor: Sensor
    tried: list[tuple[Choice, StartResult]] = field(default_factory=list)

    @property
    def best(self) -> StartResult:
        return self.results[0]


def optimize(sensor: Sensor, layout: Layout) -> Optimum:
    """The best layout that several starts find.

    sensor: as it is now.  layout: what may vary, the volume, the limits and the aim; a
    configuration's block `optimize`, `Config.layout`.  With a catalogue each choice of parts is
    tried from the sensor as it is, and the best of them from all starts. Where no start keeps all
    limits, `best.found` is false and `best.shortfalls` says which stand against each other.
    Raises `InputError` where nothing may vary, or the sensor has what the problem can not hold.

    >>> from dataclasses import replace
    >>> import facets
    >>> config = facets.load("layout")
    >>> wanted = replace(config.layout, variables={"radius_mm": (150.0, 250.0)}, starts=1)
    >>> found = facets.optimize(config.sensor, wanted)
    >>> found.best.found, f"{found.best.x[0]:.0f} mm"
    (True, '250 mm')
    """
    tried: list[tuple[Choice, StartResult]] = []
    problem = problem_of(sensor, layout)
    solver = problem.solver()
    before = objective_at(problem, solver)
    if layout.psds or layout.lasers:
        made = dict(choices(sensor, layout))
        tried = [(choice, solve_from_present(other, layout)) for choice, other in made.items()]
        tried.sort(key=lambda pair: (not pair[1].found, pair[1].objective, pair[0].price or 0))
        problem = problem_of(made[tried[0][0]], layout)
        solver = problem.solver()
    results = [solve_from(problem, solver, start) for start in starts_of(problem, layout)]
    results.sort(key=lambda result: (not result.found, result.objective))
    if not results[0].found:
        results[0].shortfalls = shortfalls_of(problem, results[0].start)
    return Optimum(problem.names, results, before, problem.sensor, tried)


def starts_of(problem: Problem, layout: Layout) -> Floats:
    """The sensor as it is, and others drawn within the bounds."""
    now = present_values(problem.sensor)
    first = np.clip([now[name] for name in problem.names], problem.low, problem.high)
    rng = np.random.default_rng(layout.seed)
    shares = rng.random((layout.starts - 1, len(problem.names)))
    return np.concatenate([first[None], problem.low + (problem.high - problem.low) * shares])


def solve_from_present(sensor: Sensor, layout: Layout) -> StartResult:
    """Where the sensor as it is ends."""
    problem = problem_of(sensor, layout)
    return solve_from(problem, problem.solver(), starts_of(problem, layout)[0])


def solve_from(problem: Problem, solver: Any, start: Floats) -> StartResult:
    """Where a start (in the units of the variables' names) ends."""
    begin = time.perf_counter()
    low, high = problem.bounds()
    found = run_solver(
        solver, x0=problem.first_guess(start), lbx=low, ubx=high, lbg=0.0, ubg=np.inf
    )
    unknowns = np.array(found["x"]).ravel()
    values, multipliers = np.array(found["g"]).ravel(), np.array(found["lam_g"]).ravel()
    return StartResult(
        start=start,
        x=problem.values_at(unknowns),
        objective=float(found["f"]),
        found=bool(solver.stats()["success"]) and bool(values.min() > -SLACK),
        status=str(solver.stats()["return_status"]).replace("_", " ").lower(),
        seconds=time.perf_counter() - begin,
        active_constraints=active_constraints(
            problem, np.abs(multipliers), np.array(found["lam_x"]).ravel(), unknowns
        ),
    )


def active_constraints(
    problem: Problem, of_limits: Floats, of_bounds: Floats, unknowns: Floats
) -> dict[str, float]:
    """The multipliers, summed by group of constraints and by end of a variable, over the largest;
    those that hold the result back, the strongest first."""
    sums: dict[str, float] = {}
    place = 0
    for limit in problem.limits:
        count = limit.value.numel()
        sums[limit.group] = float(of_limits[place : place + count].sum())
        place += count
    for i, name in enumerate(problem.names):
        end = "least" if unknowns[i] < 0.5 else "most"
        sums[f"{name} at its {end}"] = abs(float(of_bounds[i]))
    top = max(sums.values(), default=0.0)
    found = {name: size / top for name, size in sums.items() if top and size > ACTIVE * top}
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def shortfalls_of(problem: Problem, start: Floats) -> dict[str, float]:
    """Groups that can not all be kept, and by what share of its limit each would have to give."""
    solver = problem.elastic_solver()
    low, high = problem.bounds()
    count = len(problem.limits)
    found = run_solver(
        solver,
        x0=np.append(problem.first_guess(start), np.ones(count)),
        lbx=np.append(low, np.zeros(count)),
        ubx=np.append(high, np.full(count, np.inf)),
        lbg=0.0,
        ubg=np.inf,
    )
    short = np.array(found["x"]).ravel()[-count:]
    shares = {}
    for limit, gap in zip(problem.limits, short.tolist(), strict=True):
        squared = limit.group.startswith("uncertainty")  # which is kept by its square
        if gap > 1e-4:
            shares[limit.group] = np.sqrt(1 + gap) - 1 if squared else gap
    return shares


def objective_at(problem: Problem, solver: Any) -> float:
    """The objective of the sensor as it is, its variables held; NaN where it can not be."""
    now = present_values(problem.sensor)
    guess = problem.first_guess(np.array([now[name] for name in problem.names]))
    (low, high), count = problem.bounds(), len(problem.names)
    low[:count] = high[:count] = guess[:count]
    found = run_solver(solver, x0=guess, lbx=low, ubx=high, lbg=0.0, ubg=np.inf)
    values = np.array(found["g"]).ravel()
    return float(found["f"]) if values.min() > -SLACK else float("nan")
