"""The best layout by casadi alone, with its own derivatives of all constraints at once.

The first method of `facets optimize`, kept for comparison and as an optimum that shares neither
derivatives nor the choice of constraints with the present one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.layout import Layout
from ..core.names import FINE_UNITS
from ..core.sensor import Sensor
from ..core.units import Floats
from ..design.spots import ellipse_clearances
from ..design.variables import heads_of, layout_parameters, present_values
from ..design.volume import states_of
from ..optics.forward import build_geometry, dark_scene
from ..optics.gradient import linearise


def outcome(sensor: Sensor) -> Any:
    """The casadi function (parameters (30), sizes (3), state (8)) -> variances (6), powers (3) and
    `ellipse_clearances` (12), for simple noise.  sizes: of the detectors, square, mm."""
    import casadi as ca

    p, sizes, s = (ca.SX.sym(name, count) for name, count in (("p", 30), ("d", 3), ("s", 8)))
    fixed, state = build_geometry(tuple(p[i] for i in range(30))), tuple(s[i] for i in range(8))
    detectors = linearise(fixed, state)
    rows = []
    for values, derivatives in detectors:
        place = sensor.noise.position * sensor.noise.at_power / values[2]
        for slopes, sigma in zip(derivatives, (place, place, sensor.noise.power), strict=True):
            scaled = [d * unit / sigma for d, unit in zip(slopes, FINE_UNITS, strict=True)]
            rows.append(ca.horzcat(*scaled))
    matrix = ca.vertcat(*rows)
    information = ca.mtimes(matrix.T, matrix)
    inverse = ca.solve(information, ca.SX.eye(8))
    variances, powers = [inverse[i, i] for i in range(6)], [values[2] for values, _ in detectors]
    spots = ellipse_clearances(fixed, dark_scene(fixed, state), [sizes[k] for k in range(3)])
    return ca.Function("outcome", [p, sizes, s], [ca.vertcat(*variances, *powers, *spots)])


class CasadiLayout:
    """The problem of `aim: resolution` with a largest head, from `build` on."""

    def __init__(self, sensor: Sensor, layout: Layout) -> None:
        import casadi as ca

        self.names = list(layout.variables)
        self.low, self.high = np.array([layout.variables[name] for name in self.names]).T
        count = len(self.names)
        unknown = ca.MX.sym("x", count + 1)
        x = [self.low[i] + (self.high[i] - self.low[i]) * unknown[i] for i in range(count)]
        parameters, sizes = layout_parameters(sensor, self.names, x)
        states = np.array(states_of(layout, 1.0), dtype=float).T
        found = outcome(sensor).map(states.shape[1])(
            ca.repmat(ca.vertcat(*parameters), 1, states.shape[1]),
            ca.repmat(ca.vertcat(*sizes), 1, states.shape[1]), states,
        )  # fmt: skip
        half = float(np.mean([psd.size_z for psd in sensor.psds])) / 2
        kept = [ca.vec(found[6:9, :] / layout.least_power - 1)]
        kept.append(ca.vec(found[9:, :] / half))
        kept.append(1 - ca.vertcat(*heads_of(parameters)) / layout.head)
        kept += [unknown[count] - found[i, :].T / layout.unit[i] ** 2 for i in range(6)]
        options: dict[str, Any] = {
            "ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-8,
            "ipopt.bound_relax_factor": 0.0,
        }  # fmt: skip
        problem = {"x": unknown, "f": unknown[count], "g": ca.vertcat(*kept)}
        self.solver = ca.nlpsol("layout", "ipopt", problem, options)
        now = present_values(sensor)
        self.start = np.clip([now[name] for name in self.names], self.low, self.high)

    def solve(self) -> tuple[Floats, float]:
        """Return the variables, and the square of the worst uncertainty over its unit."""
        shares = (self.start - self.low) / (self.high - self.low)
        found = self.solver(
            x0=np.append(shares, 100.0), lbx=0.0, ubx=np.append(np.ones(len(shares)), np.inf),
            lbg=0.0, ubg=np.inf,
        )  # fmt: skip
        x = self.low + (self.high - self.low) * np.array(found["x"]).ravel()[:-1]
        return x, float(found["f"])
