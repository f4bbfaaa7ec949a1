"""What became of samples, counted: whether they fit the model, and what a user must be told.

`Solution.misfit` flags a pose. If most poses are flagged, the likeliest cause is found by solving
some of them again: with another power of the laser, and with the beam at another position that is
common to all. A free beam for each reading would prove nothing: of the nine numbers it leaves one,
which knows the power, not the geometry.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.arguments import as_floats
from ..core.knowledge import Knowledge, Prior
from ..core.names import TEMPERATURE_COLUMN
from ..core.plain_numbers import short_number
from ..core.units import Booleans, Floats, Integers, describe_bounds
from ..detectors.temperature import PLACES, beam_shift
from ..model.arrays import is_near_edge, readings
from .plan import FALSE_ALARM_RATE, chance_of, make_plan
from .problem import MIN_REDUNDANCY
from .solution import LABELS, Solution, Status
from .solver import solve
from .uncertainty import redundancies, unseen_by_residual

if TYPE_CHECKING:
    from ..core.sensor import Sensor
    from ..core.settings import Config, Solve
    from .solution import SampleEstimate, Samples


#: The model is doubted from this many flagged readings on, over those that chance flags; from this
#: median residual on, over the noise's, it is not the model of this sensor.
DOUBT, WRONG = 10.0, 5.0
#: Number of the newest readings whose residuals make the median.
KEPT = 10_000
#: The most flagged readings of a run that are solved again; the largest median residual, over the
#: noise's, with which a cause explains them; and the largest with it over that without it.
MAX_EXAMPLES, MAX_EXPLAINED_SIZE, EXPLAINED_SHARE = 60, 2.0, 0.5
#: Expected residuals, over the noise's, above which the priors of beam and power play no part.
NO_PRIOR = 0.99
#: Residuals, over the noise's, from which on they are more than the priors expect.
OFF_PRIOR = 1.2
#: A mirror whose poses scatter by less than so many standard uncertainties did not move.
STILL_SIGMAS = 10.0


@dataclass
class Misfit:
    """Counts poses with a residual beyond chance, and finds the cause where there are many.

    Attributes
    ----------
    judged, flagged
        Number of poses that can be checked, and of those with a residual beyond chance.
    sizes, kept
        The newest `residual_sizes`, in the pieces in which they came, and their number: at least
        KEPT once so many have come.
    carried
        Whether a stage carries the beam, whose place is known by its encoder.
    examples, stride
        Flagged readings from all over the run, one of every `stride`, each with the place of the
        beam that was assumed.
    sensor, knowledge, method
        With which the last flagged readings were solved.
    """

    judged: int = 0
    flagged: int = 0
    sizes: deque[Floats] = field(default_factory=deque)
    kept: int = 0
    carried: bool = False
    examples: list[tuple[Floats, Floats]] = field(default_factory=list)
    stride: int = 1
    sensor: Sensor | None = None
    knowledge: Knowledge = field(default_factory=Knowledge)
    method: str = "least-squares"

    def add(
        self,
        solution: Solution,
        sensor: Sensor,
        knowledge: Knowledge,
        method: str,
        readings: Floats,
        ends: Integers | None = None,
    ) -> None:
        """Count solved readings (n, 9), as perfect detectors would give them.

        knowledge, method: with which they were solved.  ends: of the pieces in which they came.
        """
        flags = solution.misfit
        if flags.any():
            self.sensor, self.knowledge, self.method = sensor, knowledge, method
            places = as_floats(knowledge.beam_prior.mean, "mean")
            self.keep_examples(flags, readings, np.broadcast_to(places, (len(flags), 2)))
        sizes = residual_sizes(solution)
        self.judged += len(sizes)
        self.flagged += int(flags.sum())
        if ends is None:
            self.sizes.append(sizes)
        else:
            self.sizes += np.split(sizes, np.cumsum(are_checked(solution))[ends[:-1] - 1])
        self.kept += len(sizes)
        while self.kept - len(self.sizes[0]) >= KEPT:
            self.kept -= len(self.sizes.popleft())

    def has_room(self, count: int) -> bool:
        """Whether so many more flagged readings leave one of every `stride` as an example."""
        return len(self.examples) + -(-count // self.stride) <= MAX_EXAMPLES

    def keep_examples(self, flags: NDArray[np.bool_], readings: Floats, places: Floats) -> None:
        rows = np.flatnonzero(flags)
        rows = rows[(self.flagged + np.arange(len(rows))) % self.stride == 0]
        self.examples += [(readings[row].copy(), places[row].copy()) for row in rows]
        while len(self.examples) > MAX_EXAMPLES:
            self.examples = self.examples[::2]
            self.stride *= 2

    @property
    def is_mostly_flagged(self) -> bool:
        """Whether more than half of what was judged is flagged."""
        return 2 * self.flagged > self.judged

    @property
    def sentence(self) -> str:
        """The message on the flags; empty if chance explains them all."""
        chance = FALSE_ALARM_RATE * self.judged
        if self.flagged <= max(DOUBT * chance, chance + 5 * np.sqrt(chance) + 1):
            return ""
        sizes = np.concatenate(self.sizes)
        size = float(np.median(sizes))
        # the median of the poses without a flag, since those with one have the largest residuals
        unflagged = np.quantile(sizes, (1 - self.flagged / self.judged) / 2)
        is_general = self.is_mostly_flagged or unflagged > OFF_PRIOR
        told = (
            f"{self.flagged} of {self.judged} poses have a residual beyond chance "
            f"({chance:.2g} would by chance); the median residual is {size:.3g} times the noise"
        )
        if size > WRONG or self.is_mostly_flagged:
            cause = self.cause(size)
            if cause:
                return f"{told}. {cause} Until then the poses and their uncertainties are wrong."
        if size > WRONG:
            return (
                f"{told}. The cause is unknown: neither another place of the beam nor another "
                "power of the laser explains the readings. Check the sensor's geometry in the "
                "configuration, the order of the detectors and the columns' signs and units, or "
                "calibrate the rig; the stated uncertainties do not hold."
            )
        if is_general:
            return (
                f"{told}: the model misses something of this sensor. Calibrate it again; if the "
                "laser's power or the beam may have moved, solve with power: unknown or beam: free."
            )
        causes = "dust, a cable, a shutter, a passing reflection"
        if self.carried:
            causes += ", or a stage whose place came too late to be that of the sample"
        return (
            f"{told}: single readings are spoilt ({causes}); the column residual of the poses "
            "says which."
        )

    def describe(self, least: float) -> str:
        """The message on the flags; where chance explains them all, the size of the residuals.

        least: the expected size where beam and power are as their priors say; 1 without priors.
        """
        if self.sentence or not self.kept or least**2 < MIN_REDUNDANCY:
            return self.sentence
        size = float(np.sqrt(np.mean(np.concatenate(self.sizes) ** 2)))
        told = f"the residuals are {size:.2f} times the noise"
        if least > NO_PRIOR:
            return f"{told} (RMS; 1 is expected)"
        told += f" (RMS; {least:.2f} to 1 is expected, with the errors that the priors allow)"
        if size < OFF_PRIOR:
            return told
        return (
            f"{told}: beam or power are further off than their standard uncertainties, or a "
            "reading is wrong by the same in all, which only a better known beam or power tells"
        )

    def cause(self, size: float) -> str:
        """The cause that explains the examples, whose residuals are `size` times the noise, as a
        sentence; empty where none does."""
        sensor, knowledge = self.sensor, self.knowledge
        if sensor is None or self.method == "paper" or not self.examples:
            return ""
        readings, places = (np.array(part) for part in zip(*self.examples, strict=True))
        enough = min(MAX_EXPLAINED_SIZE, EXPLAINED_SHARE * size)
        if knowledge.power != "unknown":
            known = Prior(places, knowledge.beam_sigma)
            power = power_that_explains(sensor, readings, known, enough)
            if power is not None:
                return (
                    f"The readings fit a laser of {power:.3g} mW instead of "
                    f"{sensor.beam.power:.3g} mW, which is the likeliest cause: correct "
                    "sensor.beam.power_mw, or solve with power: unknown."
                )
        if knowledge.beam == "free":
            return ""
        place = place_that_explains(sensor, readings, places, knowledge.power == "unknown", enough)
        return self.words_of_place(place, places.mean(axis=0)) if place is not None else ""

    def words_of_place(self, shift: tuple[Floats, bool], assumed: Floats) -> str:
        """The sentences for a beam that stands elsewhere.

        shift: from the `assumed` place (2,), mm, and whether the mirror moved meanwhile.
        """
        away, moved = shift
        if self.carried:
            words = (
                f"The readings fit a beam {point(away)} mm from where the stage "
                "says that it is, which is the likeliest cause: correct stage.zero_mm."
            )
        else:
            place = assumed + away
            words = (
                f"The readings fit a beam at {point(place)} mm instead of {point(assumed)} mm, "
                "which is the likeliest cause: move the beam back, say where it is, or solve with "
                "beam: free; where a stage carries it, acquire with --track."
            )
        if moved:
            return words
        return (
            f"{words} A wrong geometry in the configuration would explain the readings as well, "
            "because the mirror stood still."
        )


def point(place: Floats) -> str:
    """A place (2,), to the micrometre."""
    x, y = (round(float(value), 3) + 0.0 for value in place)
    return f"({x:g}, {y:g})"


def power_that_explains(
    sensor: Sensor, readings: Floats, place: Prior, enough: float
) -> float | None:
    """The power of the laser, mW, with which readings (n, 9) fit; None where they fit with none.

    place: what is known of the beam's place.  enough: the largest `median_size` of a fit.
    """
    solution = solve(sensor, readings, beam=place, power="unknown", accept_unchecked=True)
    if median_size(solution) > enough:
        return None
    return float(np.median(solution.power[solution.converged]))


def place_that_explains(
    sensor: Sensor, readings: Floats, places: Floats, unknown: bool, enough: float
) -> tuple[Floats, bool] | None:
    """The common shift (2,) of the beam from `places` (n, 2), mm, with which readings (n, 9) fit,
    and whether the mirror moved meanwhile; None where they fit with none.

    unknown: whether the power is unknown.  enough: the largest `median_size` of a fit.
    """
    power: Literal["known", "unknown"] = "unknown" if unknown else "known"
    free = solve(sensor, readings, beam="free", power=power, accept_unchecked=True)
    good = free.converged
    if not good.any():
        return None
    away = np.median(free.state[good, 6:] - places[good], axis=0)
    sigma = np.median(free.uncertainty[good, 6:], axis=0)
    together = solve(sensor, readings, beam=Prior(places + away, sigma), power=power)
    if median_size(together) > enough:
        return None
    poses, u = free.state[good, :6], np.median(free.uncertainty[good, :6], axis=0)
    return away, bool((poses.std(axis=0) > STILL_SIGMAS * u).any())


def residual_sizes(solution: Solution) -> Floats:
    """The residuals (k,) of the poses that can be checked, over what noise leaves in them (RMS)."""
    checked = are_checked(solution)
    sizes: Floats = solution.residual[checked] / np.sqrt(solution.checks[checked])
    return sizes


def are_checked(solution: Solution) -> Booleans:
    """Whether there is a pose that can be checked: (n,)."""
    return solution.converged & (solution.checks > 0)


def median_size(solution: Solution) -> float:
    """The median of `residual_sizes`; infinite where less than half of the readings have a pose
    that can be checked."""
    sizes = residual_sizes(solution)
    return float(np.median(sizes)) if 2 * len(sizes) >= len(solution.status) else np.inf


#: The bound of unseen errors is computed for the first FIRST_POSES poses, and then for one in
#: LATER_POSES.
FIRST_POSES, LATER_POSES = 100, 10_000
#: Errors of a pose that are reported, and those without a bound; standard uncertainties.
MUCH, BOUNDLESS = 10.0, 1e4


@dataclass
class Tally:
    """Counts what became of samples, and makes the sentences that a user must read of them.

    Attributes
    ----------
    what
        The word for samples in sentences.
    cold
        The clause that says where the temperature is missing that the sensor follows.
    statuses
        Number of samples by the words of their status.
    misfit
        The poses with a residual beyond chance.
    checked, unchecked
        Number of poses that something checks, and that nothing checks, which are given on request.
    edges
        Number of poses with a spot near an edge that the model lacks.
    unseen
        (2,) the largest errors of a pose, in standard uncertainties, that one spoilt place and one
        spoilt power can cause without a sign in the residual; NaN where nothing was solved.
    expected, sampled
        The sum, over the number of poses at which `unseen` was sought, of the expected squares of
        the residuals over their degrees of freedom, where beam and power are as their priors say.
    is_bare
        Whether the priors left hardly any redundancy at the last of these poses.
    unknown_temperatures, is_cold
        Number of samples without the temperature that the sensor follows, and whether there are
        samples without any thermometer.
    """

    what: str = "samples"
    cold: str = f"the samples have no {TEMPERATURE_COLUMN}"
    statuses: Counter[str] = field(default_factory=Counter)
    misfit: Misfit = field(default_factory=Misfit)
    checked: int = 0
    unchecked: int = 0
    edges: int = 0
    unseen: Floats = field(default_factory=lambda: np.full(2, np.nan))
    expected: float = 0.0
    sampled: int = 0
    is_bare: bool = False
    unknown_temperatures: int = 0
    is_cold: bool = False

    def may_join(self, solution: Solution) -> bool:
        """Whether pieces of samples are counted together as one after the other.

        Not where a status is new, or where examples or unseen errors are chosen piece by piece.
        """
        statuses = {LABELS[status] for status in np.unique(solution.status).tolist()}
        is_usual = statuses <= self.statuses.keys() and self.checked >= FIRST_POSES
        return is_usual and self.misfit.has_room(int(solution.misfit.sum()))

    def add(self, config: Config, samples: Samples, estimate: SampleEstimate) -> None:
        """Count solved samples; those of several pieces where these `may_join`."""
        sensor, (solution, knowledge, exact) = config.sensor, estimate
        self.add_statuses(solution)
        if sensor.thermal.is_on:
            self.is_cold |= samples.temperature is None
            if samples.temperature is not None:
                self.unknown_temperatures += int((~np.isfinite(samples.temperature)).sum())
        self.misfit.carried |= samples.place_sigma is not None
        self.misfit.add(solution, sensor, knowledge, config.solve.method, exact, samples.ends)
        converged, checks = solution.converged, solution.checks > 0
        was_bare, row = self.is_bare, self.look_for_unseen(config, estimate)
        is_bare: Any = self.is_bare
        if samples.ends is not None and is_bare != was_bare:  # from the piece of this row on
            first = np.append(0, samples.ends)[(samples.ends <= row).sum()]
            is_bare = is_bare ^ (np.arange(len(checks)) < first)
        self.unchecked += int((converged & (is_bare | ~checks)).sum())
        if not sensor.apertures.detectors:
            near = (is_near_edge(sensor, samples.readings) & solution.used).any(axis=1)
            self.edges += int((converged & near).sum())

    def add_statuses(self, solution: Solution) -> None:
        """Count how estimates ended."""
        for number, count in enumerate(np.bincount(solution.status).tolist()):
            if count:
                self.statuses[LABELS[number]] += count

    def rename(self, status: NDArray[np.int8], words: str) -> None:
        """Count samples with some statuses (n,) under other words."""
        self.statuses.subtract(LABELS[number] for number in status.tolist())
        self.statuses = +self.statuses
        if len(status):
            self.statuses[words] += len(status)

    def look_for_unseen(self, config: Config, estimate: SampleEstimate) -> int:
        """Bound the error of one spoilt number, at some of the next poses that can be checked.

        Returns the last of these rows; 0 if there is none.
        """
        solution, knowledge, _ = estimate
        rows = np.flatnonzero(are_checked(solution))
        order = self.checked + np.arange(len(rows))
        self.checked += len(rows)
        some = rows[(order < FIRST_POSES) | (order % LATER_POSES == 0)]
        if not len(some):
            return 0
        known = config.solve.question(knowledge).rows(some)
        plan = make_plan(config.sensor, known.knowledge, shape=some.shape)
        redundancy = redundancies(config.sensor, solution.state[some], plan)
        limit = chance_of(config.sensor, plan).limit
        errors = unseen_by_residual(redundancy, limit).reshape(-1, 3, 3)
        largest = np.array([errors[..., :2].max(), errors[..., 2].max()])
        self.unseen = np.fmax(self.unseen, largest)
        total = redundancy.sum(axis=1)
        self.expected += float(np.nansum(total / solution.checks[some]))
        self.sampled += int(np.isfinite(total).sum())
        self.is_bare = bool(total[-1] < plan.least_redundancy)
        return int(some[-1])

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
        """The sentences on the poses for their user."""
        sentences = (
            self.misfit.describe(np.sqrt(self.expected / max(self.sampled, 1))),
            self.unchecked_sentence(),
            self.edge_sentence(),
            self.unseen_sentence(),
            self.temperature_sentence(config),
        )
        return [sentence for sentence in sentences if sentence]

    def unchecked_sentence(self) -> str:
        """The sentence about samples that have, or could have, a pose which nothing checks."""
        refused = self.statuses[Status.UNCHECKED.label]
        if refused:
            return (
                f"{self.what.capitalize()} without a redundant reading: {refused}. They have as "
                "many readings as unknowns, or priors of beam and power that are too wide to check "
                "them, so that a wrong reading would not be noticed. Tell what is known better, "
                "such as solve.power: known; solve.accept_unchecked, or --accept-unchecked, gives "
                "their poses all the same."
            )
        if self.unchecked:
            return (
                f"Poses without a redundant reading: {self.unchecked}. Nothing checks them, and a "
                "distant pose may give the same readings."
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
            "A single wrong reading can shift a pose without raising its residual, in standard "
            f"uncertainties: a wrong position of a spot by {amount(place)}, a wrong power by "
            f"{amount(power)}."
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
    return "any amount" if errors > BOUNDLESS else f"up to {short_number(errors, 2)}"


def shift_per_kelvin(sensor: Sensor, options: Solve) -> Floats:
    """By how much a pose at rest is off (6,), mm and rad, where the sensor is 1 K warmer than its
    reference and the readings are solved without their temperature."""
    state = np.zeros((1, 8))
    state[:, 6:] = beam_shift(sensor, np.ones(1))
    seen = readings(sensor, state)
    seen[:, PLACES] += sensor.thermal.places
    known = replace(options, beam_offset=(0.0, 0.0)).knowledge(sensor)
    solution = solve(sensor, seen, beam=known.beam, power=known.power, covariance=False)
    shift: Floats = solution.state[0, :6]
    return shift
