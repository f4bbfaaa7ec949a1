"""The layout problem of a configuration's block `optimize`, evaluated for many layouts at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError
from ...core.extras import require_extra
from ...core.names import POSE
from ...core.sensor import Sensor
from ...core.units import Floats
from ..requirement import Constraint, head_limits, headrooms, limits_of
from ..spots import ellipse_clearances, rim_clearances
from ..variables import (
    GAIN,
    LayoutValues,
    columns_of_states,
    evaluate_layouts,
    layout_parameters,
    require_variables,
    values_between,
)
from ..volume import mirror_states, span_of, states_of
from .parts import TRIED
from .problem import GUESS, Formula, LayoutProblem, Objective, Rows

if TYPE_CHECKING:
    from ...core.layout import Layout

#: Group of the outputs that are not limited, because their mean over the states is an aim.
AVERAGED = "mean uncertainty"


def refuse_effects(sensor: Sensor, command: str) -> None:
    """Raise `InputError` if the sensor has an effect that the problem ignores."""
    opening = sensor.apertures
    unknown = {
        "beam_ratio": np.isfinite(opening.beam),
        "tip_um": opening.tip > 0,
        "gap_um": opening.gap > 0,
    }
    for key, has_effect in unknown.items():
        if has_effect:
            raise InputError(
                f"facets {command} does not support sensor.apertures.{key}, because only the "
                "facets' edges divide the light in its model; remove the key to find a layout, "
                "then see what it changes by facets resolution (rim_mm and detectors are "
                "supported: no edge cuts a spot or the light on the mirror)"
            )
    if sensor.light.on:
        raise InputError(
            f"facets {command} does not support sensor.light, because its model is that of ideal "
            "light; remove the block to find a layout, then see what it changes by facets "
            "resolution"
        )
    if sensor.calibration is not None:
        raise InputError(
            "sensor.calibration belongs to an existing rig, not to a layout that is searched; "
            "remove it"
        )


def require_unit(layout: Layout) -> None:
    """Raise `InputError` if an aim is an uncertainty and no axis has a unit."""
    if (
        layout.aims.keys() & {"resolution", "mean-resolution"}
        and not np.isfinite(layout.unit).any()
    ):
        raise InputError("optimize.unit names no axis, so that there is no uncertainty to minimise")


def require_noise(sensor: Sensor, layout: Layout, command: str) -> None:
    """Raise `InputError` if the search cannot combine the electronics' noise with the layout."""
    if sensor.electronics is None:
        if GAIN in layout.variables:
            raise InputError(
                f"optimize.variables.{GAIN}: needs sensor.noise.model: electronics, from which the "
                "noise follows"
            )
        return
    if sensor.electronics.kind == "tetra-lateral":
        raise InputError(
            f"facets {command} supports the noise of duo-lateral and pincushion detectors; that of "
            "a tetra-lateral one is a series, too slow for a search: search with "
            "`noise.model: simple`, then see by facets resolution what the electronics change"
        )
    if GAIN in layout.variables and command != "optimize":
        raise InputError(
            f"facets {command} cannot vary {GAIN}, because the least light of a range depends on "
            "it; remove it from optimize.variables"
        )
    detectors_with_noise = [name for name, part in layout.psds.items() if part.position is not None]
    if layout.amplifiers or detectors_with_noise:
        raise InputError(
            "optimize.parts: amplifiers and position_um of detectors state the noise of "
            "`noise.model: simple`, but here the noise follows from sensor.electronics; remove "
            "them, or use the simple model"
        )
    if len(layout.psds) * max(1, len(layout.lasers)) > TRIED:
        raise InputError(
            f"optimize.parts has more than {TRIED} choices: with electronics a larger detector is "
            "noisier, so that no detector is at least as good as all others, on which excluding "
            "choices relies; name fewer parts, or use `noise.model: simple`"
        )


@dataclass(frozen=True)
class LayoutConstraints:
    """The constraints of a configuration's block `optimize`."""

    sensor: Sensor
    layout: Layout

    def constrain(self, unknowns: Floats, states: Floats) -> list[Constraint]:
        """List the constraints of layouts (k, unknowns) at states (m, 8) of the volume."""
        sensor, layout = self.sensor, self.layout
        scale = unknowns[:, len(layout.variables), None, None] if "range" in layout.aims else 1.0
        places = mirror_states(states * scale, layout.object, layout.following)
        names, x = list(layout.variables), values_between(layout.variables, unknowns)
        values = evaluate_layouts(sensor, names, x, columns_of_states(places), layout.object)
        spots, rims = clearances_of(values, sensor.apertures.rim)
        outcome = values.outcome
        return [
            *limits_of(
                layout.least_power,
                layout.limit,
                outcome.powers,
                spots,
                np.sqrt(outcome.variances),
                rims,
            ),
            *headrooms(outcome),
            *head_limits(layout.head, values.heads),
            *objective_constraints(layout.aims, layout.unit, values),
        ]


def clearances_of(values: LayoutValues, rim: float) -> tuple[list[Any], list[Any]]:
    """Clearances of the spots from the detectors' edges, in halves of a detector, and of the light
    from the mirror's rim, if it has one."""
    half, where = half_of(values.sizes), (values.fixed, values.at)
    spots = [each / half for each in ellipse_clearances(*where, values.sizes)]
    return spots, rim_clearances(*where, rim) if np.isfinite(rim) else []


def problem_of(sensor: Sensor, layout: Layout, price: float = 0.0) -> LayoutProblem:
    """Make the problem of a configuration's block `optimize`; raises `InputError`.

    price: the parts' price term of the objective.
    """
    require_extra("casadi", "the search for a layout")
    refuse_effects(sensor, "optimize")
    require_variables(layout)
    require_noise(sensor, layout, "optimize")
    require_unit(layout)
    extras = [aim for aim in GUESS if aim in layout.aims]
    constrain = LayoutConstraints(sensor, layout).constrain
    states = np.array(states_of(layout, 1.0), dtype=float)
    problem = build_problem(sensor, layout.variables, extras, constrain, states)
    aims = {aim: weight for aim, weight in layout.aims.items() if aim != "price"}
    objective = replace(
        problem.objective, aims=aims, weighted=layout.aim == "weighted", price=price
    )
    return replace(
        problem,
        span=span_of(layout),
        objective=objective,
        half=fixed_half(sensor, layout.variables),
    )


def build_problem(
    sensor: Sensor,
    variables: Mapping[str, tuple[float, float]],
    extras: list[str],
    constrain: Callable[[Floats, Floats], list[Constraint]],
    states: Floats,
) -> LayoutProblem:
    """Make a problem without an objective.

    extras: the unknowns that follow the variables, see `LayoutProblem`; those that are ranges are
    arguments of the formula, too.  constrain: function from unknowns (k, n) and states (m, w) to
    the constraints.  states: (m, w) of the constraints.
    """
    names, count = list(variables), len(variables)
    low, high = np.array(list(variables.values())).T
    scales = [count + n for n, aim in enumerate(extras) if aim.startswith("range")]
    places = np.array([*range(count), *scales])
    constraints = constrain(np.full((1, len(places)), 0.5), np.zeros((1, states.shape[1])))
    limiting = [each for each in constraints if each.group != AVERAGED]
    groups = list(dict.fromkeys(each.group for each in limiting))
    # the value of its unknown at which a positive variable is zero
    origin = np.pad(np.where(low > 0, -low / (high - low), np.nan), (0, len(scales)),
                    constant_values=np.nan)  # fmt: skip
    inside = [n for n, each in enumerate(limiting)
              if each.states is None or len(states) - 1 in each.states]  # fmt: skip
    return LayoutProblem(
        sensor, names, low, high, extras,
        Formula(lambda x, points: [each.value for each in constrain(x, points)], origin),
        places, states, groups, rows_of(limiting, groups, extras, count, len(states)),
        Objective({}, averaged=len(limiting), state_count=len(states)), None,
        np.array(inside, dtype=np.int64),
    )  # fmt: skip


def rows_of(
    constraints: list[Constraint], groups: list[str], extras: list[str], variables: int, states: int
) -> Rows:
    """Make a row for each output and state, but one row for an output that is the same at all
    states."""
    rows = [
        (state, output, groups.index(each.group),
         variables + extras.index(each.slack) if each.slack else -1)
        for output, each in enumerate(constraints)
        for state in (range(states) if each.states is None else each.states)
    ]  # fmt: skip
    state, output, group, slack = np.array(rows, dtype=np.int64).T
    return Rows(state, output, group, slack, np.zeros(len(rows)))


def fixed_half(sensor: Sensor, variables: Mapping[str, tuple[float, float]]) -> float:
    """The unit of length of the clearances, mm, if the detectors' size does not vary."""
    names, middle = list(variables), [sum(bounds) / 2 for bounds in variables.values()]
    return half_of([] if "size_mm" in names else layout_parameters(sensor, names, middle)[1])


def half_of(sizes: list[Any]) -> float:
    """The unit of length of the clearances, mm: half of a detector with a fixed size."""
    return float(np.mean([size for size in sizes if isinstance(size, float)] or [1.0])) / 2


def objective_constraints(
    aims: Mapping[str, float], unit: tuple[float, ...], values: LayoutValues
) -> list[Constraint]:
    """Require the quantities of each aim to stay below the aim's slack.

    unit: (6,) the uncertainty of each axis that counts as 1, um and urad.
    """
    outcome = values.outcome
    below, ratios = (
        [],
        {
            name: variance / unit_of_axis**2
            for name, variance, unit_of_axis in zip(POSE, outcome.variances, unit, strict=True)
            if np.isfinite(unit_of_axis)
        },
    )
    if "resolution" in aims:
        for name, ratio in ratios.items():
            what = f"uncertainty of {name} as low as it can be"
            below.append(Constraint(what, -ratio, "resolution"))
    if "size" in aims:
        what = "size of the head as low as it can be"
        below += [Constraint(what, -head / 100, "size", states=(0,)) for head in values.heads]
    if "condition" in aims:
        decades = np.log10(outcome.condition) / 2
        below.append(Constraint("conditioning as good as it can be", -decades, "condition"))
    if "mean-resolution" in aims:
        below += [Constraint(AVERAGED, ratio, states=()) for ratio in ratios.values()]
    return below
