"""IPOPT, as casadi ships it, for problems whose values and derivatives are computed here.

This module imports casadi. casadi checks Python's signals occasionally. If a handler raises, casadi
ends the solver and returns its last point as if the search had failed; while it creates or frees a
function, it ignores the exception. `run_interruptibly` therefore calls the handler again.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Any

import casadi as ca  # noqa: TID253
import numpy as np

from ...core.units import Floats
from .expansion import RestrictedProblem

#: IPOPT's own tolerance.
TOLERANCE = 1e-8
#: Initial barrier parameter of a search that starts near the minimum.
NEAR = 1e-5
#: Largest number of steps.
STEPS = 300
#: Signals that interrupt a search.
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


@dataclass(frozen=True)
class SolverResult:
    """IPOPT's result.  limits, bounds: multipliers of the constraints and of the bounds."""

    x: Floats
    objective: float
    success: bool
    status: str
    limits: Floats
    bounds: Floats
    iterations: int


class ArrayFunction(ca.Callback):
    """A casadi function made from a function of arrays.

    rows: length of each input.  shapes: the sparsity of each output.  compute: function from the
    inputs to each output's numbers, column by column.
    """

    def __init__(
        self, name: str, rows: list[int], shapes: list[Any], compute: Callable[..., list[Any]]
    ) -> None:
        super().__init__()
        self.rows, self.shapes, self.compute = rows, shapes, compute
        self.construct(name, {})

    def get_n_in(self) -> int:
        """The number of arguments, for casadi."""
        return len(self.rows)

    def get_n_out(self) -> int:
        """The number of results, for casadi."""
        return len(self.shapes)

    def get_sparsity_in(self, i: int) -> Any:
        """The shape of an argument, for casadi."""
        return ca.Sparsity.dense(self.rows[i], 1)

    def get_sparsity_out(self, i: int) -> Any:
        """The shape of a result, for casadi."""
        return self.shapes[i]

    def has_eval_buffer(self) -> bool:
        """Whether casadi calls `eval_buffer`."""
        return True

    def eval_buffer(self, arguments: Any, results: Any) -> int:
        """Compute the results from buffers of the arguments; returns 0, casadi's code for
        success."""
        inputs = [np.frombuffer(each) if each is not None else np.empty(0) for each in arguments]
        for place, numbers in zip(results, self.compute(*inputs), strict=True):
            if place is not None:
                np.frombuffer(place)[:] = numbers
        return 0


class Pieces:
    """A problem's functions as IPOPT calls them; values and slopes are computed once per point."""

    def __init__(self, problem: RestrictedProblem) -> None:
        self.problem = problem
        self.where: bytes = b""
        n, m = problem.unknowns, problem.constraints
        scalar, dense = ca.Sparsity.dense(1, 1), ca.Sparsity.dense
        self.both = ArrayFunction("both", [n], [scalar, dense(m, 1)], self.values)
        self.slope = ArrayFunction("slope", [n, 0], [scalar, dense(1, n)], self.gradient)
        self.slopes = ArrayFunction("slopes", [n, 0], [dense(m, 1), dense(m, n)], self.jacobian)
        triangle = [ca.Sparsity.upper(n)]
        self.curvature = ArrayFunction("curvature", [n, 0, 1, m], triangle, self.hessian)

    def compute(self, x: Floats) -> None:
        """Evaluate objective and constraints at x, unless that was the last place."""
        if (where := x.tobytes()) != self.where:
            self.cost = self.problem.objective(x)
            self.limits = self.problem.limits(x)
            self.where = where

    def values(self, x: Floats) -> list[Any]:
        """The objective and the constraints."""
        self.compute(x)
        return [self.cost.values, self.limits.values]

    def gradient(self, x: Floats, _: Floats) -> list[Any]:
        """The objective and its slopes."""
        self.compute(x)
        return [self.cost.values, self.cost.slopes[0]]

    def jacobian(self, x: Floats, _: Floats) -> list[Any]:
        """The constraints and their slopes, column by column."""
        self.compute(x)
        return [self.limits.values, self.limits.slopes.T.ravel()]

    def hessian(self, x: Floats, _: Floats, weight: Floats, multipliers: Floats) -> list[Any]:
        """Return the upper triangle of the Lagrangian's Hessian, column by column."""
        self.compute(x)
        hessian_of_sum = self.cost.curvature(weight) + self.limits.curvature(multipliers)
        # the lower triangle of a symmetric matrix by rows is its upper triangle by columns
        return [hessian_of_sum[np.tril_indices(len(x))]]


def minimise(
    problem: RestrictedProblem,
    start: Floats,
    bounds: tuple[Floats, Floats],
    near: bool = False,
    steps: int = STEPS,
) -> SolverResult:
    """Minimise the objective with IPOPT from a start, within bounds.

    near: whether the start is near the minimum.  steps: largest number of steps.
    """
    # creating and freeing a problem swallows a handler's exception, too
    return run_interruptibly(lambda: search(problem, start, bounds, near, steps))


def search(
    problem: RestrictedProblem, start: Floats, bounds: tuple[Floats, Floats], near: bool, steps: int
) -> SolverResult:
    """Minimise as `minimise` does, without handling of interrupts."""
    pieces = Pieces(problem)
    x = ca.MX.sym("x", problem.unknowns)
    f, g = pieces.both(x)
    options: dict[str, Any] = {
        "ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": TOLERANCE,
        "ipopt.max_iter": steps, "ipopt.bound_relax_factor": 0.0, "error_on_fail": False,
        "no_nlp_grad": True, "grad_f": pieces.slope, "jac_g": pieces.slopes,
        "hess_lag": pieces.curvature,
    }  # fmt: skip
    if near:
        options |= {"ipopt.mu_init": NEAR, "ipopt.bound_push": 1e-8, "ipopt.bound_frac": 1e-8}
    solver = ca.nlpsol("layout", "ipopt", {"x": x, "f": f, "g": g}, options)
    end = solver(x0=start, lbx=bounds[0], ubx=bounds[1], lbg=0.0, ubg=np.inf)
    stats = solver.stats()
    return SolverResult(
        x=np.array(end["x"]).ravel(),
        objective=float(end["f"]),
        success=bool(stats["success"]),
        status=str(stats["return_status"]).replace("_", " ").lower(),
        limits=np.abs(np.array(end["lam_g"]).ravel()),
        bounds=np.array(end["lam_x"]).ravel(),
        iterations=int(stats["iter_count"]),
    )


def run_interruptibly(solve: Callable[[], SolverResult]) -> SolverResult:
    """Call a solver and, after an interruption, call the signal's own handler.

    A signal that ends the program at once still ends it.
    """
    if threading.current_thread() is not threading.main_thread():
        return solve()
    signals: list[int] = []

    def interrupt(number: int, _: FrameType | None) -> None:
        """Keep the signal, and interrupt the search."""
        signals.append(number)
        raise KeyboardInterrupt

    numbers = [getattr(signal, name) for name in SIGNALS if hasattr(signal, name)]
    before = {n: signal.getsignal(n) for n in numbers if callable(signal.getsignal(n))}
    try:
        for number in before:
            signal.signal(number, interrupt)
        result = solve()
    except (Exception, KeyboardInterrupt):
        if not signals:
            raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    for number in signals:
        handler = before[number]
        assert callable(handler)
        handler(number, None)
    return result
