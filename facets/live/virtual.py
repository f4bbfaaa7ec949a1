"""A virtual bench: a moving mirror, a stage that carries the beam, a board that counts; on ptys.

As nasty as real hardware, on demand: bits flip, bytes are lost or come twice, samples are dropped,
the board stalls, the cable is pulled, the beam is blocked, a converter is at its end, the stage
refuses or jams. Everything is counted, and the truth is written down, to be compared with what was
measured.
"""

from __future__ import annotations

import json
import os
import select
import termios
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..detectors.correction import uncorrected
from ..detectors.counts import counts_of, xy_sum_of
from ..model.arrays import on_detectors
from ..simulation.imperfect_optics import seen_late
from ..simulation.motion import named, states
from ..tracking.stage import StageModel
from .frames import ELECTRODES, OVERRUN, XY_SUM, Samples, encoded
from .frames import SATURATED as FULL
from .pi import PiController
from .zaber import ZaberDevice

if TYPE_CHECKING:
    from ..core.settings import Config

Floats = NDArray[np.float64]

TRUTH = np.dtype([("seq", "<u4"), ("fate", "u1"), ("host", "<f8"), ("state", "<f8", 8)])
#: What became of a sample.
SENT, DROPPED, SPOILT = range(3)
#: What a board can hold back while the host does not read, bytes: then it loses samples.
BUFFER = 1 << 16
#: How often the bench goes round, s.
ROUND = 1e-3
#: How long the mirror takes to come to speed, s.
RAMP = 1.0
#: A mirror that goes further than this leaves a fixed beam: it waits for the stage, mm.
BEAM = 0.3
#: The most samples made at once.
MOST = 20_000


@dataclass(frozen=True)
class Faults:
    """Probabilities for each sample, or per second where so said; 0 is never.

    flip: one bit of its bytes is turned.  lose, double: one byte is lost, or comes twice.
    drop: the board loses it.  stall: per second, the board sends nothing for 50 ms.
    block: per second, the beam is blocked for 50 ms.  saturate: per second, a converter for 50 ms.
    unplug: per second, the port goes away for 300 ms.  refuse: per second, the stage refuses for
    100 ms.  jam: per second, the stage does not move for 100 ms.
    """

    flip: float = 0.0
    lose: float = 0.0
    double: float = 0.0
    drop: float = 0.0
    stall: float = 0.0
    block: float = 0.0
    saturate: float = 0.0
    unplug: float = 0.0
    refuse: float = 0.0
    jam: float = 0.0

    @classmethod
    def of(cls, text: str) -> Faults:
        """'flip=1e-4,drop=1e-3'."""
        names = [field.name for field in fields(cls)]
        given = {}
        for part in filter(None, text.split(",")):
            name, _, value = part.strip().partition("=")
            try:
                given[name] = float(value)
            except ValueError:
                given[name] = -1.0
            if name not in names or not given[name] >= 0:
                raise InputError(
                    f"--faults has {part.strip()!r}; allowed: NAME=NUMBER of {', '.join(names)}"
                )
        return cls(**given)


@dataclass
class Count:
    """What the bench did. made: samples; sent: whole or spoilt; dropped: never sent.
    spoilt: sent with a flipped, lost or doubled byte."""

    made: int = 0
    sent: int = 0
    dropped: int = 0
    spoilt: int = 0
    moves: int = 0


class Pty:
    """One end of a serial line; the other has a name, linked to by a path that stays the same."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.open()

    def open(self) -> None:
        self.end, self.other = os.openpty()
        tty.setraw(self.other, termios.TCSANOW)
        os.set_blocking(self.end, False)
        self.name = os.ttyname(self.other)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(self.name)

    def close(self) -> None:
        self.link.unlink(missing_ok=True)
        os.close(self.end)
        os.close(self.other)

    def write(self, data: bytes | bytearray) -> int:
        try:
            return os.write(self.end, data)
        except BlockingIOError:
            return 0

    def read(self) -> bytes:
        try:
            return os.read(self.end, 4096)
        except (BlockingIOError, OSError):
            return b""


class Mirror:
    """The truth: where the mirror is at any time, going through a motion again and again.

    It stands at the motion's beginning until `begin` (s), then takes RAMP seconds to come to speed.
    """

    def __init__(self, config: Config, name: str, seed: int) -> None:
        times, self.states = states(named(config, name), np.random.default_rng(seed))
        self.times = times - times[0]
        step = self.times[-1] / (len(times) - 1) if len(times) > 1 else 1.0
        self.period = float(self.times[-1] + step)
        self.begin = np.inf

    @property
    def reach(self) -> float:
        """How far it goes from where it begins, across the beam, mm."""
        return float(np.hypot(*(self.states[:, :2] - self.states[0, :2]).T).max())

    def at(self, time_: Floats) -> Floats:
        """States (n, 8) at times (n,), s."""
        passed = np.maximum(time_ - self.begin, 0.0)
        ramped = np.where(passed < RAMP, passed**2 / (2 * RAMP), passed - RAMP / 2)
        phase = np.mod(ramped, self.period)
        columns = [
            np.interp(phase, self.times, column, period=self.period) for column in self.states.T
        ]
        return np.stack(columns, axis=1)


class Bench:
    """Goes round until told to end. folder: holds the ports `board` and `stage`, and the truth.

    A motion that leaves the beam begins when the stage is first asked to move.
    """

    def __init__(
        self, config: Config, motion: str, rate: float, faults: Faults, seed: int, folder: Path
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.config, self.rate, self.faults, self.folder = config, rate, faults, folder
        self.rng = np.random.default_rng(seed)
        self.mirror = Mirror(config, motion, seed)
        self.model = StageModel(config.stage)
        self.model.place = self.mirror.states[0, :2].copy()  # the beam was set up on the mirror
        self.model.target = self.model.place.copy()
        if self.mirror.reach < BEAM:
            self.mirror.begin = 0.0
        zaber = config.stage.driver == "zaber"
        self.device = ZaberDevice(self.model) if zaber else PiController(self.model)
        self.board, self.stage = Pty(folder / "board"), Pty(folder / "stage")
        self.count = Count()
        self.pending = bytearray()
        self.lines = b""
        self.overrun = False
        self.until: dict[str, float] = {}
        self.unplugged = False
        self.truth = (folder / "truth.bin").open("wb", buffering=0)
        self.electronics = config.electronics

    def run(self, seconds: float, told: Callable[[Bench], None] = lambda _: None) -> None:
        """For so many seconds; ends quietly on ^C. told: called each round."""
        self.begin = time.monotonic()
        try:
            while time.monotonic() - self.begin < seconds:
                self.round()
                told(self)
        except KeyboardInterrupt:
            pass
        finally:
            self.end()

    def end(self) -> None:
        with suppress(KeyboardInterrupt):
            last = time.monotonic() + 0.5
            while self.pending and time.monotonic() < last:
                self.flush()
                time.sleep(ROUND)
        self.truth.close()
        (self.folder / "counts.json").write_text(json.dumps(asdict(self.count)), "utf-8")
        self.board.close()
        self.stage.close()

    def round(self) -> None:
        now = time.monotonic() - self.begin
        self.befall(now)
        self.model.jammed = self.happens("jam", now)
        self.device.refuse = self.happens("refuse", now)
        due = min(int(now * self.rate) - self.count.made, MOST)
        if due > 0:
            self.make(due, now)
        self.flush()
        ready, _, _ = select.select([self.stage.end], [], [], ROUND)
        if ready:
            self.answer()

    def befall(self, now: float) -> None:
        """Draws what begins to go wrong."""
        lasting = {"stall": 0.05, "block": 0.05, "saturate": 0.05, "unplug": 0.3}
        lasting |= {"refuse": 0.1, "jam": 0.1}
        for name, duration in lasting.items():
            rate = getattr(self.faults, name)
            if rate > 0 and self.rng.random() < rate * ROUND and not self.happens(name, now):
                self.until[name] = now + duration
        gone = self.happens("unplug", now)
        if gone and not self.unplugged:
            self.board.close()
            self.pending.clear()
        if self.unplugged and not gone:
            self.board.open()
        self.unplugged = gone

    def happens(self, name: str, now: float) -> bool:
        return now < self.until.get(name, -1.0)

    def make(self, due: int, now: float) -> None:
        """The samples that are due: truth, readings, counts, bytes."""
        first = self.count.made
        times = (first + np.arange(due)) / self.rate
        start = self.model.place.copy()
        before = self.model.now
        self.model.advance(now)
        states = self.mirror.at(times)
        share = np.clip((times - before) / max(now - before, 1e-9), 0, 1)[:, None]
        states[:, 6:] = start + share * (self.model.place - start)
        seq = (first + np.arange(due)).astype(np.uint32)
        self.count.made += due
        samples = self.sampled(states, seq, times, now)
        lost = self.rng.random(due) < self.faults.drop
        if self.unplugged or self.happens("stall", now):
            lost[:] = True
        fate = np.where(lost, DROPPED, SENT).astype(np.uint8)
        self.drop(int(lost.sum()))
        fate[~lost] = self.send(samples.where(~lost))
        rows = np.zeros(due, TRUTH)
        rows["seq"], rows["fate"], rows["state"] = seq, fate, states
        rows["host"] = self.begin + times
        self.truth.write(rows.tobytes())

    def sampled(
        self, states: Floats, seq: NDArray[np.uint32], times: Floats, now: float
    ) -> Samples:
        sensor = self.config.sensor
        exact = uncorrected(sensor, seen_late(sensor, times, states, states))
        dark = ~np.repeat(on_detectors(sensor, exact), 3, axis=1)
        exact[:, 2::3] = np.where(dark[:, 2::3], 0.0, exact[:, 2::3])
        if self.happens("block", now):
            exact[:, 2::3] = 0.0
        counts = counts_of(sensor, self.electronics, exact, self.rng)
        counts = counts + np.int32(self.config.acquire.dark)
        top = 2**self.electronics.adc_bits - 1
        if self.happens("saturate", now):
            counts[:, 0] = top
        flags = np.where((np.abs(counts) >= top).any(axis=1), FULL, 0).astype(np.uint8)
        kind = ELECTRODES
        if self.config.acquire.content == "xy-sum":
            counts, kind = xy_sum_of(self.electronics, counts), XY_SUM
        kinds = np.full(len(seq), kind, np.uint8)
        board = (np.round(1e6 * times).astype(np.int64) % 2**32).astype(np.uint32)
        return Samples(kinds, flags, seq, board, counts)

    def drop(self, count: int) -> None:
        self.count.dropped += count
        self.overrun |= count > 0

    def send(self, samples: Samples) -> NDArray[np.uint8]:
        """Into the board's buffer, as far as there is room, spoilt here and there: their fates."""
        fate = np.full(len(samples), SENT, np.uint8)
        if not len(samples):
            return fate
        if self.overrun:
            samples.flags[0] |= OVERRUN
            self.overrun = False
        data = encoded(self.config.acquire.format, samples)
        size = len(data) // len(samples)
        room = (BUFFER - len(self.pending)) // max(size, 1)
        if room < len(samples):
            self.drop(len(samples) - max(room, 0))
            fate[max(room, 0) :] = DROPPED
            samples = samples.where(np.arange(len(samples)) < room)
            data = encoded(self.config.acquire.format, samples) if len(samples) else b""
        self.count.sent += len(samples)
        broken, bad = self.spoilt(data, len(samples))
        fate[bad] = SPOILT
        self.pending += broken
        return fate

    def spoilt(self, data: bytes, count: int) -> tuple[bytes | bytearray, NDArray[np.int64]]:
        """The bytes with their faults, and which samples have one."""
        f = self.faults
        chances = np.array([f.flip, f.lose, f.double])
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
        if self.unplugged:
            return
        while self.pending:
            done = self.board.write(self.pending[:65_536])
            if done == 0:
                break
            del self.pending[:done]

    def answer(self) -> None:
        """The stage's commands, line by line."""
        self.model.advance(time.monotonic() - self.begin)
        *lines, self.lines = (self.lines + self.stage.read()).split(b"\n")
        for line in lines:
            text = line.decode("ascii", "replace")
            if "mov" in text.lower():
                self.count.moves += 1
                self.mirror.begin = min(self.mirror.begin, self.model.now)
            reply = self.device.answer(text)
            if reply:
                self.stage.write(reply.encode())


def truth_of(folder: Path) -> NDArray[np.void]:
    """What the bench wrote down: `TRUTH` rows."""
    raw = (folder / "truth.bin").read_bytes()
    whole = len(raw) // TRUTH.itemsize * TRUTH.itemsize
    return np.frombuffer(raw[:whole], TRUTH)
