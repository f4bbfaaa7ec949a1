"""Comparison of a layout before and after the search, by ranges, uncertainties and simulation.

Nothing here comes from the optimiser: its result is verified with the functions that the other
commands use.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...characterization.ranges import axis_ranges
from ...characterization.resolution import uncertainties
from ...characterization.singularity import measures
from ...core.errors import InputError
from ...core.knowledge import Knowledge
from ...core.names import FINE_COLUMNS, FINE_UNITS, RANGE_COLUMNS, STATE_UNITS
from ...core.rigid_body import MeasuredObject, object_displacements
from ...core.rules import Rules
from ...core.sensor import Sensor
from ...core.units import Floats
from ...detectors.noise import add_noise
from ...estimation.solver import solve
from ...model.arrays import margins, readings
from ..volume import add_worst_states, mirror_states, span_of

if TYPE_CHECKING:
    from ...core.layout import Layout


#: Number of noisy readings at the worst state of each axis, and of random states of the volume.
DRAWS, RANDOM = 5000, 4000
FREE = Knowledge()
#: Value of an uncertainty that cannot be computed, and minus that of a distance from an edge.
LOST = 1e9


def worst_states(sensor: Sensor, layout: Layout, rng: np.random.Generator) -> Floats:
    """States (n, 8) of the mirror: the optimiser's states, random ones, and the results of searches
    from the worst of these."""

    def values(places: Floats) -> Floats:
        """Quantities (n, ...) of which the least over places (n, 8) are searched: negative
        uncertainties, distances, powers and negative condition numbers."""
        states = mirror_states(places, layout.object, layout.following)
        distances = np.nan_to_num(margins(sensor, states)[:, :, :4].reshape(-1, 12), nan=-LOST)
        fine = np.nan_to_num(uncertainties(sensor, states, FREE, layout.object), nan=LOST)
        powers = readings(sensor, states)[:, 2::3]
        conditions = measures(sensor, states)[:, 2:3]
        return np.concatenate([-fine, distances, powers, -conditions], axis=1)

    places = add_worst_states(span_of(layout), values, rng.uniform(-1, 1, (RANDOM, 8)))
    return mirror_states(places, layout.object, layout.following)


def simulate_spread(
    sensor: Sensor, states: Floats, rng: np.random.Generator, body: MeasuredObject | None = None
) -> Floats:
    """The standard deviation (6,) of axis i over solutions of noisy readings at state i; mm, rad.

    body: the object whose displacement is evaluated, if not the mirror's.
    """
    spread = np.empty(6)
    for i, state in enumerate(states):
        exact = np.broadcast_to(readings(sensor, state), (DRAWS, 9))
        solution = solve(sensor, add_noise(sensor, exact, rng), start=state, covariance=False)
        poses = solution.state[:, :6]
        if body is not None:
            poses = object_displacements(poses, np.zeros(6), body)[0]
        spread[i] = np.nanstd(poses[:, i]) if solution.converged.mean() > 0.999 else np.nan
    return spread


def performance(
    sensor: Sensor, layout: Layout, rules: Rules, rng: np.random.Generator
) -> tuple[dict[str, float], Floats]:
    """Quantities by name with unit, NaN if they cannot be computed; and the worst state of each
    axis, (6, 8)."""
    states = worst_states(sensor, layout, rng)
    sigma = uncertainties(sensor, states, FREE, layout.object)
    values: dict[str, float] = {}
    worst = np.zeros(6, dtype=int)
    for i, (name, unit) in enumerate(zip(FINE_COLUMNS, FINE_UNITS, strict=False)):
        worst[i] = int(np.argmax(np.where(np.isnan(sigma[:, i]), np.inf, sigma[:, i])))
        values[name] = float(sigma[worst[i], i] / unit)
    tracking = replace(rules, tracking=layout.following, object=layout.object)
    try:
        ranges = [axis.symmetric for axis in axis_ranges(sensor, tracking, np.zeros(6))]
    except InputError:
        ranges = [np.nan] * 6
    for name, length, unit in zip(RANGE_COLUMNS, ranges, STATE_UNITS, strict=False):
        values[name] = length / unit
    values["head_mm"] = 2 * max(psd.radius for psd in sensor.psds)
    values["condition"] = float(measures(sensor, states)[:, 2].max())
    values["room_mm"] = float(np.nan_to_num(margins(sensor, states)[:, :, :4], nan=-np.inf).min())
    values["least_power_mw"] = float(readings(sensor, states)[:, 2::3].min())
    return values, states[worst]


def compare(
    before: Sensor, after: Sensor, layout: Layout, rules: Rules, seed: int
) -> dict[str, NDArray[Any]]:
    """A table with columns quantity, before, after, and simulated (standard deviation of solutions
    at the worst state, after).

    Uncertainties, condition, clearance and power are the worst over the volume; ranges are
    symmetric, both sides together.
    """
    rng = np.random.default_rng(seed)
    old, _ = performance(before, layout, rules, rng)
    new, worst = performance(after, layout, rules, rng)
    spread = simulate_spread(after, worst, rng, layout.object) / FINE_UNITS[:6]
    simulated = np.concatenate([spread, np.full(len(new) - 6, np.nan)])
    return {
        "quantity": np.array(list(new)),
        "before": np.array(list(old.values())),
        "after": np.array(list(new.values())),
        "simulated": simulated,
    }
