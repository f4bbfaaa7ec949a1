"""A design space, and the measures of its designs: ranges, uncertainties and conditioning."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...characterization.ranges import axis_ranges, clearances
from ...characterization.resolution import uncertainties
from ...characterization.singularity import measures
from ...characterization.sobol import Sobol
from ...core.errors import InputError
from ...core.knowledge import Knowledge
from ...core.names import FINE_COLUMNS, FINE_UNITS, RANGE_COLUMNS
from ...core.plain_numbers import suggest_name
from ...core.rules import Rules
from ...core.sensor import Sensor
from ...core.units import Booleans, Floats, Integers
from ...detectors.noise import fullness
from ...model.arrays import margins, readings
from ..requirement import Requirement, margins_of, worst_places_of
from ..variables import FULL, require_variables, sensor_of
from ..volume import states_of
from .survey import (
    FAR,
    INVALID,
    OUTSIDE,
    OVERLOADED,
    SKIPPED,
    UNFIT,
    is_plain,
    measure_plain,
    rest_reasons,
)

if TYPE_CHECKING:
    from ...core.layout import Layout
    from ...core.settings import Config

#: Number of designs of a worker's task, unless they are plain.
DESIGNS_PER_TASK = 200
#: A task of plain designs is larger by up to this factor, if that leaves at least this many tasks.
LARGEST_FACTOR, LEAST_TASKS = 50, 100
#: Tolerance of a design's ranges, in units of `ranges.FARTHEST_MM_RAD`.
FINE_ENOUGH = 1e-5
#: Factors from mm and rad to um and urad, by axis of the pose.
FINE = 1 / np.array(FINE_UNITS[:6])
#: The measures of a design, each of which can be an objective. Ranges are symmetric, both sides
#: together; uncertainties and the condition number are at rest.
MEASURES = ("head_mm", *RANGE_COLUMNS, *FINE_COLUMNS, "condition")
AT_RANGES = slice(1, 7)


@dataclass(frozen=True)
class Space:
    """A design space, and the way in which it is sampled.

    count: number of designs.  part: number of designs of a task.  objectives: of the front.
    required: whether designs must meet the layout's requirements over its volume.
    """

    sensor: Sensor
    rules: Rules
    layout: Layout
    count: int
    seed: int
    objectives: tuple[str, ...] = ("head_mm", "u_roll_urad", "range_roll_mrad")
    required: bool = False
    part: int = DESIGNS_PER_TASK

    @property
    def names(self) -> list[str]:
        """The names of the variables."""
        return list(self.layout.variables)

    @cached_property
    def volume(self) -> Floats:
        """States (n, 8), mm and rad: corners, faces and centre of the layout's volume."""
        return np.array(states_of(self.layout, 1.0), dtype=float)

    @property
    def plain(self) -> bool:
        """Whether `survey` can measure many of its designs at once."""
        return not self.required and is_plain(self.sensor, self.rules)


def space_of(
    settings: Config, objectives: Sequence[str], count: int, seed: int, required: bool = False
) -> Space:
    """Make the space of a configuration, with as many designs in a task as take about a second.

    Raises `InputError` for an unknown objective, or if there are no variables.
    """
    unknown = [name for name in objectives if name not in MEASURES]
    if unknown:
        raise InputError(
            f"unknown measure {', '.join(unknown)}; allowed: {', '.join(MEASURES)}"
            f"{suggest_name(unknown[0], MEASURES)}"
        )
    require_variables(settings.layout, settings.name)
    space = Space(
        settings.sensor, replace(settings.range, object=settings.layout.object), settings.layout,
        count, seed, tuple(objectives), required,
    )  # fmt: skip
    if not space.plain:
        return space
    times = min(LARGEST_FACTOR, max(1, space.count // (LEAST_TASKS * DESIGNS_PER_TASK)))
    return replace(space, part=times * DESIGNS_PER_TASK)


def designs(space: Space) -> Floats:
    """Return all designs (n, variables), in the units of the variables' names."""
    bounds = tuple(space.layout.variables[name] for name in space.names)
    return draw(bounds, space.count, space.seed)


@lru_cache(1)  # one table serves all parts of a worker
def draw(bounds: tuple[tuple[float, float], ...], count: int, seed: int) -> Floats:
    """Draw designs (count, variables) within bounds by a Sobol' sequence."""
    fractions = Sobol(len(bounds), np.random.default_rng(seed)).draw(count)
    low, high = np.array(bounds).T
    values: Floats = low + fractions * (high - low)
    return values


def saturates(sensor: Sensor, states: Floats) -> bool:
    """Whether an electrode's current exceeds the fraction of the amplifier's full scale that the
    optimiser allows; false without electronics."""
    return bool((fullness(sensor, readings(sensor, states)) > FULL).any())


def meets(sensor: Sensor, layout: Layout, states: Floats) -> bool:
    """Whether the design meets all the layout's requirements at states (n, 8) of the volume."""
    if 2 * max(psd.radius for psd in sensor.psds) > layout.head:
        return False
    if saturates(sensor, states):
        return False
    requirement = Requirement(layout, states, rim=bool(np.isfinite(sensor.apertures.rim)))
    if not margins_of(requirement, sensor).min() > 0:
        return False
    between = replace(requirement, states=worst_places_of(requirement, sensor))
    return not len(between.states) or bool(margins_of(between, sensor).min() > 0)


def reason_at_rest(space: Space, sensor: Sensor) -> int:
    """The number in SKIPPED of a reason that is visible before the uncertainties are computed, or
    0."""
    rest, least_power = np.zeros((1, 8)), space.layout.least_power
    if why := int(rest_reasons(margins(sensor, rest), readings(sensor, rest), least_power)[0]):
        return why
    if saturates(sensor, rest):
        return OVERLOADED
    return UNFIT if space.required and not meets(sensor, space.layout, space.volume) else 0


def measure_design(space: Space, x: Floats, tolerance: float = FINE_ENOUGH) -> tuple[int, Floats]:
    """Measure a design; return the number in SKIPPED of the reason to skip it, or 0, and its
    measures (MEASURES,), which are NaN as far as they were not computed.

    tolerance: of its ranges, in units of `ranges.FARTHEST_MM_RAD`.
    """
    values = np.full(len(MEASURES), np.nan)
    try:
        sensor = sensor_of(space.sensor, space.names, x)
    except InputError:
        return INVALID, values
    values[0] = 2 * max(psd.radius for psd in sensor.psds)
    if why := reason_at_rest(space, sensor):
        return why, values
    rest = np.zeros((1, 8))
    values[7:13] = FINE * uncertainties(sensor, rest, Knowledge(), space.layout.object)[0]
    values[13] = measures(sensor, rest)[0, 2]
    rules = replace(space.rules, condition=np.inf)
    clear = clearances(sensor, np.zeros((1, 6)), rules)[0]
    if not clear.min() > 0:
        return OUTSIDE[int(clear.argmin())], values
    ranges = axis_ranges(sensor, rules, np.zeros(6), tolerance)
    values[AT_RANGES] = FAR * np.array([axis.symmetric for axis in ranges])
    return 0, values


def measure_designs(space: Space, rows: Floats) -> tuple[Integers, Floats]:
    """Measure designs (n, variables); return the reasons (n,) to skip them and their measures
    (n, MEASURES), as `measure_design` does.

    Valid designs of a plain sensor are measured many at once, all others one by one.
    """
    if space.plain:
        possible, why, values = measure_plain(
            space.sensor, space.rules, space.names, rows, space.layout.least_power, FINE_ENOUGH
        )
    else:
        possible, why = np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=np.int64)
        values = np.full((len(rows), len(MEASURES)), np.nan)
    for n in np.flatnonzero(~possible).tolist():
        why[n], values[n] = measure_design(space, rows[n])
    return why, values


def part_of(space: Space, first: int) -> dict[str, Any]:
    """Measure the part of the designs that begins with number `first`; return its table."""
    rows, begin = designs(space)[first : first + space.part], time.perf_counter()
    why, values = measure_designs(space, rows)
    seconds = np.full(len(rows), (time.perf_counter() - begin) / len(rows))
    columns: dict[str, Any] = {"design": first + np.arange(len(rows))}
    columns |= {name: rows[:, i] for i, name in enumerate(space.names)}
    columns["skipped"] = np.array(SKIPPED)[why]
    columns |= {name: values[:, i] for i, name in enumerate(MEASURES)}
    return columns | {"seconds": seconds}


def front(table: dict[str, NDArray[Any]], objectives: Sequence[str]) -> Booleans:
    """Whether, (designs,), no other design is at least as good in all objectives; ranges are
    maximised, others minimised."""
    signs = [-1.0 if name.startswith("range") else 1.0 for name in objectives]
    costs = np.stack([s * table[n] for s, n in zip(signs, objectives, strict=True)], axis=1)
    best = np.zeros(len(costs), dtype=bool)
    complete = np.flatnonzero(np.isfinite(costs).all(axis=1))
    remaining = complete[np.lexsort(costs[complete].T[::-1])]
    while len(remaining):  # no later design beats the first one; remove those that it beats
        first = remaining[0]
        best[first] = True
        beaten = (costs[remaining] >= costs[first]).all(axis=1)
        remaining = remaining[~beaten]
    return best
