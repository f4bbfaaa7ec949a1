"""Every sample to other programs, while the record goes on as if there were none.

The loop puts rows into a bounded queue and goes on. A thread hands them to a process (`senders`),
which gives them away. Where a receiver is slow, the queue fills, and what finds no place is dropped
and counted: nothing waits for it.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.closing import ClosedAtExit
from ...core.errors import InputError
from ...core.extras import require_extra
from ...core.version import __version__
from ...estimation.solution import LABELS
from ..run.pipeline import RunPoses
from ..run.pulses import PulseClock, pulse_columns
from ..run.sink import Sink
from ..sources.host_time import wall_clock_offset
from .addresses import check_address
from .lots import LENGTH
from .sample_rows import description, row_content, rows_of, sample_dtype

if TYPE_CHECKING:
    from ...core.settings import Config
    from ...estimation.measurement import Measurement

#: Maximum size of what waits in this process for one receiver: 1.4 s at 50,000 samples a second.
MAX_WAITING_BYTES = 16_000_000
#: A publication's process that has not begun within this time is ended, s.
START_TIMEOUT_S = 60.0
#: A publication may take this time at its end to send what still waits, s.
END_TIMEOUT_S = 3.0
#: A replay waits up to this time for its first receiver, s.
FIRST_RECEIVER_WAIT_S = 20.0
GONE = "its process has ended"


def require_packages(addresses: Sequence[str] | None, web: str | None) -> None:
    """Raises `InputError` where a receiver, or the page, needs a package that is not installed."""
    for address in addresses or ():
        if address.startswith("lsl:"):
            require_extra("pylsl", address)
    if web is not None:
        require_extra("aiohttp", "--web")


class Publication:
    """One address that samples go to.

    given: samples that were to be published.  sent: that were given away; where nobody answers, as
    by UDP, that says nothing of their arrival.  dropped: that were not, since nobody took them in
    time.  receivers: that take them now, None where it cannot be known.  trouble: why nothing is
    published any more, or nothing.
    """

    def __init__(self, address: str, about: dict[str, Any], patient: bool = False) -> None:
        """Raises `InputError` where there is no such address, or it cannot be used.

        about: what receivers are told of the samples.  patient: wait for receivers; for replays,
        which lose nothing by it.
        """
        self.address, self.patient = address, patient
        self.itemsize = sample_dtype(about).itemsize
        self.given = self.unplaced = self.sent = self.refused = self.lost = 0
        self.receivers: int | None = None
        self.trouble = ""
        self.queue: deque[bytes] = deque()
        self.waiting = 0
        self.ended = False
        self.news = threading.Condition()
        self.process = subprocess.Popen(
            self.command(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        self.port: int | None = None
        self.begin(description(about))
        self.threads = [
            threading.Thread(target=self.hand_over, name="publication", daemon=True),
            threading.Thread(target=self.listen, name="publication news", daemon=True),
        ]
        for thread in self.threads:
            thread.start()

    def command(self) -> list[str]:
        """What starts the process."""
        check_address(self.address)
        wait = str(FIRST_RECEIVER_WAIT_S if self.patient else 0.0)
        return [sys.executable, "-m", "facets.live.streams.senders", self.address, wait]

    def last(self) -> float:
        """So long its process may take at the end, s."""
        return END_TIMEOUT_S

    def begin(self, about: dict[str, Any]) -> None:
        """Tells the process what it is to say of the samples, and waits until it can."""
        watch = threading.Timer(START_TIMEOUT_S, self.process.kill)
        watch.daemon = True
        watch.start()
        try:
            told = json.dumps(about).encode()
            with suppress(OSError):
                self.write(LENGTH.pack(len(told)) + told)
            assert self.process.stdout is not None
            line = self.process.stdout.readline()
            words: dict[str, Any] = json.loads(line) if line else {"error": GONE}
        finally:
            watch.cancel()
        if "error" in words:
            self.process.kill()
            self.release()
            raise InputError(str(words["error"]))
        self.port = words["port"]

    def write(self, data: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(data)
        self.process.stdin.flush()

    def send(self, data: bytes) -> None:
        """Publish rows of the dtype of `sample_dtype` as soon as can be.

        Waits only where it is patient.
        """
        count = len(data) // self.itemsize
        with self.news:
            self.given += count
            while self.patient and self.waiting > MAX_WAITING_BYTES and not self.trouble:
                self.news.wait(0.1)
            if self.trouble or self.waiting + len(data) > MAX_WAITING_BYTES:
                self.unplaced += count
                return
            self.queue.append(data)
            self.waiting += len(data)
            self.news.notify_all()

    def hand_over(self) -> None:
        """The thread that gives the process what waits."""
        while True:
            with self.news:
                while not self.queue and not self.ended:
                    self.news.wait()
                if not self.queue:
                    break
                data = self.queue.popleft()
            try:
                self.write(LENGTH.pack(len(data)) + data)
            except OSError as error:
                self.give_up(f"its process has ended: {error.strerror}")
                return
            with self.news:
                self.waiting -= len(data)
                self.news.notify_all()
        with suppress(OSError):
            assert self.process.stdin is not None
            self.process.stdin.close()

    def give_up(self, reason: str) -> None:
        with self.news:
            self.trouble = self.trouble or reason
            self.queue.clear()
            self.waiting = 0
            self.news.notify_all()

    def listen(self) -> None:
        """The thread that hears what became of the samples."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.hear(json.loads(line))

    def hear(self, words: dict[str, Any]) -> None:
        self.sent, self.refused = words["sent"], words["dropped"]
        self.lost = words.get("lost", 0)
        self.receivers = words["receivers"]

    @property
    def dropped_count(self) -> int:
        """Samples that are known not to be published; those that wait are not among them."""
        unsent = self.given - self.sent if self.ended else self.unplaced + self.refused
        return unsent + self.lost

    def close(self) -> None:
        """Gives away what waits, for a while, and ends the process. Never raises."""
        with self.news:
            if self.ended:
                return
            self.ended = True
            self.news.notify_all()
        last = self.last()
        patience = FIRST_RECEIVER_WAIT_S + last if self.patient else last
        try:
            self.process.wait(timeout=patience)
        except subprocess.TimeoutExpired:
            self.trouble = self.trouble or "its receiver accepts no more data"
            self.process.kill()
            self.process.wait()
        for thread in self.threads:
            thread.join(timeout=1.0)
        self.release()

    def release(self) -> None:
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            with suppress(OSError):
                if stream is not None:
                    stream.close()


class Publications(ClosedAtExit, Sink):
    """All the addresses that samples go to; in a `with` statement they are closed at its end.

    utc_offset: of the wall clock over the host's monotonic one, s; now, if it is not given.
    """

    def __init__(
        self,
        addresses: Sequence[str],
        config: Config,
        patient: bool = False,
        utc_offset: float | None = None,
        objects: Measurement | None = None,
    ) -> None:
        """Raises `InputError` for an address that cannot be used; none is then open.

        objects: which point's poses there are, as of `row_content`.
        """
        about: dict[str, Any] = {
            "config": config.name,
            "config_sha256": config.sha256,
            "facets": __version__,
            "statuses": {str(number): words for number, words in LABELS.items()},
            **row_content(config, objects),
        }
        self.offset = wall_clock_offset() if utc_offset is None else utc_offset
        self.pulses = PulseClock() if config.acquire.mark == "pps" else None
        self.all: list[Publication] = []
        for address in addresses:
            check_address(address)
        try:
            for address in addresses:
                self.all.append(Publication(address, about, patient))
        except BaseException:
            self.close()
            raise

    def places(self) -> list[str]:
        """The addresses, with the port where the system has chosen one."""
        return [
            f"{one.address.rpartition(':')[0]}:{one.port}" if one.port else one.address
            for one in self.all
        ]

    def add_poses(self, poses: RunPoses) -> None:
        """Publish poses at every address."""
        if self.all:
            rows = rows_of(poses, self.offset)
            if self.pulses is not None:
                utc = pulse_columns(poses, self.offset, self.pulses)["utc_s"]
                rows["utc_s"] = np.where(np.isfinite(utc), utc, rows["utc_s"])
            data = rows.tobytes()
            for publication in self.all:
                publication.send(data)

    def close(self) -> None:
        for publication in self.all:
            publication.close()

    def messages(self) -> list[str]:
        found = []
        for one in self.all:
            if one.trouble:
                found.append(f"{one.address}: publishing has ended: {one.trouble}")
        return found

    def values(self) -> dict[str, Any]:
        return {"published": self.counts()}

    def counts(self) -> list[dict[str, Any]]:
        """What became of the samples, address by address."""
        return [
            {
                "address": one.address,
                "sent": one.sent,
                "dropped": one.dropped_count,
                "receivers": one.receivers,
                "trouble": one.trouble,
            }
            for one in self.all
        ]

    def sentences(self) -> list[str]:
        """A line for each address, for the end."""
        found = []
        for one in self.all:
            text = f"{one.address}: {one.sent} samples published, {one.dropped_count} dropped"
            found.append(f"{text} ({one.trouble})" if one.trouble else text)
            if self.pulses is not None:
                found.append(f"{one.address}: {self.pulses.sentence}")
        return found
