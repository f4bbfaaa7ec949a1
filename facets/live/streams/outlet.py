"""The one socket at which a run publishes its samples, and the processes that it starts there.

ZeroMQ's own thread sends what the loop has given it, and drops what finds no place, so that no
subscriber holds the run back. The page, JSON by UDP and the Lab Streaming Layer are processes of
their own (`Relay`), which subscribe as other programs do: neither making text nor a slow receiver
takes time from the loop.
"""

from __future__ import annotations

import json
import os
import secrets
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hmac import compare_digest
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

import numpy as np
import zmq
from numpy.typing import NDArray

from ...core.errors import InputError
from .addresses import zmq_endpoint
from .sample_rows import description
from .zeromq import (
    ABOUT,
    END,
    FROM,
    HIGH_WATER_MARK,
    LINGER_MS,
    LOST,
    REPORT_INTERVAL_S,
    SAMPLES,
    SHORT_HIGH_WATER_MARK,
    START_TIMEOUT_S,
    STATUS,
)

#: Maximum number of messages from subscribers that are taken in at once, so that a subscriber that
#: sends without end does not keep the loop.
MAX_HEARD = 100
#: A replay no longer waits for a subscriber that has taken nothing for this time, s.
STUCK_S = 5.0
#: Interval between two attempts to send or to receive a message, ms.
RETRY_MS = 5
#: Longest time that processes may take at the end to pass on the remaining samples, s.
END_TIMEOUT_S = 10.0
GONE = "its process has ended"


class Outlet:
    """Publishes rows at any number of endpoints. A live run waits for nobody; a replay, for all.

    Parameters
    ----------
    about : dict
        Description of the samples, which each new subscriber receives first.
    patient : bool
        Whether to wait for subscribers that are slow, as a replay does, which loses nothing by it.

    Attributes
    ----------
    count, sent, missed : int
        Numbers of rows that were published; of those for which somebody subscribed at a `zmq://`
        address; and of those that these subscribers report as missed.
    places : list of str
        The `zmq://` addresses, with the ports that the system has chosen.
    relays : list of Relay
        The processes that subscribe for the run.
    status : callable
        Returns the status of the run, in JSON's types.
    """

    def __init__(self, about: dict[str, Any], patient: bool = False) -> None:
        about = description(about)
        self.columns = json.dumps({name: about[name] for name in ("dtype", "units")})[1:].encode()
        self.patient, self.is_ending = patient, False
        self.count = self.sent = self.missed = self.subscribers = 0
        self.places, self.relays = list[str](), list[Relay]()
        self.status: Callable[[], dict[str, Any]] = dict
        self.status_due = 0.0
        self.context: zmq.Context[Any] = zmq.Context()
        self.socket = self.context.socket(zmq.XPUB)
        for option, value in {
            zmq.SNDHWM: SHORT_HIGH_WATER_MARK if patient else HIGH_WATER_MARK,
            zmq.LINGER: LINGER_MS,
            zmq.XPUB_NODROP: int(patient),
            zmq.XPUB_VERBOSER: 1,  # reports each subscriber by itself
            # a subscriber that sends without end waits itself, and fills no memory
            zmq.RCVHWM: MAX_HEARD // 10,
            zmq.MAXMSGSIZE: 4_096,
            # finds a machine that has gone; libzmq's heartbeats would do so, too, but end this
            # program if a heartbeat is due on a broken line that still holds its last messages
            zmq.TCP_MAXRT: 30_000,
        }.items():
            self.socket.setsockopt(option, value)
        self.socket.setsockopt(zmq.XPUB_WELCOME_MSG, ABOUT + json.dumps(about).encode())

    @contextmanager
    def local_endpoint(self) -> Iterator[str]:
        """Yield an endpoint at which a process of the run connects while the block lasts.

        Where the system has such, it is a file that other users of this machine cannot reach. The
        file is removed at the block's end, which connections outlast: a run that is killed leaves
        nothing behind, and nobody else connects later.
        """
        with TemporaryDirectory(prefix="facets-", ignore_cleanup_errors=True) as folder:
            yield self.bind_locally(folder)

    def bind_locally(self, folder: str) -> str:
        """Bind a file in a folder or, if that is not possible, a port of this machine."""
        if os.name == "posix":
            with suppress(zmq.ZMQError):  # of a folder whose name is too long
                return self.bind(f"ipc://{folder}/run")
        return self.bind("tcp://127.0.0.1:*")

    def bind(self, endpoint: str) -> str:
        """Also publish at an endpoint; return it with the port that the system has chosen."""
        self.socket.bind(endpoint)
        return bytes(self.socket.getsockopt(zmq.LAST_ENDPOINT)).strip(b"\0").decode()

    def open(self, address: str) -> None:
        """Also publish at `zmq://HOST:PORT`. Raises `InputError` if the address cannot be used."""
        endpoint = zmq_endpoint(address)
        self.socket.setsockopt(zmq.IPV6, int("[" in endpoint))
        try:
            port = self.bind(endpoint).rpartition(":")[2]
        except zmq.ZMQError as error:
            raise InputError(f"--publish {address}: {error.strerror}") from None
        self.places.append(f"{address.rpartition(':')[0]}:{port}")

    def send(self, rows: NDArray[np.void]) -> None:
        """Publish rows of the description's dtype; only a patient outlet waits."""
        self.hear()
        header = b'{"first": %d, "count": %d, ' % (self.count, len(rows)) + self.columns
        self.put([SAMPLES, header, rows.tobytes()])
        self.count += len(rows)
        self.sent += len(rows) if self.receivers else 0

    def refresh(self) -> None:
        """Take in messages, and publish the status of the run if it is due."""
        self.hear()
        if time.monotonic() >= self.status_due:
            self.status_due = time.monotonic() + REPORT_INTERVAL_S
            self.send_status(self.status())

    def send_status(self, status: dict[str, Any]) -> None:
        """Publish a status of the run, unless it is empty, for the page."""
        if status:
            self.put([STATUS, json.dumps(status).encode()])

    def put(self, parts: list[bytes]) -> None:
        """Send a message; a patient outlet first waits while a subscriber has no place for it."""
        last = time.monotonic() + STUCK_S
        while True:
            try:
                self.socket.send_multipart(parts, zmq.NOBLOCK)
                return
            except zmq.Again:
                time.sleep(1e-3 * RETRY_MS)
            if time.monotonic() > last:
                self.socket.setsockopt(zmq.XPUB_NODROP, 0)
                self.socket.send_multipart(parts, zmq.NOBLOCK)
                self.socket.setsockopt(zmq.XPUB_NODROP, 1)
                return

    @property
    def receivers(self) -> int:
        """Number of other programs that subscribe."""
        return max(0, self.subscribers - sum(relay.is_connected for relay in self.relays))

    def counts(self) -> dict[str, Any]:
        """Return the counts of samples and receivers at the `zmq://` addresses."""
        return {
            "address": ", ".join(self.places),
            "sent": self.sent,
            "dropped": self.count - self.sent + self.missed,
            "receivers": self.receivers,
            "trouble": "",
        }

    def hear(self, wait_ms: int = 0) -> None:
        """Take in the messages of subscribers; wait up to `wait_ms` for the first."""
        if self.socket.closed or (wait_ms and not self.socket.poll(wait_ms)):
            return
        with suppress(zmq.Again):
            for _ in range(MAX_HEARD):
                self.take(self.socket.recv(zmq.NOBLOCK))

    def take(self, message: bytes) -> None:
        """Take in a subscription, its end, a number of missed rows, or the words of a process."""
        if message[:1] in (b"\0", b"\1"):
            comes, topic = message[:1] == b"\1", message[1:]
            if SAMPLES.startswith(topic):
                self.subscribers += 1 if comes else -1
            for relay in self.relays:
                if compare_digest(topic, relay.token):
                    relay.come_or_go(comes)
        elif message.startswith(LOST) and message[len(LOST) :].isdigit() and len(message) < 20:
            self.missed += min(int(message[len(LOST) :]), self.count)  # whatever it says
        elif message.startswith(FROM):
            token, _, words = message[len(FROM) :].partition(b" ")
            for relay in self.relays:
                if compare_digest(token, relay.token):
                    relay.hear(json.loads(words))

    def close(self) -> None:
        """Send the remaining messages and end the processes, in limited time. Never raises."""
        if self.socket.closed:
            return
        self.socket.setsockopt(zmq.XPUB_NODROP, 0)
        with suppress(Exception):
            self.send_status(self.status())
        self.is_ending, begin = True, time.monotonic()
        while any(relay.has_time(begin) for relay in self.relays):
            self.socket.send(END, zmq.NOBLOCK)  # again, as it may have found no place
            self.hear(10 * RETRY_MS)
        for relay in self.relays:
            relay.end()
        self.context.destroy()


class Relay:
    """A process that subscribes to the run which has started it, and passes samples on.

    said: the newest values that the process reports. `sent` is the number of rows that it has
    passed on, whether or not they arrived. `dropped` is the number of rows that it has missed or
    could not pass on. `receivers` is the present number of receivers, or None if it cannot be
    known. trouble: the reason why nothing is published any more; empty while the process works.
    """

    def __init__(self, address: str, outlet: Outlet, module: str, setup: dict[str, Any]) -> None:
        """Start the process and wait until it is ready.  Raises `InputError` if it cannot begin.

        module: the program, as for `python -m`.  setup: values that only this process receives.
        """
        self.address, self.outlet, self.trouble = address, outlet, ""
        self.token, self.is_connected = secrets.token_hex(16).encode(), False
        self.said: dict[str, Any] = {"sent": 0, "dropped": 0, "receivers": 0}
        self.heard = time.monotonic()
        with outlet.local_endpoint() as endpoint:
            setup = {**setup, "endpoint": endpoint, "token": self.token.decode()}
            with TemporaryFile("w+") as file:  # other users can read the arguments of a command
                json.dump(setup, file)
                file.seek(0)
                self.process = subprocess.Popen(
                    [sys.executable, "-m", module, address],
                    stdin=file, stdout=subprocess.DEVNULL, start_new_session=True,
                )  # fmt: skip
            outlet.relays.append(self)
            self.await_begin()

    def await_begin(self) -> None:
        """Wait until the process is ready. Raises `InputError` if it cannot begin."""
        last = self.heard + START_TIMEOUT_S
        while not {"ready", "error"} & self.said.keys():
            is_over = self.process.poll() is not None or time.monotonic() > last
            self.outlet.hear(LINGER_MS if is_over else RETRY_MS)
            if is_over:
                self.said.setdefault("error", GONE)
        if "error" in self.said:
            self.process.kill()
            raise InputError(self.said["error"])

    def come_or_go(self, comes: bool) -> None:
        """Take note that the process has subscribed, or is no longer there."""
        self.is_connected = comes
        if not comes and not self.outlet.is_ending:
            self.trouble = GONE

    def hear(self, words: dict[str, Any]) -> None:
        """Take in values that the process reports."""
        self.heard = time.monotonic()
        self.said |= words

    def counts(self) -> dict[str, Any]:
        """Return the counts of samples and receivers; samples that wait are not dropped ones."""
        words = {name: self.said[name] for name in ("sent", "dropped", "receivers")}
        if self.trouble or self.outlet.socket.closed:
            words["dropped"] = self.outlet.count - words["sent"]
        return {"address": self.address, **words, "trouble": self.trouble}

    def has_time(self, begin: float) -> bool:
        """Whether the process may still take time for an end that began at this time, s."""
        since = max(begin, self.heard) if self.outlet.patient else begin
        return self.is_connected and time.monotonic() < since + END_TIMEOUT_S

    def end(self) -> None:
        """Wait for a process that has left the outlet to end, and kill any other."""
        try:
            status = self.process.wait(0 if self.is_connected else END_TIMEOUT_S)
            self.trouble = self.trouble or (GONE if status else "")
        except subprocess.TimeoutExpired:
            self.trouble = self.trouble or "its receiver accepts no more data"
            self.process.kill()
            self.process.wait()
