"""The other end of a publication: a process that gives samples to those who want them.

`python -m facets.live.streams.senders ADDRESS` reads rows from its standard input, each lot after
its length, and tells on its standard output, in lines of JSON, what became of them. It is a process
of its own, so that neither making text nor a slow receiver takes time from the loop.
"""

from __future__ import annotations

import json
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol
from urllib.parse import parse_qsl, urlsplit

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FacetsError, InputError
from ...core.extras import require_extra
from ...core.names import READING_COLUMNS, STATE_COLUMNS
from .sample_rows import HEAD as HEAD_COLUMNS
from .sample_rows import MAGIC, NUMBERS, SAMPLE, unit_of

if TYPE_CHECKING:
    from .filtered_rows import RowFilter

LENGTH = struct.Struct("<I")
#: Before rows with filtered poses beside the raw ones.
WIDE_MAGIC = b"FACETS2\n"
#: What is said is said so often, s.
REPORT = 0.25
#: Bytes of one datagram: what every network takes whole, and what stays within one machine.
ANYWHERE, WITHIN = 1_400, 8_192
#: A receiver that takes nothing for so long is given up, s.
STUCK = 5.0

Rows = NDArray[np.void]


class Sender(Protocol):
    """Gives rows away."""

    @property
    def receivers(self) -> int | None:
        """How many take them now, None where that can not be known."""
        ...

    def send(self, rows: Rows) -> int:
        """Returns how many of the rows were given away."""
        ...

    def close(self) -> None: ...


GROUPS = {
    "reading": READING_COLUMNS,
    "pose": STATE_COLUMNS,
    "u": tuple(f"u_{name}" for name in STATE_COLUMNS),
}
FILTER_GROUPS = {
    "filtered": STATE_COLUMNS[:6],
    "u_filtered": tuple(f"u_{name}" for name in STATE_COLUMNS[:6]),
}


def json_template(groups: dict[str, tuple[str, ...]]) -> str:
    """The text of a sample with a place for each of its numbers."""
    parts = []
    for group, names in groups.items():
        parts.append(f'"{group}":{{' + ",".join(f'"{name}":%.9g' for name in names) + "}")
    return ",".join(parts)


HEAD = '"timestamp":%.9f,"seq":%d,"status":%d,"flags":%d'
TEMPLATE = "{" + ",".join([HEAD, json_template(GROUPS), '"residual":%.9g']) + "}"
WIDE_TEMPLATE = TEMPLATE[:-1] + "," + json_template(FILTER_GROUPS) + "}"


def json_of(rows: Rows) -> list[str]:
    """A text for each sample, without the numbers that are not known: JSON has no word for them."""
    heads = rows[["utc_s", "seq", "status", "flags"]].tolist()
    names = numbers_of(rows.dtype)
    template = TEMPLATE if len(names) == len(NUMBERS) else WIDE_TEMPLATE
    numbers = np.column_stack([rows[name] for name in names])
    whole = np.isfinite(numbers).all(axis=1)
    return [
        template % (*head, *row) if fine else sparse_json(template, head, row)
        for head, row, fine in zip(heads, numbers.tolist(), whole.tolist(), strict=True)
    ]


def numbers_of(dtype: np.dtype[np.void]) -> tuple[str, ...]:
    """The columns of rows after those of the head."""
    return (dtype.names or ())[len(HEAD_COLUMNS) :]


def sparse_json(template: str, head: tuple[float, ...], row: list[float]) -> str:
    known = json.loads(template % (*head, *(1.0 if np.isfinite(value) else 0.0 for value in row)))
    found = json.loads(template % (*head, *(v if np.isfinite(v) else 0.0 for v in row)))
    for name, value in known.items():
        if isinstance(value, dict):
            found[name] = {key: found[name][key] for key, there in value.items() if there}
        elif name == "residual" and not value:
            del found[name]
    return json.dumps(found, separators=(",", ":"))


class Udp:
    """Datagrams to one address: JSON, or MAGIC and rows of bytes.

    JSON is an array of samples, each with its `timestamp`, as the UDP server of PlotJuggler takes
    it; with `?single` an object each, as its older versions do.
    """

    def __init__(self, host: str, port: int, options: dict[str, str], binary: bool) -> None:
        kind = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self.line = socket.socket(kind[0], socket.SOCK_DGRAM)
        self.line.connect(kind[4])
        near = str(kind[4][0]).startswith("127.") or kind[4][0] == "::1"
        self.most = int(options.get("bytes", WITHIN if near else ANYWHERE))
        self.binary, self.single = binary, "single" in options

    @property
    def receivers(self) -> None:
        return None

    def send(self, rows: Rows) -> int:
        return sum(count for data, count in self.datagrams(rows) if self.put(data))

    def put(self, data: bytes) -> bool:
        """False where the other machine says that nobody listens, or this one has no way there."""
        try:
            self.line.send(data)
        except OSError:
            return False
        return True

    def datagrams(self, rows: Rows) -> list[tuple[bytes, int]]:
        """Their bytes, and how many samples are in each."""
        if self.binary:
            each = max(1, (self.most - len(MAGIC)) // rows.dtype.itemsize)
            parts = [rows[start : start + each] for start in range(0, len(rows), each)]
            magic = MAGIC if rows.dtype == SAMPLE else WIDE_MAGIC
            return [(magic + part.tobytes(), len(part)) for part in parts]
        texts = json_of(rows)
        each = 1 if self.single else max(1, self.most // (max(map(len, texts)) + 1))
        if self.single:
            return [(text.encode(), 1) for text in texts]
        lots = [texts[start : start + each] for start in range(0, len(texts), each)]
        return [(f"[{','.join(lot)}]".encode(), len(lot)) for lot in lots]

    def close(self) -> None:
        self.line.close()


class Tcp:
    """Listens, and gives one reader at a time all rows from when it came, at full rate.

    A reader first gets MAGIC, the length of a description (uint32) and that, in JSON. A slow one is
    waited for: what comes meanwhile waits, and is dropped where the queue is full.
    """

    def __init__(self, host: str, port: int, about: dict[str, Any], wait: float) -> None:
        self.listening = socket.create_server((host, port))
        told = json.dumps(about).encode()
        self.hello = MAGIC + LENGTH.pack(len(told)) + told
        self.reader: socket.socket | None = None
        self.wait = wait
        self.came, self.gone = threading.Event(), threading.Event()
        threading.Thread(target=self.accept, daemon=True).start()

    @property
    def receivers(self) -> int:
        return int(self.reader is not None)

    def accept(self) -> None:
        """The thread that lets a reader in, and the next one when that has gone."""
        while True:
            try:
                reader, _ = self.listening.accept()
            except OSError:  # closed
                return
            try:
                reader.settimeout(STUCK)
                reader.sendall(self.hello)
            except OSError:  # it went as soon as it came
                reader.close()
                continue
            self.gone.clear()
            self.reader = reader
            self.came.set()
            self.gone.wait()

    def send(self, rows: Rows) -> int:
        self.came.wait(self.wait)
        self.wait = 0.0
        reader = self.reader
        if reader is None:
            return 0
        try:
            reader.sendall(rows.tobytes())
        except OSError:
            reader.close()
            self.reader = None
            self.gone.set()
            return 0
        return len(rows)

    def close(self) -> None:
        for line in (self.reader, self.listening):
            if line is not None:
                line.close()


class Lsl:
    """An outlet of the Lab Streaming Layer, with names and units of its channels."""

    def __init__(self, name: str, about: dict[str, Any], wait: float) -> None:
        pylsl = require_extra("pylsl", f"lsl:{name}")
        names = tuple(name for name, _ in about.get("dtype", ())) or SAMPLE.names or ()
        self.channels = ("status", "flags", *names[len(HEAD_COLUMNS) :])
        source = f"facets-{about.get('config_sha256', '')[:16]}"
        info = pylsl.StreamInfo(
            name or "facets", "Pose", len(self.channels), pylsl.IRREGULAR_RATE, "double64", source
        )
        channels = info.desc().append_child("channels")
        for label in self.channels:
            channel = channels.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit_of(label))
            channel.append_child_value("type", "Pose" if "_" in label else "Status")
        for key in ("config", "config_sha256", "facets"):
            info.desc().append_child_value(key, str(about.get(key, "")))
        self.outlet = pylsl.StreamOutlet(info, chunk_size=100, max_buffered=60)
        # both count from the start of this machine where it can be; else the offset is known here
        self.offset = pylsl.local_clock() - time.monotonic()
        self.until = time.monotonic() + wait

    @property
    def receivers(self) -> int:
        return int(self.outlet.have_consumers())

    def send(self, rows: Rows) -> int:
        if self.until > time.monotonic() and not self.outlet.have_consumers():
            self.outlet.wait_for_consumers(self.until - time.monotonic())
            self.until = 0.0
        heard = self.outlet.have_consumers()
        values = np.column_stack([rows[name].astype(float) for name in self.channels])
        self.outlet.push_chunk(values.tolist(), (rows["host_s"] + self.offset).tolist())
        return len(rows) if heard else 0

    def close(self) -> None:
        """Leaves what was pushed last the time to go."""
        last = time.monotonic() + 1.0
        while self.outlet.have_consumers() and time.monotonic() < last:
            time.sleep(0.05)


class Filtered:
    """Puts filtered poses beside the raw ones, and gives them to another sender."""

    def __init__(self, sender: Sender, rows: RowFilter) -> None:
        self.sender, self.rows = sender, rows

    @property
    def receivers(self) -> int | None:
        return self.sender.receivers

    @property
    def note(self) -> str:
        """Why there are no filtered poses, or nothing."""
        return self.rows.doubt

    def send(self, rows: Rows) -> int:
        return self.sender.send(self.rows.widen(rows))

    def close(self) -> None:
        self.sender.close()


SCHEMES = "udp://HOST:PORT, udp+binary://HOST:PORT, tcp://HOST:PORT, shm:NAME or lsl:NAME"


def check_address(address: str) -> None:
    """Raises `InputError` for what is no address of a publication."""
    parts = urlsplit(address)
    if parts.scheme == "shm":
        from .shared_ring import check_name

        check_name(parts.path)
        return
    try:
        sound = parts.scheme == "lsl" or (
            parts.scheme in ("udp", "udp+binary", "tcp")
            and bool(parts.hostname)
            and parts.port is not None
            and (parts.scheme == "tcp" or parts.port > 0)
        )
        sound = sound and options_of(address).keys() <= {"single", "bytes"}
        int(options_of(address).get("bytes", 1))
    except ValueError:
        sound = False
    if not sound:
        raise InputError(f"--publish {address}: is no address; give {SCHEMES}")


def options_of(address: str) -> dict[str, str]:
    return dict(parse_qsl(urlsplit(address).query, keep_blank_values=True))


def open_sender(address: str, about: dict[str, Any], wait: float) -> Sender:
    """The sender of an address. wait: s, for a first receiver, where there can be none yet."""
    check_address(address)
    parts = urlsplit(address)
    try:
        if parts.scheme == "lsl":
            return Lsl(parts.path, about, wait)
        if parts.scheme == "shm":
            from .shared_ring import SharedSender

            return SharedSender(parts.path, about, wait)
        assert parts.hostname is not None
        assert parts.port is not None
        if parts.scheme == "tcp":
            return Tcp(parts.hostname, parts.port, about, wait)
        binary = parts.scheme == "udp+binary"
        return Udp(parts.hostname, parts.port, options_of(address), binary)
    except OSError as error:
        raise InputError(f"--publish {address}: {error.strerror or error}") from None


def lots(stream: BinaryIO) -> Any:
    """What comes on a stream, lot by lot, each after its length."""
    while len(head := stream.read(LENGTH.size)) == LENGTH.size:
        data = stream.read(LENGTH.unpack(head)[0])
        if len(data) < LENGTH.unpack(head)[0]:
            return
        yield data


def serve(sender: Sender, stream: BinaryIO, tell: Callable[[dict[str, Any]], None]) -> None:
    """Gives away what comes on the stream until it ends; tells every now and then how it goes."""
    sent = dropped = 0
    ended = threading.Event()

    def report() -> None:
        words: dict[str, Any] = {"sent": sent, "dropped": dropped, "receivers": sender.receivers}
        if isinstance(sender, Filtered):
            words |= {"note": sender.note, "filter": sender.rows.sentence}
        tell(words)

    def report_often() -> None:
        while not ended.wait(REPORT):
            report()

    reporter = threading.Thread(target=report_often)
    reporter.start()
    try:
        for data in lots(stream):
            rows = np.frombuffer(data, SAMPLE)
            count = sender.send(rows)
            sent, dropped = sent + count, dropped + len(rows) - count
    finally:
        ended.set()
        reporter.join()
    sender.close()
    report()


def filter_of(about: dict[str, Any], pickled: bytes) -> RowFilter:
    """The filter that the parent asks for; warm, so that no sample waits for what it loads.

    pickled: the configuration, by the process that has started this one. What receivers are told
    of the rows is changed in `about`.
    """
    import pickle

    from .filtered_rows import WIDE, RowFilter

    config = pickle.loads(pickled)
    told = about["filter"]
    rows = RowFilter(config, told["model"], told["carried"])
    nobody = np.zeros(2, SAMPLE)
    for name in NUMBERS:
        nobody[name] = 0.1
    RowFilter(config, told["model"]).widen(nobody)
    about["dtype"] = [list(pair) for pair in WIDE.descr]
    about["units"] = {name: unit_of(name) for name in WIDE.names or () if unit_of(name)}
    return rows


def main() -> None:
    def tell(words: dict[str, Any]) -> None:
        sys.stdout.write(json.dumps(words) + "\n")
        sys.stdout.flush()

    address, wait = sys.argv[1], float(sys.argv[2])
    stream = sys.stdin.buffer
    incoming = lots(stream)
    about = json.loads(next(incoming))
    rows = filter_of(about, next(incoming)) if "filter" in about else None
    try:
        sender = open_sender(address, about, wait)
    except FacetsError as error:
        tell({"error": str(error)})
        return
    place = sender.listening.getsockname()[1] if isinstance(sender, Tcp) else None
    sender = Filtered(sender, rows) if rows else sender
    tell({"ready": True, "port": place})
    serve(sender, stream, tell)


if __name__ == "__main__":
    main()
