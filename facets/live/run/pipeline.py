"""From blocks of bytes to poses: the same for a live stream, a replay and a salvage.

A block is taken in once, in order: parsed, its counters followed, its counts turned into light.
What it held is then solved in batches, each by itself: the poses of a batch depend on nothing but
what was taken in with it, so that they are the same to the last bit in whatever order, at whatever
time, and beside whatever else they are solved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from math import hypot, isnan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.knowledge import Knowledge, Prior
from ...core.names import TEMPERATURE_COLUMN
from ...core.units import Floats
from ...detectors.counts import SATURATED, UNEQUAL, counts_to_readings
from ...detectors.noise import least_light
from ...detectors.skew import align
from ...estimation.estimates import prepare
from ...estimation.misfit import Misfit
from ...estimation.series import solve_series
from ...estimation.solution import Solution, Status, empty_solution
from ...estimation.table import (
    add_temperature_uncertainty,
    beam_place,
    exact_readings,
    missing_temperature,
    unknown_temperatures,
)
from ...tracking.encoder import MAX_EXTRAPOLATION_S, Encoder
from ..sources.clock import Sequence
from ..sources.frames import MARK, OVERRUN, PERMIT, XY_SUM, Samples, parser
from ..sources.host_time import HostTime
from .board_poses import BoardPoses, is_pose
from .doubts import Doubts, Trust
from .object_poses import ObjectPoses

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.zero import ZeroRequest


#: Standard uncertainty of the time of a sample relative to the time of the stage, s; it adds the
#: distance that a moving stage travels in this time to the uncertainty of its position.
TIMING_SIGMA_S = 1e-3
#: What is to be known of a sample, by the bits of `counts`, and of the board. Its permit for the
#: stage is no event: it is set in every sample, and counted in none.
LOST_BEFORE, MARKED, PERMITTED = 4, 8, 16
FLAGS = {
    SATURATED: "saturated",
    UNEQUAL: "unequal sums",
    LOST_BEFORE: "board overrun",
    MARKED: "marked by the board's input",
}
#: Samples that are solved together, as a series. No newer sample waits longer than for one batch.
BATCH = 250
#: Maximum number of steps of the estimator for a live sample. Where a pose can be found, it takes
#: four or five steps from rest, and up to sixteen from a millimetre off the beam.
MAX_STEPS = 20
#: The status of a sample that was recorded and not solved, since the loop had fallen behind. It is
#: none of the estimator's: a replay solves the sample.
SKIPPED = 64
#: The status of a sample that the estimator calls "non finite" since a converter was at its end.
FULL = 66
LABELS = {status.value: status.label for status in Status} | {
    SKIPPED: "skipped",
    FULL: "saturated",
}


#: The fields of `Batch` with a row for each sample.
PER_SAMPLE = ("seq", "time", "host", "readings", "aligned", "flags")


@dataclass(frozen=True)
class Batch:
    """Samples that wait to be solved.

    seq, time: (n,) unwrapped, the board's us.  host: (n,) the host's monotonic clock, s.
    readings: (n, 9) as the detectors gave them.  aligned: those of one instant each.  flags: (n,)
    bits of FLAGS.  arrival: of their bytes, s.  encoder: what the stage said then.  channels: (n,)
    values of each auxiliary channel by its column; NaN where there is none.
    """

    seq: NDArray[np.int64]
    time: NDArray[np.int64]
    host: Floats
    readings: Floats
    aligned: Floats
    flags: NDArray[np.uint8]
    arrival: float
    encoder: Encoder | None
    channels: dict[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.seq)

    def split(self) -> Iterator[Batch]:
        """Itself in batches of at most BATCH samples, in their order."""
        for start in range(0, len(self), BATCH):
            yield self.part(slice(start, start + BATCH))

    def part(self, rows: slice) -> Batch:
        channels = {column: values[rows] for column, values in self.channels.items()}
        columns = {name: getattr(self, name)[rows] for name in PER_SAMPLE}
        return replace(self, channels=channels, **columns)

    def join(self, later: Batch) -> Batch:
        """Both, with the arrival of the later samples and what the stage said then."""

        def join(one: Any, other: Any) -> Any:
            return np.concatenate([one, other])

        channels = {name: join(self.channels[name], later.channels[name]) for name in self.channels}
        columns = {name: join(getattr(self, name), getattr(later, name)) for name in PER_SAMPLE}
        return replace(later, channels=channels, **columns)


@dataclass(frozen=True)
class Poses:
    """What became of some samples: the columns of `Batch`, solution (n), and channels.

    The solution's status is one of `Status`, or SKIPPED, UNCHECKED or FULL; see LABELS.
    object: (n,) each of the measured object's columns; see `ObjectPoses`.
    """

    seq: NDArray[np.int64]
    time: NDArray[np.int64]
    host: Floats
    readings: Floats
    solution: Solution
    flags: NDArray[np.uint8]
    channels: dict[str, Floats] = field(default_factory=dict)
    object: dict[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.seq)

    @property
    def further(self) -> dict[str, Floats]:
        """The columns that only some runs have: of the object, and of auxiliary channels."""
        return {**self.object, **self.channels}


@dataclass
class Tally:
    """What happened so far.

    samples: that came.  statuses: of those that are solved or given up.  misfit: of the poses,
    those whose residual is beyond chance.  unknown_temperatures: samples without the temperature
    that the sensor follows.
    """

    samples: int = 0
    unknown_temperatures: int = 0
    misfit: Misfit = field(default_factory=Misfit)
    statuses: Counter[str] = field(default_factory=Counter)
    flags: Counter[str] = field(default_factory=Counter)

    @property
    def unsolved_count(self) -> int:
        """Samples that were looked at and have no pose."""
        return self.statuses.total() - self.statuses[Status.CONVERGED.label]

    def pose_complaint(self) -> str:
        """Why there is no pose at all; nothing where there is one."""
        if not self.samples:
            return "no sample came."
        words = ", ".join(f"{count} {status}" for status, count in self.statuses.items())
        return "" if self.statuses[Status.CONVERGED.label] else f"no sample gave a pose: {words}."

    @property
    def skipped_count(self) -> int:
        return self.statuses[LABELS[SKIPPED]]


class Pipeline:
    """Parses, follows the counters, converts; and solves."""

    def __init__(
        self, config: Config, zero: ZeroRequest | None = None, covariance: bool = False
    ) -> None:
        """zero, covariance: which further columns poses have, as of `ObjectPoses`."""
        self.config = config
        self.object_poses = ObjectPoses(config, zero, covariance)
        settings = config.acquire
        self.parser = parser(settings.format, settings.content, len(settings.channels))
        self.sequence = Sequence()
        self.host_time = HostTime()
        self.tally = Tally()
        self.board = BoardPoses()
        self.doubts = Doubts(least_light(config.sensor))
        self.trust = Trust(config)
        self.at_rest = knowledge_at_rest(config)
        self.dark = np.full(12, config.acquire.dark)
        self.last = (float("nan"), 0)  # arrival, s, and board's time, us, of the last sample
        self.latest = -float("inf")  # host's time of the last sample, s
        self.waiting: Batch | None = None  # the last two samples; see `await_neighbours`

    def feed(self, block: bytes, arrival: float, encoder: Encoder | None = None) -> Poses | None:
        """The poses of all samples that a block completes; None where it completes none.

        arrival: host's monotonic clock, s; NaN where it is not known.
        """
        parts = [self.solve(batch) for batch in self.take(block, arrival, encoder)]
        return join_poses(parts) if parts else None

    def take(self, block: bytes, arrival: float, encoder: Encoder | None = None) -> list[Batch]:
        """The samples that a block completes, ready to be solved, in batches, in order."""
        restarts = self.sequence.restarts
        came = self.parser.feed(block)
        self.refuse_other_channels()
        solved = is_pose(came)
        poses = came.where(solved) if solved.any() else None
        samples, seq, time = self.sequence.follow(
            came if poses is None else came.where(~solved), arrival
        )
        if poses is not None:
            self.board.add(poses, self.sequence, self.sequence.restarts > restarts)
        if not len(samples):
            return []
        host = self.host_times(time, arrival, self.sequence.restarts > restarts)
        if isnan(arrival):  # as late after its sample as the last that is known
            arrival = self.last[0] + 1e-6 * (int(time[-1]) - self.last[1])
        self.last = arrival, int(time[-1])
        self.trust.add_counts(samples.counts, time)
        readings, flags = self.convert(samples)
        flags |= np.where(samples.flags & OVERRUN, LOST_BEFORE, 0).astype(np.uint8)
        flags |= np.where(samples.flags & MARK, MARKED, 0).astype(np.uint8)
        flags |= np.where(samples.flags & PERMIT, PERMITTED, 0).astype(np.uint8)
        self.count(flags)
        channels = {
            channel.column: channel.values(samples.channels[:, n])
            for n, channel in enumerate(self.config.acquire.channels)
        }
        whole = Batch(seq, time, host, readings, readings, flags, arrival, encoder, channels)
        return list(self.await_neighbours(whole).split())

    def await_neighbours(self, newest: Batch) -> Batch:
        """The samples whose neighbours on both sides have come, with readings of one instant.

        Where detectors are read one after the other, the newest sample waits for the next one: from
        both sides its change is the same for whatever blocks the samples came in.
        """
        if not any(self.config.sensor.light.delays):
            return newest
        first = len(self.waiting) - 1 if self.waiting else 0
        rows = self.waiting.join(newest) if self.waiting else newest
        seconds = 1e-6 * rows.time.astype(np.float64)
        rows = replace(rows, aligned=align(self.config.sensor, seconds, rows.readings))
        self.waiting = rows.part(slice(-2, None))
        return rows.part(slice(first, -1))

    def release(self) -> list[Batch]:
        """The last sample of a stream, if it waits for the next one."""
        last, self.waiting = self.waiting, None
        return [last.part(slice(-1, None))] if last else []

    def refuse_other_channels(self) -> None:
        """Raise `InputError` if the stream has other auxiliary channels than the configuration.

        Frames of such a kind in a stream that began otherwise are refused as damaged ones are.
        """
        count, named = self.parser.other_channels, len(self.config.acquire.channels)
        if count is None or self.tally.samples or self.board.came:
            return
        remedy = f"name all {count}, in the order of the frame" if count else "leave that key out"
        raise InputError(
            f"each sample of the stream has {count} auxiliary channels, but acquire.channels of "
            f"the configuration names {named}: {remedy}, or change what the board sends; "
            "what was recorded can be solved by `facets replay RECORDING --config CONFIG`"
        )

    def host_times(self, time: NDArray[np.int64], arrival: float, restarted: bool) -> Floats:
        """The samples' times on the host's clock (n,), s, which only grow.

        time: the board's, us.  restarted: whether the board was, before one of these samples.
        """
        device: Floats = 1e-6 * time.astype(np.float64)
        before = self.host_time.line
        if restarted:
            self.host_time.restart()
        if not isnan(arrival):
            self.host_time.add(float(device[-1]), arrival)
        if self.config.acquire.timing == "arrival" or self.host_time.line is None:
            known = arrival
            if isnan(arrival):
                known = self.last[0] + 1e-6 * (int(time[-1]) - self.last[1])
            return known - self.config.acquire.delay - 1e-6 * (time[-1] - time)  # type: ignore[no-any-return]
        host = self.host_time.line.host_times(device)
        if restarted and before is not None:
            host[: self.sequence.fresh] = before.host_times(device[: self.sequence.fresh])
        host -= self.config.acquire.least_delay
        # the line moves as it is known better, and later samples are not earlier for that
        host = np.maximum(host, self.latest + 1e-9 * np.arange(1, len(host) + 1))
        host = np.maximum.accumulate(host)
        self.latest = float(host[-1])
        return host

    @property
    def late(self) -> float:
        """How much later the newest samples came than `host_times` says, by the soonest line of the
        board's clock so far, s."""
        over = self.host_time.over if self.config.acquire.timing == "arrival" else 0.0
        return self.host_time.late + over

    def warm_up(self) -> None:
        """Compiles, or loads, what the stream will need, before it runs."""
        light = np.full((2, 9), 0.1)
        nobody = Batch(
            np.zeros(2, np.int64), np.zeros(2, np.int64), np.zeros(2), light, light,
            np.zeros(2, np.uint8), 0.0, None,
        )  # fmt: skip
        prepare(self.config.sensor, self.knowledge(nobody.host, nobody.encoder))
        kept, self.object_poses = self.object_poses, ObjectPoses(self.config)
        self.solve(nobody)
        self.object_poses, self.tally = kept, Tally()
        self.doubts, self.trust = Doubts(self.doubts.floor), Trust(self.config)

    def convert(self, samples: Samples) -> tuple[Floats, NDArray[np.uint8]]:
        """Readings (n, 9) and flags (n,) of counts."""
        sensor, electronics = self.config.sensor, self.config.electronics
        xy_sum = samples.kind == XY_SUM
        if xy_sum.all() or not xy_sum.any():
            return counts_to_readings(
                sensor, electronics, samples.counts, bool(xy_sum[0]), self.dark
            )
        out, flags = np.empty((len(samples), 9)), np.empty(len(samples), np.uint8)
        for kind in (True, False):
            part = xy_sum == kind
            out[part], flags[part] = counts_to_readings(
                sensor, electronics, samples.counts[part], kind, self.dark
            )
        return out, flags

    def solve(self, batch: Batch) -> Poses:
        """The poses of a batch.

        The estimator screens each sample first: one with too few detectors that have enough light,
        within their edges and below saturation, gets its status without a step.
        """
        temperature = self.temperature_of(batch)
        solution, knowledge, exact = self.estimate(batch, temperature)
        unknown = np.zeros(len(batch), dtype=bool)
        if temperature is not None:
            unknown = ~np.isfinite(temperature)
            self.tally.unknown_temperatures += int(unknown.sum())
        self.tally.misfit.carried |= batch.encoder is not None
        self.tally.misfit.add(
            solution, self.config.sensor, knowledge, self.config.solve.method, exact
        )
        self.doubts.add(batch.readings, batch.flags, solution.misfit, unknown)
        self.trust.add_poses(solution, 1e-6 * int(batch.time[-1]))
        if self.board.came:  # which does not know the temperature
            known = solution if temperature is None else self.estimate(batch, None)[0]
            self.board.compare(batch.seq, known)
        return self.finish(batch, name_causes(solution, batch.flags))

    def estimate(
        self, batch: Batch, temperature: Floats | None
    ) -> tuple[Solution, Knowledge, Floats]:
        """The solution of a batch, by what knowledge of the beam, and of which exact readings."""
        sensor, options = self.config.sensor, self.config.solve
        exact = exact_readings(sensor, batch.aligned, temperature)
        knowledge = self.knowledge(batch.host, batch.encoder, temperature)
        solution = solve_series(
            sensor,
            exact,
            knowledge,
            method=options.method,
            max_steps=min(options.max_steps, MAX_STEPS),
            accept_unchecked=options.accept_unchecked,
        )
        if temperature is not None:
            solution = add_temperature_uncertainty(
                sensor, options, knowledge, solution, temperature
            )
        return solution, knowledge, exact

    def skip(self, batch: Batch) -> Poses:
        """The batch without poses, for want of time."""
        has_parts = self.config.sensor.calibration is not None
        return self.finish(batch, empty_solution(len(batch), SKIPPED, has_parts))

    def finish(self, batch: Batch, solution: Solution) -> Poses:
        for status, count in enumerate(np.bincount(solution.status).tolist()):
            if count:
                self.tally.statuses[LABELS[status]] += count
        return Poses(
            batch.seq, batch.time, batch.host, batch.readings, solution, batch.flags,
            batch.channels,
            self.object_poses.columns(solution, batch.seq, batch.time, self.temperature_of(batch)),
        )  # fmt: skip

    def temperature_of(self, batch: Batch) -> Floats | None:
        """Temperatures (n,), degrees Celsius, if the sensor follows them and a channel has them."""
        if not self.config.sensor.thermal.is_on:
            return None
        return batch.channels.get(TEMPERATURE_COLUMN)

    def temperature_sentence(self) -> str:
        """What it costs that samples lack a temperature that the sensor follows; empty if none."""
        channels = {channel.column for channel in self.config.acquire.channels}
        if not self.config.sensor.thermal.is_on or TEMPERATURE_COLUMN in channels:
            return unknown_temperatures(self.tally.unknown_temperatures, "samples")
        source = f"acquire.channels names no channel {TEMPERATURE_COLUMN}"
        return missing_temperature(self.config.sensor, self.config.solve, source)

    def knowledge(
        self, host: Floats, encoder: Encoder | None, temperature: Floats | None = None
    ) -> Knowledge:
        """What is known of the beam at the samples' times and temperatures."""
        sensor, options = self.config.sensor, self.config.solve
        if self.at_rest.beam == "free":
            return self.at_rest
        shift = beam_place(sensor, None, temperature)
        shift = np.zeros(2) if shift is None else np.nan_to_num(shift)
        if encoder is None:
            return self.at_rest if temperature is None else options.knowledge(sensor, shift)
        age = float(host[-1]) - encoder.time
        if not age <= MAX_EXTRAPOLATION_S:
            return replace(self.at_rest, beam="free")
        # a stage may have changed its speed since it was asked: half the way is in doubt
        moving = float(np.hypot(*encoder.speed)) * (TIMING_SIGMA_S + max(0.0, age) / 2)
        sigma = hypot(self.config.stage.accuracy, moving, jitter_of(self.config))
        places = encoder.places(host) + np.array(options.beam_offset) + shift
        return replace(self.at_rest, beam=Prior(places, sigma))

    def count(self, flags: NDArray[np.uint8]) -> None:
        self.tally.samples += len(flags)
        if flags.any():
            for bit, name in FLAGS.items():
                self.tally.flags[name] += int((flags & bit > 0).sum())


def jitter_of(config: Config) -> float:
    """The beam's pointing jitter at the mirror, 1 sigma, mm."""
    return config.sensor.electronics.pointing if config.sensor.electronics else 0.0


def knowledge_at_rest(config: Config) -> Knowledge:
    """What is known of the beam where no stage carries it, or where its position is solved for."""
    if config.solve.method == "paper":
        return Knowledge()
    return config.solve.knowledge(config.sensor)


def name_causes(solution: Solution, flags: NDArray[np.uint8]) -> Solution:
    """The same with the status FULL for what is not finite since a converter was at its end."""
    full = flags & SATURATED > 0
    if not full.any():
        return solution
    full &= solution.status == Status.NON_FINITE
    return replace(solution, status=np.where(full, np.int8(FULL), solution.status))


def join_poses(parts: list[Poses]) -> Poses:
    """Poses one after the other."""
    if len(parts) == 1:
        return parts[0]
    joined = {
        f.name: np.concatenate([getattr(part.solution, f.name) for part in parts])
        for f in fields(Solution)
        if getattr(parts[0].solution, f.name) is not None
    }
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("seq", "time", "host", "readings", "flags")
    }
    further = [
        {name: np.concatenate([getattr(part, kind)[name] for part in parts])
         for name in getattr(parts[0], kind)}
        for kind in ("channels", "object")
    ]  # fmt: skip
    return Poses(solution=Solution(**joined), channels=further[0], object=further[1], **columns)
