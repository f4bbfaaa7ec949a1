"""A virtual detector board: light to counts, counts to bytes, bytes into a port, with faults."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.units import Floats
from ...detectors.correction import invert_correction
from ...detectors.counts import counts_to_xy_sum, readings_to_counts
from ...detectors.skew import delay_states, delayed_readings
from ...model.arrays import mask_missed_spots
from ...tracking.interlock import HEARTBEAT, KIND, MAY_MOVE, SIGN, heartbeat_frame
from ..run.board_poses import SOLVED
from ..run.pipeline import join
from ..sources.frames import (
    ELECTRODES,
    OVERRUN,
    PERMIT,
    POSE,
    SATURATED as FULL,
    XY_SUM,
    RawSamples,
    encode,
)
from .faults import Faults, Schedule

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...firmware.library import FirmwareLibrary
    from .pty import Pty
    from .wire import Wire


TRUTH = np.dtype([("seq", "<u4"), ("fate", "u1"), ("host", "<f8"), ("state", "<f8", 8)])
#: The value of an auxiliary channel in its unit: (n,) at times (n,), s, and states (n, 8).
Signal = Callable[[Floats, Floats], Floats]
#: Fates of a sample.
SENT, DROPPED, SPOILT = range(3)
#: Size of the board's buffer while the host does not read; beyond it, samples are lost.
BUFFER_BYTES = 1 << 16
#: A board whose line takes nothing for this time has no reader, and keeps nothing for it, s.
UNREAD_TIMEOUT_S = 1.0
#: A board that has heard no heartbeat for this time stops the stage, s.
HEARTBEAT_PATIENCE_S = 0.1


def sine_signal(times: Floats, states: Floats) -> Floats:
    """Sine wave of amplitude 1 and 1 Hz, at times (n,), s: (n,)."""
    return np.sin(2 * np.pi * times)


@dataclass(frozen=True)
class BenchSetup:
    """The parts of a virtual bench.

    motion: name of the mirror's motion.  rate: samples per second.  firmware: the board solves each
    sample with it, and sends the pose after the sample; None for a board without a solver.
    reference: whether a reference instrument reads the mirror's poses, too.  truth: whether the
    true state of each sample is written.  signals: of the auxiliary channels of the configuration,
    by their names; the other channels show a sine wave (`sine_signal`).
    """

    config: Config
    motion: str
    rate: float
    faults: Faults = field(default_factory=Faults)
    seed: int = 1
    firmware: FirmwareLibrary | None = None
    reference: bool = False
    truth: bool = False
    signals: Mapping[str, Signal] = field(default_factory=dict)


@dataclass
class Count:
    """Counts of samples, faults and moves of the bench.

    made, sent, dropped: numbers of samples; those sent include the corrupted ones.  `spoilt`:
    number of samples sent with a flipped, lost or doubled byte.  moves: commands that the stage
    obeyed. restarts: of the board. slipped: time for which the bench's time was halted, because its
    machine was busy, s. disabled: how often the board stopped the stage, because no heartbeat came.
    """

    made: int = 0
    sent: int = 0
    dropped: int = 0
    spoilt: int = 0
    moves: int = 0
    restarts: int = 0
    slipped: float = 0.0
    disabled: int = 0


def add_board_poses(
    samples: RawSamples, firmware: FirmwareLibrary, dark_counts: Floats
) -> RawSamples:
    """The samples (n,), each followed by a frame of the kind POSE: (2 n,)."""
    xy_sum = bool(samples.kind[0] == XY_SUM)
    begin = time.perf_counter()
    poses = firmware.solve(firmware.readings_of_counts(samples.counts, dark_counts, xy_sum))
    took = 1e6 * (time.perf_counter() - begin) / len(samples)
    solved = np.zeros(len(samples), SOLVED)
    solved["state"], solved["status"] = poses.state, poses.status
    solved["power"], solved["residual"] = poses.power, poses.residual
    solved["used"] = poses.used @ np.array([1, 2, 4])
    solved["microseconds"] = min(took, 65_535)
    poses_sent = replace(
        samples,
        kind=np.full_like(samples.kind, POSE),
        flags=np.zeros_like(samples.flags),
        counts=solved.view("<i4").reshape(-1, 12).astype(np.int32),
        channels=np.full_like(samples.channels, np.nan),
    )
    alternating = np.arange(2 * len(samples)).reshape(2, -1).T.ravel()
    both: RawSamples = join([samples, poses_sent])
    return both.where(alternating)


class HeartbeatWatch:
    """Watches the heartbeats of the program that moves the stage."""

    def __init__(self) -> None:
        self.rest, self.count, self.heard, self.may_move = b"", 0, -HEARTBEAT_PATIENCE_S, False

    def feed(self, data: bytes, now: float) -> None:
        """Take bytes that the program has sent by the time `now`, s."""
        self.rest += data
        while (at := self.rest.find(SIGN)) >= 0 and len(self.rest) - at >= HEARTBEAT.size:
            frame = self.rest[at : at + HEARTBEAT.size]
            _, kind, flags, count, _ = HEARTBEAT.unpack(frame)
            is_sound = kind == KIND and frame == heartbeat_frame(count, bool(flags & MAY_MOVE))
            self.rest = self.rest[at + (HEARTBEAT.size if is_sound else 1) :]
            if is_sound and count != self.count:  # a frame that hangs is no sign of life
                self.count, self.heard, self.may_move = count, now, bool(flags & MAY_MOVE)
        self.rest = self.rest[-HEARTBEAT.size :]

    def is_alive(self, now: float) -> bool:
        """Whether the stage may move at the time `now`, s."""
        return self.may_move and now - self.heard <= HEARTBEAT_PATIENCE_S


class Board:
    """Samples the light, numbers the samples, and sends them.

    clock: of the host, s.  born, born_at: number of the bench's sample at which the board was last
    switched on, and the host's time then, s, from which the board counts samples and microseconds.
    Its clock continues, as a quartz does, while a busy machine halts the bench's time.
    """

    def __init__(
        self,
        setup: BenchSetup,
        schedule: Schedule,
        count: Count,
        port: Pty | Wire,
        clock: Callable[[], float],
    ) -> None:
        self.config, self.rate, self.firmware = setup.config, setup.rate, setup.firmware
        self.schedule, self.count = schedule, count
        signals = dict(setup.signals)
        self.signals = [
            (channel, signals.pop(channel.name, sine_signal))
            for channel in setup.config.acquire.channels
        ]
        if signals:
            raise InputError(f"acquire.channels names no channel {', '.join(signals)}")
        self.rng = schedule.rng
        self.port, self.clock = port, clock
        self.read_at = clock()  # when the line last took something
        self.overrun = self.unplugged = self.booting = False
        self.born = 0
        self.born_at: float | None = None
        self.packets: deque[tuple[float, bytearray]] = deque()  # and when they may leave
        self.watch = HeartbeatWatch()

    def switch_on(self, host: float) -> None:
        """Switch the board on at the host's time `host`, s, less the uptime of the faults."""
        self.born_at = host - self.schedule.faults.uptime_s

    def suffer(self, now: float) -> None:
        """Pull the cable, put it back or restart, as the schedule demands at the time `now`, s."""
        is_unplugged = self.schedule.is_on("unplug", now)
        if is_unplugged and not self.unplugged:
            self.port.close()
            self.packets.clear()
        if self.unplugged and not is_unplugged:
            self.port.open()
        self.unplugged = is_unplugged
        booting = self.schedule.is_on("restart", now)
        if booting and not self.booting:
            self.packets.clear()
            self.overrun = False
        if self.booting and not booting:
            self.born, self.born_at = self.count.made, None
            self.count.restarts += 1
        self.booting = booting

    def take(
        self, states: Floats, seq: NDArray[np.uint32], host: Floats, now: float
    ) -> NDArray[np.uint8]:
        """Sample and send the light of states (n, 8) with the bench's numbers `seq` (n,); return
        the samples' fates (n,).

        host: the host's times (n,) of the samples, s.
        """
        if self.born_at is None:
            self.born_at = float(host[0])
        lost = self.rng.random(len(seq)) < self.schedule.faults.drop
        if self.unplugged or self.booting or self.schedule.is_on("stall", now):
            lost[:] = True
        fate = np.where(lost, DROPPED, SENT).astype(np.uint8)
        self.lose(int(lost.sum()))
        if not lost.all():
            fate[~lost] = self.send(self.sample(states[~lost], seq[~lost], host[~lost], now))
        return fate

    def sample(
        self, states: Floats, seq: NDArray[np.uint32], host: Floats, now: float
    ) -> RawSamples:
        """The samples of states (n, 8), as the board counts and times them."""
        sensor, electronics = self.config.sensor, self.config.electronics
        exact = delayed_readings(sensor, seq / self.rate, states, states)
        exact = invert_correction(sensor, mask_missed_spots(sensor, exact, exact))
        if self.schedule.is_on("block", now):
            exact[:, 2::3] = 0.0
        counts = readings_to_counts(sensor, electronics, exact, self.rng)
        counts = counts + np.int32(self.config.acquire.dark)
        top = 2**electronics.adc_bits - 1
        if self.schedule.is_on("saturate", now):
            counts[:, 0] = top
        flags = np.where((np.abs(counts) >= top).any(axis=1), FULL, 0).astype(np.uint8)
        if self.config.stage.permit == "board" and not self.schedule.is_on("permit", now):
            flags |= np.uint8(PERMIT)
        kind = ELECTRODES
        if self.config.acquire.content == "xy-sum":
            counts, kind = counts_to_xy_sum(electronics, counts), XY_SUM
        kinds = np.full(len(seq), kind, np.uint8)
        number = (seq.astype(np.int64) - self.born) % 2**32
        channels = self.sample_channels(seq / self.rate, states)
        return RawSamples(
            kinds, flags, number.astype(np.uint32), self.microseconds(host), counts, channels
        )

    def sample_channels(self, times: Floats, states: Floats) -> NDArray[np.float32]:
        """The numbers (n, m) of the auxiliary channels at the bench's times (n,), s, each later by
        its channel's delay."""
        raw = [
            channel.raw(signal(times + channel.delay, delay_states(times, states, channel.delay)))
            for channel, signal in self.signals
        ]
        return np.stack(raw, axis=1) if raw else np.zeros((len(times), 0), np.float32)

    def microseconds(self, host: Floats) -> NDArray[np.uint32]:
        """Readings of the board's clock at the host's times (n,), us."""
        assert self.born_at is not None
        passed = (host - self.born_at) / (1 + 1e-6 * self.schedule.faults.drift_ppm)
        return (np.round(1e6 * passed).astype(np.int64) % 2**32).astype(np.uint32)

    def encode(self, samples: RawSamples) -> bytes:
        """Bytes of the samples, and of their poses where the board has a solver."""
        if self.firmware is not None:
            dark_counts = np.full(12, float(self.config.acquire.dark))
            samples = add_board_poses(samples, self.firmware, dark_counts)
        return encode(self.config.acquire.format, samples)

    def lose(self, count: int) -> None:
        """Count samples that are never sent; the next sample carries the flag OVERRUN."""
        self.count.dropped += count
        self.overrun |= count > 0

    def send(self, samples: RawSamples) -> NDArray[np.uint8]:
        """Put samples with their faults into the board's buffer, as far as it takes them, and
        return their fates (n,)."""
        fate = np.full(len(samples), SENT, np.uint8)
        if self.overrun:
            samples.flags[0] |= OVERRUN
            self.overrun = False
        data = self.encode(samples)
        size = len(data) // len(samples)
        pending = sum(len(packet) for _, packet in self.packets)
        space = max(0, (BUFFER_BYTES - pending) // max(size, 1))
        if space < len(samples):
            self.lose(len(samples) - space)
            fate[space:] = DROPPED
            samples = samples.where(np.arange(len(samples)) < space)
            data = self.encode(samples) if len(samples) else b""
        self.count.sent += len(samples)
        broken, bad = self.spoil(data, len(samples))
        fate[bad] = SPOILT
        jitter = 1e-3 * self.schedule.faults.jitter_ms
        due = self.clock() + (self.rng.uniform(0, jitter) if jitter else 0.0)
        if self.packets:
            due = max(due, self.packets[-1][0])
        self.packets.append((due, bytearray(broken)))
        return fate

    def spoil(self, data: bytes, count: int) -> tuple[bytes | bytearray, NDArray[np.int64]]:
        """The bytes with their faults, and the numbers (m,) of the samples that have one."""
        faults = self.schedule.faults
        chances = np.array([faults.flip, faults.lose, faults.double])
        if count == 0 or not chances.any():
            return data, np.zeros(0, np.int64)
        drawn = self.rng.random((count, 3)) < chances
        bad = np.flatnonzero(drawn.any(axis=1))
        self.count.spoilt += len(bad)
        out, size = bytearray(data), len(data) / count
        for n in bad[::-1].tolist():
            place = int((n + 0.1 + 0.8 * self.rng.random()) * size)
            if drawn[n, 0]:
                out[place] ^= 1 << int(self.rng.integers(8))
            elif drawn[n, 1]:
                del out[place]
            else:
                out.insert(place, out[place])
        return out, bad

    def flush(self) -> None:
        """Send as many bytes as the port takes."""
        if self.unplugged:
            return
        now = self.clock()
        while self.packets and self.packets[0][0] <= now:
            packet = self.packets[0][1]
            if done := self.port.write(packet):
                self.read_at = now
            del packet[:done]
            if packet:
                break
            self.packets.popleft()
        else:
            self.read_at = now
        if self.packets and now - self.read_at > UNREAD_TIMEOUT_S:
            self.packets.clear()
            self.overrun = True

    def may_move(self) -> bool:
        """Whether the program that moves the stage lives, and lets it move."""
        now = self.clock()
        self.watch.feed(b"" if self.unplugged else self.port.read(), now)
        return self.watch.is_alive(now)

    def close(self) -> None:
        if not self.unplugged:
            self.port.close()
