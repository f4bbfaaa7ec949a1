"""What every source of bytes must do: ours, and one that another package brings."""

from __future__ import annotations

import socket
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from facets.experiments.studies import kills

from facets.live import SIZE, DatagramPort, PortError, PortInUse, check_source, open_port
from facets.live.sources import ports as module

DATA = kills.stream(200)


def test_a_file_is_a_port(tmp_path):
    (tmp_path / "bytes.bin").write_bytes(DATA)
    check_source(lambda: open_port(f"file:{tmp_path}/bytes.bin", 0), lambda _: None, DATA)


def test_datagrams_are_a_port():
    port = DatagramPort("udp://127.0.0.1:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.connect(port.line.getsockname())

        def send(data):
            for n in range(0, len(data), 20 * SIZE):
                line.send(data[n : n + 20 * SIZE])

        check_source(lambda: port, send, DATA)


def senders(count):
    """Sockets that send datagrams from this machine."""
    return [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]


def read_all(port, count=20):
    """What a port has within some reads."""
    return b"".join(port.read() for _ in range(count))


def test_a_port_for_datagrams_is_open_to_this_machine_unless_a_host_is_named():
    for name, host in (("udp://:0", "127.0.0.1"), ("udp://0.0.0.0:0", "0.0.0.0")):
        with open_port(name, 0) as port:
            assert port.line.getsockname()[0] == host
            assert ("only this machine" in port.message) == (host == "127.0.0.1")


def test_the_first_sender_of_datagrams_is_read_and_another_one_is_named(monkeypatch):
    monkeypatch.setattr(module, "SENDER_SILENCE_S", np.inf)
    board, other = senders(2)
    with board, other, open_port("udp://:0", 0) as port:
        for line in (board, other, board, other, other):
            line.sendto(b"board" if line is board else b"other", port.line.getsockname())
        assert read_all(port) == b"boardboard"
        assert "3 datagrams of other senders were dropped" in port.message
        assert f":{other.getsockname()[1]}:" in port.message
        monkeypatch.setattr(module, "SENDER_SILENCE_S", -1.0)
        other.sendto(b"after it", port.line.getsockname())
        assert read_all(port) == b"after it"


@pytest.mark.parametrize(
    ("option", "data"), [("any", b"boardother"), ("127.0.0.1", b"board"), ("127.0.0.2", b"")]
)
def test_the_address_of_a_port_chooses_the_sender_of_datagrams(option, data):
    board, other = senders(2)
    with board, other, open_port(f"udp://:0?from={option}", 0) as port:
        board.sendto(b"board", port.line.getsockname())
        other.sendto(b"other", port.line.getsockname())
        assert read_all(port) == data
        assert bool(port.message) == (option != "any")


@pytest.fixture
def server():
    """A board that serves its bytes by TCP, and the name of its port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server, f"socket://127.0.0.1:{server.getsockname()[1]}"


def test_what_a_board_sent_before_it_closed_the_connection_is_read(server):
    with open_port(server[1], 0) as port:
        line, _ = server[0].accept()
        line.sendall(DATA)
        line.close()
        data = b""
        while len(data) < len(DATA):
            data += port.read()
        assert data == DATA
        with pytest.raises(PortError, match="closed the connection"):
            read_all(port)


def test_a_connection_is_probed_while_it_is_silent(server):
    """Its other end may have lost its power, and then sends no end."""
    with open_port(server[1], 0) as board, module.open_line(server[1], 0, 0.1) as stage:
        for line in (board.line, stage._socket):
            assert line.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)


def test_a_socket_is_a_port(server):
    port = open_port(server[1], 0)
    with server[0].accept()[0] as line:
        check_source(lambda: port, line.sendall, DATA)


class Other(module.ClosedAtExit):
    """A source as another package would write it."""

    ended = False
    waits = True

    def __init__(self, name, baud):
        if name == "test:gone":
            raise PortError(f"{name}: is not plugged in")
        if name == "test:broken":
            raise RuntimeError("driver 7")
        self.data = DATA

    def read(self):
        part, self.data = self.data[:1000], self.data[1000:]
        self.ended = not part
        return part

    def close(self):
        pass


@pytest.fixture
def others(monkeypatch):
    """Entry points as two installed packages would have them."""
    sources = {"test": Other, "none": lambda name, baud: object()}

    def find(group, name):
        return [EntryPoint(name, f"{name}:open", group)] if name in sources else []

    monkeypatch.setattr(EntryPoint, "load", lambda self: sources[self.name])
    monkeypatch.setattr(module, "entry_points", find)


def test_another_packages_source_is_a_port(others):
    check_source(lambda: open_port("test:1", 0), lambda _: None, DATA)
    for name, words in (
        ("test:gone", "is not plugged in"),
        ("test:broken", "RuntimeError: driver 7"),
        ("none:1", "gives no port: it has no read, close, ended, waits"),
    ):
        with pytest.raises(PortError, match=words):
            open_port(name, 0)


def test_a_virtual_bench_is_no_port_of_a_run_on_the_hosts_clock():
    with pytest.raises(PortInUse, match=r"are opened by `facets acquire` and facets.live.Run"):
        open_port("virtual:wobble", 0)


@pytest.mark.parametrize(
    "name", ["udp://:x", "udp://", "udp://256.1.1.1:5", "udp://:0?form=x", "udp://:0?from="]
)
def test_a_place_that_nobody_can_listen_at_is_told(name):
    with pytest.raises(PortError, match="udp://"):
        open_port(name, 0)
