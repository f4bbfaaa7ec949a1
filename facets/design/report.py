"""What a layout's objective means, and how it would change with the fixed quantities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..core.sensor import Sensor
from ..core.units import Floats
from .problem import problem_of
from .search import solve_from

if TYPE_CHECKING:
    from ..core.layout import Layout


#: By aim, what an objective stands for, and this quantity from the number that is minimised.
QUANTITIES: dict[str, tuple[str, Callable[[float], float]]] = {
    "resolution": ("worst uncertainty", lambda square: max(square, 0.0) ** 0.5),
    "mean-resolution": ("root mean square uncertainty", lambda square: max(square, 0.0) ** 0.5),
    "range": ("times the volume", lambda negative: -negative),
    "condition": ("worst condition number", lambda exponent: 10.0**exponent),
    "weighted": ("weighted sum", lambda value: value),
    "size": ("head, mm", lambda share: 100 * share),
}


def objective_quantity(aim: str, objective: float) -> float:
    """The quantity that an objective stands for, in the unit that is printed."""
    return QUANTITIES[aim][1](objective)


def objective_text(aim: str, objective: float) -> str:
    """Describe an objective in words."""
    number = f"{objective_quantity(aim, objective):.4g}"
    if aim in ("resolution", "mean-resolution"):
        return f"{QUANTITIES[aim][0]} {number} of the requested units"
    if aim == "range":
        return f"a volume {number} times as large in each axis"
    if aim == "size":
        return f"a head of {number} mm"
    return f"{QUANTITIES[aim][0]} {number}"


def gains(
    sensor: Sensor,
    layout: Layout,
    best: Floats,
    constant: float = 0.0,
    spare: Floats | None = None,
) -> dict[str, float]:
    """Return the objective with each fixed quantity slightly larger, solved again from the optimum.

    constant: the term of the parts' price in it.  spare: the least values of the constraints.
    """
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
    objectives = {}
    for what, (other, asked) in tried.items():
        problem = problem_of(other, asked, constant)
        result = solve_from(problem.replace_spare(spare), best)
        if result.found:
            objectives[what] = result.objective
    return objectives
