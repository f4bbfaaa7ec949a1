"""The best layout over a volume, by casadi's IPOPT on the model's own text.

Over the corners, the middles of the faces and the centre of the volume, the largest of what is
asked for is pushed down by a slack variable (minimax); what must be kept are constraints with
names, so that what holds the optimum back, or what can not be met, is told in words. Where parts
come from a catalogue, every choice of them is tried.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.names import FINE_UNITS, POSE
from ..core.sensor import Sensor
from .variables import Outcome, heads_of, outcome, present, varied

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..core.settings import Layout

Floats = NDArray[np.float64]

#: A multiplier smaller than this, over the largest, holds nothing back.
ACTIVE = 1e-4
#: What is asked of a solution: IPOPT's own tolerance, and how far a constraint may be off.
TOLERANCE, OFF = 1e-8, 1e-6
EDGES = ("-y", "+y", "-z", "+z")


@dataclass(frozen=True)
class Limit:
    """One constraint: what it is about, its value, and below which it must not fall, scaled."""

    group: str
    value: Any


@dataclass
class End:
    """Where a start ended.

    x: the variables, in the units of their names.  objective: see `in_words`.
    pressing: how much each group of constraints presses, over the largest; those that do.
    missing: by how much a group can not be met, where the requirement is infeasible; its own units.
    """

    start: Floats
    x: Floats
    objective: float
    found: bool
    status: str
    seconds: float
    pressing: dict[str, float] = field(default_factory=dict)
    missing: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Choice:
    """Parts from the catalogue, "" where it has none of the kind.  price: of three detectors and
    the laser, None where one is not known."""

    psd: str
    laser: str
    price: float | None


@dataclass(frozen=True)
class Optimum:
    """All ends, the best first.  names: of the variables.  before: the objective as it was, or NaN
    where the sensor did not keep the constraints.  sensor: with the best of the parts.  tried: each
    choice of parts and where it ended, the best first; empty without a catalogue."""

    names: list[str]
    ends: list[End]
    before: float
    sensor: Sensor
    tried: list[tuple[Choice, End]] = field(default_factory=list)

    @property
    def best(self) -> End:
        return self.ends[0]


def shares_of_volume() -> Floats:
    """Places in the volume, -1 to 1: corners of the pose and of the offset, faces, centre."""
    corners = np.array(list(product((-1.0, 1.0), repeat=6)))
    offsets = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    with_offset = np.concatenate(
        [
            np.column_stack([corners, np.broadcast_to(o, (64, 2))])[n::4]
            for n, o in enumerate(offsets)
        ]
    )
    faces = np.concatenate([np.eye(8), -np.eye(8)])
    return np.unique(np.concatenate([with_offset, faces, np.zeros((1, 8))]), axis=0)


def states_of(layout: Layout, scale: Any) -> list[Any]:
    """States (8,) over the volume, `scale` times as large; symbols where scale is one."""
    states = []
    for share in shares_of_volume():
        pose = [float(s * w) * scale for s, w in zip(share[:6], layout.volume[:6], strict=True)]
        offset = [float(s * w) * scale for s, w in zip(share[6:], layout.volume[6:], strict=True)]
        beam = [pose[0] + offset[0], pose[1] + offset[1]] if layout.following else offset
        states.append([*pose, *beam])
    return unique(states) if isinstance(scale, float) else states


def unique(states: list[Any]) -> list[Any]:
    return [list(row) for row in np.unique(np.array(states, dtype=float), axis=0)]


#: What the slack of an aim, or the scale of the volume, starts from; for an aim that needs one.
GUESS = {"resolution": 100.0, "condition": 10.0, "size": 100.0, "range": 0.3}


class Problem:
    """The problem as casadi takes it: variables x and, last, slacks and the scale, by their aim."""

    def __init__(self, sensor: Sensor, layout: Layout) -> None:
        import casadi as ca

        self.sensor, self.layout = sensor, layout
        self.names = list(layout.variables)
        if sensor.electronics is not None or sensor.apertures.cut:
            raise InputError(
                "facets optimize knows neither sensor.apertures nor `noise.model: electronics`; "
                "leave them out to find a layout, then see what they change by facets resolution"
            )
        if sensor.calibration is not None:
            raise InputError(
                "sensor.calibration belongs to a rig that stands, not to a layout to be found; "
                "leave it out"
            )
        if not self.names:
            raise InputError("optimize.variables is empty: nothing may change")
        self.low = np.array([layout.variables[name][0] for name in self.names])
        self.high = np.array([layout.variables[name][1] for name in self.names])
        self.width = self.high - self.low
        self.extras = [aim for aim in GUESS if aim in layout.aims]
        self.unknown = ca.MX.sym("x", len(self.names) + len(self.extras))
        x = [self.low[i] + self.width[i] * self.unknown[i] for i in range(len(self.names))]
        extra = {aim: self.unknown[len(self.names) + n] for n, aim in enumerate(self.extras)}
        parameters, sizes = varied(sensor, self.names, x)
        states = states_of(layout, extra.get("range", 1.0))
        columns = [ca.vertcat(*state) for state in states]
        self.count = len(columns)
        function = outcome(sensor).map(self.count)
        prior = 0.0
        results = function(
            ca.repmat(ca.vertcat(*parameters), 1, self.count),
            ca.repmat(ca.vertcat(*sizes), 1, self.count),
            ca.horzcat(*columns),
            prior,
        )
        self.limits = self.kept(results, parameters, sizes)
        self.objective = self.wanted(results, parameters, extra)

    def kept(self, results: Any, parameters: Any, sizes: Any) -> list[Limit]:
        """What every layout must keep: each value at least zero, all of order one."""
        import casadi as ca

        layout, kept = self.layout, []
        power = results[Outcome.POWERS, :].T / layout.least_power - 1
        kept.append(Limit("power on a detector", column(power)))
        half = np.mean([size for size in sizes if isinstance(size, float)] or [1.0]) / 2
        for k, letter in enumerate("ABC"):
            for e, edge in enumerate(EDGES):
                room = results[Outcome.ROOM.start + 4 * k + e, :].T / half
                kept.append(Limit(f"spot on PSD {letter}, {edge} edge", room))
        for i, name in enumerate(POSE):
            limit = layout.limit[i]
            if np.isfinite(limit):
                fine = 1 - results[i, :].T / limit**2
                kept.append(Limit(f"uncertainty of {name}", fine))
        if np.isfinite(layout.head):
            heads = ca.vertcat(*heads_of(parameters))
            kept.append(Limit("size of the head", 1 - heads / layout.head))
        return kept

    def wanted(self, results: Any, parameters: Any, extra: dict[str, Any]) -> Any:
        """What is made small: the sum of the aims by their weights.

        For the worst of something, its parts become constraints below the slack.
        """
        weights = self.layout.aims
        if weights.keys() & {"resolution", "mean-resolution"}:
            axes = [i for i in range(6) if np.isfinite(self.layout.unit[i])]
            if not axes:
                raise InputError("optimize.unit names no axis: there is nothing to be made fine")
            parts = {i: results[i, :].T / self.layout.unit[i] ** 2 for i in axes}
        costs = {}
        if "resolution" in weights:
            for i, part in parts.items():
                what = f"uncertainty of {POSE[i]} as low as it can be"
                self.limits.append(Limit(what, extra["resolution"] - part))
            costs["resolution"] = extra["resolution"]
        if "mean-resolution" in weights:
            costs["mean-resolution"] = total(parts.values()) / (len(parts) * self.count)
        if "size" in weights:
            for head in heads_of(parameters):
                what = "size of the head as low as it can be"
                self.limits.append(Limit(what, extra["size"] - head / 100))
            costs["size"] = extra["size"]
        if "condition" in weights:
            decades = log10(results[Outcome.CONDITION, :].T) / 2
            what = "conditioning as good as it can be"
            self.limits.append(Limit(what, extra["condition"] - decades))
            costs["condition"] = extra["condition"]
        if "range" in weights:
            costs["range"] = -extra["range"]
        if self.layout.aim != "weighted":
            return costs[self.layout.aim]
        for squared in costs.keys() & {"resolution", "mean-resolution"}:
            costs[squared] = costs[squared] ** 0.5  # what is added up is uncertainty, not variance
        return sum(weights[aim] * cost for aim, cost in costs.items())

    def solver(self) -> Any:
        import casadi as ca

        options: dict[str, Any] = {
            "ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": TOLERANCE,
            "ipopt.max_iter": 300, "ipopt.bound_relax_factor": 0.0,
            "ipopt.hessian_approximation": "exact", "error_on_fail": False,
        }  # fmt: skip
        constraints = ca.vertcat(*[limit.value for limit in self.limits])
        problem = {"x": self.unknown, "f": self.objective, "g": constraints}
        return ca.nlpsol("layout", "ipopt", problem, options)

    def elastic(self) -> Any:
        """By how much each group has to give way: the least sum of shortfalls, one a group."""
        import casadi as ca

        shortfall = ca.MX.sym("e", len(self.limits))
        parts = [limit.value + shortfall[n] for n, limit in enumerate(self.limits)]
        problem = {
            "x": ca.vertcat(self.unknown, shortfall),
            "f": ca.sum1(shortfall),
            "g": ca.vertcat(*parts),
        }
        options: dict[str, Any] = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
        return ca.nlpsol("elastic", "ipopt", problem, options)

    def first_guess(self, start: Floats) -> Floats:
        """The unknowns at a start: the slack above what it has to be above, the scale small."""
        return np.append((start - self.low) / self.width, [GUESS[aim] for aim in self.extras])

    def bounds(self) -> tuple[Floats, Floats]:
        low, high = np.zeros(self.unknown.numel()), np.ones(self.unknown.numel())
        high[len(self.names) :] = np.inf
        return low, high


def column(values: Any) -> Any:
    """A matrix of symbols as one column."""
    import casadi as ca

    return ca.reshape(values, values.numel(), 1)


def total(columns: Any) -> Any:
    import casadi as ca

    return ca.sum1(ca.vertcat(*columns))


def log10(value: Any) -> Any:
    import casadi as ca

    return ca.log(value) / np.log(10)


def starts_of(problem: Problem, layout: Layout) -> Floats:
    """The sensor as it is, and others drawn within the bounds."""
    now = present(problem.sensor)
    first = np.clip([now[name] for name in problem.names], problem.low, problem.high)
    rng = np.random.default_rng(layout.seed)
    others = problem.low + problem.width * rng.random((layout.starts - 1, len(problem.names)))
    return np.concatenate([first[None], others])


def optimize(sensor: Sensor, layout: Layout) -> Optimum:
    """The best of several starts. Raises `InputError` where nothing is asked for.

    With a catalogue each choice of parts is tried from the sensor as it is, and the best of them
    from all starts.
    """
    tried: list[tuple[Choice, End]] = []
    problem = Problem(sensor, layout)
    solver = problem.solver()
    before = objective_at(problem, solver)
    if layout.psds or layout.lasers:
        made = dict(choices(sensor, layout))
        tried = [(choice, alone(other, layout)) for choice, other in made.items()]
        tried.sort(key=lambda pair: (not pair[1].found, pair[1].objective, pair[0].price or 0))
        problem = Problem(made[tried[0][0]], layout)
        solver = problem.solver()
    ends = [ended(problem, solver, start) for start in starts_of(problem, layout)]
    ends.sort(key=lambda end: (not end.found, end.objective))
    if not ends[0].found:
        ends[0].missing = shortfalls(problem, ends[0])
    return Optimum(problem.names, ends, before, problem.sensor, tried)


def choices(sensor: Sensor, layout: Layout) -> Iterator[tuple[Choice, Sensor]]:
    """Every choice of parts and the sensor with it."""
    for psd, laser in product(layout.psds or [""], layout.lasers or [""]):
        made, prices = sensor, []
        if psd:
            part = layout.psds[psd]
            prices.append(None if part.price is None else 3 * part.price)
            a, b, c = (replace(p, size_y=part.size, size_z=part.size) for p in made.psds)
            position = made.noise.position if part.position is None else part.position
            made = replace(made, psds=(a, b, c), noise=replace(made.noise, position=position))
        if laser:
            source = layout.lasers[laser]
            prices.append(source.price)
            beam = replace(made.beam, power=source.power)
            if "diameter_mm" not in layout.variables:  # else a telescope makes it
                beam = replace(beam, diameter_x=source.diameter, diameter_y=source.diameter)
            made = replace(made, beam=beam)
        known = [price for price in prices if price is not None]
        yield Choice(psd, laser, sum(known) if len(known) == len(prices) else None), made


def alone(sensor: Sensor, layout: Layout) -> End:
    """Where the sensor as it is ends."""
    problem = Problem(sensor, layout)
    return ended(problem, problem.solver(), starts_of(problem, layout)[0])


def ended(problem: Problem, solver: Any, start: Floats) -> End:
    begin = time.perf_counter()
    low, high = problem.bounds()
    found = solver(x0=problem.first_guess(start), lbx=low, ubx=high, lbg=0.0, ubg=np.inf)
    unknowns = np.array(found["x"]).ravel()
    values, pull = np.array(found["g"]).ravel(), np.abs(np.array(found["lam_g"]).ravel())
    return End(
        start=start,
        x=problem.low + problem.width * unknowns[: len(problem.names)],
        objective=float(found["f"]),
        found=bool(solver.stats()["success"]) and bool(values.min() > -OFF),
        status=str(solver.stats()["return_status"]).replace("_", " ").lower(),
        seconds=time.perf_counter() - begin,
        pressing=pressing_of(problem, pull, np.array(found["lam_x"]).ravel(), unknowns),
    )


def pressing_of(
    problem: Problem, pull: Floats, sides: Floats, unknowns: Floats
) -> dict[str, float]:
    """How much each group presses, over the largest: constraints, and ends of the variables."""
    sums: dict[str, float] = {}
    place = 0
    for limit in problem.limits:
        count = limit.value.numel()
        sums[limit.group] = float(pull[place : place + count].sum())
        place += count
    for i, name in enumerate(problem.names):
        side = "least" if unknowns[i] < 0.5 else "most"
        sums[f"{name} at its {side}"] = abs(float(sides[i]))
    top = max(sums.values(), default=0.0)
    found = {name: size / top for name, size in sums.items() if top and size > ACTIVE * top}
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def shortfalls(problem: Problem, end: End) -> dict[str, float]:
    """Groups that can not all be kept, and by what share of their limit each would have to give."""
    solver = problem.elastic()
    low, high = problem.bounds()
    count = len(problem.limits)
    found = solver(
        x0=np.append(problem.first_guess(end.start), np.ones(count)),
        lbx=np.append(low, np.zeros(count)),
        ubx=np.append(high, np.full(count, np.inf)),
        lbg=0.0,
        ubg=np.inf,
    )
    short = np.array(found["x"]).ravel()[-count:]
    found = {}
    for limit, gap in zip(problem.limits, short.tolist(), strict=True):
        squared = limit.group.startswith("uncertainty")  # which is kept by its square
        if gap > 1e-4:
            found[limit.group] = np.sqrt(1 + gap) - 1 if squared else gap
    return found


def objective_at(problem: Problem, solver: Any) -> float:
    """The objective of the sensor as it is, its variables held; NaN where it can not be."""
    now = present(problem.sensor)
    start = np.array([now[name] for name in problem.names])
    fixed = (start - problem.low) / problem.width
    (low, high), count = problem.bounds(), len(fixed)
    found = solver(
        x0=problem.first_guess(start),
        lbx=np.append(fixed, low[count:]),
        ubx=np.append(fixed, high[count:]),
        lbg=0.0,
        ubg=np.inf,
    )
    values = np.array(found["g"]).ravel()
    return float(found["f"]) if values.min() > -OFF else float("nan")


def gains(sensor: Sensor, layout: Layout, best: Floats) -> dict[str, float]:
    """The objective if what may not vary were a little more, solved again from the optimum."""
    tried: dict[str, tuple[Sensor, Layout]] = {}
    if "size_mm" not in layout.variables and not layout.psds:
        wider = [replace(p, size_y=p.size_y + 1, size_z=p.size_z + 1) for p in sensor.psds]
        larger = replace(sensor, psds=(wider[0], wider[1], wider[2]))
        tried["1 mm more detector"] = (larger, layout)
    if "power_mw" not in layout.variables and not layout.lasers:
        brighter = replace(sensor, beam=replace(sensor.beam, power=1.1 * sensor.beam.power))
        tried["10 % more laser power"] = (brighter, layout)
    if np.isfinite(layout.head):
        tried["10 mm more head"] = (sensor, replace(layout, head=layout.head + 10))
    found = {}
    for what, (other, asked) in tried.items():
        problem = Problem(other, asked)
        end = ended(problem, problem.solver(), best)
        if end.found:
            found[what] = end.objective
    return found


def in_words(aim: str, objective: float) -> str:
    """What an objective means."""
    if aim in ("resolution", "mean-resolution"):
        kind = "worst" if aim == "resolution" else "root mean square"
        return f"{kind} uncertainty {np.sqrt(max(objective, 0.0)):.4g} of the units asked for"
    if aim == "range":
        return f"a volume {-objective:.4g} times as large in each axis"
    if aim == "condition":
        return f"worst condition number {10**objective:.4g}"
    if aim == "weighted":
        return f"weighted sum {objective:.4g}"
    return f"a head of {100 * objective:.4g} mm"


def worst_over(sensor: Sensor, layout: Layout) -> Floats:
    """The largest standard uncertainties (6,) over the volume, um and urad, by the float model."""
    from ..characterization.resolution import Estimator, uncertainties

    states = np.array(states_of(layout, 1.0), dtype=float)
    found = uncertainties(sensor, states, Estimator("", np.inf))
    worst: Floats = found.max(axis=0) / np.array(FINE_UNITS[:6])
    return worst
