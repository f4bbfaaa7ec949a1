"""Results of a search as the tables that the commands print: headings and rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .changes import changes_of

if TYPE_CHECKING:
    from ...core.sensor import Sensor
    from ...core.settings import Config
    from ..optimisation.rounding import Rounded
    from ..optimisation.search import Optimum

#: Headings and rows of a table.
Rows = tuple[list[str], list[list[str]]]
#: Text for an error of half a rounding step that makes the design break a limit.
BREAKS = "breaks a limit"
#: Last part of a variable's key, if it differs from the variable's name.
KEYS = {"azimuth_b_deg": "azimuth_deg"} | {
    f"{kind}_{letter}_{key}": key
    for kind, keys in (
        ("facet", ("inclination_deg", "azimuth_deg")),
        ("psd", ("radius_mm", "azimuth_deg", "height_mm", "roll_mrad", "pitch_mrad", "yaw_mrad")),
    )
    for letter in "abc"
    for key in keys
}


#: By aim: name of the printed quantity, and its value from the objective that is minimised.
QUANTITIES: dict[str, tuple[str, Callable[[float], float]]] = {
    "resolution": ("worst uncertainty", lambda square: max(square, 0.0) ** 0.5),
    "mean-resolution": ("root mean square uncertainty", lambda square: max(square, 0.0) ** 0.5),
    "range": ("times the volume", lambda negative: -negative),
    "condition": ("worst condition number", lambda exponent: 10.0**exponent),
    "weighted": ("weighted sum", lambda value: value),
    "size": ("head, mm", lambda ratio: 100 * ratio),
}


def objective_quantity(aim: str, objective: float) -> float:
    """The printed quantity of an objective, in its printed unit."""
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


def part_rows(optimum: Optimum, aim: str) -> Rows:
    """Headings and rows of the searched choices of parts."""
    headings = ["detectors", "laser", "amplifiers", "price", "weeks", *optimum.names,
                QUANTITIES[aim][0], "end"]  # fmt: skip
    rows = []
    for choice, end in optimum.tried:
        price = "" if choice.price is None else f"{choice.price:.0f}"
        weeks = "" if choice.delivery is None else f"{choice.delivery:g}"
        values = [f"{value:.4g}" for value in end.x]
        objective = f"{objective_quantity(aim, end.objective):.4g}" if end.found else "-"
        psd, laser, amplifiers = choice.names
        parted = [psd, laser, amplifiers or "-", price, weeks]
        rows.append([*parted, *values, objective, end.status])
    return headings, rows


def start_rows(optimum: Optimum, aim: str) -> Rows:
    """Headings and rows of all starts, the best first."""
    rows = [
        [*(f"{value:.5g}" for value in end.x), f"{objective_quantity(aim, end.objective):.6g}",
         f"{end.seconds:.1f}", end.status]
        for end in optimum.results
    ]  # fmt: skip
    return [*optimum.names, QUANTITIES[aim][0], "seconds", "end"], rows


def change_rows(settings: Config, sensor: Sensor, made: Rounded | None, names: list[str]) -> Rows:
    """Headings and rows of all changed keys, with the effect of an error in each."""
    allowed = roundings(made, names)
    rows = []
    for key, before, after in changes_of(settings, sensor):
        rows.append(
            [key, value_text(before), value_text(after), allowed.get(key.rpartition(".")[2], "")]
        )
    return ["sensor.", "before", "after", "made to"], rows


def value_text(value: Any) -> str:
    """A value as text, floats with seven digits."""
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def roundings(made: Rounded | None, names: list[str]) -> dict[str, str]:
    """Half the rounding step and the effect of an error of this size, by the last part of a key."""
    if made is None:
        return {}
    effects = {}
    for name, step, cost in zip(names, made.steps, made.costs, strict=True):
        if step:
            worse = BREAKS if cost == float("inf") else f"costs up to {cost:.2g} %"
            effects[KEYS.get(name, name)] = f"+- {step / 2:g}, which {worse}"
    return effects


def comparison_rows(table: dict[str, Any]) -> Rows:
    """Headings and rows of a comparison before and after the search."""
    headings = ["quantity", "before", "after", "after / before", "simulated"]
    rows = []
    for quantity, before, after, simulated_value in zip(*table.values(), strict=True):
        simulated = "" if simulated_value != simulated_value else f"{simulated_value:.3g}"
        ratio = f"{after / before:.2f}" if before > 0 < after else ""
        rows.append([str(quantity), f"{before:.3g}", f"{after:.3g}", ratio, simulated])
    return headings, rows
