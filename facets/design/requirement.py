"""A layout's requirements over the volume, as margins of the float model that must not be negative.

The search applies them to layouts (`problem`, `trade`). This module applies them to a head as
built, whose detectors and facets are each slightly displaced. It also computes the errors of poses
that are solved with the parameters of another head.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..characterization.resolution import uncertainties
from ..core.knowledge import Knowledge
from ..core.names import FINE_UNITS, POSE
from ..core.rigid_body import object_displacements
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.correction import correct, invert_correction
from ..estimation.solver import solve
from ..model.arrays import half_sizes, margins, readings
from .variables import Outcome
from .volume import (
    mirror_states,
    span_of,
    states_of,
    volume_fractions,
    wide_axes,
    worst_places,
)

if TYPE_CHECKING:
    from ..core.layout import Layout

FREE = Knowledge()
#: Margin of a requirement that cannot be evaluated, because a spot or its light is missing.
LOST = -1.0
UNITS = np.array(FINE_UNITS[:6])
EDGES = ("-y", "+y", "-z", "+z")


class Constraint(NamedTuple):
    """A value that must not fall below zero, or below minus a slack.

    group: name of the requirement.  value: an array that broadcasts to (layouts, states).
    slack: the aim whose unknown is added; "" for none.  states: numbers of the constrained states;
    None for all.
    """

    group: str
    value: Any
    slack: str = ""
    states: Sequence[int] | None = None


def limits_of(
    least_power: float,
    largest: Sequence[float],
    powers: Any,
    spots: Any,
    sigmas: Any,
    rims: Any = (),
) -> list[Constraint]:
    """List a layout's requirements at every state of its volume, scaled to order one.

    least_power: least power on a detector, mW.  largest: (6,) largest standard uncertainties, um
    and urad; infinite without a limit.
    powers: the 3 powers, mW.  spots: 12 clearances of the spots from the detectors' edges, in
    halves of a detector.  sigmas: 6 standard uncertainties of the pose, um and urad.  rims: 3
    clearances of the light from the mirror's rim, over the rim's radius; empty without a rim.
    """
    return [
        *(Constraint("power on a detector", power / least_power - 1) for power in powers),
        *(
            Constraint(f"spot on PSD {'ABC'[n // 4]}, {EDGES[n % 4]} edge", spot)
            for n, spot in enumerate(spots)
        ),
        *(
            Constraint(f"uncertainty of {name}", 1 - sigma / limit)
            for name, sigma, limit in zip(POSE, sigmas, largest, strict=True)
            if np.isfinite(limit)
        ),
        *(
            Constraint(f"light on facet {letter}, rim", rim)
            for letter, rim in zip("ABC", rims, strict=False)
        ),
    ]


def head_limits(largest: float, heads: list[Any]) -> list[Constraint]:
    """Limit the head's size, for detectors whose radius varies or is too large. A head of constant
    size cannot limit the search."""
    wide = [head for head in heads if not isinstance(head, float) or head > largest]
    return [
        Constraint("size of the head", 1 - head / largest, states=(0,))
        for head in wide
        if np.isfinite(largest)
    ]


def headrooms(outcome: Outcome) -> list[Constraint]:
    """Constrain the amplifiers' headrooms, if the noise follows from electronics."""
    return [
        Constraint(f"full scale of PSD {'ABC'[n // 4]}'s amplifiers", each)
        for n, each in enumerate(outcome.headrooms)
    ]


@dataclass(frozen=True)
class Requirement:
    """The requirements over the volume.

    states: (m, 8), mm and rad, the last at rest; if the layout has an object, with its
    displacements in place of the mirror's pose.  power: knowledge of the laser's power, as in
    `solve`.  rim: whether the light on the mirror must stay within its rim.
    """

    layout: Layout
    states: Floats
    power: Any = "known"
    rim: bool = False

    @property
    def mirror_states(self) -> Floats:
        """The states of the mirror, (m, 8)."""
        return mirror_states(self.states, self.layout.object, self.layout.following)

    @property
    def accuracy_axes(self) -> list[int]:
        """Numbers of the axes whose error is limited."""
        return [i for i in range(6) if np.isfinite(self.layout.accuracy[i])]

    @property
    def groups(self) -> list[str]:
        """Names of the margins of one state, in the order of `margins_of`."""
        ones = np.ones(12)
        constraints = limits_of(
            self.layout.least_power,
            self.layout.limit,
            ones[:3],
            ones,
            ones[:6],
            ones[: 3 * self.rim],
        )
        return [each.group for each in constraints]

    @property
    def error_groups(self) -> list[str]:
        """The names of the constraints on the pose's errors."""
        return [f"error of {POSE[i]}" for i in self.accuracy_axes]


def requirement_of(sensor: Sensor, layout: Layout, drifts: bool) -> Requirement:
    """Make the requirement at the volume's states and at the sensor's worst states between them.

    drifts: whether the laser's power is unknown in each sample.
    """
    rim = bool(np.isfinite(sensor.apertures.rim))
    power = "unknown" if drifts else "known"
    requirement = Requirement(layout, np.array(states_of(layout, 1.0)), power, rim)
    states = [requirement.states, worst_places_of(requirement, sensor), np.zeros((1, 8))]
    return replace(requirement, states=np.concatenate(states))


def worst_places_of(requirement: Requirement, sensor: Sensor) -> Floats:
    """Find states (k, 8) between the requirement's states at which a margin is smaller than at all
    of these."""
    span, wide = span_of(requirement.layout), wide_axes(requirement.layout)

    def values(fractions: Floats) -> Floats:
        """The margins (n, ...) at fractions (n, d) of the volume's sides."""
        return margins_of(replace(requirement, states=fractions @ span), sensor)

    places, _ = worst_places(values, volume_fractions(wide), wide)
    states: Floats = places @ span
    return states


def margins_of(requirement: Requirement, sensor: Sensor) -> Floats:
    """The margins (m, groups) of a head at the requirement's states, each relative to its limit."""
    layout = requirement.layout
    states = requirement.mirror_states
    halves = np.repeat(half_sizes(sensor), 2, axis=1)
    distances = margins(sensor, states)
    spots = (distances[:, :, :4] / halves).reshape(len(states), 12)
    sigmas = np.full((1, 6), np.nan)
    if np.isfinite(layout.limit).any():
        sigmas = uncertainties(sensor, states, FREE, layout.object) / UNITS
    rims = (distances[:, :, 4] / sensor.apertures.rim).T if requirement.rim else ()
    constraints = limits_of(
        layout.least_power,
        layout.limit,
        readings(sensor, states)[:, 2::3].T,
        spots.T,
        sigmas.T,
        rims,
    )
    values: Floats = np.nan_to_num(np.stack([each.value for each in constraints], axis=1), nan=LOST)
    return values


def errors_of(requirement: Requirement, built: Sensor, assumed: Sensor) -> Floats:
    """The errors (m, 6) of the poses, less the error at rest, um and urad; NaN without a pose.

    built: the head that makes the readings.  assumed: the head whose parameters the solver uses.
    """
    states, body = requirement.mirror_states, requirement.layout.object
    raw = invert_correction(built, readings(built, states).copy())
    solution = solve(
        assumed, correct(assumed, raw), beam="free", power=requirement.power,
        start=states, covariance=False, accept_unchecked=True,
    )  # fmt: skip
    poses = solution.state[:, :6]
    if body is not None:
        poses = object_displacements(poses, np.zeros(6), body)[0]
    off = (poses - requirement.states[:, :6]) / UNITS
    relative: Floats = off - off[-1]
    return relative


def accuracy_margins(requirement: Requirement, errors: Floats) -> Floats:
    """One minus each error over its limit, (..., axes with a limit); `LOST` without a pose."""
    axes = requirement.accuracy_axes
    limits = np.array(requirement.layout.accuracy)[axes]
    margin: Floats = np.nan_to_num(1 - np.abs(errors[..., axes]) / limits, nan=LOST)
    return margin
