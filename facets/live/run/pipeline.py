"""From blocks of bytes to poses: the same for a live stream, a replay and a salvage.

A block is taken in once, in order: parsed, its counters followed, its counts turned into readings.
Its samples are then solved in batches. The poses of a batch depend only on the samples of the
batch, so that they are the same to the last bit in whatever order and at whatever time batches are
solved. `recording.together` takes in many blocks at once where this gives the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from math import hypot, inf, isnan, nan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.names import READING_COLUMNS, TEMPERATURE_COLUMN
from ...core.units import Floats
from ...detectors.counts import SATURATED, UNEQUAL, counts_to_readings
from ...detectors.noise import least_light
from ...detectors.skew import align
from ...estimation.blocks import prepare
from ...estimation.measurement import Measurement
from ...estimation.solution import Poses, Samples, Solution
from ...estimation.tally import Tally
from ...estimation.uncertainty import unseen_errors
from ...estimation.zero import PoseColumns
from ...tracking.encoder import MAX_EXTRAPOLATION_S, Encoder
from ..sources.frames import MARK, OVERRUN, PERMIT, POSE, XY_SUM, RawSamples, parser
from .board_poses import BoardPoses
from .doubts import Doubts, Trust
from .sample_times import SampleTimes

if TYPE_CHECKING:
    from ...core.settings import Config


#: Standard uncertainty of the time of a sample relative to the time of the stage, s; it adds the
#: distance that a moving stage travels in this time to the uncertainty of its position.
TIMING_SIGMA_S = 1e-3
#: Bits of a sample's flags in addition to those of `detectors.counts`. The board's permit for the
#: stage is no event: it is set in every sample and never counted.
LOST_BEFORE, MARKED, PERMITTED = 4, 8, 16
#: The flags that are counted, in words.
FLAGS = {
    SATURATED: "saturated",
    UNEQUAL: "unequal sums",
    LOST_BEFORE: "board overrun",
    MARKED: "marked by the board's input",
}
#: Maximum number of samples in a batch, which is solved as a series. The newest sample waits for
#: one batch at most.
BATCH = 250
#: The fields of `Batch` with a row for each sample.
PER_SAMPLE = ("seq", "time", "host", "readings", "aligned", "flags")


@dataclass(frozen=True)
class Batch:
    """Samples that wait to be solved.

    seq: (n,) unwrapped numbers.  time: (n,) unwrapped times of the board, us.  host: (n,) times on
    the host's monotonic clock, s.  readings: (n, 9) as the detectors gave them.  aligned: (n, 9)
    readings of one instant for each sample.  flags: (n,) bits of FLAGS.  channels: (n,) values of
    each auxiliary channel by its column; NaN where a sample has none.  arrival: time at which the
    bytes came, s.  place, place_sigma: the beam's place by the stage, see `Samples`.
    """

    seq: NDArray[np.int64]
    time: NDArray[np.int64]
    host: Floats
    readings: Floats
    aligned: Floats
    flags: NDArray[np.uint8]
    channels: dict[str, Floats] = field(default_factory=dict)
    arrival: float = nan
    place: Floats | None = None
    place_sigma: float | None = None

    def __len__(self) -> int:
        return len(self.seq)

    def part(self, rows: slice, **origin: Any) -> Batch:
        """Return some of the samples, while no place is known.  origin: see `locate`."""
        channels = {column: values[rows] for column, values in self.channels.items()}
        columns = {name: getattr(self, name)[rows] for name in PER_SAMPLE}
        return Batch(channels=channels, **columns, **origin)

    def join_solution(self, poses: Poses) -> RunPoses:
        """Return the samples with their poses."""
        return RunPoses(
            seq=self.seq, time=self.time, host=self.host, readings=self.readings,
            flags=self.flags, channels=self.channels, **vars(poses),
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class RunPoses(Poses):
    """Poses of a board's samples, with the columns of `Batch`."""

    seq: NDArray[np.int64]
    time: NDArray[np.int64]
    host: Floats
    readings: Floats
    flags: NDArray[np.uint8]
    channels: dict[str, Floats]

    def __len__(self) -> int:
        return len(self.seq)

    @property
    def further(self) -> dict[str, Floats]:
        """The columns (n,) that only some runs have: of the object, and of auxiliary channels."""
        return {**self.object, **self.channels}

    def columns(self) -> dict[str, Any]:
        """The samples and their poses as columns of numbers, as a recording has them."""
        head = {
            "seq": self.seq,
            "board_us": self.time,
            "host_s": self.host,
            "flags": self.flags,
            **{name: self.readings[:, i] for i, name in enumerate(READING_COLUMNS)},
        }
        return {**head, **super().columns(), **self.channels}


class ParsedBlock(NamedTuple):
    """The samples of a block of bytes, the time of its arrival, s, and the stage's place then."""

    samples: RawSamples
    arrival: float
    encoder: Encoder | None


@dataclass
class RunTally(Tally):
    """The tally of a run.

    samples: number of samples that came.  flags: number of samples with each flag, by its words.
    """

    samples: int = 0
    flags: Counter[str] = field(default_factory=Counter)

    def add_flags(self, flags: NDArray[np.uint8]) -> None:
        """Count samples by their flags (n,)."""
        self.samples += len(flags)
        if flags.any():
            for bit, name in FLAGS.items():
                self.flags[name] += int((flags & bit > 0).sum())

    def pose_complaint(self) -> str:
        """Say why no sample gave a pose; empty if one did."""
        if not self.samples:
            return (
                "no sample came; if bytes did, check acquire.baud, acquire.format and "
                "acquire.channels."
            )
        words = ", ".join(f"{count} {status}" for status, count in self.statuses.items())
        return "" if self.solved_count else f"no sample gave a pose: {words}."


class Pipeline:
    """Turns blocks of bytes into poses: parses, follows the counters, converts and solves.

    Parameters
    ----------
    config : Config
        Sensor, solver and stream.
    columns : PoseColumns, optional
        Further columns of the poses, such as displacements from a zero.
    """

    #: The last two samples; see `await_neighbours`.
    waiting: Batch | None = None
    #: Arrival of the last samples, and the stage's place then.
    origin: Any = ()

    def __init__(self, config: Config, columns: PoseColumns | None = None) -> None:
        self.config = config
        self.tally = RunTally(cold=f"acquire.channels names no channel {TEMPERATURE_COLUMN}")
        self.measurement = Measurement(config, columns, waits=True, tally=self.tally)
        settings = config.acquire
        self.parser = parser(settings.format, settings.content, len(settings.channels))
        self.times = SampleTimes(settings)
        self.sequence, self.host_time = self.times.sequence, self.times.host_time
        self.board = BoardPoses()
        self.doubts = Doubts(least_light(config.sensor))
        self.trust = Trust(config)

    def feed(self, block: bytes, arrival: float, encoder: Encoder | None = None) -> RunPoses | None:
        """Return the poses of all samples that a block completes; None if it completes none.

        arrival: time on the host's monotonic clock, s; NaN if it is not known.
        """
        parts = [self.solve(batch) for batch in self.take(block, arrival, encoder)]
        return join_poses(parts) if parts else None

    def take(self, block: bytes, arrival: float, encoder: Encoder | None = None) -> list[Batch]:
        """Return the samples that a block completes, in batches to be solved, in order. arrival:
        see `feed`."""
        return self.follow([ParsedBlock(self.parser.feed(block), arrival, encoder)])

    def follow(self, blocks: Sequence[ParsedBlock]) -> list[Batch]:
        """Return the samples of blocks, in batches to be solved, in order.

        The samples of several blocks must be consecutive (`Sequence.continues`), without poses.
        """
        came: RawSamples = join([block.samples for block in blocks])
        is_pose = came.kind == POSE
        samples = came.where(~is_pose) if is_pose.any() else came
        arrivals = [block.arrival for block in blocks if not isnan(block.arrival)]
        breaks, counts = self.sequence.breaks, [len(block.samples) for block in blocks[:-1]]
        before_last = sum(counts)
        samples, seq, time = self.sequence.follow(
            samples, arrivals[-1] if arrivals else nan, [*counts, len(samples) - before_last]
        )
        has_restarted = self.sequence.breaks > breaks
        if is_pose.any():
            self.board.add(came.where(is_pose), self.sequence, has_restarted)
        if not len(samples):
            return []
        hosts, origins, end = [], [], 0
        for count, block in zip([*counts, len(samples) - before_last], blocks, strict=True):
            rows = slice(end, end + count)
            hosts.append(self.times.follow(time[rows], block.arrival, has_restarted))
            origins.append((rows.stop, self.times.arrival, block.encoder))
            end = rows.stop
        return self.batches_of(samples, seq, time, np.concatenate(hosts), origins)

    def batches_of(
        self,
        samples: RawSamples,
        seq: NDArray[np.int64],
        time: NDArray[np.int64],
        host: Floats,
        pieces: Sequence[tuple[int, float, Encoder | None]],
    ) -> list[Batch]:
        """Return samples in batches of at most BATCH samples, in their order. seq, time, host: (n,)
        numbers, us on the board's clock, and s on the host's.

        pieces: of each block the end of its samples, their arrival and the stage's place.
        """
        readings, flags = convert(self.config, samples)
        self.trust.add_samples(samples, flags, host)
        for bit, flag in ((OVERRUN, LOST_BEFORE), (MARK, MARKED), (PERMIT, PERMITTED)):
            flags |= (samples.flags & bit) * np.uint8(flag // bit)
        self.tally.add_flags(flags)
        channels = {
            channel.column: channel.values(samples.channels[:, n])
            for n, channel in enumerate(self.config.acquire.channels)
        }
        complete = self.await_neighbours(
            Batch(seq, time, host, readings, readings, flags, channels)
        )
        batches, start, waiting = [], 0, len(seq) - len(complete)
        for end, arrival, encoder in pieces:
            while start < end - waiting:
                rows = slice(start, min(start + BATCH, end - waiting))
                origin = locate(self.config, complete.host[rows], arrival, encoder)
                batches.append(complete.part(rows, **origin))
                start = rows.stop
        self.origin = pieces[-1][1:]
        return batches

    def await_neighbours(self, newest: Batch) -> Batch:
        """Return the samples whose neighbours have come, with readings of one instant.

        Where detectors are read one after the other, the newest sample waits for the next one: from
        both sides its change is the same for whatever blocks the samples came in.
        """
        if not any(self.config.sensor.light.delays):
            return newest
        first = len(self.waiting) - 1 if self.waiting else 0
        rows = join([self.waiting, newest]) if self.waiting else newest
        seconds = 1e-6 * rows.time.astype(np.float64)
        rows = replace(rows, aligned=align(self.config.sensor, seconds, rows.readings))
        self.waiting = rows.part(slice(-2, None))
        return rows.part(slice(first, -1))

    def release(self) -> list[Batch]:
        """Return the last sample of a stream, if it still waits for a next one."""
        last, self.waiting = self.waiting, None
        if last is None:
            return []
        origin = locate(self.config, last.host[-1:], *self.origin)
        return [last.part(slice(-1, None), **origin)]

    def warm_up(self) -> None:
        """Compile or load the code that the stream needs, before it runs."""
        light = np.full((2, 9), 0.1)
        example = Batch(
            np.zeros(2, np.int64), np.zeros(2, np.int64), np.zeros(2), light, light,
            np.zeros(2, np.uint8),
        )  # fmt: skip
        prepare(self.config.sensor, self.measurement.at_rest)
        warm = Pipeline(self.config)
        warm.measurement.poses(samples_of(self.config, example))
        unseen_errors(self.config.sensor, np.zeros(8))

    def solve(self, batch: Batch) -> RunPoses:
        """Return the poses of a batch.

        The estimator screens each sample first. A sample gets its status without a step if too few
        detectors have a spot within their edges, enough light and no saturation.
        """
        samples = samples_of(self.config, batch)
        poses = self.measurement.poses(samples)
        if self.board.came:  # the board does not know the temperature
            solution = poses.solution
            if samples.temperature is not None:
                solution, *_ = self.measurement.estimate(replace(samples, temperature=None))
            self.board.compare(batch.seq, solution)
        return self.screen_poses(batch, samples, poses)

    def screen_poses(self, batch: Batch, samples: Samples, poses: Poses) -> RunPoses:
        """Update the doubts with solved samples, and return the samples with their poses."""
        cold = np.zeros(len(batch), dtype=bool)
        if samples.temperature is not None:
            cold = ~np.isfinite(samples.temperature)
        self.doubts.add(batch.readings, batch.flags, poses.solution.misfit, cold)
        self.trust.add_poses(poses.solution, float(batch.host[-1]))
        return batch.join_solution(poses)

    def skip(self, batch: Batch) -> RunPoses:
        """Return the samples of a batch that was skipped for lack of time, without poses."""
        return batch.join_solution(self.measurement.skip(samples_of(self.config, batch)))


def samples_of(config: Config, batch: Batch) -> Samples:
    """Return the samples of a batch with the beam's place by the stage, and temperatures."""
    temperature = None
    if config.sensor.thermal.is_on:
        temperature = batch.channels.get(TEMPERATURE_COLUMN)
    return Samples(
        batch.aligned, batch.seq, 1e-6 * batch.time.astype(np.float64), temperature,
        batch.place, batch.place_sigma, batch.flags & SATURATED > 0,
    )  # fmt: skip


def convert(config: Config, samples: RawSamples) -> tuple[Floats, NDArray[np.uint8]]:
    """Readings (n, 9) and flags (n,) of counts."""
    sensor, electronics = config.sensor, config.electronics
    dark_counts = np.full(12, config.acquire.dark)
    xy_sum = samples.kind == XY_SUM
    if xy_sum.all() or not xy_sum.any():
        return counts_to_readings(sensor, electronics, samples.counts, bool(xy_sum[0]), dark_counts)
    out, flags = np.empty((len(samples), 9)), np.empty(len(samples), np.uint8)
    for kind in (True, False):
        part = xy_sum == kind
        out[part], flags[part] = counts_to_readings(
            sensor, electronics, samples.counts[part], kind, dark_counts
        )
    return out, flags


def locate(config: Config, host: Floats, arrival: float, encoder: Encoder | None) -> dict[str, Any]:
    """Return the arrival of a batch, and the beam's place by the stage at its times (n,)."""
    place = sigma = None
    if encoder is not None:
        sigma, age = inf, float(host[-1]) - encoder.time
        place = encoder.places(host)
        if age <= MAX_EXTRAPOLATION_S:
            # the stage may have changed its speed since it answered: half the way is uncertain
            moving = float(np.hypot(*encoder.speed)) * (TIMING_SIGMA_S + max(0.0, age) / 2)
            electronics = config.sensor.electronics
            jitter = electronics.pointing if electronics else 0.0  # of the beam at the mirror
            sigma = hypot(config.stage.accuracy, moving, jitter)
    return {"arrival": arrival, "place": place, "place_sigma": sigma}


def join_poses(parts: list[RunPoses]) -> RunPoses:
    """Join the poses of some parts, one after the other."""
    return parts[0] if len(parts) == 1 else join(parts)


def join(parts: Sequence[Any]) -> Any:
    """Join arrays, and records and tables of arrays, one after the other; of other values take the
    first."""
    first = parts[0]
    if isinstance(first, np.ndarray):
        return np.concatenate(parts)
    if isinstance(first, dict):
        return {name: join([part[name] for part in parts]) for name in first}
    if not is_dataclass(first):
        return first
    kind: Any = Solution if isinstance(first, Solution) else type(first)
    names = [item.name for item in fields(kind)]
    return kind(**{name: join([getattr(part, name) for part in parts]) for name in names})
