"""Faults of the table: alternatives that change the samples, each undone in turn before a fit.

A wrong sign, exchanged detectors, another order of the angles or a wrong unit leave residuals
without a recognisable form. Some of them hide in an unknown: a swapped sign in a scale of -2,
another order of angles in the errors of a detector. So each is tried as a hypothesis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import combinations, permutations, product
from typing import Any, NamedTuple

import numpy as np

from ...core.errors import InputError
from ...core.names import KINDS, POSE
from ...core.rigid_body import rotation_angles, rotation_matrix
from ...core.sensor import Sensor
from ...core.units import Floats
from ...detectors.electrodes import tetra_lateral_places, tetra_lateral_ratios
from ...detectors.noise import standard_deviations
from ...detectors.temperature import PLACES
from ...model.arrays import half_sizes, readings
from ..fitting.bundle_adjustment import Data
from ..fitting.fit import NORMAL_MEDIAN, Descent, Guess, StoppingRule, Task, solve_open_axes
from ..fitting.samples import row_numbers
from ..fitting.unknowns import Choice
from .alternative import EXACT_TRIALS, Alternative, Finding, capitalise
from .score import likeliest_states

Change = Callable[[Data], Data]
ColumnChange = Callable[[Floats], Floats]

#: Numbers of samples and steps of a first trial and of a last one.
SAMPLES, STEPS = (30, 120), (4, 12)
#: Number of the best hypotheses that are tried in pairs with all others.
PAIRED_COUNT = 6
#: A hypothesis explains a fit if it lowers chi-square to this fraction, and the residuals to this
#: many times the noise. Larger residuals, as real light causes, are accepted if chi-square is lower
#: than that of the next best hypothesis by the last factor.
LEAST_REDUCTION, GOOD_SIGMAS, CLEAR_GAP = 0.4, 5.0, 3.0
#: Faults whose chi-square is within this factor of the best one's are indistinguishable from it.
ALIKE_FACTOR = 1.5
#: Rows are strays if their residuals are this many times those of the others. Entering or leaving a
#: block of them costs this many rows; a block has this number of rows or more, and up to this
#: fraction of all.
STRAY_FACTOR, STRAY_COST, LEAST_STRAY, MAX_STRAY_FRACTION = 5.0, 4.0, 8, 0.6
#: Residuals, relative to the noise, that no light of a bench causes.
WORST_LIGHT_SIGMAS = 17.0
#: Amplifiers saturate if this fraction of the currents above this quantile are too small.
LARGE_QUANTILE, INWARD_FRACTION = 0.9, 0.8


def table_fault(words: str, remedy: str, change: Change, general: bool = False) -> Alternative:
    """The alternative that the table has a fault which `change` undoes."""
    return Alternative(words, "table", words, remedy, change=change, general=general)


def table_faults(sensor: Sensor) -> Iterator[Alternative]:
    """Yield all faults of a table that can be undone, as alternatives."""
    yield from swapped_signs()
    yield from exchanged_readings()
    yield from angle_orders()
    yield from shifted_rows()
    yield from reference_axes()
    yield from wrong_units()
    yield from detector_kinds(sensor)


def change_readings(change: ColumnChange) -> Change:
    """Make a change of samples from one of their readings (n, 9)."""
    return lambda data: data._replace(raw=change(data.raw))


def change_pose(change: ColumnChange) -> Change:
    """Make a change of samples from one of the reference's poses (n, 6); velocities are dropped."""
    return lambda data: data._replace(pose=change(data.pose), velocity=None)


def scale(columns: Any, factor: float) -> ColumnChange:
    """Multiply some columns by a factor."""

    def change(values: Floats) -> Floats:
        changed = values.copy()
        changed[:, columns] *= factor
        return changed

    return change


def permute(order: Sequence[int]) -> ColumnChange:
    """Reorder the columns."""
    return lambda values: values[:, order]


def exchange(a: int, b: int, count: int) -> ColumnChange:
    """Exchange two of `count` columns."""
    order = list(range(count))
    order[a], order[b] = b, a
    return permute(order)


def swapped_signs() -> Iterator[Alternative]:
    """Hypotheses of a swapped sign: of a coordinate on one detector or on all, or of an axis of the
    reference."""
    for n, kind in enumerate(("psi", "zeta")):
        for k in (0, 1, 2, slice(None)):
            of = "all detectors" if isinstance(k, slice) else f"detector {'ABC'[k]}"
            yield table_fault(
                f"the sign of {kind} of {of} is swapped",
                "swap it back",
                change_readings(scale(np.arange(n, 9, 3)[k], -1)),
            )
    for n, name in enumerate(POSE):
        yield table_fault(
            f"the sign of the reference's {name} is swapped",
            "swap it back",
            change_pose(scale(n, -1)),
        )


def exchanged_readings() -> Iterator[Alternative]:
    """Hypotheses that detectors are exchanged, or two of the nine readings."""
    for order in permutations(range(3)):
        if order == (0, 1, 2):
            continue
        letters = "".join("ABC"[k] for k in order)
        moved = [k for k in range(3) if order[k] != k]
        of = " and ".join("ABC"[k] for k in moved) if len(moved) == 2 else "A, B and C"
        yield table_fault(
            f"detectors {of} are exchanged",
            f"name the columns of the readings in the order {letters}",
            change_readings(permute([3 * k + n for k in order for n in range(3)])),
        )
    for a, b in combinations(range(9), 2):
        if (a % 3 == 2) == (b % 3 == 2):  # nobody takes a place for a power
            yield table_fault(
                f"{name_pair(a, b)} are exchanged",
                "exchange them",
                change_readings(exchange(a, b, 9)),
            )


def name_pair(a: int, b: int) -> str:
    """Name two of the nine readings."""
    (first, letter), (second, other_letter) = ((f"{KINDS[n % 3]}", "ABC"[n // 3]) for n in (a, b))
    if letter == other_letter:
        return f"{first} and {second} of detector {letter}"
    if first == second:
        return f"{first.replace('power', 'powers')} of detectors {letter} and {other_letter}"
    return f"{first} of detector {letter} and {second} of detector {other_letter}"


def rotations(pose: Floats, order: str) -> Floats:
    """Rotation matrices (n, 3, 3) of angles about fixed axes in the given order."""
    about = np.zeros((len(pose), 3, 3, 3))
    for n in range(3):
        only = np.zeros((len(pose), 3))
        only[:, n] = pose[:, 3 + n]
        about[:, n] = rotation_matrix(only)
    matrices = np.eye(3)
    for axis in order:
        matrices = about[:, "xyz".index(axis)] @ matrices
    return matrices


def angle_orders() -> Iterator[Alternative]:
    """Hypotheses of another order of the reference's angles, or of the inverse rotation."""

    def replace_angles(matrices: Callable[[Floats], Floats]) -> Change:
        """Make the change that replaces the angles by those of rotation matrices (n, 3, 3) of the
        pose."""
        return change_pose(lambda pose: np.hstack([pose[:, :3], rotation_angles(matrices(pose))]))

    for order in ("".join(axes) for axes in permutations("xyz")):
        if order != "xyz":
            axes = ", then ".join(order)
            yield table_fault(
                f"the reference's angles are taken in another order (about the fixed axes {axes}; "
                "here x, then y, then z)",
                "convert them",
                replace_angles(partial(rotations, order=order)),
            )
    yield table_fault(
        "the reference gives the inverse rotation",
        "invert it",
        replace_angles(lambda pose: np.swapaxes(rotation_matrix(pose[:, 3:]), 1, 2)),
    )


def shifted_rows() -> Iterator[Alternative]:
    """Hypotheses that the reference's rows are shifted by one row."""
    for words, by in (("below", 1), ("above", -1)):
        yield table_fault(
            f"the reference's rows are one row {words} where they belong",
            "move them",
            partial(shift_reference, by=by),
        )


def shift_reference(data: Data, by: int) -> Data:
    """The samples with the poses of the row below, by = 1, or above."""
    if data.moves is None:
        return data
    step = data.moves.following if by > 0 else data.moves.last
    return data._replace(pose=data.pose + by * step, velocity=None)


def reference_axes() -> Iterator[Alternative]:
    """Hypotheses that axes of the reference are exchanged or turned by multiples of 90 degrees."""
    for a, b in ((0, 1), (3, 4)):
        yield table_fault(
            f"the reference's {POSE[a]} and {POSE[b]} are exchanged",
            "exchange them",
            change_pose(exchange(a, b, 6)),
        )
    for quarters in (1, 2, 3):
        yield table_fault(
            f"the reference's x and y axes are turned by {90 * quarters} degrees about z",
            "turn them back",
            change_pose(partial(turn_axes, quarters=quarters)),
        )


def turn_axes(pose: Floats, quarters: int) -> Floats:
    """Turn the x and y axes of poses (n, 6) by multiples of 90 degrees about z."""
    turned = pose.copy()
    for _ in range(quarters):
        for x in (0, 3):
            turned[:, x], turned[:, x + 1] = -turned[:, x + 1], turned[:, x].copy()
    return turned


def wrong_units() -> Iterator[Alternative]:
    """Hypotheses of another unit of lengths, angles or powers."""
    degree = np.pi / 180 * 1000
    lengths, angles, powers = slice(3), slice(3, 6), slice(2, 9, 3)
    for words, factor in (
        ("degrees where mrad is asked for", degree),
        ("rad where mrad is asked for", 1e3),
        ("urad where mrad is asked for", 1e-3),
        ("arc minutes where mrad is asked for", degree / 60),
        ("arc seconds where mrad is asked for", degree / 3600),
    ):
        change = change_pose(scale(angles, factor))
        yield table_fault(f"the reference's angles are in {words}", "convert them", change)
    for words, factor in (
        ("um where mm is asked for", 1e-3),
        ("m where mm is asked for", 1e3),
    ):
        change = change_pose(scale(lengths, factor))
        yield table_fault(f"the reference's lengths are in {words}", "convert them", change)
        change = change_readings(scale(PLACES, factor))
        yield table_fault(f"the spots' places are in {words}", "convert them", change)
    for words, factor in (("uW", 1e-3), ("W", 1e3)):
        change = change_readings(scale(powers, factor))
        yield table_fault(
            f"the powers are in {words} where mW is asked for", "convert them", change
        )


def detector_kinds(sensor: Sensor) -> Iterator[Alternative]:
    """Hypotheses that currents were converted by the formula of another kind of detector."""
    for words, convert, kind in (
        ("a tetra-lateral's and were not straightened", tetra_lateral_places, "tetra-lateral"),
        (
            "straightened as a tetra-lateral's and are none",
            tetra_lateral_ratios,
            "duo-lateral or pincushion",
        ),
    ):
        yield table_fault(
            f"the places on the detectors are {words}",
            f"set sensor.electronics.kind to {kind} and convert the recorded currents again",
            change_readings(partial(convert_places, sensor, convert)),
        )


def convert_places(
    sensor: Sensor, convert: Callable[[Floats, float], Floats], raw: Floats
) -> Floats:
    """Convert the places in readings (n, 9), mm, by a function of places in half sizes and of the
    detector's aspect ratio, except on detectors with places beyond their edges, in other units."""
    converted = raw.copy()
    for k, psd in enumerate(sensor.psds):
        half = np.array([psd.size_y, psd.size_z]) / 2
        columns = slice(3 * k, 3 * k + 2)
        places = raw[:, columns] / half
        if not (np.abs(places) >= 1).any():
            converted[:, columns] = convert(places, psd.size_z / psd.size_y) * half
    return converted


def saturation(sensor: Sensor) -> Alternative:
    """The hypothesis that amplifiers saturate."""
    return Alternative(
        "saturated", "electronics", "amplifiers saturate (the largest currents are smaller than "
        "a fit to the others expects)",
        "use a range with room above the largest current, or less light",
        change=partial(exclude_large_currents, sensor),
    )  # fmt: skip


def largest_currents(sensor: Sensor, data: Data) -> tuple[Floats, Floats]:
    """The largest current of each detector (n, 3), mW, and the places (n, 3, 2) in half sizes."""
    parts = data.raw.reshape(-1, 3, 3)
    places = parts[:, :, :2] / half_sizes(sensor)
    return parts[:, :, 2] * (1 + np.abs(places).max(axis=2)) / 2, places


def exclude_large_currents(sensor: Sensor, data: Data) -> Data:
    """Return the samples without the readings whose current is above the median, and without rows
    that have none left."""
    current, _ = largest_currents(sensor, data)
    small = current <= np.nanmedian(current)
    raw = np.where(np.repeat(small, 3, axis=1), data.raw, np.nan)
    return data._replace(raw=raw).part(np.asarray(small.any(axis=1)))


# ---- trying them


def subsample(sensor: Sensor, data: Data, count: int) -> Data:
    """Samples at equal intervals, with the noise of the mirror at rest.

    A fault in the powers would change the noise of the samples, on which the comparison depends.
    """
    rows = np.linspace(0, len(data.raw) - 1, min(count, len(data.raw))).astype(np.int64)
    part = data.part(np.unique(rows))
    noise = standard_deviations(sensor, readings(sensor, np.zeros((1, 8))))
    return part._replace(noise=np.broadcast_to(noise, part.raw.shape))


def short_fit_of(
    sensor: Sensor, data: Data, chosen: Choice, steps: int
) -> tuple[Task, Guess | None]:
    """Fit for some steps; returns the task and the last guess, which is None if the sensor becomes
    impossible."""
    task = Descent(sensor, data, chosen, 3.0)
    with suppress(InputError, np.linalg.LinAlgError):
        at = task.guess(task.start, solve_open_axes(data, sensor))
        return task, task.settle(at, StoppingRule(steps))[0]
    return task, None


def mean_square(task: Task, at: Guess) -> float:
    """The mean square of the residuals plus that of the unknowns' distances from their priors.

    The first is robust, so that spikes do not hide a fault. The means are separate, since a sign
    that hides in a scale of -2 is one unknown among a thousand readings.
    """
    is_read = np.isfinite(task.data.raw)
    distance = (at.values - task.start)[task.choice.places]
    size = NORMAL_MEDIAN * float(np.median(np.abs(at.residual[is_read])))
    return size**2 + float(distance @ task.prior @ distance) / len(distance)


class Explanation(NamedTuple):
    """An explanation of a bad fit.

    faults: one fault, or two at once.  before, after: the residuals relative to the noise, with the
    faults and with the faults undone.  others: faults that explain the data equally well.
    """

    faults: tuple[Alternative, ...]
    before: float
    after: float
    others: tuple[tuple[Alternative, ...], ...]

    @property
    def finding(self) -> Finding:
        """The finding, which refuses the calibration and names the faults and their remedies."""
        faults = ", and ".join(fault.words for fault in self.faults)
        are_two = len(self.faults) > 1
        remedies = "; ".join(fault.remedy for fault in self.faults)
        others = " or that ".join(
            " and ".join(fault.words for fault in rivals) for rivals in self.others
        )
        rest = f" It could be that {others} as well: these samples cannot tell." if others else ""
        return Finding(True, (
            f"Probably {'two faults at once: ' if are_two else ''}{faults}: with that undone, the "
            f"residuals fall from {self.before:.3g} to {self.after:.3g} times the noise. "
            f"{capitalise(remedies)}, and calibrate again.{rest}"
        ), tuple(fault.key for fault in self.faults))  # fmt: skip

    @property
    def is_block(self) -> bool:
        """Whether it is a block of rows whose fault is unknown."""
        return self.faults[0].general

    def undo(self, data: Data) -> Data:
        """The samples without the faults."""
        return undo(data, self.faults)


def find_fault(sensor: Sensor, data: Data, chosen: Choice) -> Explanation | None:
    """Find the fault, or the two faults, that explain a bad fit best; None if none does.

    Pairs are tried only if no single fault leaves residuals as small as real light and scatter do.
    """
    trials = Trials(sensor, data, chosen)
    before = trials.trial((), 1)
    every = list(table_faults(sensor))
    if is_saturated(sensor, data, chosen):
        every.append(saturation(sensor))
    single = trials.rank([(hypothesis,) for hypothesis in every])
    explains = single.explains(before)
    small = before <= GOOD_SIGMAS**2 or (explains and single.levels[0] <= GOOD_SIGMAS**2)
    if not small:
        partners = [fault for (fault,) in single.partners]
        others = [fault for fault in every if fault not in partners]
        double = trials.rank([*combinations(partners, 2), *product(partners, others)])
        if double.explains(min(before, single.levels[0])):
            return double.explanation(before)
    if explains:
        return single.explanation(before)
    return find_stray_rows(sensor, data, chosen, float(before**0.5))


def find_stray_rows(
    sensor: Sensor, data: Data, chosen: Choice, before: float
) -> Explanation | None:
    """Find a block of rows that a fit to a third of the others does not describe; None if there is
    none.  The explanation names the fault of the table in these rows, if one fits them.

    before: the residuals of the fit, relative to the noise.
    """
    count, at, used = len(data.raw), None, slice(0)
    level = WORST_LIGHT_SIGMAS**2
    for n in range(3):
        part = slice(n * count // 3, (n + 1) * count // 3)
        third = subsample(sensor, data.part(part), SAMPLES[1])
        task, tried = short_fit_of(sensor, third, chosen, STEPS[1])
        if tried is not None and mean_square(task, tried) < level:
            at, level, used = tried, mean_square(task, tried), part
    if at is None:
        return None
    sizes = row_residuals(sensor, data, chosen, at)
    usual = float(np.median(sizes[used]))
    block = likeliest_states(np.where(sizes > STRAY_FACTOR * usual, 1.0, -1.0), STRAY_COST)
    if not LEAST_STRAY <= block.sum() <= MAX_STRAY_FRACTION * count:
        return None
    numbers, rest = row_numbers(data)[block], data.part(block)
    every = list(table_faults(sensor))
    mended = sorted(
        (float(np.median(row_residuals(sensor, undo(rest, (fault,)), chosen, at))), n)
        for n, fault in enumerate(every)
    )
    words = f"rows {numbers[0]} to {numbers[-1]} do not belong to the others"
    is_clear = mended[0][0] < STRAY_FACTOR * usual and CLEAR_GAP * mended[0][0] < mended[1][0]
    if is_clear:
        words += f" (in them, {every[mended[0][1]].words})"
    elif before <= GOOD_SIGMAS or level > LEAST_REDUCTION * before**2:
        return None
    remedy = "mend these rows, or delete them: look for columns, units and rows that were moved"
    exclude = partial(exclude_rows, numbers[0], numbers[-1])
    fault = table_fault(words, remedy, exclude, general=not is_clear)
    return Explanation((fault,), before, level**0.5, ())


def exclude_rows(first: int, last: int, data: Data) -> Data:
    """Return the samples without the rows numbered first to last."""
    rows = row_numbers(data)
    return data.part((rows < first) | (rows > last))


def is_saturated(sensor: Sensor, data: Data, chosen: Choice) -> bool:
    """Whether spots of the largest currents are nearer to the centre than a fit to the smaller half
    predicts."""
    dim = subsample(sensor, exclude_large_currents(sensor, data), SAMPLES[1])
    _, at = short_fit_of(sensor, dim, chosen, STEPS[1])
    if at is None:
        return False
    current, places = largest_currents(sensor, data)
    residuals = residuals_at(all_rows(sensor, data, chosen), at).reshape(-1, 3, 3)
    residuals = residuals[:, :, :2] * np.sign(places)
    axis = np.abs(np.nan_to_num(places)).argmax(axis=2)[:, :, None]
    outward = np.take_along_axis(residuals, axis, axis=2)[:, :, 0]
    largest = outward[current > np.nanquantile(current, LARGE_QUANTILE)]
    return bool((largest < -GOOD_SIGMAS).mean() > INWARD_FRACTION)


def row_residuals(sensor: Sensor, data: Data, chosen: Choice, at: Guess) -> Floats:
    """The largest residual (n,) of each row's places at the common unknowns of a fit to others."""
    sizes: Floats = np.abs(residuals_at(all_rows(sensor, data, chosen), at)[:, PLACES]).max(axis=1)
    return sizes


def all_rows(sensor: Sensor, data: Data, chosen: Choice) -> Task:
    """The fit of all rows."""
    return Task(sensor, subsample(sensor, data, len(data.raw)), chosen, 3.0)


def residuals_at(task: Task, at: Guess) -> Floats:
    """Residuals (n, 9) at the common unknowns of a fit to other rows, with the laser's power
    unknown; 0 for missing readings."""
    residuals: Floats = task.guess(at.values, solve_open_axes(task.data, task.nominal)).residual
    residuals[~np.isfinite(task.data.raw)] = 0.0
    return residuals


class Trials(NamedTuple):
    """Short fits with faults undone."""

    sensor: Sensor
    data: Data
    chosen: Choice

    def trial(self, faults: tuple[Alternative, ...], n: int) -> float:
        """Chi-square per reading after a first trial (0) or a last one (1)."""
        data = subsample(self.sensor, undo(self.data, faults), SAMPLES[n])
        task, at = short_fit_of(self.sensor, data, self.chosen, STEPS[n])
        return np.inf if at is None else mean_square(task, at)

    def rank(self, several: list[tuple[Alternative, ...]]) -> Ranking:
        """Try all faults briefly, and the best of them again; levels are chi-square per reading."""
        first = sorted((self.trial(faults, 0), n) for n, faults in enumerate(several))
        last = sorted((self.trial(several[n], 1), n) for _, n in first[:EXACT_TRIALS])
        return Ranking(
            [level for level, _ in last],
            [several[n] for _, n in last],
            [several[n] for _, n in first[:PAIRED_COUNT]],
        )


def undo(data: Data, faults: tuple[Alternative, ...]) -> Data:
    """Return the samples with the changes of all faults applied."""
    for fault in faults:
        assert fault.change is not None
        data = fault.change(data)
    return data


class Ranking(NamedTuple):
    """Faults in the order of chi-square with each of them undone.

    levels, faults: chi-square per reading, and the faults of the last trials, the best first.
    partners: the best faults of the first trials, each of which may be one of two.
    """

    levels: list[float]
    faults: list[tuple[Alternative, ...]]
    partners: list[tuple[Alternative, ...]]

    def explains(self, before: float) -> bool:
        """Whether the best faults reduce chi-square per reading enough, from `before`, and clearly
        more than the next."""
        best, runner_up = self.levels[0], self.levels[1]
        clear = best <= GOOD_SIGMAS**2 or (
            best <= WORST_LIGHT_SIGMAS**2 and CLEAR_GAP * best < runner_up
        )
        return best < LEAST_REDUCTION * before and clear

    def explanation(self, before: float) -> Explanation:
        """The explanation by the best faults, with those that are about as good. before: chi-square
        per reading without them."""
        alike = [faults for level, faults in zip(self.levels[1:], self.faults[1:], strict=True)
                 if level < ALIKE_FACTOR * self.levels[0]]  # fmt: skip
        best = float(self.levels[0] ** 0.5)
        return Explanation(self.faults[0], float(before**0.5), best, tuple(alike))
