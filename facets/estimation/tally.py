"""What became of samples, counted, and what their user must be told."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.names import TEMPERATURE_COLUMN
from ..core.units import Floats, describe_bounds
from ..model.arrays import is_near_edge, readings
from .misfit import Misfit
from .reliability import unseen_errors
from .solution import LABELS, Solution, Status
from .solver import solve

if TYPE_CHECKING:
    from ..core.knowledge import Knowledge
    from ..core.sensor import Sensor
    from ..core.settings import Config, Solve
    from .samples import Samples

#: `unseen_errors` is asked for at the first so many poses, and at one in so many later ones.
FIRST_POSES, LATER_POSES = 100, 500
#: Errors of a pose that are reported, and those without a bound; standard uncertainties.
MUCH, BOUNDLESS = 10.0, 1e4
#: Which readings are places, in the order of `Thermal.places`.
PLACES = [0, 1, 3, 4, 6, 7]


@dataclass
class Tally:
    """What happened so far.

    what: the word for samples.  cold: the clause that says where the temperature is missing which
    the sensor follows.  statuses: of samples that are solved or given up, by their words.  misfit:
    whether the residuals are beyond chance.  checked:
    poses that something checks.  unchecked: poses that nothing checks, given on request.  edges:
    poses with a spot near an edge that the model lacks.  unseen: (2,) by how much one spoilt place
    and one spoilt power can put a pose off unseen, in standard uncertainties, at most; NaN where
    nothing was solved.  unknown_temperatures: samples without the temperature that the sensor
    follows, and is_cold whether none has one.
    """

    what: str = "samples"
    cold: str = f"the samples have no {TEMPERATURE_COLUMN}"
    statuses: Counter[str] = field(default_factory=Counter)
    misfit: Misfit = field(default_factory=Misfit)
    checked: int = 0
    unchecked: int = 0
    edges: int = 0
    unseen: Floats = field(default_factory=lambda: np.full(2, np.nan))
    unknown_temperatures: int = 0
    is_cold: bool = False

    def add(
        self, config: Config, samples: Samples, solution: Solution, how: tuple[Knowledge, Floats]
    ) -> None:
        """Count solved samples.  how: what was known of the beam, and the exact readings (n, 9)."""
        sensor, (knowledge, exact) = config.sensor, how
        self.add_statuses(solution)
        if sensor.thermal.is_on:
            self.is_cold |= samples.temperature is None
            if samples.temperature is not None:
                self.unknown_temperatures += int((~np.isfinite(samples.temperature)).sum())
        self.misfit.carried |= samples.place_sigma is not None
        self.misfit.add(solution, sensor, knowledge, config.solve.method, exact)
        converged, checks = solution.converged, solution.checks > 0
        self.unchecked += int((converged & ~checks).sum())
        if not sensor.apertures.detectors:
            near = (is_near_edge(sensor, samples.readings) & solution.used).any(axis=1)
            self.edges += int((converged & near).sum())
        self.look_for_unseen(config, solution.state[converged & checks])

    def add_statuses(self, solution: Solution) -> None:
        """Count how estimates ended."""
        numbers, counts = np.unique(solution.status, return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            self.statuses[LABELS[number]] += count

    def rename(self, status: NDArray[np.int8], words: str) -> None:
        """Count samples with some statuses (n,) under other words."""
        self.statuses.subtract(LABELS[number] for number in status.tolist())
        self.statuses = +self.statuses
        if len(status):
            self.statuses[words] += len(status)

    def look_for_unseen(self, config: Config, states: Floats) -> None:
        """Bound, at some of the next checked states (n, 8), the error of one spoilt number."""
        order = self.checked + np.arange(len(states))
        self.checked += len(states)
        some = states[(order < FIRST_POSES) | (order % LATER_POSES == 0)]
        if not len(some):
            return
        known = config.solve.knowledge(config.sensor)
        errors = unseen_errors(config.sensor, some, beam=known.beam, power=known.power)
        errors = errors.reshape(-1, 3, 3)
        largest = np.array([errors[..., :2].max(), errors[..., 2].max()])
        self.unseen = np.fmax(self.unseen, largest)

    @property
    def solved_count(self) -> int:
        """Samples that have a pose."""
        return self.statuses[Status.CONVERGED.label]

    @property
    def unsolved_count(self) -> int:
        """Samples that were looked at and have no pose."""
        return self.statuses.total() - self.solved_count

    @property
    def skipped_count(self) -> int:
        return self.statuses[Status.SKIPPED.label]

    def sentences(self, config: Config) -> list[str]:
        """What a user must be told of the poses."""
        found = (
            self.misfit.words,
            self.unchecked_sentence(),
            self.edge_sentence(),
            self.unseen_sentence(),
            self.temperature_sentence(config),
        )
        return [sentence for sentence in found if sentence]

    def unchecked_sentence(self) -> str:
        """The sentence about samples that have, or could have, a pose which nothing checks."""
        refused = self.statuses[Status.UNCHECKED.label]
        if refused:
            return (
                f"{self.what.capitalize()} with as many readings as unknowns: {refused}. A wrong "
                "reading would not be noticed there; solve.accept_unchecked, or "
                "--accept-unchecked, gives their poses all the same."
            )
        if self.unchecked:
            return (
                f"Poses from as many readings as unknowns: {self.unchecked}. No reading is left to "
                "check them, and a distant pose may give the same readings."
            )
        return ""

    def edge_sentence(self) -> str:
        """The sentence about poses with a spot near an edge that the model lacks."""
        if not self.edges:
            return ""
        return (
            "Poses with a spot closer to its detector's edge than its own diameter: "
            f"{self.edges}. Light may miss the detector there, and then the stated uncertainties "
            "do not hold. Set sensor.apertures.detectors to model the edges."
        )

    def unseen_sentence(self) -> str:
        """The sentence about the undetected error that one spoilt number can cause, if large."""
        place, power = self.unseen.tolist()
        if not max(place, power) > MUCH:
            return ""
        return (
            "A single wrong reading can shift a pose without raising its residual: a wrong "
            f"position of a spot by {amount(place)}, a wrong power by {amount(power)} standard "
            "uncertainties."
        )

    def temperature_sentence(self, config: Config) -> str:
        """The sentence about samples without the temperature that the sensor follows."""
        if not self.is_cold:
            if not self.unknown_temperatures:
                return ""
            return (
                f"{self.unknown_temperatures} {self.what} have no value of {TEMPERATURE_COLUMN} "
                f"from {describe_bounds(TEMPERATURE_COLUMN)}, which sensor.temperature needs, and "
                "therefore no pose."
            )
        shift = abs(shift_per_kelvin(config.sensor, config.solve))
        return (
            f"{self.cold}, though sensor.temperature has coefficients: the poses hold at "
            f"{config.sensor.thermal.reference:.4g} degrees Celsius. Each kelvin above or below "
            f"shifts them by up to {1e3 * shift[:3].max():.2g} um and "
            f"{1e6 * shift[3:].max():.2g} urad, which the stated uncertainties do not include."
        )


def amount(errors: float) -> str:
    """An error in standard uncertainties, in words."""
    return "any amount" if errors > BOUNDLESS else f"up to {errors:.2g}"


def shift_per_kelvin(sensor: Sensor, options: Solve) -> Floats:
    """By how much a pose at rest is off (6,), mm and rad, where the sensor is 1 K warmer than its
    reference and the readings are solved without their temperature."""
    state = np.zeros((1, 8))
    state[0, 6:] = sensor.thermal.beam
    seen = readings(sensor, state)
    seen[:, PLACES] += sensor.thermal.places
    known = replace(options, beam_offset=(0.0, 0.0)).knowledge(sensor)
    solution = solve(sensor, seen, beam=known.beam, power=known.power, covariance=False)
    shift: Floats = solution.state[0, :6]
    return shift
