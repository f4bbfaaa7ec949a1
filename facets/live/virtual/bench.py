"""A virtual bench: its time, its mirror, its board, its stage and its reference instrument."""

from __future__ import annotations

import json
import select
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict, replace
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, OutputError
from ...core.names import TEMPERATURE_COLUMN
from ...core.plain_numbers import times_text
from ...tracking.stage import StageModel
from .board import TRUTH, BenchSetup, Board, Count, Signal
from .faults import Schedule
from .mirror import Mirror
from .pty import Pty
from .reference import Reference
from .stages import CONTROLLERS

if TYPE_CHECKING:
    from .wire import Wire

#: Time between two rounds of the bench's loop, s.
ROUND_INTERVAL_S = 1e-3
#: Samples of this span are made and sent together, s, like the packets of a USB board.
PACKET_S = 2e-3
#: The bench's time advances by this at most at once, s. So a busy machine makes bench and mirror
#: slower. Otherwise the mirror would run away from late samples and from a stage that gets no
#: answer. On the circle of the shipped bench that is 0.03 mm, a tenth of the range in which there
#: are poses.
MAX_ADVANCE_S = 0.005
#: The same until the stage is first moved: until then nothing follows the mirror, and the bench
#: catches up, so that its samples have no gaps.
MAX_CATCHING_UP_S = 0.2
#: Column of the auxiliary channel that shows the force of a shaker, N.
FORCE_COLUMN = "force_n"
#: The bench reports that its clock stood still if it did so for at least this time, s.
REPORTED_SLIP_S = 0.05


class Bench:
    """A virtual bench, which runs for a given time or until ^C.

    folder: holds the ports `board` and `stage`, the counts and the truth.

    Beam and stage begin at the origin. If the motion leaves a beam there, the beam is set up on the
    mirror. A motion that leaves that beam, too, begins with the first move of the stage.
    """

    truth: FileIO | None = None

    def __init__(
        self, setup: BenchSetup, folder: Path, clock: Callable[[], float] = time.monotonic
    ) -> None:
        config, seed = setup.config, setup.seed
        if config.stage.driver == "other":
            raise InputError("the virtual bench has no stage for stage.driver: other; use zaber")
        self.config, self.rate, self.folder, self.clock = config, setup.rate, folder, clock
        self.mirror = Mirror(config, setup.motion, seed)
        self.model = StageModel(config.stage)
        place = np.zeros(2)
        if self.mirror.leaves(place):
            place = self.mirror.states[0, :2]
        self.model.place, self.model.target = place.copy(), place.copy()
        if not self.mirror.leaves(place):
            self.mirror.begin = 0.0
        self.reference = Reference(config, self.mirror, seed) if setup.reference else None
        self.device = CONTROLLERS[config.stage.driver](self.model)
        self.schedule = Schedule(setup.faults, np.random.default_rng(seed))
        self.count = Count()
        setup = replace(setup, signals={**self.bench_signals(), **setup.signals})
        line = self.open_lines(setup.truth)
        self.board = Board(setup, self.schedule, self.count, line, clock)
        self.is_enabled = False
        self.last = 0.0

    def open_lines(self, has_truth: bool) -> Pty | Wire:
        """Open the stage's line and the files in the folder; return the board's line. Raises
        `OutputError` if the folder cannot be written in."""
        folder = self.folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if has_truth:
                self.truth = (folder / "truth.bin").open("wb", buffering=0)
        except OSError as error:
            raise OutputError(
                f"{folder}: is not a folder that can be written in: {error.strerror}"
            ) from None
        self.stage = Pty(folder / "stage")
        return Pty(folder / "board")

    def bench_signals(self) -> dict[str, Signal]:
        """Signals of the bench by the names of their channels: the force of a shaker, and for a
        sensor that follows the temperature its reference temperature."""
        force, thermal = self.mirror.force, self.config.sensor.thermal
        names = {channel.column: channel.name for channel in self.config.acquire.channels}
        signals: dict[str, Signal] = {}
        if FORCE_COLUMN in names and self.mirror.is_shaken:
            signals[names[FORCE_COLUMN]] = lambda time_, _: force(time_)
        if TEMPERATURE_COLUMN in names and thermal.is_on:
            signals[names[TEMPERATURE_COLUMN]] = lambda time_, _: np.full(
                time_.shape, thermal.reference
            )
        return signals

    def run(self, seconds: float, on_progress: Callable[[Bench], None] = lambda _: None) -> None:
        """Run the bench for some seconds, or until ^C.  on_progress: called in each round."""
        self.begin = self.clock()
        self.board.switch_on(self.begin)
        try:
            while self.last < seconds:
                self.round()
                self.answer()
                on_progress(self)
        except KeyboardInterrupt:
            pass
        finally:
            self.end()

    def end(self) -> None:
        """Send the remaining bytes and close all ports and files, whatever fails on the way."""
        with ExitStack() as closing:
            closing.callback(self.stage.close)
            closing.callback(self.board.close)
            closing.callback(self.write_counts)
            if self.truth:
                closing.callback(self.truth.close)
            with suppress(KeyboardInterrupt):
                last = time.monotonic() + 0.5
                while self.board.packets and time.monotonic() < last:
                    self.board.flush()
                    time.sleep(ROUND_INTERVAL_S)

    def write_counts(self) -> None:
        """Write the counts of samples to the bench's folder."""
        (self.folder / "counts.json").write_text(json.dumps(asdict(self.count)), "utf-8")

    def summary(self) -> Iterator[str]:
        """Yield sentences on the samples, faults and moves of the bench."""
        count = self.count
        yield (
            f"The board made {count.made} samples in {self.last:.1f} s: {count.sent} were sent, "
            f"{count.spoilt} of them damaged, and {count.dropped} were dropped."
        )
        if count.dropped > count.sent:
            yield "Most were dropped, as happens when nobody reads the board's port."
        yield f"The stage obeyed {count.moves} moves." if count.moves else "The stage never moved."
        if count.disabled:
            stops = times_text(count.disabled)
            yield f"The board stopped the stage {stops}, because no heartbeat came."
        if count.restarts:
            yield f"The board restarted {times_text(count.restarts)}."
        if count.slipped >= REPORTED_SLIP_S:
            yield (
                f"The machine was too busy: the bench's clock stood still for "
                f"{count.slipped:.2g} s in all, and the mirror with it."
            )
        files = "counts.json and truth.bin" if self.truth else "counts.json"
        yield f"{self.folder}/: {files}"

    def now(self) -> float:
        """The bench's time, s, which slips where the machine is too busy for it."""
        passed = self.clock() - self.begin - self.last
        most = MAX_ADVANCE_S if self.count.moves else MAX_CATCHING_UP_S
        if passed > most:
            self.begin += passed - most
            self.count.slipped += passed - most
        self.last += min(passed, most)
        return self.last

    def round(self) -> None:
        """Draw faults, and make and send the samples that are due."""
        now = self.now()
        self.schedule.draw(now)
        self.board.suffer(now)
        self.model.jammed = self.schedule.is_on("jam", now)
        self.device.refuse = self.schedule.is_on("refuse", now)
        if self.config.stage.heartbeat == "board":
            self.enable(self.board.may_move())
        due = int(now * self.rate) - self.count.made
        if due >= max(1, int(PACKET_S * self.rate)):
            self.make(due, now)
        self.board.flush()

    def enable(self, may_move: bool) -> None:
        """Stop the stage if it may not move, as the board's relay does without a heartbeat."""
        if self.is_enabled and not may_move:
            self.model.halt()
            self.count.disabled += 1
        self.is_enabled = may_move
        self.device.refuse |= not may_move

    def make(self, due: int, now: float) -> None:
        """Make `due` samples: write the truth, and give it to the board."""
        first = self.count.made
        times = (first + np.arange(due)) / self.rate
        start, before = self.model.place.copy(), self.model.now
        self.model.advance(now)
        states = self.mirror.interpolate(times)
        fraction = np.clip((times - before) / max(now - before, 1e-9), 0, 1)[:, None]
        carried = start + fraction * (self.model.place - start)
        states[:, 6:] = carried + self.config.solve.beam_offset
        seq = (first + np.arange(due)).astype(np.uint32)
        self.count.made += due
        host = self.begin + seq / self.rate
        if self.reference:
            self.reference.read(times, host)
        fate = self.board.take(states, seq, host, now)
        if self.truth:
            self.truth.write(truth_rows(seq, host, states, fate))

    def answer(self) -> None:
        """Wait a round for the stage's commands, and answer them line by line."""
        ready, _, _ = select.select([self.stage.end], [], [], ROUND_INTERVAL_S)
        if ready:
            self.stage.write(self.receive(self.stage.read()))

    def receive(self, data: bytes) -> bytes:
        """Give bytes to the stage's controller, and return its answers."""
        self.model.advance(self.now())
        answers = self.device.receive(data)
        if self.device.moves > self.count.moves:
            self.count.moves = self.device.moves
            self.mirror.begin = min(self.mirror.begin, self.model.now)
        return answers


def truth_rows(
    seq: NDArray[np.uint32],
    host: NDArray[np.float64],
    states: NDArray[np.float64],
    fate: NDArray[np.uint8],
) -> bytes:
    """The bytes of rows of `TRUTH` of samples (n,), with states (n, 8), mm and rad."""
    rows = np.zeros(len(seq), TRUTH)
    rows["seq"], rows["fate"], rows["host"], rows["state"] = seq, fate, host, states
    return rows.tobytes()


def truth_of(folder: Path) -> NDArray[np.void]:
    """The rows of `TRUTH` (n,) that a bench wrote to its folder."""
    raw = (folder / "truth.bin").read_bytes()
    return np.frombuffer(raw, TRUTH, len(raw) // TRUTH.itemsize)
