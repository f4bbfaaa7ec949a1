"""Count samples by their results, and report limitations of their poses to the user.

`Solution.misfit` flags a pose. If most poses are flagged, some of them are solved again to find the
likeliest cause: with another power of the laser, and with the beam at another position that is
common to all. A free beam for each reading would not help, because it leaves one redundant number,
which checks the power but not the geometry.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
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
from .solution import LABELS, UNPARSABLE, Solution, Status
from .solver import solve
from .uncertainty import redundancies, unseen_by_residual

if TYPE_CHECKING:
    from ..core.sensor import Sensor
    from ..core.settings import Config, Solve
    from .solution import SampleEstimate, Samples


#: The model is doubted if this many times more readings are flagged than by chance; it is wrong for
#: this sensor if the median residual is this many times the noise.
DOUBT, WRONG = 10.0, 5.0
#: Largest number of samples that a sentence names.
MAX_NAMED = 5
#: The median residual is computed from this many of the newest readings.
NEWEST = 10_000
#: Largest number of flagged readings that are solved again. A cause explains them if it reduces
#: their median residual to this many times the noise, and to this fraction of its earlier value.
MAX_EXAMPLES, MAX_EXPLAINED_SIZE, EXPLAINED_FRACTION = 60, 2.0, 0.5
#: Priors of beam and power have no effect if the expected residual over the noise is above this.
NO_PRIOR = 0.99
#: Residuals above this many times the noise are larger than the priors allow.
OFF_PRIOR = 1.2
#: A mirror whose poses scatter by less than this many standard uncertainties did not move.
STILL_SIGMAS = 10.0


@dataclass
class Misfit:
    """Counts of poses with a residual beyond chance, and the search for the cause of many.

    Attributes
    ----------
    what
        The word for samples in sentences.
    judged, flagged
        Number of poses that can be checked, and number of these with a residual beyond chance.
    rows
        Numbers of the first flagged samples, up to MAX_NAMED.
    largest, excess
        The largest of all `residual_sizes` of flagged poses, and of their residuals over the limit.
    sizes, size_count
        The newest `residual_sizes`, in the pieces in which they came, and their number: at least
        NEWEST, unless there are fewer in all.
    carried
        Whether a stage carries the beam, so that its encoder gives the beam's position.
    examples, stride
        Flagged readings from the whole run, one of every `stride`, each with the assumed position
        of the beam.
    sensor, knowledge, method
        Arguments with which the last flagged readings were solved.
    """

    what: str = "samples"
    judged: int = 0
    flagged: int = 0
    rows: list[int] = field(default_factory=list)
    largest: float = 0.0
    excess: float = 0.0
    sizes: deque[Floats] = field(default_factory=deque)
    size_count: int = 0
    carried: bool = False
    examples: list[tuple[Floats, Floats]] = field(default_factory=list)
    stride: int = 1
    sensor: Sensor | None = None
    knowledge: Knowledge = field(default_factory=Knowledge)
    method: str = "least-squares"

    def add(self, config: Config, samples: Samples, estimate: SampleEstimate) -> None:
        """Count solved samples."""
        solution, knowledge, exact = estimate
        flags, ends = solution.misfit, samples.ends
        if flags.any():
            self.sensor, self.knowledge, self.method = config.sensor, knowledge, config.solve.method
            places = as_floats(knowledge.beam_prior.mean, "mean")
            self.keep_examples(flags, exact, np.broadcast_to(places, (len(flags), 2)))
            name_first(self.rows, samples.numbers[flags])
            residuals = solution.residual[flags]
            sizes = residuals / np.sqrt(solution.checks[flags])
            self.largest = max(self.largest, float(sizes.max()))
            self.excess = max(self.excess, float((residuals / solution.limit[flags]).max()))
        sizes = residual_sizes(solution)
        self.judged += len(sizes)
        self.flagged += int(flags.sum())
        if ends is None:
            self.sizes.append(sizes)
        else:
            self.sizes += np.split(sizes, np.cumsum(are_checked(solution))[ends[:-1] - 1])
        self.size_count += len(sizes)
        while self.size_count - len(self.sizes[0]) >= NEWEST:
            self.size_count -= len(self.sizes.popleft())

    def has_room(self, count: int) -> bool:
        """Whether `count` more flagged readings can be added without a larger `stride`."""
        return len(self.examples) + -(-count // self.stride) <= MAX_EXAMPLES

    def keep_examples(self, flags: NDArray[np.bool_], readings: Floats, places: Floats) -> None:
        """Store some of the flagged readings (n, 9), with the positions of the beam (n, 2)."""
        rows = np.flatnonzero(flags)
        rows = rows[(self.flagged + np.arange(len(rows))) % self.stride == 0]
        self.examples += [(readings[row].copy(), places[row].copy()) for row in rows]
        while len(self.examples) > MAX_EXAMPLES:
            self.examples = self.examples[::2]
            self.stride *= 2

    @property
    def is_mostly_flagged(self) -> bool:
        """Whether more than half of the judged poses are flagged."""
        return 2 * self.flagged > self.judged

    @property
    def sentence(self) -> str:
        """The message on flagged poses; empty if chance explains them all."""
        chance = FALSE_ALARM_RATE * self.judged
        is_rate_normal = self.flagged <= max(DOUBT * chance, chance + 5 * np.sqrt(chance) + 1)
        if is_rate_normal and self.excess <= excess_by_chance(self.judged):
            return ""
        sizes = np.concatenate(self.sizes)
        size = float(np.median(sizes))
        # The median of the poses without a flag, since flagged poses have the largest residuals.
        unflagged = np.quantile(sizes, (1 - self.flagged / self.judged) / 2)
        is_general = self.is_mostly_flagged or unflagged > OFF_PRIOR
        expected = "fewer than one" if chance < 1 else f"{chance:.2g}"
        counts = (
            f"{self.flagged} of {self.judged} poses {('have', 'has')[self.flagged == 1]} a "
            f"residual beyond chance ({expected} expected by chance); the median residual is "
            f"{size:.3g} times the noise, the largest {self.largest:.3g} times (see "
            f"{numbers_text(self.what, self.rows, self.flagged)})"
        )
        if size > WRONG or self.is_mostly_flagged:
            cause = self.cause(size)
            if cause:
                return f"{counts}. {cause} Until then the poses and their uncertainties are wrong."
        if size > WRONG:
            return (
                f"{counts}. The cause is unknown: neither another place of the beam nor another "
                "power of the laser explains the readings. Check the sensor's geometry in the "
                "configuration, the order of the detectors and the columns' signs and units, or "
                "calibrate the rig; the stated uncertainties do not hold."
            )
        if is_general:
            return (
                f"{counts}: the model misses something of this sensor. Calibrate it again; if the "
                "laser's power or the beam may have moved, solve with power: unknown or beam: free."
            )
        causes = "dust, a cable, a shutter, a passing reflection"
        if self.carried:
            causes += ", or a position of the stage that came too late for its sample"
        return (
            f"{counts}: single readings are corrupted ({causes}); the column residual of the poses "
            "shows which."
        )

    def describe(self, expected: float) -> str:
        """The message on flagged poses; if chance explains them all, the size of the residuals.

        expected: size of the residuals if beam and power are within their priors; 1 without priors.
        """
        if self.sentence or not self.size_count or expected**2 < MIN_REDUNDANCY:
            return self.sentence
        size = float(np.sqrt(np.mean(np.concatenate(self.sizes) ** 2)))
        ratio = f"the residuals are {size:.2f} times the noise"
        if expected > NO_PRIOR:
            return f"{ratio} (RMS; 1 is expected)"
        ratio += f" (RMS; {expected:.2f} to 1 is expected, with the errors that the priors allow)"
        if size < OFF_PRIOR:
            return ratio
        return (
            f"{ratio}: beam or power are further off than their standard uncertainties, or a "
            "reading has the same error in all samples; a better known beam or power would "
            "distinguish the two"
        )

    def cause(self, size: float) -> str:
        """A sentence on the cause that explains the examples; empty if none does.

        size: median residual of the poses over the noise.
        """
        sensor, knowledge = self.sensor, self.knowledge
        if sensor is None or self.method == "paper" or not self.examples:
            return ""
        readings, places = (np.array(part) for part in zip(*self.examples, strict=True))
        largest = min(MAX_EXPLAINED_SIZE, EXPLAINED_FRACTION * size)
        if knowledge.power != "unknown":
            beam = Prior(places, knowledge.beam_sigma)
            power = power_that_explains(sensor, readings, beam, largest)
            if power is not None:
                return (
                    f"The readings fit a laser of {power:.3g} mW instead of "
                    f"{sensor.beam.power:.3g} mW; a changed gain of one detector fits nearly as "
                    "well. Measure the laser's power to distinguish the two. If it changed, set "
                    "sensor.beam.power_mw, or solve with power: unknown; else run facets rezero."
                )
        if knowledge.beam == "free":
            return ""
        place = place_that_explains(sensor, readings, places, knowledge.power == "unknown", largest)
        return self.words_of_place(place, places.mean(axis=0)) if place is not None else ""

    def words_of_place(self, shift: tuple[Floats, bool], assumed: Floats) -> str:
        """The sentences on a beam at another position than assumed.

        shift: from the `assumed` position (2,), mm, and whether the mirror moved meanwhile.
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
                "which is the likeliest cause: move the beam back, configure its position, or "
                "solve with beam: free; where a stage carries it, acquire with --track."
            )
        if moved:
            return words
        return (
            f"{words} A wrong geometry in the configuration would explain the readings as well, "
            "because the mirror did not move."
        )


def excess_by_chance(count: int) -> float:
    """The ratio of a residual to its limit that chance exceeds in one of `count` poses with about
    the probability FALSE_ALARM_RATE; exactly for two degrees of freedom."""
    return float(np.sqrt(1 - np.log(max(count, 1)) / np.log(FALSE_ALARM_RATE)))


def name_first(named: list[int], numbers: Integers) -> None:
    """Add numbers (n,) of samples to those that a sentence names, up to MAX_NAMED."""
    named += numbers[: MAX_NAMED - len(named)].tolist()


def numbers_text(what: str, named: list[int], count: int) -> str:
    """Write the first numbers of `count` samples: "rows 3, 7 ..."."""
    noun = what[:-1] if count == 1 else what
    return f"{noun} {', '.join(map(str, named))}{' ...' * (count > len(named))}"


def point(place: Floats) -> str:
    """Format a position (2,), mm, to the micrometre."""
    x, y = (round(float(value), 3) + 0.0 for value in place)
    return f"({x:g}, {y:g})"


def power_that_explains(
    sensor: Sensor, readings: Floats, beam: Prior, largest: float
) -> float | None:
    """Find the power of the laser, mW, that fits readings (n, 9); None if no power fits.

    beam: prior of the beam's position.  largest: largest `median_size` of a fit.
    """
    solution = solve(sensor, readings, beam=beam, power="unknown", accept_unchecked=True)
    if median_size(solution) > largest:
        return None
    return float(np.median(solution.power[solution.converged]))


def place_that_explains(
    sensor: Sensor, readings: Floats, places: Floats, is_power_unknown: bool, largest: float
) -> tuple[Floats, bool] | None:
    """Find the common shift (2,) of the beam from `places` (n, 2), mm, that fits readings (n, 9).

    Returns it with whether the mirror moved between the readings; None if no shift fits.

    largest: largest `median_size` of a fit.
    """
    power: Literal["known", "unknown"] = "unknown" if is_power_unknown else "known"
    free = solve(sensor, readings, beam="free", power=power, accept_unchecked=True)
    good = free.converged
    if not good.any():
        return None
    away = np.median(free.state[good, 6:] - places[good], axis=0)
    sigma = np.median(free.uncertainty[good, 6:], axis=0)
    together = solve(sensor, readings, beam=Prior(places + away, sigma), power=power)
    if median_size(together) > largest:
        return None
    poses, u = free.state[good, :6], np.median(free.uncertainty[good, :6], axis=0)
    return away, bool((poses.std(axis=0) > STILL_SIGMAS * u).any())


def residual_sizes(solution: Solution) -> Floats:
    """Residuals (k,) of the poses that can be checked, relative to their RMS due to noise."""
    checked = are_checked(solution)
    sizes: Floats = solution.residual[checked] / np.sqrt(solution.checks[checked])
    return sizes


def are_checked(solution: Solution) -> Booleans:
    """Whether each reading has a pose that can be checked: (n,)."""
    return solution.converged & (solution.checks > 0)


def median_size(solution: Solution) -> float:
    """Median of `residual_sizes`; infinite if fewer than half of the readings have a pose that can
    be checked."""
    sizes = residual_sizes(solution)
    return float(np.median(sizes)) if 2 * len(sizes) >= len(solution.status) else np.inf


#: The bound of undetected errors is computed for the first FIRST_POSES poses, and then for one in
#: LATER_POSES.
FIRST_POSES, LATER_POSES = 100, 10_000
#: Undetected errors above MUCH are reported, and above BOUNDLESS as unlimited; in standard
#: uncertainties.
MUCH, BOUNDLESS = 10.0, 1e4


@dataclass
class Tally:
    """Counts samples by their results, and writes the sentences on them for the user.

    Attributes
    ----------
    what
        Name of the samples in sentences.
    cold
        Clause on a missing temperature, for a sensor with `Sensor.thermal`.
    statuses
        Number of samples by the words of their status.
    named
        Numbers of the first samples by the words of their status; lines of unparsable rows.
    unlit
        (3,) number of samples with the status UNCHECKED in which a detector is dark or its spot is
        out of range.
    misfit
        Counts of the poses with a residual beyond chance.
    checked, unchecked
        Number of poses with and without redundancy; the latter exist only on request.
    edges
        Number of poses with a spot near a detector's edge, if the model has no edges.
    unseen
        (2,) largest errors of a pose, in standard uncertainties, that one corrupted position and
        one corrupted power can cause without being detected; NaN before the first pose.
    expected, sampled
        Sum over some poses of the expected squared residual, relative to its degrees of freedom, if
        beam and power are within their priors; and the number of these poses.
    is_bare
        Whether the last of these poses had hardly any redundancy.
    unknown_temperatures, is_cold
        Number of samples without a temperature that the sensor needs, and whether there are samples
        without any thermometer.
    """

    what: str = "samples"
    cold: str = f"the samples have no {TEMPERATURE_COLUMN}"
    statuses: Counter[str] = field(default_factory=Counter)
    named: dict[str, list[int]] = field(default_factory=dict)
    unlit: Integers = field(default_factory=lambda: np.zeros(3, np.int64))
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
        """Whether pieces of samples may be counted together, with the same result.

        They must not if a status is new, or if the choice of examples or of poses for undetected
        errors depends on the pieces.
        """
        statuses = {LABELS[status] for status in np.unique(solution.status).tolist()}
        is_usual = statuses <= self.statuses.keys() and self.checked >= FIRST_POSES
        return is_usual and self.misfit.has_room(int(solution.misfit.sum()))

    def add(self, config: Config, samples: Samples, estimate: SampleEstimate) -> None:
        """Count solved samples; those of several pieces only if they `may_join`."""
        sensor, solution = config.sensor, estimate.solution
        self.add_statuses(solution, samples.numbers)
        self.unlit += (~solution.used[solution.status == Status.UNCHECKED]).sum(axis=0)
        if sensor.thermal.is_on:
            self.is_cold |= samples.temperature is None
            if samples.temperature is not None:
                self.unknown_temperatures += int((~np.isfinite(samples.temperature)).sum())
        self.misfit.what = self.what
        self.misfit.carried |= samples.place_sigma is not None
        self.misfit.add(config, samples, estimate)
        converged, checks = solution.converged, solution.checks > 0
        was_bare, row = self.is_bare, self.look_for_unseen(config, estimate)
        is_bare: Any = self.is_bare
        if samples.ends is not None and is_bare != was_bare:  # changes at the piece of this row
            first = np.append(0, samples.ends)[(samples.ends <= row).sum()]
            is_bare = is_bare ^ (np.arange(len(checks)) < first)
        self.unchecked += int((converged & (is_bare | ~checks)).sum())
        if not sensor.apertures.detectors:
            near = (is_near_edge(sensor, samples.readings) & solution.used).any(axis=1)
            self.edges += int((converged & near).sum())

    def add_statuses(self, solution: Solution, numbers: Integers) -> None:
        """Count the statuses of a solution.  numbers: (n,) of the samples."""
        for number, count in enumerate(np.bincount(solution.status).tolist()):
            if count:
                self.statuses[LABELS[number]] += count
                self.name(LABELS[number], numbers[solution.status == number])

    def rename(self, status: NDArray[np.int8], words: str, lines: Integers) -> None:
        """Count samples with some statuses (n,) under other words.  lines: (n,) in their file."""
        self.statuses.subtract(LABELS[number] for number in status.tolist())
        self.statuses = +self.statuses
        if len(status):
            self.statuses[words] += len(status)
            self.name(words, lines)

    def name(self, words: str, numbers: Integers) -> None:
        """Store the first numbers (n,) of samples with a status."""
        name_first(self.named.setdefault(words, []), numbers)

    def status_sentences(self) -> Iterator[str]:
        """Yield the number of samples with each status other than CONVERGED, and the first ones."""
        for words, count in self.statuses.items():
            where = "lines" if words == UNPARSABLE else self.what
            if words == Status.NON_FINITE.label:
                yield f"{count} {words}"  # unparsable rows were among the first
            elif words != Status.CONVERGED.label:
                yield f"{count} {words}: {numbers_text(where, self.named[words], count)}"

    def look_for_unseen(self, config: Config, estimate: SampleEstimate) -> int:
        """Bound the undetected error of one corrupted number at some of the checked poses.

        Returns the last of their rows; 0 if there is none.
        """
        solution, knowledge, _ = estimate
        rows = np.flatnonzero(are_checked(solution))
        order = self.checked + np.arange(len(rows))
        self.checked += len(rows)
        chosen = rows[(order < FIRST_POSES) | (order % LATER_POSES == 0)]
        if not len(chosen):
            return 0
        question = config.solve.question(knowledge).rows(chosen)
        plan = make_plan(config.sensor, question.knowledge, shape=chosen.shape)
        redundancy = redundancies(config.sensor, solution.state[chosen], plan)
        limit = chance_of(config.sensor, plan).limit
        errors = unseen_by_residual(redundancy, limit).reshape(-1, 3, 3)
        largest = np.array([errors[..., :2].max(), errors[..., 2].max()])
        self.unseen = np.fmax(self.unseen, largest)
        total = redundancy.sum(axis=1)
        self.expected += float(np.nansum(total / solution.checks[chosen]))
        self.sampled += int(np.isfinite(total).sum())
        self.is_bare = bool(total[-1] < plan.least_redundancy)
        return int(chosen[-1])

    @property
    def solved_count(self) -> int:
        """Number of samples that have a pose."""
        return self.statuses[Status.CONVERGED.label]

    @property
    def unsolved_count(self) -> int:
        """Number of samples that have no pose."""
        return self.statuses.total() - self.solved_count

    @property
    def skipped_count(self) -> int:
        return self.statuses[Status.SKIPPED.label]

    def sentences(self, config: Config) -> list[str]:
        """Sentences for the user on limitations of the poses, as far as they apply."""
        sentences = (
            self.misfit.describe(np.sqrt(self.expected / max(self.sampled, 1))),
            self.unchecked_sentence(config.solve.power),
            self.edge_sentence(),
            self.unseen_sentence(config.solve.beam),
            self.temperature_sentence(config),
        )
        return [sentence for sentence in sentences if sentence]

    def unchecked_sentence(self, power: str) -> str:
        """A sentence on samples whose poses have, or would have, no redundancy; "" for none.

        power: what is known about the laser's power, as `solve.power`.
        """
        refused = self.statuses[Status.UNCHECKED.label]
        if refused:
            pairs = zip("ABC", self.unlit.tolist(), strict=True)
            unlit = ", ".join(f"PSD {letter} in {count}" for letter, count in pairs if count)
            reason = (
                "They have as many readings as unknowns, or priors of beam and power that are too "
                "wide to check them"
            )
            unknown = "beam" if power == "known" else "power"
            advice = f"Give more knowledge, such as solve.{unknown}: known"
            if unlit:
                reason = (
                    "A detector gives no usable reading, because it is dark or its spot is out of "
                    f"range ({unlit}), and only as many readings as unknowns remain"
                )
                advice = "Bring all spots onto their detectors"
            return (
                f"{self.what.capitalize()} without a redundant reading: {refused}. {reason}, so "
                f"that a wrong reading would not be noticed. {advice}, or solve them all the same "
                "with --accept-unchecked (solve.accept_unchecked)."
            )
        if self.unchecked:
            return (
                f"Poses without a redundant reading: {self.unchecked}. Nothing checks them, and a "
                "distant pose may give the same readings."
            )
        return ""

    def edge_sentence(self) -> str:
        """A sentence on poses with a spot near an edge, if the model has no edges; "" for none."""
        if not self.edges:
            return ""
        return (
            "Poses with a spot closer to its detector's edge than its own diameter: "
            f"{self.edges}. Light may miss the detector there, and then the stated uncertainties "
            "do not hold. Set sensor.apertures.detectors to model the edges."
        )

    def unseen_sentence(self, beam: str) -> str:
        """A sentence on the undetected error that one corrupted number can cause; "" if small.

        beam: what is known about the beam's position, as `solve.beam`.
        """
        place, power = self.unseen.tolist()
        if not max(place, power) > MUCH:
            return ""
        cause = ", because the beam is free" if beam == "free" and place > BOUNDLESS else ""
        return (
            "One wrong number can go unnoticed. A wrong power then shifts the pose by "
            f"{amount(power)}; a wrong position of a spot by {amount(place)}{cause}."
        )

    def temperature_sentence(self, config: Config) -> str:
        """A sentence on samples without a temperature that the sensor needs; "" for none."""
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
            f"shifts them by up to {short_number(1e3 * shift[:3].max(), 2)} µm and "
            f"{short_number(1e6 * shift[3:].max(), 2)} µrad, which the stated uncertainties do not "
            "include."
        )


def amount(errors: float) -> str:
    """Format an error in standard uncertainties."""
    return (
        "any amount"
        if errors > BOUNDLESS
        else (f"at most {short_number(errors, 2)} of its standard uncertainties")
    )


def shift_per_kelvin(sensor: Sensor, options: Solve) -> Floats:
    """Error (6,) of the zero pose, mm and rad, if a sensor is 1 K warmer than its reference and the
    readings are solved without their temperature."""
    state = np.zeros((1, 8))
    state[:, 6:] = beam_shift(sensor, np.ones(1))
    raw = readings(sensor, state)
    raw[:, PLACES] += sensor.thermal.places
    knowledge = replace(options, beam_offset=(0.0, 0.0)).knowledge(sensor)
    beam, power = knowledge.beam, knowledge.power
    solution = solve(sensor, raw, beam=beam, power=power, covariance=False)
    shift: Floats = solution.state[0, :6]
    return shift
